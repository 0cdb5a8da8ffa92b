"""What real cables do to a platform: pulleys, weight and a stiffening law, each by itself, by both methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from cdpr_sim.analysis.cable_profiles import cable_profiles
from cdpr_sim.core import cable_path
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.studies.lines import PAPER_HEIGHTS, PAPER_LINE, PAPER_SAG

BELOW, ABOVE = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
"""Where a cable comes from to its pulley, as the direction in which it arrives: up a mast from a winch on the ground,
or down from one above."""

POSES, SEED = 200, 1
"""Random level poses of the workspace, per robot."""

DEMOBOT_RADIUS, DEMOBOT_DENSITY = 0.01, 0.0005
"""[m], [kg/m] Assumed, as the paper gives neither: a small ball-bearing wheel; Vectran of 0.7 mm, 1.4 g/cm³."""

CRANE_RADIUS, CRANE_DENSITY, CRANE_STIFFNESS = 0.1, 0.064, 1e6
"""[m], [kg/m], [N] Assumed: wheels of 25 times the rope's diameter; steel rope of 4 mm, some 0.06 kg/m in makers'
tables, and 80 GPa over the whole of its cross-section."""

STIFFENING = (50.0, 0.0)
"""(a2, a3), assumed: the stiffness doubles by 1 % of strain. New ropes stiffen that much, ones in use less."""


def crane() -> Robot:
    """CoGiRo, a suspended crane of 15 m x 11 m x 6 m on 8 crossed cables: the zoo's, with plain cables."""
    return load_robot("cogiro-crane").replace(name="crane", axial_stiffness=CRANE_STIFFNESS, pulley_radius=0.0)


@dataclass(frozen=True, eq=False)
class Case:
    """A robot, and what its cables are said to be like.

    Attributes:
        title: what the robot is called.
        robot: with plain cables.
        radius: of its pulleys [m].
        density: of its cables [kg/m].
    """

    title: str
    robot: Robot
    radius: float
    density: float

    def commanded(self, poses: int = POSES) -> Float[np.ndarray, "poses 3"]:
        """Random level positions of its workspace [m]."""
        return np.random.default_rng(SEED).uniform(self.robot.workspace[0], self.robot.workspace[1], (poses, 3))


def cases() -> tuple[Case, ...]:
    """DemoBot's two layouts, and the crane."""
    demobot = DEMOBOT_RADIUS, DEMOBOT_DENSITY
    return (
        Case("DemoBot, crossed (cogiro)", load_robot("cogiro"), *demobot),
        Case("DemoBot, parallel", load_robot("parallel"), *demobot),
        Case("crane of 15 m", crane(), CRANE_RADIUS, CRANE_DENSITY),
    )


def lengths_as_if_for_points(robot: Robot, commanded: ArrayLike) -> Float[np.ndarray, "poses cables"]:
    """Rest lengths [m] by which winches let cables over pulleys out that believe in point exits.

    Homed at the middle of the workspace: there they are right. The change from there is that of straight cables.
    """
    points = robot.replace(pulley_radius=0.0)
    commanded, home = np.asarray(commanded, dtype=float), robot.home[None]
    level = np.eye(3)[None]

    def straight(positions: np.ndarray) -> np.ndarray:
        return cable_path.lengths(points.cabling, positions, np.broadcast_to(level, (len(positions), 3, 3)))

    return straight(commanded) + cable_path.lengths(robot.cabling, home, level) - straight(home)


@dataclass(frozen=True, eq=False)
class CableEffect:
    """How far platforms move when a property of their cables is taken in, or told to the winches.

    Attributes:
        robot: what the robot is called.
        what: the property.
        shifts: distances by which the platforms move, in MuJoCo, (settled,) [m].
        turns: by how much their tilts change, in MuJoCo, (settled,) [rad].
        apart: the largest distance between MuJoCo and statics over all these poses [m].
        unsettled: how many poses are left out, since MuJoCo's platform did not come to rest there.
    """

    robot: str
    what: str
    shifts: Float[np.ndarray, " poses"]
    turns: Float[np.ndarray, " poses"]
    apart: float
    unsettled: int


UNAWARE, UNAWARE_ABOVE = "pulleys unknown to the winches", "the same, cables from above"
ELASTICITY, AWARE, WEIGHT, LAW = "elasticity", "pulleys known to the winches", "weight", "stiffening"


