"""Effect of pulleys, cable mass, nonlinear elasticity and drive lines on DemoBot and a large crane, settled in MuJoCo.

Run: python scripts/figures/real_cables.py. It prints two tables and draws
pictures/real-cables.png.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table

import robots_on_axes as drawing
from cdpr_sim.analysis.cable_profiles import cable_profiles
from cdpr_sim.core import cable_path
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of
from cdpr_sim.drawing.figures import canvas, encoded, key, styled
from cdpr_sim.drawing.readable_numbers import exponent
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from robots_on_axes import legend_below, points

OUTPUT = Path(__file__).parents[2] / "pictures" / "real-cables.png"


BELOW, ABOVE = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
"""Direction in which a cable arrives at its pulley: up a mast from a winch below, or down from a winch above."""

POSES, SEED = 200, 1
"""Random level poses of the workspace, per robot."""

DEMOBOT_RADIUS, DEMOBOT_DENSITY, DEMOBOT_BEHIND = 0.01, 0.0005, 0.5
"""[m], [kg/m], [m] Assumed, as the paper gives none: a small ball-bearing wheel; Vectran of 0.7 mm, 1.4 g/cm³; winches
at the floor."""

CRANE_RADIUS, CRANE_DENSITY, CRANE_BEHIND, CRANE_STIFFNESS = 0.1, 0.064, 6.0, 1e6
"""[m], [kg/m], [m], [N] Assumed: wheels of 25 times the rope's diameter; steel rope of 4 mm, about 0.06 kg/m in
manufacturers' tables, and 80 GPa over the full cross-section; winches at the floor."""

STIFFENING = (50.0, 0.0)
"""(a2, a3), assumed: the stiffness doubles at 1 % strain, as for new ropes; used ropes stiffen less."""


def crane() -> Robot:
    """CoGiRo, a suspended crane of 15 m x 11 m x 6 m on 8 crossed cables: the zoo's, with plain cables."""
    return load_robot("cogiro-crane").replace(name="crane", axial_stiffness=CRANE_STIFFNESS, pulley_radius=0.0)


@dataclass(frozen=True, eq=False)
class StudiedRobot:
    """A robot and the assumed properties of its cables.

    Attributes:
        title: name of the robot.
        robot: with plain cables.
        radius: of its pulleys [m].
        density: of its cables [kg/m].
        behind: length of rope between winch and exit [m].
    """

    title: str
    robot: Robot
    radius: float
    density: float
    behind: float

    @property
    def properties(self) -> dict[str, dict[str, ArrayLike]]:
        """The changes of the plain robot that each property is."""
        return {
            AWARE: {"pulley_radius": self.radius, "pulley_axis": BELOW},
            MASS: {"linear_density": self.density},
            NONLINEAR: {"stiffening": STIFFENING},
            BEHIND: {"winch_to_exit": self.behind},
        }

    def commanded(self, poses: int = POSES) -> Float[np.ndarray, "poses 3"]:
        """Random level positions of its workspace [m]."""
        return np.random.default_rng(SEED).uniform(self.robot.workspace[0], self.robot.workspace[1], (poses, 3))


def cases() -> tuple[StudiedRobot, ...]:
    """DemoBot's two layouts, and the crane."""
    demobot = DEMOBOT_RADIUS, DEMOBOT_DENSITY, DEMOBOT_BEHIND
    return (
        StudiedRobot("DemoBot, crossed (cogiro)", load_robot("cogiro"), *demobot),
        StudiedRobot("DemoBot, parallel", load_robot("parallel"), *demobot),
        StudiedRobot("crane of 15 m", crane(), CRANE_RADIUS, CRANE_DENSITY, CRANE_BEHIND),
    )


