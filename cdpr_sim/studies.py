"""What the figures show, computed: where robots rest along the paper's lines, by both roads, and how solvers fare.

Each study returns a frozen result that knows what was asked. The static road answers densely, for lines; MuJoCo
sparsely, for points; neither is interpolated or corrected by the other.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim import newton, settling, solvers, statics, two_cable
from cdpr_sim.agreement import Verdict, compare
from cdpr_sim.catalog import list_robots, load_robot
from cdpr_sim.equilibrium import Stability
from cdpr_sim.errors import NotConverged
from cdpr_sim.materials import MATERIALS
from cdpr_sim.pose import euler
from cdpr_sim.robot import Robot

PAPER_LINE = (0.17, 0.63)
"""[m] From where to where along x the paper's trajectories go (section IV)."""

PAPER_HEIGHTS = (0.1, 0.2)
"""[m] The heights z of the paper's trajectories."""

PAPER_TILT, PAPER_SAG = np.radians(20.0), 0.015
"""[rad], [m] Tilt and deviation in z at both ends of the paper's lines, parallel layout, either cable: "approximately
20°" and "about 15 mm". Read from the paper's text (section IV), not from its data."""


# What both roads answer


@dataclass(frozen=True, eq=False)
class Rests:
    """Where the platform of one robot rests, one row per commanded position, as one road found it.

    Attributes:
        robot: the robot.
        commanded: (rows, 3) [m]; the platform was commanded to be level there.
        positions: (rows, 3) [m].
        rotations: (rows, 3, 3) rotation matrices.
        tensions: (rows, cables) [N], 0 where slack.
        lengths: (rows, cables) [m].
        rest_lengths: (rows, cables) [m].
        source: "newton" or "mujoco".
    """

    robot: Robot
    commanded: Float[np.ndarray, "rows 3"]
    positions: Float[np.ndarray, "rows 3"]
    rotations: Float[np.ndarray, "rows 3 3"]
    tensions: Float[np.ndarray, "rows cables"]
    lengths: Float[np.ndarray, "rows cables"]
    rest_lengths: Float[np.ndarray, "rows cables"]
    source: str

    def __len__(self) -> int:
        return len(self.commanded)

    @property
    def rotation_about_y(self) -> Float[np.ndarray, " rows"]:
        """beta [rad], what the paper's plots show."""
        return euler(Rotation.from_matrix(self.rotations))[:, 1]

    @property
    def slack(self) -> Bool[np.ndarray, "rows cables"]:
        """Which cables carry no tension."""
        return self.tensions <= 0

    @cached_property
    def twins(self) -> tuple[tuple[int, ...], ...]:
        """Cables grouped by equal tension over all rows, as symmetry makes them (within 1e-6 N)."""
        groups: list[list[int]] = []
        for cable in range(self.robot.cables):
            for group in groups:
                if np.allclose(self.tensions[:, cable], self.tensions[:, group[0]], rtol=0, atol=1e-6):
                    group.append(cable)
                    break
            else:
                groups.append([cable])
        return tuple(map(tuple, groups))

    def zones(self) -> tuple[tuple[float, float, int], ...]:
        """(from, to, number of slack cables) along the commanded x [m], for rows ordered in x."""
        x, slack = self.commanded[:, 0], self.slack.sum(1)
        changes = np.flatnonzero(np.diff(slack)) + 1
        starts, ends = np.append(0, changes), np.append(changes, len(self) - 1)
        return tuple((float(x[a]), float(x[b]), int(slack[a])) for a, b in zip(starts, ends, strict=True))


def rests_by_statics(robot: Robot, commanded: ArrayLike) -> Rests:
    """Where the static solver says the platform rests, commanded level to (rows, 3) [m].

    Raises:
        NotConverged: some row has no answer.
    """
    commanded = np.asarray(commanded, dtype=float)
    solutions = newton.solve_many(robot, commanded)
    if not solutions.converged.all():
        raise NotConverged(f"newton: {robot.name!r} finds no rest at {commanded[~solutions.converged][0].tolist()} m")
    return Rests(
        robot=robot,
        commanded=commanded,
        positions=solutions.positions,
        rotations=solutions.rotations,
        tensions=solutions.tensions,
        lengths=solutions.lengths,
        rest_lengths=statics.lengths(robot, commanded, np.eye(3)),
        source="newton",
    )


