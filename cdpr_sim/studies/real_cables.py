"""Effects of real cables on a platform, by both methods: each of pulleys, mass, nonlinear elasticity, drive line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.analysis.cable_profiles import cable_profiles
from cdpr_sim.core import cable_path
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.studies.lines import all_solved

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
class Case:
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


def cases() -> tuple[Case, ...]:
    """DemoBot's two layouts, and the crane."""
    demobot = DEMOBOT_RADIUS, DEMOBOT_DENSITY, DEMOBOT_BEHIND
    return (
        Case("DemoBot, crossed (cogiro)", load_robot("cogiro"), *demobot),
        Case("DemoBot, parallel", load_robot("parallel"), *demobot),
        Case("crane of 15 m", crane(), CRANE_RADIUS, CRANE_DENSITY, CRANE_BEHIND),
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


def effects(case: Case, poses: int = POSES) -> tuple[CableEffect, ...]:
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


def growth(
    case: Case, axis: tuple[float, float, float] = BELOW, *, radii: int = 13, every: int = 4, poses: int = POSES
) -> Growth:
    """Position errors for radii from 0 to three times that of the case.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    commanded = case.commanded(poses)
    sizes = np.linspace(0, 3 * case.radius, radii)

    def shifts(method, radius: float) -> np.ndarray:
        robot = case.robot.replace(pulley_radius=radius, pulley_axis=axis)
        unaware = method(robot, commanded, point_exit_lengths(robot, commanded))
        return np.linalg.norm(all_solved(unaware).positions - all_solved(method(robot, commanded)).positions, axis=-1)

    return Growth(
        title=case.title,
        axis=axis,
        radii=sizes,
        shifts=np.array([shifts(solve_many, radius) for radius in sizes]),
        settled_radii=sizes[::every],
        settled=np.array([shifts(settle_many, radius) for radius in sizes[::every]]),
    )


@dataclass(frozen=True, eq=False)
class CableExample:
    """An equilibrium by MuJoCo, to be drawn.

    Attributes:
        equilibria: a single row.
        shapes: profiles of its cables, (cables, points, 3) [m].
    """

    equilibria: EquilibriumBatch
    shapes: Float[np.ndarray, "cables points 3"]


@dataclass(frozen=True, eq=False)
class RealCables:
    """The whole study.

    Attributes:
        effects: of each robot and property.
        growths: position error over the pulleys' radius.
        over_pulleys: DemoBot with pulleys unknown to its winches.
        with_mass: the crane, with cables with mass.
    """

    effects: tuple[CableEffect, ...]
    growths: tuple[Growth, ...]
    over_pulleys: CableExample
    with_mass: CableExample


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
        over_pulleys=_example(over, aside, point_exit_lengths(over, aside)),
        with_mass=_example(large.robot.replace(linear_density=large.density), corner),
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


def _example(robot: Robot, commanded: np.ndarray, rest_lengths: np.ndarray | None = None) -> CableExample:
    equilibria = all_solved(settle_many(robot, commanded, rest_lengths))
    return CableExample(equilibria, cable_profiles(equilibria)[0])