def point_exit_lengths(robot: Robot, commanded: ArrayLike) -> Float[np.ndarray, "poses cables"]:
    """Rest lengths [m] of cables over pulleys, commanded by winches that assume point exits.

    They are correct at the middle of the workspace, where the robot is homed; changes are those of straight cables.
    """
    points = robot.replace(pulley_radius=0.0)
    commanded, home = np.asarray(commanded, dtype=float), robot.home[None]
    level = np.eye(3)[None]

    def straight(positions: np.ndarray) -> np.ndarray:
        return cable_path.lengths(points.cabling, positions, np.broadcast_to(level, (len(positions), 3, 3)))

    return straight(commanded) + cable_path.lengths(robot.cabling, home, level) - straight(home)


@dataclass(frozen=True, eq=False)
class CableEffect:
    """Displacement of platforms by a property of their cables, or by its use in the winches' model.

    Attributes:
        robot: name of the robot.
        what: the property.
        shifts: displacements in MuJoCo, (settled,) [m].
        turns: changes of tilt in MuJoCo, (settled,) [rad].
        method_difference: largest distance between MuJoCo and statics over these poses [m].
        unsettled: number of poses left out, since MuJoCo did not settle.
    """

    robot: str
    what: str
    shifts: Float[np.ndarray, " poses"]
    turns: Float[np.ndarray, " poses"]
    method_difference: float
    unsettled: int


UNAWARE, UNAWARE_ABOVE = "pulleys unknown to the winches", "the same, cables from above"
ELASTICITY, AWARE = "elasticity", "pulleys known to the winches"
MASS, NONLINEAR, BEHIND = "mass of the cables", "nonlinear elasticity", "rope behind the exits"


def effects(case: StudiedRobot, poses: int = POSES) -> tuple[CableEffect, ...]:
    """Effect of each property of the cables separately.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
    """
    robot, commanded = case.robot, case.commanded(poses)
    from_above = robot.replace(pulley_radius=case.radius, pulley_axis=ABOVE)
    plain, aware_above = (both(one, commanded) for one in (robot, from_above))
    changed = {what: both(robot.replace(**changes), commanded) for what, changes in case.properties.items()}
    over = robot.replace(**case.properties[AWARE])
    unaware = both(over, commanded, point_exit_lengths(over, commanded))
    unaware_above = both(from_above, commanded, point_exit_lengths(from_above, commanded))
    pairs = {
        UNAWARE: (unaware, changed[AWARE]),
        UNAWARE_ABOVE: (unaware_above, aware_above),
        ELASTICITY: (plain, None),
        **{what: (one, plain) for what, one in changed.items()},
    }
    return tuple(effect_of(case.title, what, *pair) for what, pair in pairs.items())


@dataclass(frozen=True, eq=False)
class Growth:
    """Position error caused by pulleys unknown to the winches, over their radius.

    Attributes:
        title: of the robot.
        axis: ``BELOW`` or ``ABOVE``.
        radii: (radii,) [m].
        shifts: by statics, (radii, poses) [m].
        settled_radii: every few of them, (some,) [m].
        settled: by MuJoCo, (some, poses) [m].
    """

    title: str
    axis: tuple[float, float, float]
    radii: Float[np.ndarray, " radii"]
    shifts: Float[np.ndarray, "radii poses"]
    settled_radii: Float[np.ndarray, " some"]
    settled: Float[np.ndarray, "some poses"]

    @property
    def rate(self) -> float:
        """Median error per radius, at the middle radius."""
        middle = len(self.radii) // 2
        return float(np.median(self.shifts[middle]) / self.radii[middle])