def rests_by_mujoco(robot: Robot, commanded: ArrayLike) -> Rests:
    """Where MuJoCo's platform settles, let go level at (rows, 3) [m].

    Raises:
        NotSettled: some row did not come to rest.
    """
    commanded = np.asarray(commanded, dtype=float)
    settlings = settling.settle_many(robot, commanded)
    for row in np.flatnonzero(~settlings.settled):
        settlings.equilibrium(int(row))  # raises with the reason
    return Rests(
        robot=robot,
        commanded=commanded,
        positions=np.array(settlings.poses.translation),
        rotations=settlings.poses.rotation.as_matrix(),
        tensions=settlings.tensions,
        lengths=settlings.lengths,
        rest_lengths=np.array([problem.rest_lengths for problem in settlings.problems]),
        source="mujoco",
    )


# Along a line (Fig. 7, 8, 10, 11, 12)


@dataclass(frozen=True, eq=False)
class Line:
    """One robot commanded along x at one height, by both roads.

    Attributes:
        static: dense, for lines.
        settled: sparse, for points.
    """

    static: Rests
    settled: Rests

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.static.robot

    @property
    def height(self) -> float:
        """Commanded z [m]."""
        return float(self.static.commanded[0, 2])


@dataclass(frozen=True, eq=False)
class Width:
    """One robot across its workspace: poses to draw, and tensions along the width for each material.

    Attributes:
        poses: a few poses at a few heights, by the static road, with the first material.
        lines: one per material, all at the same height.
    """

    poses: Rests
    lines: tuple[Line, ...]


def line(
    robot: Robot, height: float, ends: tuple[float, float], *, static_rows: int = 601, settled_rows: int = 24
) -> Line:
    """Command ``robot`` level along x from end to end [m] at ``height`` z [m], midway in y.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    return Line(
        rests_by_statics(robot, _along_x(robot, height, ends, static_rows)),
        rests_by_mujoco(robot, _along_x(robot, height, ends, settled_rows)),
    )


def across_the_width(
    robot: Robot,
    *,
    materials: Sequence[str] = ("fishing-0.4mm", "vectran-0.7mm"),
    height: float = PAPER_HEIGHTS[0],
    pose_heights: Sequence[float] = (0.1, 0.28),
    columns: int = 5,
    static_rows: int = 1201,
    settled_rows: int = 25,
) -> Width:
    """``robot`` commanded across its whole workspace along x, with each of ``materials``.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    robots = [robot.replace(material=name) for name in materials]
    ends = (float(robot.workspace[0, 0]), float(robot.workspace[1, 0]))
    poses = np.concatenate([_along_x(robot, z, ends, columns) for z in pose_heights])
    return Width(
        poses=rests_by_statics(robots[0], poses),
        lines=tuple(line(one, height, ends, static_rows=static_rows, settled_rows=settled_rows) for one in robots),
    )


