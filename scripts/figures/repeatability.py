"""Repeatability: distance between equilibria at one commanded pose, reached from the left and from the right.

Run: python scripts/figures/repeatability.py. It prints a table and draws pictures/repeatability.png.

Each robot goes along x through the middle of its workspace and back, and stops at 21 poses on both ways. Winches hold
rest lengths, so that friction at the exits acts through the rope behind them, whose lengths are assumed here. Friction
and hysteresis are assumed too, in the range of measured ropes (``docs/concepts/memory.md``).
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, key, legend_above, styled
from cdpr_sim.drawing.readable_numbers import plain
from lines import PAPER_DEVIATION

OUTPUT = Path(__file__).parents[2] / "pictures" / "repeatability.png"

BEHIND = {
    "cogiro": 0.5, "parallel": 0.5, "planar-vertical": 0.5, "planar-horizontal": 0.5, "two-cable": 0.5,
    "ipanema-3": 3.0, "ipanema-1": 3.0, "cogiro-crane": 6.0,
}  # fmt: skip
"""[m] Rope between winch and exit of each robot; assumed."""

STOPS = 21

FRICTION = (0.02, 0.05)
"""c at the exit: a wheel with rolling bearings, and a worse one."""

HYSTERESIS = (0.1, 0.2)
"""w of an element of 20 % of EA that yields in proportion: loops of 5 and 10 % of the tension."""


def path_difference(robot: cdpr.Robot, **memory) -> float:
    """Largest distance [mm] between the equilibria at one command on the way there and on the way back."""
    (low, _, _), (high, _, _) = robot.workspace
    there = np.repeat(robot.home[None], STOPS, axis=0)
    there[:, 0] = np.linspace(low, high, STOPS)
    path = cdpr.solve_path(robot.replace(**memory), np.concatenate([there, there[-2::-1]]), steps=2)
    assert path.converged.all()
    return 1e3 * float(np.linalg.norm(path.positions[:STOPS] - path.positions[: STOPS - 2 : -1], axis=1).max())


def deviation(robot: cdpr.Robot) -> float:
    """Largest distance [mm] from the command along the same line, of the same cables without memory."""
    (low, _, _), (high, _, _) = robot.workspace
    there = np.repeat(robot.home[None], STOPS, axis=0)
    there[:, 0] = np.linspace(low, high, STOPS)
    return 1e3 * float(np.linalg.norm(cdpr.solve_many(robot, there).deviation, axis=1).max())


def measured() -> dict[str, tuple[float, list[float], list[float]]]:
    """Of each robot: deviation, and distances by friction and by hysteresis [mm]."""
    found = {}
    for name, behind in BEHIND.items():
        robot = cdpr.load_robot(name).replace(winch_to_exit=behind, linear_density=0.0)
        friction = [path_difference(robot, pulley_friction=c) for c in FRICTION]
        hysteresis = [path_difference(robot, hysteresis=[(0.2, np.inf, w)]) for w in HYSTERESIS]
        found[name] = deviation(robot), friction, hysteresis
        print(f"{name:18} {found[name][0]:8.3f}" + "".join(f"{one:9.4f}" for one in friction + hysteresis), flush=True)
    return found


@styled
def draw(found: dict[str, tuple[float, list[float], list[float]]]) -> Figure:
    """One row for each robot, on a logarithmic scale."""
    highest = max(max(friction + hysteresis) for _, friction, hysteresis in found.values())
    figure = canvas(
        style.WIDTH,
        5.4,
        f"One command, reached from the left and from the right: at most {plain(highest)} mm apart",
        f"Largest distance between the two equilibria, over {STOPS} commanded poses along x through the middle of the "
        "workspace; static solver. Winches hold rest lengths. Friction at the exits, hysteresis of the ropes, and the "
        "rope between winch and exit (in parentheses) are assumed.",
    )
    handles = [
        key("friction of 2 to 5 %", color=style.BLUE, lw=6),
        key("hysteresis of 5 to 10 %", color=style.VERMILLION, lw=6),
        key("for scale: elastic deviation from the command", ls="none", marker="o", mfc="white", color=style.INK, ms=6),
    ]
    axes = figure.add_subplot(legend_above(figure, handles, 3))
    for row, (away, friction, hysteresis) in enumerate(found.values()):
        axes.plot(away, row, "o", mfc="white", mec=style.INK, ms=6, zorder=4)
        for shift, color, ends in ((-0.14, style.BLUE, friction), (0.14, style.VERMILLION, hysteresis)):
            axes.plot(ends, [row + shift] * 2, color=color, lw=6, solid_capstyle="butt")
    axes.axvline(1e3 * PAPER_DEVIATION, color=style.MUTED, lw=style.THIN, ls=style.DASHES[1])
    axes.text(14, -0.72, "the paper's 15 mm", color=style.MUTED, ha="right", va="center")
    axes.set_xscale("log")
    axes.set_xlim(1e-3, 100)
    axes.set_xticks([1e-3, 1e-2, 0.1, 1, 10, 100], ["1 µm", "10 µm", "0.1 mm", "1 mm", "10 mm", "100 mm"])
    axes.set_ylim(len(found) - 0.4, -1.05)
    axes.set_yticks(range(len(found)), [f"{name} ({BEHIND[name]:g} m)" for name in found])
    axes.set_xlabel("distance between the two equilibria")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    return figure


if __name__ == "__main__":
    write_whole({OUTPUT: encoded(draw(measured()))})
