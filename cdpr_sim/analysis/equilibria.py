"""All equilibria of given cable lengths, and which of them a robot reaches when its load is applied.

Long cables allow a platform more than one equilibrium: upright, upside down, hanging on two of eight cables.
Many starts, spread over every position and rotation that the cables allow, descend the energy to the stable ones;
saddles, on request, are roots of the net wrench found from as many starts, and from poses between the stable ones.

That none is missing cannot be proved this way, but it can sometimes be refuted: the space of poses is, up to
contraction of positions, that of rotations; on it, the equilibria with an even number of unstable directions are as
many as those with an odd number, if none is neutral (Morse; the Euler characteristic of SO(3), and of the circle, is
0).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import FLAG, refuse_unless, whole
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, Stability
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import Pose, PoseLike, distance
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import NEUTRAL, Status
from cdpr_sim.statics import forces, newton
from cdpr_sim.statics.gufuncs import ROOTS

SAME = 1e-3
"""Two equilibria at a distance below this fraction of the characteristic length, with as many unstable directions, are
one: two solutions of one stable equilibrium scatter by at most 3e-8 of it, and two different stable ones differ by at
least 0.01, of 120,000 random ones (``scripts/dev/measure_constants.py``). Near a fold, a stable one and a saddle are
nearer."""

LOOSE = 1e-8
"""Equilibria whose smallest eigenvalue is below this fraction of the largest may belong to a family: ``parallel``,
hanging on two diagonal cables, measures 5e-16, and the softest stable equilibrium 1e-7
(``scripts/dev/measure_constants.py``)."""

BALANCED = 1e-8
"""Unbalanced force of a root, as a fraction of the load."""

BETWEEN = 7
"""Starts on the screw motion between each two stable equilibria."""

MOST_PAIRS = 300
"""Largest number of equilibria between which starts are made."""

MOST_SEARCHES = 8
"""Largest number of searches for saddles, each with its own starts, while some are known to be missing."""

SOFT_STRAIN, STIFFENING = 0.01, 3.0
"""Saddles are searched for first with cables that the load strains by this much, then with cables stiffer by this
factor, repeatedly, up to the true stiffness."""

FIRST_LOAD, SHORTEST_STEP, LONGEST_STEP = 1e-3, 1e-4, 0.05
"""Fractions of the load: the first one, and the steps."""

JUMP = 0.2
"""A pose that moves by more than this fraction of the characteristic length within the shortest step counts as a
jump."""


@dataclass(frozen=True, eq=False)
class Equilibria(HtmlRepr):
    """Equilibria of one problem, lowest energy first. Iterates over them.

    Attributes:
        problem: rest lengths and load; its pose has no effect.
        found: the equilibria, each certified by its own residual and eigenvalues.
        energies: energy of each [J]: that of gravity, zero at z = 0, and that of the cables, zero where slack.
        starts: number of starts.
        saddles: whether unstable ones were searched for.
        beyond_law: whether there are roots beyond the range of a cable's nonlinear law, which are no equilibria.
    """

    problem: Problem
    found: tuple[Equilibrium, ...]
    energies: Float[np.ndarray, " equilibria"]
    starts: int
    saddles: bool
    beyond_law: bool = False

    def __len__(self) -> int:
        return len(self.found)

    def __iter__(self) -> Iterator[Equilibrium]:
        return iter(self.found)

    def __getitem__(self, index: int) -> Equilibrium:
        return self.found[index]

    @property
    def stable(self) -> tuple[Equilibrium, ...]:
        """The stable ones, neutral ones included."""
        return tuple(one for one in self.found if one.stability is not Stability.UNSTABLE)

    @property
    def unstable(self) -> tuple[Equilibrium, ...]:
        """Saddles and maxima."""
        return tuple(one for one in self.found if one.stability is Stability.UNSTABLE)

    @property
    def imbalance(self) -> int | None:
        """Equilibria with an even minus those with an odd number of unstable directions: 0 if none is missing.

        None if undefined: saddles were not searched for, some equilibrium is neutral, or the search met roots beyond
        the range of a law.
        """
        if not self.saddles or self.beyond_law:
            return None
        return _imbalance(self.found)

    def nearest(self, pose: RigidTransform) -> tuple[int, float]:
        """Index of the equilibrium nearest to ``pose``, and its distance [m], rotations scaled.

        Returns:
            Its index in ``found``, and the distance sqrt(|translation|² + (characteristic length · angle)²) [m].
        """
        arm, pose = self.problem.robot.characteristic_length, Pose.of(pose).transform
        distances = [distance(one.pose, pose, arm) for one in self.found]
        index = int(np.argmin(distances))
        return index, distances[index]

    def __repr__(self) -> str:
        unstable = f", {len(self.unstable)} unstable" if self.saddles else ""
        return f"<Equilibria of {self.problem.robot.name!r}: {len(self.stable)} stable{unstable}, lowest energy first>"


@dataclass(frozen=True, eq=False)
class LoadPath(HtmlRepr):
    """Equilibria of a platform while its load grows from zero.

    Attributes:
        loads: fractions of the load, ascending to 1, (steps,).
        equilibria: the equilibrium at each of them.
        jumps: loads at which the platform lost its equilibrium and jumped to another.
    """

    loads: Float[np.ndarray, " steps"]
    equilibria: tuple[Equilibrium, ...]
    jumps: tuple[float, ...]

    @property
    def reached(self) -> Equilibrium:
        """The equilibrium under the full load."""
        return self.equilibria[-1]

    def __repr__(self) -> str:
        x, y, z = self.reached.position
        return (
            f"<LoadPath of {self.reached.problem.robot.name!r}: to ({x:.6f}, {y:.6f}, {z:.6f}) m in "
            f"{len(self.loads)} steps of the load, with {len(self.jumps)} jumps>"
        )


def find_equilibria(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    saddles: bool = False,
    starts: int = 2000,
    seed: int = 0,
) -> Equilibria:
    """Equilibria of the platform on cables of these lengths, lowest energy first.

    A neutral equilibrium represents the family to which it belongs.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: the commanded pose, which determines the default of the rest lengths; it has no other effect.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        external_wrench: a force [N], without torque, on the platform's origin, base frame, besides gravity.
        saddles: whether to search for the unstable ones as well.
        starts: number of starting poses. For saddles, the same number repeatedly, while some are known to be missing,
            up to 8 times.
        seed: seed of the starts.

    Returns:
        All that were found, each with its energy [J]; there may be more.

    Raises:
        InvalidInput: an invalid argument; a load of zero.
        NotConverged: all starts lead to poses where a cable is strained beyond the range of its law; carries one such
            pose.
    """
    if isinstance(robot, Robot) and pose is None and rest_lengths is not None:
        pose = robot.home
    problem = Problem.of(robot, pose, rest_lengths, external_wrench)
    problem.robot.cabling.refuse_memory()
    if problem.external_wrench[3:].any():
        raise InvalidInput("external_wrench: found a torque, expected a force only: a torque has no potential energy")
    if not problem.load > 0:
        raise InvalidInput(
            "find_equilibria: found no load, expected weight or force: without load, any pose on slack "
            "cables is an equilibrium"
        )
    refuse_unless(FLAG, saddles=saddles)
    whole("starts", starts, 1)
    whole("seed", seed, 0)
    random = np.random.default_rng(seed)
    found: list[Equilibrium] = []
    made, beyond_law = 0, False
    for _ in range(MOST_SEARCHES if saddles else 1):
        positions, rotations = _around(problem, found, starts, random) if made else _starts(problem, starts, random)
        found += _stable_equilibria(problem, positions, rotations, found)
        if saddles:  # roots from the same starts, and from between the stable equilibria
            between = _between(found)
            positions = np.concatenate([positions, between.translation])
            rotations = np.concatenate([rotations, between.rotation.as_matrix()])
            roots = _stiffened_roots(problem, positions, rotations)
            found += _distinct(problem, *roots, polish=False, known=found)
            lengths = forces.at(problem, *roots).lengths
            beyond_law |= bool(problem.robot.cabling.beyond_law(lengths, problem.rest_lengths).any())
        made += len(positions)
        if not _imbalance(found):
            break
    energies = np.array([_energy(one) for one in found], dtype=float)
    order = np.argsort(energies, kind="stable")
    return Equilibria(problem, tuple(found[i] for i in order), energies[order], made, saddles, beyond_law)


def follow_load(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
) -> LoadPath:
    """The equilibrium that the platform reaches from ``pose`` when its load is applied slowly.

    Gravity and wrench grow from a thousandth to their full values, and each equilibrium is the start of the next. Steps
    are halved where the platform moves far; if it still does in the shortest step, its equilibrium has disappeared: a
    jump.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: the commanded pose, near which the platform starts.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        external_wrench: force [N] and torque [N m] on the platform's origin, base frame, besides gravity; it grows too.

    Returns:
        The equilibria under growing load, (steps,), and the loads at which the platform jumped.

    Raises:
        InvalidInput: an invalid argument; a load of zero.
        NotConverged: no equilibrium under some load; carries the best point.
    """
    whole = Problem.of(robot, pose, rest_lengths, external_wrench)
    whole.robot.cabling.refuse_memory()
    robot = whole.robot
    if not whole.load > 0:
        raise InvalidInput("follow_load: found no load, expected weight or an external wrench")

    def under(load: float, start: RigidTransform) -> Equilibrium:
        part = robot if load == 1 else robot.replace(gravity=load * robot.gravity)
        return newton.solve(Problem.of(part, start, whole.rest_lengths, load * whole.external_wrench))

    arm = robot.characteristic_length
    loads, equilibria, jumps = [FIRST_LOAD], [under(FIRST_LOAD, whole.pose)], []
    step = FIRST_LOAD
    while loads[-1] < 1:
        load = min(loads[-1] + step, 1.0)
        found = under(load, equilibria[-1].pose)
        far = distance(found.pose, equilibria[-1].pose, arm) > JUMP * arm
        if far and step > SHORTEST_STEP:
            step = max(step / 2, SHORTEST_STEP)
            continue
        if far:
            jumps.append(load)
        loads.append(load)
        equilibria.append(found)
        step = min(1.5 * step, LONGEST_STEP)
    return LoadPath(np.array(loads), tuple(equilibria), tuple(jumps))


def unstable_directions(equilibrium: Equilibrium) -> int:
    """Index of the equilibrium, the number of unstable directions: 0 if stable, 1 at a saddle."""
    values = equilibrium.eigenvalues
    return int((values < -NEUTRAL * np.abs(values).max()).sum())


def _starts(
    problem: Problem, count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "starts 3"], Float[np.ndarray, "starts 3 3"]]:
    """Positions within a cable's length of the exits, below and beside them, and uniform rotations."""
    robot, longest = problem.robot, problem.rest_lengths.max()
    reach = longest + robot.characteristic_length
    lower, upper = robot.exits.min(0), robot.exits.max(0)
    margin = 0.3 * reach
    positions = rng.uniform(lower - np.array([margin, margin, reach]), upper + margin, (count, 3))
    if robot.mobility == "planar":
        positions[:, 1] = 0
        return positions, Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (count, 1)) * [0.0, 1.0, 0.0]).as_matrix()
    return positions, Rotation.random(count, rng=rng).as_matrix()