def paper_lines(
    layouts: Sequence[str] = ("parallel", "cogiro"),
    materials: Sequence[str] = tuple(MATERIALS),
    heights: Sequence[float] = PAPER_HEIGHTS,
    *,
    static_rows: int = 601,
    settled_rows: int = 13,
) -> tuple[Line, ...]:
    """The paper's experiment (section IV): every layout with every material at every height.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    return tuple(
        line(
            load_robot(layout).replace(material=material),
            height,
            PAPER_LINE,
            static_rows=static_rows,
            settled_rows=settled_rows,
        )
        for layout in layouts
        for material in materials
        for height in heights
    )


# The two-cable robot (Fig. 3, 4)


@dataclass(frozen=True, eq=False)
class Manifold:
    """The poses at which the two-cable bar can rest, and where it drifts as its cables soften (Fig. 3).

    Attributes:
        robot: the robot.
        x: (columns,) [m].
        z: (heights,) [m].
        rotation_about_y: the closed form's upright equilibrium, (heights, columns) [rad].
        commanded: level poses, (commands, 3) [m].
        axial_stiffness: EA, (drifts,) [N], stiffest first.
        static: one ``Rests`` per stiffness, a row per command.
        settled: the same for every few stiffnesses, by MuJoCo.
    """

    robot: Robot
    x: Float[np.ndarray, " columns"]
    z: Float[np.ndarray, " heights"]
    rotation_about_y: Float[np.ndarray, "heights columns"]
    commanded: Float[np.ndarray, "commands 3"]
    axial_stiffness: Float[np.ndarray, " drifts"]
    static: tuple[Rests, ...]
    settled: tuple[Rests, ...]


@dataclass(frozen=True, eq=False)
class ClosedForms:
    """The two-cable bar by four witnesses: both roads, and the closed form with and without the bar's length (Fig. 4).

    Attributes:
        line: the bar commanded along x.
        closed_form: rotation about y [rad] at which the bar balances where the static road put it, (rows,).
        short_bar: the same by the paper's Eq. 5 and 6, mended: a bar of no length, (rows,) [rad].
        poses: a few poses at a few heights, by the static road.
        settled_poses: the same by MuJoCo.
        balanced: the closed form's rotation [rad] at the commanded positions of ``poses``.
    """

    line: Line
    closed_form: Float[np.ndarray, " rows"]
    short_bar: Float[np.ndarray, " rows"]
    poses: Rests
    settled_poses: Rests
    balanced: Float[np.ndarray, " poses"]


def manifold(
    robot: Robot | None = None,
    *,
    commanded: ArrayLike = ((0.18, 0, 0.3), (0.4, 0, 0.3), (0.58, 0, 0.15)),
    stiffest: float = 1e5,
    softest: float = 15.0,
    drifts: int = 49,
    settled_every: int = 8,
    columns: int = 61,
    heights: int = 41,
) -> Manifold:
    """The two-cable robot's manifold over its workspace, and its drift on it as EA falls [N].

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    robot = load_robot("two-cable") if robot is None else robot
    (left, _, bottom), (right, _, top) = robot.workspace
    x, z = np.linspace(left, right, columns), np.linspace(bottom, top, heights)
    commanded = np.asarray(commanded, dtype=float)
    stiffness = np.geomspace(stiffest, softest, drifts)
    robots = [robot.replace(axial_stiffness=EA) for EA in stiffness]
    return Manifold(
        robot=robot,
        x=x,
        z=z,
        rotation_about_y=np.array([[_upright(robot, (a, 0.0, b)) for a in x] for b in z]),
        commanded=commanded,
        axial_stiffness=stiffness,
        static=tuple(rests_by_statics(one, commanded) for one in robots),
        settled=tuple(rests_by_mujoco(one, commanded) for one in robots[::settled_every]),
    )


def closed_forms(
    robot: Robot | None = None,
    *,
    height: float = PAPER_HEIGHTS[0],
    pose_heights: Sequence[float] = (0.1, 0.22, 0.34),
    columns: int = 5,
    static_rows: int = 201,
    settled_rows: int = 25,
) -> ClosedForms:
    """The two-cable bar commanded across its workspace, held against its closed forms.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    robot = load_robot("two-cable") if robot is None else robot
    ends = (float(robot.workspace[0, 0]), float(robot.workspace[1, 0]))
    along = line(robot, height, ends, static_rows=static_rows, settled_rows=settled_rows)
    poses = np.concatenate([_along_x(robot, z, ends, columns) for z in pose_heights])
    return ClosedForms(
        line=along,
        closed_form=np.array([_upright(robot, position) for position in along.static.positions]),
        short_bar=np.array([two_cable.short_bar_rotation(robot, position) for position in along.static.positions]),
        poses=rests_by_statics(robot, poses),
        settled_poses=rests_by_mujoco(robot, poses),
        balanced=np.array([_upright(robot, position) for position in poses]),
    )


def _upright(robot: Robot, position: ArrayLike) -> float:
    """Of the closed form's equilibria the one that is not turned over [rad]."""
    rotations = two_cable.equilibrium_rotations(robot, position)
    return float(rotations[np.argmin(np.abs(rotations))])


# Moment balance of parallel pairs (Fig. 9)


@dataclass(frozen=True, eq=False)
class Balance:
    """A planar platform on two pairs of cables, seen through its moment balance (Fig. 9).

    Attributes:
        robot: the robot.
        position: of the platform (and of its centre of mass), (3,) [m].
        rotation: (3, 3).
        slack: (cables,).
        starts: a point on each side's line of force, (2, 3) [m].
        directions: unit vectors along them, (2, 3).
        intersection: where the two lines meet, (3,) [m]: H or V of the paper while the pairs pull equally.
        arm: horizontal distance of the centre of mass from there [m], positive to the right.
        moment: of the weight about the intersection [N m], positive as rotation about y: m g arm.
        unbalanced: what the forces leave as a moment about y, by the wrench matrix [N m]; equals ``moment``.
        sides: force of each side along its direction, (2,) [N].
        at_rest: whether the tensions are those of the equilibrium, rather than equal in each pair.
    """

    robot: Robot
    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    slack: Bool[np.ndarray, " cables"]
    starts: Float[np.ndarray, "2 3"]
    directions: Float[np.ndarray, "2 3"]
    intersection: Float[np.ndarray, "3"]
    arm: float
    moment: float
    unbalanced: float
    sides: Float[np.ndarray, "2"]
    at_rest: bool


