"""Effect of pretension on IPAnema 1: stiffness, slack cables, and the effect of a length error of 1 %; by both methods.

Run: python scripts/figures/fully_constrained.py. It prints a table with conclusions and draws
pictures/fully-constrained.png.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import robots_on_axes as drawing
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, key, styled
from cdpr_sim.drawing.readable_numbers import exponent
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.newton import solve_many
from robots_on_axes import points

POINTS = 121  # pretensions, from the smallest without slack cables to the largest of the winches
OUTPUT = Path(__file__).parents[2] / "pictures" / "fully-constrained.png"


FORCE, TORQUE = 100.0, 2.0
"""[N], [N m] External force and torque."""

PUSHES = {
    "pushed down": np.array([0, 0, -FORCE, 0, 0, 0]),
    "pushed along y": np.array([0, FORCE, 0, 0, 0, 0]),
    "pushed along x": np.array([FORCE, 0, 0, 0, 0, 0]),
    "turned about x": np.array([0, 0, 0, TORQUE, 0, 0]),
    "turned about z": np.array([0, 0, 0, 0, 0, TORQUE]),
}
"""External wrenches [N, N m]."""

DRAWN, HELD = 90.0, 300.0
"""Pretensions [N]: of the drawn robot, under a force that makes cables slack; of the robot with a length error."""

MOST_ERROR = 0.01
"""Largest error of one rest length, as a fraction of it."""

LEAST_MARGIN = 1e-3
"""[N] Smallest tension at the lowest pretension considered."""

ABOVE, BELOW = 0, 4
"""An upper and a lower cable: at the middle, all others are equivalent to one of them."""

SIDES = {ABOVE: "upper", BELOW: "lower"}


@dataclass(frozen=True, eq=False)
class Series:
    """Equilibria over a quantity: at all its values by statics, and at one of ``every`` by MuJoCo.

    Attributes:
        values: of the quantity, (values,).
        every: one of so many values is settled.
        static: (values,).
        settled: (some,).
    """

    values: Float[np.ndarray, " values"]
    every: int
    static: EquilibriumBatch
    settled: EquilibriumBatch

    @property
    def settled_values(self) -> Float[np.ndarray, " some"]:
        """Values at which MuJoCo was settled."""
        return self.values[:: self.every]


@dataclass(frozen=True, eq=False)
class Pretension:
    """A fully constrained robot, commanded to its home.

    Attributes:
        unloaded: over pretension [N], without external wrench.
        pushes: the same under each of ``PUSHES``, by its name.
        taut: smallest pretension [N] without slack cables under each of ``PUSHES``.
        wrong: over an error [m] of one rest length at the pretension ``HELD``, by the index of the cable.
        rigid: eigenvalues with rigid lengths, without pretension, (6,) [N/m].
        drawn: MuJoCo's equilibrium at ``DRAWN`` under the downward force, (1,).
    """

    unloaded: Series
    pushes: dict[str, Series]
    taut: dict[str, float]
    wrong: dict[int, Series]
    rigid: Float[np.ndarray, "6"]
    drawn: EquilibriumBatch

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.drawn.robot

    def short_by(self, cable: int, tension: float) -> float:
        """Error of this cable's rest length [m], too short, at which the largest of all tensions is ``tension`` [N]."""
        one = self.wrong[cable]
        short = one.values <= 0
        return float(np.interp(tension, one.static.tensions.max(-1)[short][::-1], -one.values[short][::-1]))

    def method_differences(self) -> tuple[float, float]:
        """Largest distance between the methods [m], and largest relative difference of an eigenvalue."""
        distances, shares = [], []
        for one in (self.unloaded, *self.pushes.values(), *self.wrong.values()):
            values = one.static.eigenvalues[:: one.every]
            distances.append(np.abs(one.static.positions[:: one.every] - one.settled.positions).max())
            shares.append((np.abs(values - one.settled.eigenvalues).max(-1) / values.max(-1)).max())
        return float(max(distances)), float(max(shares))


