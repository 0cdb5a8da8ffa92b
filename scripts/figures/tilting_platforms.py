"""Render the README's video: two layouts of DemoBot along the paper's line, side by side, nearly static.

One layout stays level. The other tilts, deviates from the line, and half of its cables are slack. The motion is from
MuJoCo; the gold outline is the result of the static solver.

Run: python scripts/figures/tilting_platforms.py
"""

from pathlib import Path

from cdpr_sim.cli import app

FILE = Path(__file__).parents[2] / "pictures" / "tilting-platforms.gif"
LINE = "--path 0.17 0.63 --y 0.25 --z 0.1"  # m, the paper's
VIDEO = "--seconds 10 --fps 8 --size 800 450"

if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    app(["video", "cogiro", "parallel", *LINE.split(), *VIDEO.split(), "--force", "-o", str(FILE)])
