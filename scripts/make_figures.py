"""Draw every figure, or those that are named: ``python scripts/make_figures.py [NAME...]``."""

import sys
from pathlib import Path

from cdpr_sim import CdprError, list_figures, write_figures

FOLDER = Path("figures")  # where <name>.svg and <name>.png go
REPLACE = True  # files that are there already


if __name__ == "__main__":
    try:
        for name, paths in write_figures(sys.argv[1:] or list_figures(), FOLDER, force=REPLACE):
            print(f"{name}: {', '.join(map(str, paths))}")
    except CdprError as error:
        sys.exit(f"make_figures: {error}")