def pretension(points: int = 121, every: int = 10, errors: int = 81) -> Pretension:
    """IPAnema 1 at the middle of its workspace, from the smallest pretension without slack cables to its limit.

    Args:
        points: number of pretensions.
        every: one of so many pretensions and of half as many errors is settled in MuJoCo as well.
        errors: number of errors of one length.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    robot = load_robot("ipanema-1")
    home = robot.home
    least = least_pretension(robot)
    sizes = np.geomspace(least, float(robot.force_max.min()) - least, points)  # to the tension limit of upper cables
    lengths = np.array([robot.rest_lengths(home, size) for size in sizes])
    nominal = robot.rest_lengths(home, HELD)
    changes = {cable: np.linspace(-MOST_ERROR, MOST_ERROR, errors) * nominal[cable] for cable in (ABOVE, BELOW)}
    cables = np.arange(robot.cables)
    return Pretension(
        unloaded=_series(robot, sizes, every, lengths),
        pushes={what: _series(robot, sizes, every, lengths, wrench) for what, wrench in PUSHES.items()},
        taut={what: taut_from(robot, wrench) for what, wrench in PUSHES.items()},
        wrong={
            cable: _series(robot, change, every // 2, nominal + np.outer(change, cables == cable))
            for cable, change in changes.items()
        },
        rigid=solve_many(robot, home[None]).eigenvalues[0],
        drawn=settle_many(
            robot, home[None], robot.rest_lengths(home, DRAWN)[None], external_wrench=PUSHES["pushed down"]
        ),
    )


def least_pretension(robot: Robot) -> float:
    """Smallest pretension [N] with nonnegative tensions at the robot's home; tensions grow with it."""
    low, high = 0.0, float(robot.force_max.min()) / 2
    while high - low > LEAST_MARGIN:
        middle = (low + high) / 2
        try:
            robot.rest_lengths(robot.home, middle)
        except InvalidInput:
            low = middle
        else:
            high = middle
    return high


def taut_from(robot: Robot, wrench: ArrayLike) -> float:
    """Smallest pretension [N] without slack cables under a wrench, by root finding.

    A cable becomes slack at its rest length: the function is the smallest elongation over all cables.
    """

    def least_stretch(size: float) -> float:
        lengths = robot.rest_lengths(robot.home, size)
        found = solve_many(robot, robot.home[None], lengths[None], external_wrench=wrench)
        return float((found.lengths - found.rest_lengths).min())

    low = least_pretension(robot)
    high = float(robot.force_max.min()) - low
    if least_stretch(low) >= 0:
        return low
    return float(brentq(least_stretch, low, high, xtol=1e-6))  # type: ignore[arg-type]


def _series(
    robot: Robot,
    values: Float[np.ndarray, " values"],
    every: int,
    lengths: Float[np.ndarray, "values cables"],
    wrench: ArrayLike | None = None,
) -> Series:
    """Equilibria commanded to the robot's home, with rest lengths for each of the values."""

    def solved(method: Callable[..., EquilibriumBatch], some: Float[np.ndarray, "some cables"]) -> EquilibriumBatch:
        return all_solved(method(robot, np.repeat(robot.home[None], len(some), axis=0), some, external_wrench=wrench))

    return Series(values, every, solved(solve_many, lengths), solved(settle_many, lengths[::every]))


