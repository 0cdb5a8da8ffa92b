"""Performance of solvers: success rate and time; and differences between the two methods; with their figures."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

import functools
import itertools
import time
import timeit
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

from cdpr_sim.core.describe import newtons
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, Stability
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.compare import (
    POSITION_TOLERANCE,
    ROTATION_TOLERANCE,
    TENSION_TOLERANCE,
    Agreement,
    Verdict,
    compare,
)
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, key, styled
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import PAPER_ROBOTS, load_robot
from cdpr_sim.statics import newton
from cdpr_sim.statics import solve as solvers
from cdpr_sim.statics.solve import Method

REPEATS = 9
"""Repetitions of the timing of the compiled call, which takes less than a millisecond; the median is used."""


@dataclass(frozen=True, eq=False)
class Convergence:
    """Success rate and time of each solver over the cables' stiffness.

    Attributes:
        robot: the robot, apart from its stiffness.
        axial_stiffness: EA, (stiffnesses,) [N].
        poses: number of random commanded poses per stiffness.
        solved: per method, number of poses with balanced forces, (stiffnesses,).
        stable: per method, number of those that are not unstable, (stiffnesses,).
        seconds: per method, time of every pose, solved or not, (stiffnesses, poses) [s].
        compiled_seconds: time per pose of Newton for all poses in one call, (stiffnesses,) [s].
    """

    robot: Robot
    axial_stiffness: Float[np.ndarray, " stiffnesses"]
    poses: int
    solved: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    stable: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    seconds: Mapping[str, Float[np.ndarray, "stiffnesses poses"]]
    compiled_seconds: Float[np.ndarray, " stiffnesses"]


def convergence(
    *,
    axial_stiffness: ArrayLike = (1e2, 1e3, 1e4, 1e5, 1e6),
    poses: int = 24,
    methods: Sequence[Method] = get_args(Method),
) -> Convergence:
    """Run every method from the same random level poses of the workspace of DemoBot's parallel layout."""
    robot, rng = load_robot("parallel"), np.random.default_rng(1)
    stiffness = np.asarray(axial_stiffness, dtype=float)
    commanded = rng.uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
    solved = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    stable = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    seconds = {method: np.zeros((len(stiffness), poses)) for method in methods}
    compiled = np.zeros(len(stiffness))
    newton.solve_many(robot, commanded)  # compiles before the timing
    for i, EA in enumerate(stiffness):
        one = robot.replace(axial_stiffness=EA)
        for method in methods:
            for j, position in enumerate(commanded):
                found, balanced, seconds[method][i, j] = timed(one, position, method)
                solved[method][i] += balanced
                stable[method][i] += balanced and found is not None and found.stability is not Stability.UNSTABLE
        repeated = timeit.repeat(functools.partial(newton.solve_many, one, commanded), number=1, repeat=REPEATS)
        compiled[i] = np.median(repeated) / poses
    return Convergence(robot, stiffness, poses, solved, stable, seconds, compiled)


def timed(robot: Robot, position: ArrayLike, method: Method) -> tuple[Equilibrium | None, bool, float]:
    """The best point that a solver found at a level pose, whether forces balance there, and its time [s]."""
    start = time.perf_counter()
    try:
        found, balanced = solvers.solve(robot, position, method=method), True
    except NotConverged as error:
        found, balanced = error.equilibrium, False
    return found, balanced, time.perf_counter() - start


