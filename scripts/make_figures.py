"""Draw all figures, or those that are named: ``python scripts/make_figures.py [NAME...]``.

Figures that docs/gallery.md draws with this script are also copied to pictures/, where the manual shows them.
"""

import re
import shutil
import sys
from pathlib import Path

from cdpr_sim import CdprError, list_figures, write_figures

ROOT = Path(__file__).parents[1]
FOLDER = Path("figures")  # of <name>.svg and <name>.png; not part of the repository
MANUAL_FOLDER = ROOT / "pictures"  # part of the repository
MANUAL_PICTURES = re.findall(r"make_figures\.py ([\w-]+)", (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"))


def main(names: list[str]) -> None:
    written = write_figures(
        names or list_figures(), FOLDER, force=True, progress=lambda done: print(f"{done:.0%} drawn")
    )
    for name, paths in written.items():
        print(*paths)
        if name in MANUAL_PICTURES:
            print(shutil.copy(FOLDER / f"{name}.png", MANUAL_FOLDER))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except CdprError as error:
        sys.exit(f"make_figures: {error}")