def shifts(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    """Displacements of the platform [m]."""
    return np.linalg.norm(equilibria.deviation, axis=-1)


def turns(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    """Rotations of the platform [rad]."""
    return np.asarray(Rotation.from_matrix(equilibria.rotations).magnitude())


def directions(equilibria: EquilibriumBatch) -> list[str]:
    """Direction of each eigenvalue of the first row, "along x"; by symmetry the stiffness matrix is diagonal there."""
    state = forces.at(equilibria.problems[0], equilibria.positions[0], equilibria.rotations[0])
    stiffness = np.diag(state.stiffness_matrix) / equilibria.robot.units**2
    return [f"{'along' if i < 3 else 'about'} {'xyzxyz'[i]}" for i in np.argsort(stiffness)]


# The figure


SETTLED = key("MuJoCo, settled", **points(style.INK))
LABEL_SPACING = 1.35
"""Smallest ratio between the heights of two labels on a logarithmic scale."""

SLACK = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH, "lw": 2.2}
"""Line style where cables are slack, as for a slack cable."""


@styled
def draw_pretension(study: Pretension) -> Figure:
    """Stiffness over pretension, slack cables, and the effect of one length error."""
    robot, differences = study.robot, study.method_differences()
    gain = study.unloaded.static.eigenvalues[-1, 0] / study.rigid[0]
    overload = study.short_by(ABOVE, float(robot.force_max[0]))
    figure = canvas(
        style.WIDTH,
        10.5,
        f"Pretension makes IPAnema 1 up to {gain:.0f} times stiffer about its softest axis; one length "
        f"{100 * overload / robot.rest_lengths(robot.home)[ABOVE]:.1f} % too short overloads it",
        f"{robot.name}: 8 cables of 2.5 mm Dyneema, EA = {robot.axial_stiffness[0] / 1e3:.0f} kN, winches of "
        f"{robot.force_max[0]:.0f} N; platform of {robot.mass:g} kg (assumed) commanded to the middle. Pretension p: "
        "rest lengths whose tensions balance the weight and are closest to p. Rotations are weighted by the distance "
        f"of {1e3 * robot.characteristic_length:.0f} mm from the platform's middle to its anchors. Lines: statics; "
        f"hollow points: MuJoCo. Differences below {exponent(differences[0])} m and "
        f"{exponent(differences[1])} of the stiffness.",
    )
    grid = figure.add_gridspec(3, 2)
    _robot(figure.add_subplot(grid[0, 0], projection="3d"), study)
    _stiffness(figure.add_subplot(grid[0, 1]), study)
    _pushes(figure.add_subplot(grid[1, 0]), study, turned=False)
    _pushes(figure.add_subplot(grid[1, 1]), study, turned=True)
    _displacements(figure.add_subplot(grid[2, 0]), study)
    _overload(figure.add_subplot(grid[2, 1]), study)
    return figure


def _robot(ax: Axes3D, study: Pretension) -> None:
    """The robot under a downward force, with too little pretension."""
    drawing.draw_frame(ax, study.robot)
    drawing.draw_pose(ax, study.drawn, 0)
    ax.set_box_aspect(tuple(np.diff(study.robot.frame, axis=0)[0]), zoom=1.0)
    for axis, (low, high) in zip((ax.xaxis, ax.yaxis, ax.zaxis), study.robot.frame.T, strict=True):
        axis.set_ticks([high] if axis is ax.yaxis else [low, high])
    x, y, z = study.drawn.positions[0]
    ax.quiver(x, y, z + 0.75, 0, 0, -0.6, color=style.INK, lw=2, arrow_length_ratio=0.3)
    above = drawing.seen(ax, np.array([x, y, z + 0.85]))
    ax.text2D(*above, f"{FORCE:g} N", transform=ax.transData, fontsize=8.5, ha="center", va="bottom")
    slack = int(study.drawn.slack[0].sum())
    ax.set_title(f"{DRAWN:g} N: {slack} cables slack under a force", loc="left")
    handles = [handle for handle in drawing.pose_legend(slack=True) if "cable" in str(handle.get_label())]
    ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, -0.08), ncols=2)


def _stiffness(ax: Axes, study: Pretension) -> None:
    """Six eigenvalues over pretension, labelled by their directions."""
    one, names = study.unloaded, directions(study.unloaded.static)
    eigenvalues, settled = one.static.eigenvalues / 1e3, one.settled.eigenvalues / 1e3
    for mode, name in enumerate(names):
        color = style.CABLES[mode]
        ax.plot(one.values, eigenvalues[:, mode], color=color, gid=f"static {name}")
        ax.plot(one.settled_values, settled[:, mode], **points(color), gid=f"mujoco {name}")
    heights = eigenvalues[-1].copy()
    for mode in range(1, len(heights)):  # room for each label
        heights[mode] = max(heights[mode], LABEL_SPACING * heights[mode - 1])
    for name, color, height in zip(names, style.CABLES, heights, strict=False):
        ax.annotate(name, (1.04 * one.values[-1], height), color=color, fontsize=8.5, va="center",
                    annotation_clip=False)  # fmt: skip
    rigid = study.rigid[0] / 1e3
    ax.plot(0, rigid, "D", color=style.CABLES[0], ms=5, clip_on=False, zorder=6, gid="rigid")
    ax.annotate(f"{rigid:.2g} kN/m with rigid lengths:\nlower cables slack", (0, rigid), (10, 0),
                textcoords="offset points", fontsize=8.5, va="center", color=style.MUTED)  # fmt: skip
    ax.set(xlabel="pretension [N]", ylabel="stiffness [kN/m]", yscale="log")
    ax.set_xlim(0, 1.02 * one.values[-1])
    ax.set_ylim(0.7 * rigid, 900)
    ax.set_title("Six stiffnesses: rotations gain most")
    ax.legend(handles=[SETTLED], loc="upper left")


