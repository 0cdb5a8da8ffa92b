"""Repeatability: distance between equilibria at one commanded pose, reached from the left and from the right.

    python scripts/figures/repeatability.py pictures/repeatability.png

Each robot goes along x through the middle of its workspace and back, and stops at 21 poses on both ways. Winches hold
rest lengths, so that friction at the exits acts through the rope behind them, whose lengths are assumed here. Friction
and hysteresis are assumed too, in the range of measured ropes (``docs/concepts/memory.md``).
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import cdpr_sim as cdpr
from cdpr_sim.drawing.axes import styled
from cdpr_sim.drawing.style import BLUE, FAINT, INK, MUTED, VERMILLION

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
    figure = Figure(figsize=(7.2, 3.9))
    axes = figure.subplots()
    for row, (away, friction, hysteresis) in enumerate(found.values()):
        axes.plot(away, row, "o", mfc="white", mec=INK, ms=6, zorder=4)
        for shift, color, ends in ((-0.14, BLUE, friction), (0.14, VERMILLION, hysteresis)):
            axes.plot(ends, [row + shift] * 2, color=color, lw=6, solid_capstyle="round")
    axes.axvline(15, color=MUTED, lw=1, ls=(0, (4, 2)))
    axes.text(14, -0.72, "the paper's 15 mm", color=MUTED, ha="right", va="center")
    axes.set_xscale("log")
    axes.set_xlim(1e-3, 100)
    axes.set_xticks([1e-3, 1e-2, 0.1, 1, 10, 100], ["1 µm", "10 µm", "0.1 mm", "1 mm", "10 mm", "100 mm"])
    axes.set_ylim(len(found) - 0.4, -1.05)
    labels = [f"{name}  ({BEHIND[name]:g} m behind the exits)" for name in found]
    axes.set_yticks(range(len(found)), labels)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=FAINT, lw=0.6)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    figure.suptitle(
        "One command, reached from the left and from the right: largest distance of the two equilibria",
        x=0.01, ha="left", fontsize=9.5,
    )  # fmt: skip
    axes.plot([], [], color=BLUE, lw=6, label="by friction of 2 to 5 %")
    axes.plot([], [], color=VERMILLION, lw=6, label="by hysteresis of 5 to 10 %")
    axes.plot([], [], "o", mfc="white", mec=INK, ms=6, label="for scale: elastic deviation from the command")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, handlelength=1.4, columnspacing=1.6)
    return figure


if __name__ == "__main__":
    draw(measured()).savefig(Path(sys.argv[1]), dpi=160)