def growth(case: StudiedRobot, axis: tuple[float, float, float] = BELOW, *, poses: int = POSES) -> Growth:
    """Position errors for radii from 0 to three times that of the case.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    commanded = case.commanded(poses)
    sizes = np.linspace(0, 3 * case.radius, 13)

    def shifts(method, radius: float) -> np.ndarray:
        robot = case.robot.replace(pulley_radius=radius, pulley_axis=axis)
        unaware = method(robot, commanded, point_exit_lengths(robot, commanded))
        return np.linalg.norm(all_solved(unaware).positions - all_solved(method(robot, commanded)).positions, axis=-1)

    return Growth(
        title=case.title,
        axis=axis,
        radii=sizes,
        shifts=np.array([shifts(solve_many, radius) for radius in sizes]),
        settled_radii=sizes[::4],
        settled=np.array([shifts(settle_many, radius) for radius in sizes[::4]]),
    )


@dataclass(frozen=True, eq=False)
class RealCables:
    """The whole study.

    Attributes:
        effects: of each robot and property.
        growths: position error over the pulleys' radius.
        over_pulleys: DemoBot with pulleys unknown to its winches, by MuJoCo, (1,).
        with_mass: the crane, with cables with mass, by MuJoCo, (1,).
    """

    effects: tuple[CableEffect, ...]
    growths: tuple[Growth, ...]
    over_pulleys: EquilibriumBatch
    with_mass: EquilibriumBatch


def real_cables(poses: int = POSES) -> RealCables:
    """Compute the data of the figure.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    crossed, parallel, large = cases()
    over = crossed.robot.replace(pulley_radius=2 * crossed.radius, pulley_axis=BELOW)
    aside = np.array([[0.2, over.home[1], 0.15]])
    corner = np.array([[-5.0, -3.5, 3.5]])
    return RealCables(
        effects=tuple(effect for case in (crossed, parallel, large) for effect in effects(case, poses)),
        growths=(
            growth(crossed, poses=poses),
            growth(parallel, poses=poses),
            growth(crossed, ABOVE, poses=poses),
            growth(large, poses=poses),
        ),
        over_pulleys=all_solved(settle_many(over, aside, point_exit_lengths(over, aside))),
        with_mass=all_solved(settle_many(large.robot.replace(linear_density=large.density), corner)),
    )


def both(
    robot: Robot, commanded: np.ndarray, rest_lengths: np.ndarray | None = None
) -> tuple[EquilibriumBatch, EquilibriumBatch]:
    """Equilibria by MuJoCo and by statics."""
    problems = Problems.of(robot, commanded, rest_lengths)
    return settle_many(problems), all_solved(solve_many(problems))


def effect_of(
    title: str,
    what: str,
    changed: tuple[EquilibriumBatch, EquilibriumBatch],
    reference: tuple[EquilibriumBatch, EquilibriumBatch] | None,
) -> CableEffect:
    """Displacement from ``reference``, or from the commanded poses, by equilibria of ``both`` methods."""
    pairs = [changed] if reference is None else [changed, reference]
    rows = np.all([settled.converged for settled, _ in pairs], axis=0)
    difference = max(float(np.linalg.norm(a.positions - b.positions, axis=-1)[rows].max()) for a, b in pairs)
    settled = changed[0]
    start, tilt = (
        (settled.problems.positions, 0.0) if reference is None else (reference[0].positions, reference[0].tilt)
    )
    shifts, turns = np.linalg.norm(settled.positions - start, axis=-1), np.abs(settled.tilt - tilt)
    return CableEffect(title, what, shifts[rows], turns[rows], difference, int((~rows).sum()))


# The figure


COLORS = (style.BLUE, style.VERMILLION, style.GREEN)
"""Colours of the robots, in the study's order."""

ROWS = {
    UNAWARE: "pulleys unknown\nto the winches",
    UNAWARE_ABOVE: "…, cables arriving\nfrom above",
    ELASTICITY: "elasticity",
    AWARE: "pulleys known\nto the winches",
    MASS: "mass of the cables",
    NONLINEAR: "nonlinear elasticity",
    BEHIND: "rope behind\nthe exits",
}
"""Labels of the rows."""