def differences(
    robots: Sequence[str] = PAPER_ROBOTS, materials: Sequence[str] = PAPER_MATERIALS, *, poses: int = 100
) -> dict[str, list[Agreement]]:
    """Both methods compared at ``poses`` random level poses per robot (default: the paper's) and material, by robot.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    rng = np.random.default_rng(2)
    agreements = {name: [] for name in robots}
    for name, material in itertools.product(robots, materials):
        robot = load_robot(name).replace(material=material)
        commanded = rng.uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
        pairs = zip(commanded, settle_many(robot, commanded), strict=True)
        agreements[name] += [compare(solvers.solve(robot, position), settled) for position, settled in pairs]
    return agreements


# Figures


NAMES = {
    "newton": ("Newton (ours)", "Newton solves"),
    "fsolve": ("SEECR, fsolve", "fsolve"),
    "least_squares": ("SEECR, least_squares", "least_squares"),
}
"""Names in legends and in the title."""


@styled
def draw_convergence(study: Convergence) -> Figure:
    """Success rate and time of each solver over the cables' stiffness."""
    unstable = int(sum((study.solved[method] - study.stable[method]).sum() for method in study.solved))
    shares = ", ".join(f"{NAMES[one][1]} {100 * n[-1] / study.poses:.0f} %" for one, n in study.solved.items())
    figure = canvas(
        10.5,
        4.7,
        f"With EA = {newtons(study.axial_stiffness[-1])}, {shares} of the poses",
        f"{study.robot.name}: {study.poses} random commanded poses for each of {len(study.axial_stiffness)} "
        "stiffnesses. Solved: forces balance to 1e-6 of the weight; "
        f"{unstable or 'none'} of the solutions {'is' if unstable == 1 else 'are'} unstable. "
        "Time: median per pose, solved or not, with the range from the fastest to the slowest tenth, on the machine "
        "that drew this picture, one pose at a time through the Python interface.",
    )
    left, right = figure.subplots(1, 2)
    looks = {"newton": (style.BLUE, 0), "fsolve": (style.VERMILLION, 1), "least_squares": (style.ORANGE, 2)}
    for method, solved in study.solved.items():
        color, number = looks[method]
        line = {"color": color, "ls": style.DASHES[number], "marker": style.MARKERS[number], "ms": 6}
        left.plot(study.axial_stiffness, 100 * solved / study.poses, label=NAMES[method][0], gid=method, **line)
        milliseconds = 1e3 * study.seconds[method]
        low, middle, high = np.quantile(milliseconds, (0.1, 0.5, 0.9), axis=1)
        shift = 1.06 ** (number - 1)  # so that ranges do not overlap
        right.errorbar(
            study.axial_stiffness * shift, middle, (middle - low, high - middle), capsize=3, gid=method, **line
        )
    right.plot(
        study.axial_stiffness,
        1e3 * study.compiled_seconds,
        color=style.BLUE,
        lw=1.2,
        ls=style.DASHES[3],
        marker="D",
        mfc="white",
        gid="compiled",
    )
    right.annotate(
        "Newton, all poses in one compiled call",
        (study.axial_stiffness[1], 1e3 * study.compiled_seconds[1]),
        (0, 8),
        textcoords="offset points",
        color=style.BLUE,
    )
    left.set(ylim=(-3, 106), ylabel="poses solved [%]", title="success rate")
    right.set(yscale="log", ylabel="time per pose [ms]", title="time")
    right.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for ax in (left, right):
        ax.set(xscale="log", xlabel="axial stiffness EA [N]")
        ax.grid(axis="y")
    left.legend(loc="lower left")
    return figure


@styled
def draw_agreement(study: Mapping[str, Sequence[Agreement]]) -> Figure:
    """Cumulative distribution of the differences between statics and simulation."""
    every = [one for agreements in study.values() for one in agreements]
    poses, disagreeing = len(every), sum(not one.agrees for one in every)
    neutral = sum(one.verdict is Verdict.AGREE_EXCEPT_NEUTRAL for one in every)
    agreeing = poses - neutral - disagreeing
    count = f"all {poses}" if agreeing == poses else f"{agreeing} of {poses}"
    verdict = f"agree at {count} poses"
    others = [f"{neutral} are neutrally stable"] * bool(neutral) + [f"at {disagreeing} they disagree"] * bool(
        disagreeing
    )
    crosses = (
        f" Crosses: {neutral} neutrally stable poses, at which the platform hangs on two diagonal cables: it has a "
        "continuum of equilibria about them, and the methods stop at different ones."
        if neutral
        else ""
    )
    figure = canvas(
        10.8,
        4.7,
        "; ".join([f"Statics and simulation, which share no physics code, {verdict}", *others]),
        f"Static solver (Newton) minus MuJoCo at {poses} random commanded poses, both materials; cumulative. Dashed "
        "line: tolerance of the comparison." + crosses,
    )
    panels = (
        ("position_error", 1.0, POSITION_TOLERANCE, "difference in position [m]"),
        ("rotation_error", np.degrees(1.0), np.degrees(ROTATION_TOLERANCE), "difference in rotation [°]"),
        ("tension_error", 1.0, TENSION_TOLERANCE, "largest difference in a tension [N]"),
    )
    colors = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE)
    axes = figure.subplots(1, 3, sharey=True)
    for ax, (field, unit, tolerance, label) in zip(axes, panels, strict=True):
        for i, (name, agreements) in enumerate(study.items()):
            errors = unit * np.array([getattr(one, field) for one in agreements])
            free = np.array([one.verdict is Verdict.AGREE_EXCEPT_NEUTRAL for one in agreements])
            values = np.sort(errors[~free])
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            looks = {"color": colors[i % 5], "ls": style.DASHES[i % 5], "drawstyle": "steps-post"}
            ax.plot(values, share, **looks, label=name, gid=name)
            if free.any():
                ax.plot(errors[free], np.full(free.sum(), 103.0), "x", color=colors[i % 5], ms=5, gid=f"{name} neutral")
        ax.axvline(tolerance, color=style.INK, lw=style.THIN, ls=(0, (5, 3)))
        ax.set(xscale="log", xlabel=label, ylim=(0, 106))
        ax.set_xlim(left=1e-17)
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("poses with a smaller difference [%]")
    handles, _ = axes[0].get_legend_handles_labels()
    handles += [
        key("tolerance", color=style.INK, lw=style.THIN, ls=(0, (5, 3))),
        key("neutrally stable", color=style.MUTED, ls="none", marker="x"),
    ]
    figure.legend(handles=handles, loc="outside right center")
    return figure