def displacements(what: str, equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    """Displacements [mm] under one of ``PUSHES``, or rotations [°] if it is a torque."""
    return np.degrees(turns(equilibria)) if is_torque(what) else 1e3 * shifts(equilibria)


def is_torque(what: str) -> bool:
    """Whether one of ``PUSHES`` is a torque."""
    return not PUSHES[what][:3].any()


def _pushes(ax: Axes, study: Pretension, *, turned: bool) -> None:
    """Displacements under forces, or rotations under torques; dotted where a cable is slack."""
    pushes = {what: push for what, push in study.pushes.items() if is_torque(what) == turned}
    sizes = study.unloaded.values
    for (name, push), color, marker in zip(pushes.items(), style.CABLES, style.MARKERS, strict=False):
        taut, values = study.taut[name], displacements(name, push.static)
        slack = sizes <= taut
        at = float(np.interp(taut, sizes, values))
        ax.plot([taut, *sizes[~slack]], [at, *values[~slack]], color=color, gid=f"static {name}")
        ax.plot([*sizes[slack], taut], [*values[slack], at], **SLACK | {"color": color}, gid=f"slack {name}")
        ax.plot(taut, at, marker, color=color, ms=6.5, zorder=7)
        settled = displacements(name, push.settled)
        ax.plot(push.settled_values, settled, **points(color, marker), gid=f"mujoco {name}")
        ax.plot([], [], color=color, marker=marker, ms=5, label=f"{name}: taut from {taut:.0f} N")
    what = f"rotation under {TORQUE:g} N m [°]" if turned else f"displacement under {FORCE:g} N [mm]"
    ax.set(xlabel="pretension [N]", ylabel=what, xscale="log")
    ax.set_xlim(0.96 * sizes[0], 1.03 * sizes[-1])
    ticks = [80, 100, 150, 200, 300, 400, 600]
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_ylim(bottom=0)
    ax.set_title(
        "Torque: rotation decreases with pretension" if turned else "Force: large displacement only with slack cables"
    )
    handles, labels = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], **SLACK | {"color": style.MUTED}))
    ax.legend(handles, [*labels, "dotted: cables slack"], loc="upper right")


def _displacements(ax: Axes, study: Pretension) -> None:
    """Displacement of the platform by one length error."""
    _over_errors(ax, study, lambda equilibria: 1e3 * shifts(equilibria))
    for (cable, _), color, marker in _wrong(study):
        ax.plot([], [], color=color, marker=marker, ms=5, label=f"{SIDES[cable]} cable")
    ax.set_ylabel("displacement of the platform [mm]")
    ax.set_title(f"One length error, at {HELD:g} N of pretension")
    ax.set_ylim(0, 1.25 * ax.get_ylim()[1])
    ax.legend(loc="upper center", ncols=2)


def _overload(ax: Axes, study: Pretension) -> None:
    """Largest tension of all cables under one length error."""
    _over_errors(ax, study, lambda equilibria: equilibria.tensions.max(-1))
    for (_, wrong), color, marker in _wrong(study):
        first = np.flatnonzero(wrong.static.slack.any(-1))[:1]
        largest = wrong.static.tensions[first].max(-1)
        ax.plot(1e3 * wrong.values[first], largest, marker, color=color, ms=6.5, zorder=7)
    limit = study.robot.force_max[0]
    ax.axhline(limit, color=style.INK, lw=1, ls=style.COMMANDED_DASH)
    ax.annotate(f"the winches' {limit:g} N", (1e3 * study.wrong[ABOVE].values[-1], limit), (0, 4), ha="right",
                textcoords="offset points", fontsize=8.5)  # fmt: skip
    short = 1e3 * study.short_by(ABOVE, limit)
    ax.annotate(f"{short:.0f} mm too short", (-short, limit), (12, 22), textcoords="offset points", fontsize=8.5,
                arrowprops={"arrowstyle": "-", "color": style.MUTED, "lw": 0.7})  # fmt: skip
    ax.set_ylabel("largest tension [N]")
    ax.set_ylim(bottom=0)
    ax.set_title("Largest tension under this length error")
    full = key("from here on, it is slack", ls="none", marker="o", color=style.MUTED, ms=6.5)
    ax.legend(handles=[SETTLED, full], loc="lower left")


def _wrong(study: Pretension):
    return zip(study.wrong.items(), (style.BLUE, style.VERMILLION), style.MARKERS, strict=False)