@styled
def draw_real_cables(study: RealCables) -> Figure:
    """Real cables: examples, and the displacement of the platform by each of their properties."""
    rates = [one.rate for one in study.growths if one.axis == BELOW][:2]
    figure = canvas(
        style.WIDTH,
        8.2,
        f"Pulleys unknown to the winches cause an error of about {np.mean(rates):.1f} mm per mm of radius; cable mass "
        "and nonlinear elasticity have little effect",
        "Settled in MuJoCo; statics differs by less than "
        f"{exponent(max(effect.method_difference for effect in study.effects))} m. DemoBot: 10 mm pulleys, 0.5 g/m, "
        "0.5 m behind the exits; "
        "crane (geometry and 91 kg of CoGiRo, by CASPR): 100 mm pulleys, 4 mm steel rope, 64 g/m, EA = 1 MN, 6 m; "
        "EA doubles at 1 % strain: all these are assumed. Cables arrive from below, up masts, unless stated "
        f"otherwise. {len(study.effects[0].shifts)} random commanded poses per robot; homed at the middle."
        f"{_left_out(study.effects)}",
    )
    columns = figure.add_gridspec(1, 2, width_ratios=(1, 1.1))
    left, right = columns[0].subgridspec(2, 1, height_ratios=(1.55, 1)), columns[1].subgridspec(2, 1)
    _pulleys(figure.add_subplot(left[0]), study.over_pulleys)
    _ropes_with_mass(figure.add_subplot(left[1]), study.with_mass)
    _growth(figure.add_subplot(right[0]), study.growths)
    _effects(figure.add_subplot(right[1]), study.effects)
    return figure


def _pulleys(ax: Axes, equilibria: EquilibriumBatch) -> None:
    """DemoBot with pulleys, and its commanded pose with point exits."""
    robot, position, rotation = equilibria.robot, equilibria.positions[0], equilibria.rotations[0]
    drawing.draw_frame(ax, robot)
    commanded = equilibria.problems.positions[0]
    for exit_, anchor in zip(robot.exits, commanded + robot.anchors, strict=True):
        ax.plot([exit_[0], anchor[0]], [exit_[2], anchor[2]], color=style.COMMANDED, lw=0.6, ls=style.COMMANDED_DASH)
    drawing.draw_pose(ax, equilibria, 0)
    off = 1e3 * np.linalg.norm(position - commanded)
    radius = 1e3 * robot.cabling.pulley_radius.max()
    ax.set_ylim(-0.02, 0.56)
    ax.set_title(f"DemoBot with {radius:.0f} mm pulleys\nunknown to its winches: error of {off:.0f} mm")
    handles = drawing.pose_legend(slack=bool(equilibria.slack.any()))
    handles[0] = key("commanded, with point exits", color=style.COMMANDED, lw=0.9, ls=style.COMMANDED_DASH)
    legend_below(ax, [*handles, Patch(**style.WHEEL, label="pulley")], 0.2)
    # One exit, closer.
    cable = int(np.argmin(robot.exits @ [1.0, 1.0, 0.0]))
    near, anchor = ax.inset_axes((0.6, 0.05, 0.37, 0.42)), position + rotation @ robot.anchors[cable]
    wheel = wheel_of(robot.cabling, cable, anchor)
    if wheel is None:
        return
    # In the wheel's own plane: outwards and upwards from the exit.
    flat = np.array([wheel.outwards, wheel.axis])
    curves = wheel.arc(), cable_curve(robot.cabling, cable, anchor)
    rim, curve = ((points - robot.exits[cable]) @ flat.T for points in curves)
    near.fill(*rim.T, fc=style.WHEEL["fc"], ec=style.WHEEL["ec"], lw=1)
    near.plot([0, 0], [-3 * wheel.radius, 0], color=style.INK, lw=1.2)
    near.plot(*curve.T, color=style.INK, lw=1.2)
    near.plot([0, curve[-1, 0]], [0, curve[-1, 1]], color=style.COMMANDED, lw=1, ls=style.COMMANDED_DASH)
    near.plot(0, 0, "o", color=style.INK, ms=3.5)
    near.set(aspect="equal", xticks=[], yticks=[])
    near.set_xlim(-1.2 * wheel.radius, 3.4 * wheel.radius)
    near.set_ylim(-2.6 * wheel.radius, 1.4 * wheel.radius)
    near.set_title("one pulley from its side", fontsize=8, loc="center", bbox={"fc": "white", "ec": "none", "pad": 1})
    near.spines[:].set(visible=True, color=style.FAINT)