def effects(case: Case, poses: int = POSES) -> tuple[CableEffect, ...]:
    """Each property of the cables by itself.

    Raises:
        NotConverged: the static solver found no rest somewhere.
    """
    robot, commanded = case.robot, case.commanded(poses)
    over = robot.replace(pulley_radius=case.radius, pulley_axis=BELOW)
    from_above = robot.replace(pulley_radius=case.radius, pulley_axis=ABOVE)
    plain, aware, aware_above = (_both(one, commanded) for one in (robot, over, from_above))
    unaware = _both(over, commanded, lengths_as_if_for_points(over, commanded))
    unaware_above = _both(from_above, commanded, lengths_as_if_for_points(from_above, commanded))
    weight = _both(robot.replace(linear_density=case.density), commanded)
    law = _both(robot.replace(stiffening=STIFFENING), commanded)
    pairs = {
        UNAWARE: (unaware, aware),
        UNAWARE_ABOVE: (unaware_above, aware_above),
        ELASTICITY: (plain, None),
        AWARE: (aware, plain),
        WEIGHT: (weight, plain),
        LAW: (law, plain),
    }
    return tuple(_effect(case.title, what, *pair) for what, pair in pairs.items())


@dataclass(frozen=True, eq=False)
class Growth:
    """The error that pulleys cause of which the winches do not know, against their radius.

    Attributes:
        title: of the robot.
        axis: ``BELOW`` or ``ABOVE``.
        radii: (radii,) [m].
        shifts: by statics, (radii, poses) [m].
        settled_radii: every few of them, (some,) [m].
        settled: the same by MuJoCo, (some, poses) [m].
    """

    title: str
    axis: tuple[float, float, float]
    radii: Float[np.ndarray, " radii"]
    shifts: Float[np.ndarray, "radii poses"]
    settled_radii: Float[np.ndarray, " some"]
    settled: Float[np.ndarray, "some poses"]

    @property
    def rate(self) -> float:
        """Median error per radius, at the middle of the radii."""
        middle = len(self.radii) // 2
        return float(np.median(self.shifts[middle]) / self.radii[middle])


def growth(
    case: Case, axis: tuple[float, float, float] = BELOW, *, radii: int = 13, every: int = 4, poses: int = POSES
) -> Growth:
    """Radii from none to thrice the case's own.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    commanded = case.commanded(poses)
    sizes = np.linspace(0, 3 * case.radius, radii)

    def shifts(method, radius: float) -> np.ndarray:
        robot = case.robot.replace(pulley_radius=radius, pulley_axis=axis)
        unaware = method(robot, commanded, lengths_as_if_for_points(robot, commanded))
        return np.linalg.norm(_at_rest(unaware).positions - _at_rest(method(robot, commanded)).positions, axis=-1)

    return Growth(
        title=case.title,
        axis=axis,
        radii=sizes,
        shifts=np.array([shifts(solve_many, radius) for radius in sizes]),
        settled_radii=sizes[::every],
        settled=np.array([shifts(settle_many, radius) for radius in sizes[::every]]),
    )


@dataclass(frozen=True, eq=False)
class PaperEnd:
    """What a property of the cables makes of the ends of the paper's lines, in MuJoCo.

    Attributes:
        what: the property.
        sags: of the parallel layout, per height, (heights,) [m].
        tilts: of the parallel layout, (heights,) [rad].
        crossed_rises: deviations in z of the crossed layout, which the paper saw follow its line, (heights,) [m].
    """

    what: str
    sags: Float[np.ndarray, " heights"]
    tilts: Float[np.ndarray, " heights"]
    crossed_rises: Float[np.ndarray, " heights"]


def paper_ends(heights: Sequence[float] = PAPER_HEIGHTS) -> tuple[PaperEnd, ...]:
    """The paper's 15 mm: does any property of the cables explain it? Lengths as if for points, as the paper's are.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    enough = radius_for_sag(PAPER_SAG, heights[0])
    known = {
        "plain cables": {},
        f"weight, {1e3 * DEMOBOT_DENSITY:g} g/m": {"linear_density": DEMOBOT_DENSITY},
        f"stiffening, a2 = {STIFFENING[0]:g}": {"stiffening": STIFFENING},
        f"pulleys of {1e3 * DEMOBOT_RADIUS:g} mm": {"pulley_radius": DEMOBOT_RADIUS, "pulley_axis": BELOW},
        "the same, from above": {"pulley_radius": DEMOBOT_RADIUS, "pulley_axis": ABOVE},
        f"pulleys of {1e3 * enough:.0f} mm, from above": {"pulley_radius": enough, "pulley_axis": ABOVE},
    }
    found = []
    for what, changes in known.items():
        ends = {
            name: _end(load_robot(name).replace(**changes), heights, settle_many) for name in ("parallel", "cogiro")
        }
        parallel, crossed = ends["parallel"], ends["cogiro"]
        found.append(PaperEnd(what, -parallel.deviation[:, 2], parallel.tilt, crossed.deviation[:, 2]))
    return tuple(found)


