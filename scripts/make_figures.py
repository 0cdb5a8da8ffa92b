"""Draw every figure, or those that are named: ``python scripts/make_figures.py [NAME...]``.

The manual's pictures among them are copied to where it shows them.
"""

import shutil
import sys
from pathlib import Path

from cdpr_sim import CdprError, list_figures, write_figures

FOLDER = Path("figures")  # where <name>.svg and <name>.png go; not part of the repository
MANUAL_FOLDER = Path("pictures")  # part of the repository
MANUAL_PICTURES = (
    "paper-line", "parallel", "tilt-condition", "two-cable-manifold", "layouts", "convergence", "agreement",
)  # fmt: skip


def main(names: list[str]) -> None:
    written = write_figures(
        names or list_figures(), FOLDER, force=True, progress=lambda done: print(f"{done:.0%} drawn")
    )
    for name, paths in written.items():
        print(*paths)
        if name in MANUAL_PICTURES:
            MANUAL_FOLDER.mkdir(exist_ok=True)
            print(shutil.copy(FOLDER / f"{name}.png", MANUAL_FOLDER))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except CdprError as error:
        sys.exit(f"make_figures: {error}")
