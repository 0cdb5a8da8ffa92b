"""Effect of pretension on a fully constrained robot, by both methods: stiffness, slack cables, one length error."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import axes as drawing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, key, points, styled
from cdpr_sim.drawing.readable_numbers import exponent
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.studies.lines import all_solved

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


@dataclass(frozen=True, eq=False)
class Stiffening:
    """Stiffness of the platform over pretension, without external wrench.

    Attributes:
        pretensions: (pretensions,) [N].
        eigenvalues: of the stiffness matrix by statics, ascending, (pretensions, 6) [N/m].
        settled_pretensions: (some,) [N].
        settled: eigenvalues by MuJoCo, (some, 6) [N/m].
        directions: direction of each eigenvalue: "along x", "about z".
        rigid: eigenvalues with rigid lengths, without pretension, (6,) [N/m].
    """

    pretensions: Float[np.ndarray, " pretensions"]
    eigenvalues: Float[np.ndarray, "pretensions 6"]
    settled_pretensions: Float[np.ndarray, " some"]
    settled: Float[np.ndarray, "some 6"]
    directions: tuple[str, ...]
    rigid: Float[np.ndarray, "6"]


@dataclass(frozen=True, eq=False)
class Push:
    """Displacement of the platform under a wrench, over pretension.

    Attributes:
        what: name of the wrench.
        shifts: displacements by statics, (pretensions,) [m].
        turns: rotations by statics, (pretensions,) [rad].
        settled_shifts: displacements by MuJoCo, (some,) [m].
        settled_turns: rotations by MuJoCo, (some,) [rad].
        taut: smallest pretension without slack cables under this wrench [N].
    """

    what: str
    shifts: Float[np.ndarray, " pretensions"]
    turns: Float[np.ndarray, " pretensions"]
    settled_shifts: Float[np.ndarray, " some"]
    settled_turns: Float[np.ndarray, " some"]
    taut: float


@dataclass(frozen=True, eq=False)
class WrongLength:
    """Effect of an error of one cable's rest length.

    Attributes:
        cable: index of the cable, from 0.
        errors: of its rest length, (errors,) [m].
        shifts: displacements of the platform by statics, (errors,) [m].
        turns: rotations of the platform by statics, (errors,) [rad].
        largest_tensions: of all cables by statics, (errors,) [N].
        slack: number of slack cables, (errors,).
        settled_errors: (some,) [m].
        settled_shifts, settled_turns, settled_largest_tensions: by MuJoCo, (some,) [m], [rad], [N].
    """

    cable: int
    errors: Float[np.ndarray, " errors"]
    shifts: Float[np.ndarray, " errors"]
    turns: Float[np.ndarray, " errors"]
    largest_tensions: Float[np.ndarray, " errors"]
    slack: Int[np.ndarray, " errors"]
    settled_errors: Float[np.ndarray, " some"]
    settled_shifts: Float[np.ndarray, " some"]
    settled_turns: Float[np.ndarray, " some"]
    settled_largest_tensions: Float[np.ndarray, " some"]

    def short_by(self, tension: float) -> float:
        """Length error [m], too short, at which the largest tension of all cables is ``tension`` [N]."""
        short = self.errors <= 0
        return float(np.interp(tension, self.largest_tensions[short][::-1], -self.errors[short][::-1]))


@dataclass(frozen=True, eq=False)
class Pretension:
    """The whole study.

    Attributes:
        robot: fully constrained, commanded to its home.
        stiffening: without a wrench.
        pushes: under each of ``PUSHES``.
        wrong: length errors of an upper and a lower cable.
        drawn: MuJoCo's equilibrium at ``DRAWN`` under the downward force, (1,).
        method_differences: largest distance between the methods [m], and largest relative difference of an eigenvalue.
    """

    robot: Robot
    stiffening: Stiffening
    pushes: tuple[Push, ...]
    wrong: tuple[WrongLength, ...]
    drawn: EquilibriumBatch
    method_differences: tuple[float, float]


def pretension(points: int = 121, every: int = 10, errors: int = 81) -> Pretension:
    """IPAnema 1 at the middle of its workspace, from the smallest pretension without slack cables to its limit.

    Args:
        points: number of pretensions.
        every: one of so many pretensions and errors is settled in MuJoCo as well.
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
    still = _both(robot, lengths, every)
    moved = {what: _both(robot, lengths, every, wrench) for what, wrench in PUSHES.items()}
    nominal = robot.rest_lengths(home, HELD)
    wrong, batches = [], []
    for cable in (ABOVE, BELOW):
        changes = np.linspace(-MOST_ERROR, MOST_ERROR, errors) * nominal[cable]
        lengths_with_error = np.repeat(nominal[None], errors, axis=0)
        lengths_with_error[:, cable] += changes
        static, settled = methods = _both(robot, lengths_with_error, every // 2)
        batches.append(methods)
        wrong.append(
            WrongLength(
                cable, changes, _shifts(static), _turns(static), static.tensions.max(-1), static.slack.sum(-1),
                changes[:: every // 2], _shifts(settled), _turns(settled), settled.tensions.max(-1),
            )
        )  # fmt: skip
    pushes = tuple(
        Push(what, _shifts(static), _turns(static), _shifts(settled), _turns(settled), taut_from(robot, PUSHES[what]))
        for what, (static, settled) in moved.items()
    )  # fmt: skip
    static, settled = still
    compared = [(*methods, every) for methods in (still, *moved.values())] + [
        (*methods, every // 2) for methods in batches
    ]
    differences = np.max([_difference(static, settled, step) for static, settled, step in compared], axis=0)
    rigid = solve_many(robot, home[None])
    drawn = settle_many(robot, home[None], robot.rest_lengths(home, DRAWN)[None], external_wrench=PUSHES["pushed down"])
    return Pretension(
        robot=robot,
        stiffening=Stiffening(
            sizes, static.eigenvalues, sizes[::every], settled.eigenvalues, _directions(static), rigid.eigenvalues[0]
        ),
        pushes=pushes,
        wrong=tuple(wrong),
        drawn=drawn,
        method_differences=(float(differences[0]), float(differences[1])),
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


def _both(
    robot: Robot, lengths: Float[np.ndarray, "rows cables"], every: int, wrench: ArrayLike | None = None
) -> tuple[EquilibriumBatch, EquilibriumBatch]:
    """All rows by statics, and one of ``every`` by MuJoCo, commanded to the robot's home."""
    methods = []
    for method, some in ((solve_many, lengths), (settle_many, lengths[::every])):
        equilibria = method(robot, np.repeat(robot.home[None], len(some), axis=0), some, external_wrench=wrench)
        methods.append(all_solved(equilibria))
    return methods[0], methods[1]


def _shifts(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    return np.linalg.norm(equilibria.deviation, axis=-1)


def _turns(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    return np.asarray(Rotation.from_matrix(equilibria.rotations).magnitude())


def _directions(equilibria: EquilibriumBatch) -> tuple[str, ...]:
    """Direction of each eigenvalue of the first row; by symmetry the stiffness matrix is diagonal there."""
    state = forces.at(equilibria[0].problem, equilibria.positions[0], equilibria.rotations[0])
    stiffness = np.diag(state.stiffness_matrix) / equilibria.robot.units**2
    return tuple(f"{'along' if i < 3 else 'about'} {'xyzxyz'[i]}" for i in np.argsort(stiffness))


def _difference(static: EquilibriumBatch, settled: EquilibriumBatch, every: int) -> tuple[float, float]:
    """Largest distance between the methods' positions [m], and largest relative difference of eigenvalues."""
    distance = np.abs(static.positions[::every] - settled.positions).max()
    values = static.eigenvalues[::every]
    return float(distance), float((np.abs(values - settled.eigenvalues).max(-1) / values.max(-1)).max())


# The figure


SETTLED = key("MuJoCo, settled", **points(style.INK))
LABEL_SPACING = 1.3
"""Smallest ratio between the heights of two labels on a logarithmic scale."""

SLACK = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH, "lw": 2.2}
"""Line style where cables are slack, as for a slack cable."""


@styled
def draw_pretension(study: Pretension) -> Figure:
    """Stiffness over pretension, slack cables, and the effect of one length error."""
    stiffening, robot = study.stiffening, study.robot
    gain = stiffening.eigenvalues[-1, 0] / stiffening.rigid[0]
    overload = study.wrong[0].short_by(float(robot.force_max[0]))
    figure = canvas(
        13,
        8.2,
        f"Pretension makes IPAnema 1 up to {gain:.0f} times stiffer about its softest axis; one length "
        f"{100 * overload / robot.rest_lengths(robot.home)[ABOVE]:.1f} % too short overloads it",
        f"{robot.name}: 8 cables of 2.5 mm Dyneema, EA = {robot.axial_stiffness[0] / 1e3:.0f} kN, winches of "
        f"{robot.force_max[0]:.0f} N; platform of {robot.mass:g} kg (assumed) commanded to the middle. Pretension p: "
        "rest lengths whose tensions balance the weight and are closest to p. Rotations are weighted by the distance "
        f"of {1e3 * robot.characteristic_length:.0f} mm from the platform's middle to its anchors. Lines: statics; "
        f"hollow points: MuJoCo. Differences below {exponent(study.method_differences[0])} m and "
        f"{exponent(study.method_differences[1])} of the stiffness.",
    )
    grid = figure.add_gridspec(2, 3)
    _robot(figure.add_subplot(grid[0, 0], projection="3d"), study)
    _stiffness(figure.add_subplot(grid[0, 1]), study)
    _pushes(figure.add_subplot(grid[1, 0]), study, turned=False)
    _pushes(figure.add_subplot(grid[1, 1]), study, turned=True)
    _displacements(figure.add_subplot(grid[0, 2]), study)
    _overload(figure.add_subplot(grid[1, 2]), study)
    return figure


def _robot(ax: Axes3D, study: Pretension) -> None:
    """The robot under a downward force, with too little pretension."""
    drawing.draw_frame(ax, study.robot)
    drawing.draw_pose(ax, study.drawn, 0)
    ax.set_box_aspect(tuple(np.diff(study.robot.frame, axis=0)[0]), zoom=0.78)
    ax.zaxis.labelpad = -6
    for axis, (low, high) in zip((ax.xaxis, ax.yaxis, ax.zaxis), study.robot.frame.T, strict=True):
        axis.set_ticks([0, high] if axis is ax.yaxis else [low, high])
    x, y, z = study.drawn.positions[0]
    ax.quiver(x, y, z + 0.75, 0, 0, -0.6, color=style.INK, lw=2, arrow_length_ratio=0.3)
    above = drawing.seen(ax, np.array([x, y, z + 1.1]))
    ax.text2D(*above, f"{FORCE:g} N", transform=ax.transData, fontsize=8.5, ha="center")
    slack = int(study.drawn.slack[0].sum())
    ax.set_title(f"{DRAWN:g} N: {slack} cables slack under a force", loc="left")
    handles = [handle for handle in drawing.pose_legend(slack=True) if "cable" in str(handle.get_label())]
    ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, -0.08), ncols=2)


def _stiffness(ax: Axes, study: Pretension) -> None:
    """Six eigenvalues over pretension, labelled by their directions."""
    one = study.stiffening
    for mode, name in enumerate(one.directions):
        color = style.CABLES[mode]
        ax.plot(one.pretensions, one.eigenvalues[:, mode] / 1e3, color=color, gid=f"static {name}")
        ax.plot(one.settled_pretensions, one.settled[:, mode] / 1e3, **points(color), gid=f"mujoco {name}")
    heights = one.eigenvalues[-1] / 1e3
    for mode in range(1, len(heights)):  # room for each label
        heights[mode] = max(heights[mode], LABEL_SPACING * heights[mode - 1])
    for name, color, height in zip(one.directions, style.CABLES, heights, strict=False):
        ax.annotate(name, (1.04 * one.pretensions[-1], height), color=color, fontsize=8.5, va="center",
                    annotation_clip=False)  # fmt: skip
    rigid = one.rigid[0] / 1e3
    ax.plot(0, rigid, "D", color=style.CABLES[0], ms=5, clip_on=False, zorder=6, gid="rigid")
    ax.annotate(f"{rigid:.2g} kN/m with rigid lengths:\nlower cables slack", (0, rigid), (10, 0),
                textcoords="offset points", fontsize=8.5, va="center", color=style.MUTED)  # fmt: skip
    ax.set(xlabel="pretension [N]", ylabel="stiffness [kN/m]", yscale="log")
    ax.set_xlim(0, 1.02 * one.pretensions[-1])
    ax.set_ylim(0.7 * rigid, 900)
    ax.set_title("Six stiffnesses: rotations gain most")
    ax.legend(handles=[SETTLED], loc="upper left")


def _pushes(ax: Axes, study: Pretension, *, turned: bool) -> None:
    """Displacements under forces, or rotations under torques; dotted where a cable is slack."""
    pushes = [push for push in study.pushes if push.what.startswith("turned") == turned]
    sizes, some = study.stiffening.pretensions, study.stiffening.settled_pretensions
    for push, color, marker in zip(pushes, style.CABLES, style.MARKERS, strict=False):
        values = np.degrees(push.turns) if turned else 1e3 * push.shifts
        settled = np.degrees(push.settled_turns) if turned else 1e3 * push.settled_shifts
        slack = sizes <= push.taut
        at = float(np.interp(push.taut, sizes, values))
        ax.plot([push.taut, *sizes[~slack]], [at, *values[~slack]], color=color, gid=f"static {push.what}")
        ax.plot([*sizes[slack], push.taut], [*values[slack], at], **SLACK | {"color": color}, gid=f"slack {push.what}")
        ax.plot(push.taut, at, marker, color=color, ms=6.5, zorder=7)
        ax.plot(some, settled, **points(color, marker), gid=f"mujoco {push.what}")
        ax.plot([], [], color=color, marker=marker, ms=5, label=f"{push.what}: taut from {push.taut:.0f} N")
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
    for wrong, color, marker in _wrong(study):
        where = "upper" if wrong.cable == ABOVE else "lower"
        ax.plot(1e3 * wrong.errors, 1e3 * wrong.shifts, color=color, gid=f"static {wrong.cable}")
        ax.plot(1e3 * wrong.settled_errors, 1e3 * wrong.settled_shifts, **points(color, marker))
        ax.plot([], [], color=color, marker=marker, ms=5, label=f"{where} cable")
    _along_errors(ax, study)
    ax.set_ylabel("displacement of the platform [mm]")
    ax.set_title(f"One length error, at {HELD:g} N of pretension")
    ax.set_ylim(0, 1.25 * ax.get_ylim()[1])
    ax.legend(loc="upper center", ncols=2)


def _overload(ax: Axes, study: Pretension) -> None:
    """Largest tension of all cables under one length error."""
    for wrong, color, marker in _wrong(study):
        ax.plot(1e3 * wrong.errors, wrong.largest_tensions, color=color, gid=f"static {wrong.cable}")
        ax.plot(1e3 * wrong.settled_errors, wrong.settled_largest_tensions, **points(color, marker))
        first = np.flatnonzero(wrong.slack)
        if first.size:
            at = first[0]
            ax.plot(1e3 * wrong.errors[at], wrong.largest_tensions[at], marker, color=color, ms=6.5, zorder=7)
    limit = study.robot.force_max[0]
    ax.axhline(limit, color=style.INK, lw=1, ls=style.COMMANDED_DASH)
    ax.annotate(f"the winches' {limit:g} N", (1e3 * study.wrong[0].errors[-1], limit), (0, 4), ha="right",
                textcoords="offset points", fontsize=8.5)  # fmt: skip
    short = 1e3 * study.wrong[0].short_by(limit)
    ax.annotate(f"{short:.0f} mm too short", (-short, limit), (12, 22), textcoords="offset points", fontsize=8.5,
                arrowprops={"arrowstyle": "-", "color": style.MUTED, "lw": 0.7})  # fmt: skip
    _along_errors(ax, study)
    ax.set_ylabel("largest tension [N]")
    ax.set_ylim(bottom=0)
    ax.set_title("Largest tension under this length error")
    full = key("from here on it is slack", ls="none", marker="o", color=style.MUTED, ms=6.5)
    ax.legend(handles=[SETTLED, full], loc="lower left")


def _wrong(study: Pretension):
    return zip(study.wrong, (style.BLUE, style.VERMILLION), style.MARKERS, strict=False)


def _along_errors(ax: Axes, study: Pretension) -> None:
    most = 1e3 * study.wrong[0].errors[-1]
    ax.set_xlabel(f"error of its length, {MOST_ERROR:.0%} at the ends [mm]")
    ax.set_xlim(-1.03 * most, 1.03 * most)
    ax.axvline(0, color=style.FAINT, lw=style.HAIR, zorder=0)