def _around(
    problem: Problem, found: list[Equilibrium], count: int, random: np.random.Generator
) -> tuple[Float[np.ndarray, "starts 3"], Float[np.ndarray, "starts 3 3"]]:
    """Starts around equilibria that are known, near and far: missing ones are mostly near others."""
    robot = problem.robot
    steps = np.zeros((count, 6))
    steps[:, robot.free] = random.normal(size=(count, len(robot.free))) * 10 ** random.uniform(-1.5, 0.5, (count, 1))
    of = random.integers(len(found), size=count)
    positions = np.array([one.position for one in found])[of] + robot.characteristic_length * steps[:, :3]
    matrices = np.array([one.rotation_matrix for one in found])[of]
    return positions, Rotation.from_rotvec(steps[:, 3:]).as_matrix() @ matrices


def _imbalance(found: Sequence[Equilibrium]) -> int | None:
    """Equilibria with an even minus those with an odd number of unstable directions; None where one is neutral."""
    if any(one.stability is Stability.NEUTRAL for one in found):
        return None
    return sum(1 - 2 * (unstable_directions(one) % 2) for one in found)


def _stable_equilibria(
    problem: Problem,
    positions: Float[np.ndarray, "starts 3"],
    rotations: Float[np.ndarray, "starts 3 3"],
    known: list[Equilibrium],
) -> list[Equilibrium]:
    """Stable equilibria that descent from the starts reaches, besides those ``known``."""
    descended = newton.solve_many(
        problem.robot,
        positions,
        problem.rest_lengths,
        rotations=rotations,
        external_wrench=problem.external_wrench,
    )
    done, beyond = descended.converged, descended.status == Status.OVERSTRAINED
    if not done.any() and beyond.any():
        raise NotConverged.because(Status.OVERSTRAINED, descended.point(int(np.argmax(beyond))))
    return _distinct(problem, descended.positions[done], descended.rotations[done], polish=True, known=known)