def radius_for_sag(sag: float, height: float) -> float:
    """Of pulleys with cables from above [m] with which the parallel layout hangs that low at the line's end."""

    def missing(radius: float) -> float:
        robot = load_robot("parallel").replace(pulley_radius=radius, pulley_axis=ABOVE)
        return float(-_end(robot, (height,), solve_many).deviation[0, 2]) - sag

    return float(brentq(missing, 0.0, 0.09, xtol=1e-5))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class CableExample:
    """A platform to be drawn, settled by MuJoCo.

    Attributes:
        equilibria: a single row.
        shapes: how its cables hang, (cables, points, 3) [m].
    """

    equilibria: EquilibriumBatch
    shapes: Float[np.ndarray, "cables points 3"]


@dataclass(frozen=True, eq=False)
class RealCables:
    """All of the study.

    Attributes:
        effects: of each robot and property.
        growths: of the pulleys' error with their radius.
        over_pulleys: DemoBot over pulleys that its winches do not know.
        heavy: the crane, with cables with mass.
        ends: of the paper's lines.
    """

    effects: tuple[CableEffect, ...]
    growths: tuple[Growth, ...]
    over_pulleys: CableExample
    heavy: CableExample
    ends: tuple[PaperEnd, ...]


def real_cables(poses: int = POSES) -> RealCables:
    """Everything that the figure and the table show.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
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
        over_pulleys=_example(over, aside, lengths_as_if_for_points(over, aside)),
        heavy=_example(large.robot.replace(linear_density=large.density), corner),
        ends=paper_ends(),
    )


def _end(robot: Robot, heights: Sequence[float], method) -> EquilibriumBatch:
    """At the left end of the paper's line, per height; lengths as if for points."""
    commanded = np.array([[PAPER_LINE[0], robot.home[1], height] for height in heights])
    return _at_rest(method(robot, commanded, lengths_as_if_for_points(robot, commanded)))


def _both(
    robot: Robot, commanded: np.ndarray, rest_lengths: np.ndarray | None = None
) -> tuple[EquilibriumBatch, EquilibriumBatch]:
    """By MuJoCo and by statics."""
    problems = Problems.of(robot, commanded, rest_lengths)
    return settle_many(problems), _at_rest(solve_many(problems))


def _at_rest(equilibria: EquilibriumBatch) -> EquilibriumBatch:
    for row in np.flatnonzero(~equilibria.converged):
        equilibria[int(row)]  # raises, with the reason
    return equilibria


def _effect(
    title: str,
    what: str,
    found: tuple[EquilibriumBatch, EquilibriumBatch],
    beside: tuple[EquilibriumBatch, EquilibriumBatch] | None,
) -> CableEffect:
    pairs = [found] if beside is None else [found, beside]
    rows = np.all([settled.converged for settled, _ in pairs], axis=0)
    apart = max(float(np.linalg.norm(a.positions - b.positions, axis=-1)[rows].max()) for a, b in pairs)
    settled = found[0]
    start, tilt = (settled.problems.positions, 0.0) if beside is None else (beside[0].positions, beside[0].tilt)
    shifts, turns = np.linalg.norm(settled.positions - start, axis=-1), np.abs(settled.tilt - tilt)
    return CableEffect(title, what, shifts[rows], turns[rows], apart, int((~rows).sum()))


def _example(robot: Robot, commanded: np.ndarray, rest_lengths: np.ndarray | None = None) -> CableExample:
    equilibria = _at_rest(settle_many(robot, commanded, rest_lengths))
    return CableExample(equilibria, cable_profiles(equilibria)[0])