def _ropes_with_mass(ax: Axes, equilibria: EquilibriumBatch) -> None:
    """The crane with the profiles of its ropes."""
    robot, position, rotation = equilibria.robot, equilibria.positions[0], equilibria.rotations[0]
    shapes = cable_profiles(equilibria)[0]
    drawing.draw_frame(ax, robot)
    drawing.draw_platform(ax, robot, position, rotation)
    drawing.draw_cables(ax, robot, position, rotation, equilibria.slack[0], shapes=shapes)
    along = np.linspace(0, 1, shapes.shape[1])
    chords = shapes[:, :1] + along[:, None] * (shapes[:, -1:] - shapes[:, :1])
    sags = 1e3 * (chords - shapes)[..., 2]
    ax.set_title(f"The crane on steel ropes, with a sag of {sags.max(1).min():.0f} to {sags.max(1).max():.0f} mm")
    # The same profiles, with the sag enlarged.
    near = ax.inset_axes((0.52, 0.14, 0.45, 0.36))
    for sag, slack in zip(sags, equilibria.slack[0], strict=True):
        looks = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH} if slack else {"color": style.INK}
        near.plot(along, -sag, lw=1.0, **looks)
    near.set_title("sag [mm], from exit to anchor", fontsize=8, loc="center")
    near.tick_params(labelsize=7.5)
    near.set_xticks([])
    if equilibria.slack.any():
        taut = key("taut rope", color=style.INK, lw=style.HAIR + 0.2)
        ax.legend(handles=[taut, drawing.slack_key("slack rope")], loc="lower left", bbox_to_anchor=(0.16, 0.0))


def _growth(ax: Axes, growths: tuple[Growth, ...]) -> None:
    """Position error over radius: DemoBot as curves; the crane, ten times larger, in the legend only."""
    colors = dict(zip(dict.fromkeys(one.title for one in growths), COLORS, strict=False))
    for one in growths:
        if one.title.startswith("crane"):
            continue
        color, from_below = colors[one.title], one.axis == BELOW
        radii = 1e3 * one.radii
        low, middle, high = 1e3 * np.quantile(one.shifts, [0.05, 0.5, 0.95], axis=1)
        arriving = "from below" if from_below else "from above"
        layout = one.title.removeprefix("DemoBot, ").split(" (")[0]  # the rest is in other panels
        label = f"{layout}, {arriving}: {one.rate:.2f} mm per mm"
        dashes = style.DASHES[0 if from_below else 1]
        ax.fill_between(radii, low, high, color=color, alpha=0.10 if from_below else 0.05, lw=0)
        ax.plot(radii, middle, color=color, ls=dashes, label=label, gid=f"static {one.title} {arriving}")
        settled = 1e3 * np.median(one.settled, axis=1)
        marker = style.MARKERS[list(colors).index(one.title)]
        ax.plot(1e3 * one.settled_radii, settled, **points(color, marker), gid=f"mujoco {one.title} {arriving}")
    crane = next((one for one in growths if one.title.startswith("crane")), None)
    if crane is not None:
        ax.plot([], [], ls="none", label=f"crane (not drawn), from below: {crane.rate:.2f}")
    ax.set(xlabel="radius of the pulleys [mm]", ylabel="position error [mm]")
    ax.set_ylim(0, 1.4 * ax.get_ylim()[1])
    ax.set_xlim(0, 1e3 * growths[0].radii[-1])
    ax.set_title("DemoBot, with rest lengths for point exits")
    handles, labels = ax.get_legend_handles_labels()
    handles += [Patch(fc=style.FAINT, alpha=0.6), Line2D([], [], **points(style.INK))]
    ax.legend(handles, [*labels, "from 5 to 95 % of the poses; lines: median", "MuJoCo, settled"], loc="upper left")