def _over_errors(ax: Axes, study: Pretension, quantity: Callable[[EquilibriumBatch], np.ndarray]) -> None:
    """A quantity over the error of one length, by both methods, for each cable."""
    for (cable, wrong), color, marker in _wrong(study):
        ax.plot(1e3 * wrong.values, quantity(wrong.static), color=color, gid=f"static {cable}")
        ax.plot(1e3 * wrong.settled_values, quantity(wrong.settled), **points(color, marker))
    most = 1e3 * study.wrong[ABOVE].values[-1]
    ax.set_xlabel(f"error of its length, {MOST_ERROR:.0%} at the ends [mm]")
    ax.set_xlim(-1.03 * most, 1.03 * most)
    ax.axvline(0, color=style.FAINT, lw=style.HAIR, zorder=0)


def pretension_table(study: Pretension) -> Table:
    """A row for each pretension settled in MuJoCo: lowest and highest stiffness, displacements under wrenches."""
    one, names = study.unloaded, directions(study.unloaded.static)
    table = new_table(
        f"{study.robot.name} at the middle, settled in MuJoCo; force of {FORCE:g} N, torque of {TORQUE:g} N m",
        "pretension\nN", f"softest\n{names[0]}\nkN/m", f"stiffest\n{names[-1]}\nkN/m",
        *("\n".join([*what.rsplit(" ", 1), "°" if is_torque(what) else "mm"]) for what in study.pushes),
        text_columns=0, dense=True,
    )  # fmt: skip
    moved = [displacements(what, push.settled) for what, push in study.pushes.items()]
    for row, size in enumerate(one.settled_values):
        softest, stiffest = one.settled.eigenvalues[row, [0, -1]] / 1e3
        table.add_row(f"{size:.0f}", f"{softest:.1f}", f"{stiffest:.1f}", *(f"{values[row]:.3f}" for values in moved))
    return table


def conclusions(study: Pretension) -> Iterator[str]:
    """Results of the study, a sentence each."""
    sizes, eigenvalues, robot = study.unloaded.values, study.unloaded.static.eigenvalues, study.robot
    softest, stiffest = eigenvalues[[0, -1], 0], eigenvalues[[0, -1], -1]
    yield (
        f"With rigid lengths the lower cables are slack: the softest direction has {study.rigid[0] / 1e3:.2g} "
        f"kN/m, the stiffest {study.rigid[-1] / 1e3:.0f} kN/m. Pretensions from {sizes[0]:.1f} to "
        f"{sizes[-1]:.1f} N keep all cables taut and within the winches' {robot.force_max[0]:.0f} N: the "
        f"softest direction then has {softest[0] / 1e3:.0f} to {softest[1] / 1e3:.0f} kN/m, at most "
        f"{softest[1] / study.rigid[0]:.0f} times as much as with rigid lengths, the stiffest "
        f"{stiffest[0] / 1e3:.0f} to {stiffest[1] / 1e3:.0f} kN/m, at most {stiffest[1] / study.rigid[-1]:.2f} times "
        "as much."
    )
    taut = "; ".join(f"{what}, {size:.0f} N" for what, size in study.taut.items())
    yield f"Smallest pretension without slack cables: {sizes[0]:.1f} N unloaded; {taut}."
    limit = float(robot.force_max[0])
    for cable, wrong in study.wrong.items():
        short, long = ((1e3 * shifts(wrong.static)[end], np.degrees(turns(wrong.static)[end])) for end in (0, -1))
        slack = wrong.values[np.flatnonzero(wrong.static.slack.any(-1))[0]]
        yield (
            f"One {SIDES[cable]} cable {MOST_ERROR:.0%} ({1e3 * wrong.values[-1]:.0f} mm) too short at {HELD:g} N "
            f"moves the platform by {short[0]:.1f} mm and {short[1]:.1f}° and has a tension "
            f"of {wrong.static.tensions[0].max():.0f} N; the winches' {limit:.0f} N are reached at "
            f"{1e3 * study.short_by(cable, limit):.1f} mm. The same length too long moves it by "
            f"{long[0]:.1f} mm and {long[1]:.1f}°; the cable is slack from {1e3 * slack:.1f} mm on."
        )
    distance, share = study.method_differences()
    yield f"Largest difference between the methods: {distance:.0e} m, and {share:.0e} of the stiffness."


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
