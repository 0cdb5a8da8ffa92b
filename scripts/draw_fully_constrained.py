"""Effect of pretension on IPAnema 1: stiffness, slack cables, and the effect of a length error of 1 %; by both methods.

Run: python scripts/draw_fully_constrained.py. It prints a table with conclusions and draws
pictures/fully-constrained.png.
"""

from pathlib import Path

from rich.console import Console

from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing.axes import encoded
from cdpr_sim.studies.pretension import draw_pretension, pretension
from studies.pretension_tables import conclusions, pretension_table

POINTS = 121  # pretensions, from the smallest without slack cables to the largest of the winches
OUTPUT = Path(__file__).parent.parent / "pictures" / "fully-constrained.png"


def main() -> None:
    console, study = Console(), pretension(POINTS)
    console.print(pretension_table(study))
    for sentence in conclusions(study):
        console.print(sentence, highlight=False)
    OUTPUT.parent.mkdir(exist_ok=True)
    write_whole({OUTPUT: encoded(draw_pretension(study))})
    print(OUTPUT.name)


if __name__ == "__main__":
    main()