def _effects(ax: Axes, effects: tuple[CableEffect, ...]) -> None:
    """A row per property, a point per robot: the median, with a line up to the 95 % quantile."""
    titles = list(dict.fromkeys(effect.robot for effect in effects))
    names = list(ROWS)[::-1]
    for effect in effects:
        robot = titles.index(effect.robot)
        height = names.index(effect.what) + 0.22 * (1 - robot)
        middle, high = 1e3 * np.quantile(effect.shifts, [0.5, 0.95])
        ax.plot(
            [middle, high], [height, height], color=COLORS[robot], lw=1.2, gid=f"range {effect.robot} {effect.what}"
        )
        marker = points(COLORS[robot], style.MARKERS[robot], ms=5.5)
        ax.plot(middle, height, **marker, gid=f"median {effect.robot} {effect.what}")
    ax.set(xscale="log", xlabel="displacement of the platform:\nmedian, and up to 95 % of the poses [mm]")
    ax.set_yticks(range(len(names)), [ROWS[name] for name in names])
    ax.grid(axis="x")
    ax.set_title("Effect of each property separately, in MuJoCo")
    handles = [
        key(title, **points(COLORS[i], style.MARKERS[i], ms=5.5) | {"ls": "-", "color": COLORS[i]})
        for i, title in enumerate(titles)
    ]
    ax.legend(handles=handles, loc="upper left")
    ax.set_xlim(right=100)


def _left_out(effects: tuple[CableEffect, ...]) -> str:
    missing = sum(effect.unsettled for effect in effects)
    return f" Left out: {missing} poses at which MuJoCo did not settle." if missing else ""


TOGETHER = "all together"


def together(case: StudiedRobot, poses: int = POSES) -> tuple[CableEffect, ...]:
    """Effect of all properties of the cables together, and by how much each of them changes that equilibrium.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
    """
    robot, commanded = case.robot, case.commanded(poses)

    def with_all_but(left_out: str) -> tuple[EquilibriumBatch, EquilibriumBatch]:
        changes = [changes for what, changes in case.properties.items() if what != left_out]
        return both(robot.replace(**{name: value for one in changes for name, value in one.items()}), commanded)

    whole = with_all_but("")
    effects = [effect_of(case.title, TOGETHER, whole, both(robot, commanded))]
    effects += [effect_of(case.title, f"without {what}", with_all_but(what), whole) for what in case.properties]
    return tuple(effects)


def effects_table(effects: Sequence[CableEffect]) -> Table:
    """A row for each robot and property: displacement of the platform, and difference between the methods."""
    poses = max(len(effect.shifts) for effect in effects)
    table = new_table(
        f"Displacement of the platform, over {poses} poses, settled in MuJoCo",
        "", "mm\nmedian", "mm\n95 %", "tilt °\nmedian", "tilt °\n95 %", "method\ndiff.\nnm", dense=True,
    )  # fmt: skip
    last = ""
    for effect in effects:
        if effect.robot != last:
            if last:
                table.add_section()
            table.add_row(effect.robot, style="bold")
        shifts, turns = (np.quantile(values, [0.5, 0.95]) for values in (1e3 * effect.shifts, np.degrees(effect.turns)))
        table.add_row(
            f"  {effect.what}",
            *map(_short, (*shifts, *turns)),
            _short(1e9 * effect.method_difference),
        )
        last = effect.robot
    return table


def _short(value: float) -> str:
    """Two or three digits."""
    return f"{value:.3g}" if value >= 1 else f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}"


def left_out(effects: Sequence[CableEffect]) -> str:
    """Number of poses at which MuJoCo's platform did not settle; empty if none."""
    missing = [f"{one.unsettled} ({one.robot}, {one.what})" for one in effects if one.unsettled]
    return f"Poses left out because MuJoCo's platform did not settle: {', '.join(missing)}." if missing else ""


def main() -> None:
    console, study = Console(), real_cables(POSES)
    for effects in (study.effects, together(cases()[-1], POSES)):
        console.print(effects_table(effects))
        if left_out(effects):
            console.print(left_out(effects), highlight=False)
    for one in study.growths:
        arriving = "from below" if one.axis == BELOW else "from above"
        console.print(f"{one.title}, cables arriving {arriving}: {one.rate:.2f} mm per mm of radius", highlight=False)
    OUTPUT.parent.mkdir(exist_ok=True)
    write_whole({OUTPUT: encoded(draw_real_cables(study))})
    print(OUTPUT.name)


if __name__ == "__main__":
    main()