def _between(found: list[Equilibrium]) -> RigidTransform:
    """Poses on the screw motions between pairs of equilibria, since a saddle lies between; a part if many."""
    pairs = np.stack(np.tril_indices(len(found), -1))
    ones, others = np.repeat(pairs[:, :: len(pairs[0]) // MOST_PAIRS + 1], BETWEEN, axis=1)
    if not len(ones):
        return RigidTransform.concatenate([RigidTransform.identity()])
    poses = RigidTransform.concatenate([one.pose for one in found])
    screws = (poses[ones].inv() * poses[others]).as_exp_coords()
    fractions = np.tile(np.linspace(0, 1, BETWEEN + 2)[1:-1], len(ones) // BETWEEN)
    between = poses[ones] * RigidTransform.from_exp_coords(fractions[:, None] * screws)
    return RigidTransform.concatenate([RigidTransform.identity(), between])


def _stiffened_roots(
    problem: Problem, positions: Float[np.ndarray, "starts 3"], rotations: Float[np.ndarray, "starts 3 3"]
) -> tuple[Float[np.ndarray, "roots 3"], Float[np.ndarray, "roots 3 3"]]:
    """Roots from the starts, and from the roots of softer cables, with increasing stiffness.

    The stiffer the cables, the narrower the valleys that lead to a saddle: at a strain of a percent they are wide.
    """
    robot = problem.robot
    straight = _roots(problem, positions, rotations)
    softening = SOFT_STRAIN * float(robot.axial_stiffness.max()) / problem.load
    levels = max(int(np.ceil(np.log(max(softening, 1.0)) / np.log(STIFFENING))), 0)
    fresh = np.array_split(np.random.default_rng(0).permutation(len(positions)), max(levels, 1))
    starts = positions, rotations
    for level in range(levels, -1, -1):
        softer = robot.replace(axial_stiffness=robot.axial_stiffness / STIFFENING**level)
        part = Problem(softer, problem.pose, problem.rest_lengths, problem.external_wrench)
        positions, rotations = _roots(part, positions, rotations, 1e-2 if level == levels else 1e-12)
        if level:  # pairs of equilibria appear as cables get stiffer
            # One of each group that is equal up to rounding: thousands of starts lead to tens of roots.
            places = np.hstack([positions / robot.characteristic_length, rotations.reshape(-1, 9)])
            _, first = np.unique(np.round(places / SAME), axis=0, return_index=True)
            positions, rotations = positions[first], rotations[first]
            rows = fresh[level - 1]
            born = _roots(part, starts[0][rows], starts[1][rows], 1e-2)
            positions, rotations = np.concatenate([positions, born[0]]), np.concatenate([rotations, born[1]])
    return np.concatenate([straight[0], positions]), np.concatenate([straight[1], rotations])


def _roots(
    problem: Problem,
    positions: Float[np.ndarray, "starts 3"],
    rotations: Float[np.ndarray, "starts 3 3"],
    damping: float = 1e-2,
) -> tuple[Float[np.ndarray, "roots 3"], Float[np.ndarray, "roots 3 3"]]:
    """Roots of the net wrench, stable or not, to which the starts lead."""
    robot, free = problem.robot, np.zeros(6)
    free[problem.robot.free] = 1.0
    with np.errstate(all="ignore"):
        positions, rotations, left = ROOTS(
            robot.cable_table(), problem.rest_lengths, robot.weight, robot.center_of_mass, problem.external_wrench,
            free, robot.characteristic_length, int(not robot.cabling.springs), 1e-3 * BALANCED * problem.load, damping,
            positions, rotations,
        )  # fmt: skip
    balanced = left <= BALANCED * problem.load
    # The orthogonality of products of many small rotations deteriorates by rounding.
    positions, rotations = positions[balanced], Rotation.from_matrix(rotations[balanced]).as_matrix()
    # The search continues where an anchor comes into its wheel; a cable has no path there.
    possible = np.isfinite(forces.at(problem, positions, rotations).lengths).all(-1)
    return positions[possible], rotations[possible]


def _distinct(
    problem: Problem,
    positions: Float[np.ndarray, "rows 3"],
    rotations: Float[np.ndarray, "rows 3 3"],
    *,
    polish: bool,
    known: list[Equilibrium],
) -> list[Equilibrium]:
    """One of each distinct equilibrium, besides those ``known``; the first of a neutral family."""
    arm = problem.robot.characteristic_length
    found, relatives = [], list(known)
    left = np.ones(len(positions), dtype=bool)
    sides = _sides(forces.at(problem, positions, rotations).eigenvalues)
    for one in relatives:
        left &= ~_same(one, positions, rotations, sides, arm)
    while left.any():
        row = int(np.argmax(left))
        pose = RigidTransform.from_components(positions[row], Rotation.from_matrix(rotations[row]))
        left[row] = False
        one = forces.equilibrium_at(problem, pose, iterations=0, source="equilibria")
        if polish:
            try:
                one = newton.solve(Problem.of(problem.robot, pose, problem.rest_lengths, problem.external_wrench))
            except NotConverged:
                continue
        left &= ~_same(one, positions, rotations, sides, arm)
        if problem.robot.cabling.beyond_law(one.lengths, one.rest_lengths).any():
            continue
        if not (_among(one, relatives, arm) or any(_related(one, other) for other in relatives)):
            found.append(one)
            relatives.append(one)
    return found


def _among(one: Equilibrium, others: Sequence[Equilibrium], arm: float) -> bool:
    """Whether it is one of the others."""
    if not others:
        return False
    positions, rotations = (np.stack([getattr(o, name) for o in others]) for name in ("position", "rotation_matrix"))
    return bool(_same(one, positions, rotations, _sides(np.stack([o.eigenvalues for o in others])), arm).any())


def _same(
    one: Equilibrium,
    positions: Float[np.ndarray, "rows 3"],
    rotations: Float[np.ndarray, "rows 3 3"],
    sides: Int[np.ndarray, " rows"],
    arm: float,
) -> Bool[np.ndarray, " rows"]:
    """Which poses are this equilibrium: nearly equal, unless one is stable and one is not, as at a fold."""
    cosine = (np.einsum("nij,ij->n", rotations, one.rotation_matrix) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    near = np.hypot(np.linalg.norm(positions - one.position, axis=1), arm * angle) <= SAME * arm
    side = _sides(one.eigenvalues[None])[0]
    return near & ((sides == side) | (sides < 0) | (side < 0))


def _sides(eigenvalues: Float[np.ndarray, "rows free"]) -> np.ndarray:
    """The number of unstable directions of each; −1 where an eigenvalue is too small to decide."""
    size = np.abs(eigenvalues)
    with np.errstate(invalid="ignore"):
        loose = ~(size.min(-1) > LOOSE * size.max(-1))
    return np.where(loose, -1, (eigenvalues < 0).sum(-1))


def _related(one: Equilibrium, other: Equilibrium) -> bool:
    """Whether two neutral equilibria belong to one family: the same tensions at the same energy."""
    if min(np.abs(e.eigenvalues).min() / np.abs(e.eigenvalues).max() for e in (one, other)) > LOOSE:
        return False
    problem = one.problem
    energies = [_energy(e) for e in (one, other)]
    size = problem.load * problem.robot.characteristic_length
    alike = np.allclose(one.tensions, other.tensions, rtol=0, atol=1e-5 * problem.load)
    return bool(alike and abs(energies[0] - energies[1]) <= 1e-8 * size)


def _energy(equilibrium: Equilibrium) -> float:
    state = forces.at(equilibrium.problem, equilibrium.position, equilibrium.rotation_matrix)
    return float(state.energy)