def equal_pulls(robot: Robot, position: ArrayLike) -> Balance:
    """Level at ``position``, each pair's two cables pulling equally, as hard as it takes to carry the weight.

    The intersection is the paper's point H or V, and ``unbalanced`` the moment that makes the platform tilt.
    """
    position = np.asarray(position, dtype=float)
    rotation = np.eye(3)
    pulls = statics.wrench_matrix(robot, position, rotation)
    pairs = pulls.reshape(6, 2, -1).sum(-1)  # unit tension in both cables of a pair
    sides = np.linalg.solve(pairs[[0, 2]], [0.0, robot.weight])
    tensions = np.repeat(sides, robot.cables // 2)
    return _balance(robot, position, rotation, tensions, at_rest=False)


def balance_at_rest(robot: Robot, commanded: ArrayLike) -> Balance:
    """The same at the equilibrium that the static solver finds: the lines meet on the vertical of the centre of mass.

    Raises:
        NotConverged: there is none.
    """
    found = solvers.solve(robot, np.asarray(commanded, dtype=float))
    return _balance(robot, found.position, found.rotation.as_matrix(), found.tensions, at_rest=True)


def moment_balances() -> tuple[Balance, ...]:
    """Fig. 9's cases: horizontal pairs beside the middle, vertical ones in the middle, beside it, and there at rest.

    Raises:
        NotConverged: the static solver found no rest.
    """
    horizontal, vertical = load_robot("planar-horizontal"), load_robot("planar-vertical")
    middle, beside = (0.4, 0.0, 0.2), (0.32, 0.0, 0.2)
    return (
        equal_pulls(horizontal, beside),
        equal_pulls(vertical, middle),
        equal_pulls(vertical, beside),
        balance_at_rest(vertical.replace(material="fishing-0.4mm"), beside),
    )


def _balance(
    robot: Robot, position: np.ndarray, rotation: np.ndarray, tensions: np.ndarray, *, at_rest: bool
) -> Balance:
    arms, vectors = statics.cable_vectors(robot, position, rotation)
    forces = (tensions[:, None] * vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).reshape(2, -1, 3)
    anchors = (position + arms).reshape(2, -1, 3)
    side_forces = forces.sum(1)
    starts = np.array([_point_of_action(points, pair) for points, pair in zip(anchors, forces, strict=True)])
    sizes = np.linalg.norm(side_forces, axis=1)
    directions = side_forces / sizes[:, None]
    along = np.linalg.solve(
        np.stack([directions[0, [0, 2]], -directions[1, [0, 2]]], -1), (starts[1] - starts[0])[[0, 2]]
    )
    intersection = starts[0] + along[0] * directions[0]
    arm = float(position[0] - intersection[0])
    return Balance(
        robot=robot,
        position=position,
        rotation=rotation,
        slack=tensions <= 0,
        starts=starts,
        directions=directions,
        intersection=intersection,
        arm=arm,
        moment=robot.weight * arm,
        unbalanced=float((statics.wrench_matrix(robot, position, rotation) @ tensions)[4]),
        sides=sizes,
        at_rest=at_rest,
    )


def _point_of_action(
    points: Float[np.ndarray, "pair 3"], forces: Float[np.ndarray, "pair 3"]
) -> Float[np.ndarray, "3"]:
    """The point nearest to the anchors' middle on the line in the x-z plane about which ``forces`` have no moment."""
    total, middle = forces.sum(0), points.mean(0)
    moment = np.cross(points - middle, forces).sum(0)
    return middle + np.cross(total, moment) / (total @ total)


# How solvers fare (beyond the paper)

Method = Literal["newton", "fsolve", "least_squares"]


@dataclass(frozen=True, eq=False)
class Convergence:
    """How often and how fast each solver finds rest, against the cables' stiffness.

    Attributes:
        robot: the robot, its own stiffness aside.
        axial_stiffness: EA, (stiffnesses,) [N].
        poses: number of random commanded poses per stiffness.
        solved: per method, poses at which forces balance in the end, (stiffnesses,).
        stable: per method, those of them at which the platform would stay, (stiffnesses,).
        seconds: per method, time of every pose, solved or not, (stiffnesses, poses) [s].
        compiled_seconds: time per pose where Newton solves them all in one call, (stiffnesses,) [s].
    """

    robot: Robot
    axial_stiffness: Float[np.ndarray, " stiffnesses"]
    poses: int
    solved: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    stable: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    seconds: Mapping[str, Float[np.ndarray, "stiffnesses poses"]]
    compiled_seconds: Float[np.ndarray, " stiffnesses"]


def convergence(
    robot: Robot | None = None,
    *,
    axial_stiffness: ArrayLike = (1e2, 1e3, 1e4, 1e5, 1e6),
    poses: int = 24,
    methods: Sequence[Method] = get_args(Method),
    seed: int = 1,
) -> Convergence:
    """Every method from the same random level poses of the robot's workspace (default: DemoBot's parallel layout)."""
    robot = load_robot("parallel") if robot is None else robot
    stiffness = np.asarray(axial_stiffness, dtype=float)
    commanded = np.random.default_rng(seed).uniform(*robot.workspace, (poses, 3))
    solved = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    stable = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    seconds = {method: np.zeros((len(stiffness), poses)) for method in methods}
    compiled = np.zeros(len(stiffness))
    newton.solve_many(robot, commanded)  # compile before the clock starts
    for i, EA in enumerate(stiffness):
        one = robot.replace(axial_stiffness=EA)
        for method in methods:
            for j, position in enumerate(commanded):
                start = time.perf_counter()
                try:
                    found = solvers.solve(one, position, method=method)
                except NotConverged:
                    found = None
                seconds[method][i, j] = time.perf_counter() - start
                if found is not None:
                    solved[method][i] += 1
                    stable[method][i] += found.stability is not Stability.UNSTABLE
        start = time.perf_counter()
        newton.solve_many(one, commanded)
        compiled[i] = (time.perf_counter() - start) / poses
    return Convergence(robot, stiffness, poses, solved, stable, seconds, compiled)


@dataclass(frozen=True, eq=False)
class Differences:
    """What the solver says minus what MuJoCo does, for one robot over all materials.

    Attributes:
        name: of the robot.
        position_errors: (poses,) [m].
        rotation_errors: (poses,) [rad].
        tension_errors: (poses,) largest of a pose's cables [N].
        verdicts: one per pose.
    """

    name: str
    position_errors: Float[np.ndarray, " poses"]
    rotation_errors: Float[np.ndarray, " poses"]
    tension_errors: Float[np.ndarray, " poses"]
    verdicts: tuple[Verdict, ...]

    @property
    def free(self) -> Bool[np.ndarray, " poses"]:
        """Poses at which nothing holds the platform against some motion, so that each road may stop elsewhere."""
        return np.array([verdict is Verdict.AGREE_BUT_FREE for verdict in self.verdicts])

    @property
    def disagreeing(self) -> int:
        """How many poses the two roads disagree about."""
        return sum(verdict not in (Verdict.AGREE, Verdict.AGREE_BUT_FREE) for verdict in self.verdicts)


def differences(
    robots: Sequence[str] = (), materials: Sequence[str] = tuple(MATERIALS), *, poses: int = 100, seed: int = 2
) -> tuple[Differences, ...]:
    """Both roads from ``poses`` random level poses per robot (default: the catalogue) and material.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    rng = np.random.default_rng(seed)
    results = []
    for name in robots or list_robots():
        agreements = []
        for material in materials:
            robot = load_robot(name).replace(material=material)
            commanded = rng.uniform(*robot.workspace, (poses, 3))
            settlings = settling.settle_many(robot, commanded)
            agreements += [
                compare(solvers.solve(robot, position), settlings.equilibrium(row))
                for row, position in enumerate(commanded)
            ]
        results.append(
            Differences(
                name=name,
                position_errors=np.array([one.position_error for one in agreements]),
                rotation_errors=np.array([one.rotation_error for one in agreements]),
                tension_errors=np.array([one.tension_error for one in agreements]),
                verdicts=tuple(one.verdict for one in agreements),
            )
        )
    return tuple(results)


def _along_x(robot: Robot, height: float, ends: tuple[float, float], rows: int) -> Float[np.ndarray, "rows 3"]:
    """Positions along x from end to end [m] at one height, midway in y."""
    x = np.linspace(*ends, rows)
    return np.stack([x, np.full(rows, robot.home[1]), np.full(rows, height)], axis=-1)
