"""Compensation: unstretched lengths with which elastic cables hold the platform at the commanded pose.

At the commanded pose, choose tensions within limits that balance the load (``tensions``), and give each cable the
rest length that its tension stretches to its length there,

    l0 = l EA / (EA + tau)          from  tau = EA (l − l0)/l0  (paper Eq. 10).

No winch can have a cable of any length: l0 has a least value c, which bounds the tension by tau <= EA (l − c)/c.
The commanded pose is then an equilibrium; it is stable if its stiffness matrix is positive definite. Where no tensions
within limits do this, the nearest pose where some do is found instead: the least sqrt(|translation|² + (arm·angle)²),
with the robot's characteristic length as arm by default.
"""

from __future__ import annotations

import enum
import functools
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.analysis.tensions import Demand, balances, leftover, nearest, on_the_balance, smallest, stiffest
from cdpr_sim.analysis.workspace.feasibility import BALANCED, over_poses
from cdpr_sim.core import cable_law
from cdpr_sim.core.checks import Frozen, checked_array, frozen, one_of
from cdpr_sim.core.describe import describe_twist
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, Stability
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.limits import checked_limits
from cdpr_sim.core.pose import PoseLike, distance, moved
from cdpr_sim.core.pretension import without_pretension
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.slack import slack_limits
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.statics import derivatives, forces, newton
from cdpr_sim.statics.given_tensions import cut
from cdpr_sim.statics.gufuncs import SHORTFALLS

Prefer = Literal["smallest", "stiffest"]

_Start = tuple[Float[np.ndarray, "6"], Float[np.ndarray, " cables"]]
"""A step from the commanded pose, as of ``moved``, and tensions [N]."""

TAUT = 0.01
"""Default lower limit of tension, as a fraction of the load (or, without one, of the scale of forces): keeps
every cable taut, so that each one contributes stiffness."""

ABOVE_SLACK = 1.1
"""Default lower limit of tension of a cable with mass, in ``slack_limits`` by the length of its path: a level rope
with it is 1.045 times as long, and its weight just as much more, so that it is not slack."""

HELD = 1e-3
"""Least stiffness that counts as stable, in loads per characteristic length: with less, a thousandth of the load moves
the platform by a characteristic length. A choice: of 30,000 poses each, the softest equilibrium of ``cogiro`` has 0.1,
and of the stable ones of ``parallel``, three have less (``scripts/dev/measure_constants.py``)."""

LEAST_LENGTH = 0.01
"""Default least rest length, in characteristic lengths: 0.5 mm of DemoBot's platform, 1 cm of a platform of 1 m. A
choice: with less, the end of the rope is in its exit. Without a bound, poses with an anchor almost at an exit are
"nearest" ones, on cables of a micrometre."""

SHORTENED = 1e-6
"""Tolerance of the least rest length, as a fraction: SLSQP satisfies its constraints up to rounding."""

LEAST_ARM = 1e-3
"""Weight of the rotation, in characteristic lengths, if only the position counts: this small weight still chooses the
least rotation for a position, and moves the position by its square times centimetres: at most 8e-9 m
(``scripts/dev/measure_constants.py``)."""

MASS_STEPS, MISSES = 30, 2
"""Choices of tensions of cables with mass, each with the directions of the last; they come nearer tenfold or more. How
many of them may find no tensions within limits before none are said to hold the pose."""

MOST_STRAIN, MOST_LOADS, WORKING = 0.05, 3.0, 1 / 5
"""Default upper limit of tension: a strain of 5 %, where ropes break, and at most a fifth of the breaking
load if that is known, the working load of lifting ropes (Directive 2006/42/EC, Annex I, 4.1.2.4); or this many loads,
if that is more, since the softest cables cannot hold their load with less."""

ROUNDS, SAMPLES, STARTS, APART = 6, 1000, 3, 0.3
"""Number of searches for a pose nearer than the nearest found; poses sampled in each, and number of starts from them;
their least mutual distance, as a fraction of the distance of the nearest."""

CONVERGED = 1e-12
"""SLSQP ends where a step changes half the squared distance, per squared characteristic length, by less, and the
unbalanced forces add up to less, per load. Tensions of hundreds of loads are balanced no better than by rounding: with
a hundredth of it, SLSQP tries up to thirty times as many poses, and poses differ by less than 1e-9 m. With an arm below
the characteristic length the first is smaller, in proportion: rotations have a smaller share in the distance."""

TOO_FAR = 7.0
"""Translation, in mean cable lengths, at which a search for a stable pose is given up. Of 19 searches of a random robot
with three cables, those that ended at a pose near by stayed within 5.3; the others went beyond 7 within 20 steps, and
then ran to the limit of steps."""

DIFFERENCE = 1.5e-8
"""Step of the unknowns for the slope of an eigenvalue: the square root of rounding."""

_EQUAL = 1e-6
"""[m] Tolerance between SLSQP's nearest pose and the equilibrium of its rest lengths: the difference measures below
1e-12, where SLSQP has converged (``scripts/dev/measure_constants.py``)."""


class CompensationOutcome(enum.Enum):
    """Outcome of a compensation; the value is its description."""

    EXACT = "the commanded pose is held exactly"
    NEAREST = "no lengths hold the commanded pose; this is the nearest found"


@dataclass(frozen=True, eq=False)
class Compensation(Frozen, HtmlRepr):
    """Rest lengths with which the platform is in equilibrium at the commanded pose, or at the nearest pose found.

    Attributes:
        commanded: the commanded pose.
        equilibrium: equilibrium on the compensated lengths, by statics: its pose, tensions and stiffness.
        outcome: whether that is the commanded pose.
        distance: distance of the two poses [m], sqrt(|translation|² + (arm·angle)²); 0 where exact.
        arm: factor of rotations in that distance [m].
        reasons: why no lengths hold the commanded pose, a sentence each; empty where exact.
        tension_limits: (2, cables) [N].
        reached: equilibrium that the platform reaches on these lengths from the commanded pose, by statics; None if
            there is none. ``verify_compensation`` checks both in MuJoCo.
    """

    commanded: RigidTransform
    equilibrium: Equilibrium
    outcome: CompensationOutcome
    distance: float
    arm: float
    reasons: tuple[str, ...]
    tension_limits: Float[np.ndarray, "2 cables"]
    reached: Equilibrium | None

    @property
    def reached_from_commanded(self) -> bool:
        """Whether the platform reaches the compensated pose from the commanded one, by statics."""
        reach = self.equilibrium.problem.robot.characteristic_length
        return self.reached is not None and distance(self.pose, self.reached.pose, reach) <= _EQUAL

    @property
    def exact(self) -> bool:
        """Whether the compensated lengths hold the commanded pose itself."""
        return self.outcome is CompensationOutcome.EXACT

    @property
    def pose(self) -> RigidTransform:
        """The pose that the compensated lengths hold."""
        return self.equilibrium.pose

    @property
    def rest_lengths(self) -> Float[np.ndarray, " cables"]:
        """Compensated unstretched lengths l0, (cables,) [m]: those that the winches should let out."""
        return self.equilibrium.rest_lengths

    @property
    def tensions(self) -> Float[np.ndarray, " cables"]:
        """Tensions at that pose, (cables,) [N]."""
        return self.equilibrium.tensions

    @property
    def overloaded(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have a tension there above their breaking load, (cables,); none where it is unknown."""
        return self.equilibrium.overloaded

    def __repr__(self) -> str:
        count = int(self.overloaded.sum())
        broken = f", {count} cable{'s' * (count > 1)} beyond the breaking load" if count else ""
        return f"<Compensation: {self.outcome.value}, {1e3 * self.distance:.3g} mm away{broken}>"


def compensate(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    tensions: tuple[ArrayLike, ArrayLike] | np.ndarray | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | np.ndarray | None = None,
    prefer: Prefer = "smallest",
    arm: float | None = None,
    least_length: float | None = None,
) -> Compensation:
    """Rest lengths with which the platform with elastic cables is in equilibrium at ``pose``.

    Args:
        robot: the robot; or a ``Problem``, without other arguments, whose rest lengths have no effect.
        pose: the commanded pose of the platform.
        external_wrench: force [N] and torque [N m] on the platform's origin, base frame, besides gravity.
        tensions: smallest and largest tension [N], each one number or one per cable: the pretension of a robot with
            cables from below. Default of the smallest: the robot's ``force_min``; without it, 1 % of the load, or a
            cable's weight if that is larger. Default of the largest: the tension of 5 % strain or a fifth of the
            breaking load, whichever is smaller, but at least three times the load, and at most ``force_max``.
        tension_limits: the same argument by its name in ``feasible`` and ``sweep``.
        prefer: of all such tensions, the "smallest" (by norm) or those that make the platform "stiffest".
        arm: weight of rotation where only a nearby pose can be held: sqrt(|translation|² + (arm·angle)²) is least.
            0 [m] minimises the distance of the position, with a small rotation; default: the robot's characteristic
            length.
        least_length: least rest length of a cable that a winch can have [m], from exit to anchor; default: 1 % of the
            characteristic length.

    Returns:
        The lengths, their equilibrium, and whether that is the commanded pose; if not, the reasons.

    Raises:
        InvalidInput: an invalid argument; limits that no tension satisfies.
        UnknownName: no such preference.
        NotConverged: no pose was found that tensions within limits hold.
    """
    one_of("preference", prefer, get_args(Prefer))
    if isinstance(robot, Robot):
        robot = without_pretension(robot)  # the tensions are chosen here
    given_problem = Problem.of(robot, pose, external_wrench=external_wrench)
    given_problem.robot.cabling.refuse_memory()
    machine: Robot = without_pretension(given_problem.robot)
    robot, commanded = machine, given_problem.pose
    rigid = Problem.of(
        robot, commanded, external_wrench=given_problem.external_wrench
    )  # refuses a pose above all exits
    if tensions is not None and tension_limits is not None:
        raise InvalidInput("tensions: found tension_limits beside it, expected one of the two, which are the same")
    field, given = ("tension_limits", tension_limits) if tensions is None else ("tensions", tensions)
    lower, upper = default_limits(rigid) if given is None else checked_limits(robot, given, field)
    upper = np.minimum(upper, cable_law.largest_tension(robot.cabling.law))
    if (lower > upper).any():
        cable = int(np.argmax(lower > upper))
        raise InvalidInput(
            f"{field}: found a smallest tension of {lower[cable]:g} N in cable {cable + 1}, expected at most "
            f"{upper[cable]:g} N, up to which its nonlinear law is defined"
        )
    limits = frozen(np.array([lower, upper]))
    arm = robot.characteristic_length if arm is None else float(checked_array("arm", arm, ()))
    if arm < 0:
        raise InvalidInput(f"arm: found {arm:g} m, expected 0 or more")
    least = LEAST_LENGTH * robot.characteristic_length
    least = least if least_length is None else float(checked_array("least_length", least_length, ()))
    if least < 0:
        raise InvalidInput(f"least_length: found {least:g} m, expected 0 or more")
    any_length = demand_at(rigid, commanded, lower, upper)
    longest = _tensions_at(rigid, commanded, least)
    demand = replace(any_length, upper=np.minimum(upper, longest))
    floor = HELD * rigid.force_scale / robot.characteristic_length
    possible = bool((lower <= demand.upper).all())
    if prefer == "stiffest" and np.isinf(upper).any():
        stiffest(
            any_length, floor
        )  # refuses limits within which tensions can grow until cables are as short as allowed
    idle = len(robot.free) - demand.held.shape[1]
    chosen, missed = (smallest if prefer == "smallest" else stiffest)(demand, floor) if possible else None, 0
    for _ in range(0 if not possible else 1 if robot.cabling.springs else MASS_STEPS):
        if chosen is None:
            missed += 1
            if missed > MISSES or robot.cabling.springs:
                break
            chosen = nearest(demand)  # with their directions, tensions within limits may balance the load
        try:
            rest, _ = cut(robot, commanded.translation, commanded.rotation.as_matrix(), chosen)
        except InvalidInput:  # a cable has no rest length with which it has this tension there
            break
        shortened = Problem(robot, commanded, frozen(rest), rigid.external_wrench)
        found = forces.equilibrium_at(shortened, commanded, iterations=0, source="compensation")
        if robot.cabling.springs or found.residual <= BALANCED * demand.scale:
            if not _holds(found, idle) or (rest < (1 - SHORTENED) * least).any():
                break
            return Compensation(commanded, found, CompensationOutcome.EXACT, 0.0, arm, (), limits, found)
        # The directions in which cables with mass pull depend on their tensions.
        state = forces.at(shortened, commanded.translation, commanded.rotation.as_matrix())
        demand = replace(demand, wrench_matrix=(state.wrench_matrix / robot.units[:, None])[robot.free])
        # The stiffest are only brought to the balance again: a choice of its own each time would not settle.
        chosen = smallest(demand, floor) if prefer == "smallest" else on_the_balance(demand, chosen)
    if balances(any_length) and not (possible and balances(demand)):
        cable = int(np.argmin(longest - lower))
        reasons = (
            f"tensions within limits balance the load there only on a cable shorter than the least length of "
            f"{1e3 * least:.3g} mm: cable {cable + 1}, {1e3 * rigid.rest_lengths[cable]:.3g} mm from exit to anchor",
        )
    else:
        reasons = _reasons(any_length, rigid)
    held = any_length.held if idle else np.eye(len(robot.free))
    found = _nearest(rigid, limits, floor, held, max(arm, LEAST_ARM * robot.characteristic_length), least)
    try:
        reached = newton.solve(Problem.of(robot, commanded, found.rest_lengths, rigid.external_wrench))
    except NotConverged:
        reached = None
    away = distance(commanded, found.pose, arm)
    return Compensation(commanded, found, CompensationOutcome.NEAREST, away, arm, reasons, limits, reached)


def default_limits(problem: Problem) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """The robot's force limits; where it has none, those that keep every cable taut and below its breaking load."""
    robot = problem.robot
    most = np.minimum(MOST_STRAIN * robot.axial_stiffness, WORKING * robot.breaking_load)
    most = np.maximum(most, MOST_LOADS * problem.load)
    upper = np.minimum(robot.force_max, np.maximum(most, robot.force_min))
    taut = np.where(robot.cable_weights > 0, ABOVE_SLACK * robot.cabling.tensions(slack_limits(problem)), 0.0)
    taut = np.maximum(TAUT * problem.force_scale, taut)
    lower = np.where(robot.force_min > 0, robot.force_min, np.minimum(taut, upper))
    return lower, upper


def _holds(found: Equilibrium, idle: int, floor: float = 0.0) -> bool:
    """Whether the equilibrium is stable except in ``idle`` directions, which no tensions change (``Demand.held``)."""
    held = found.eigenvalues[idle:]
    return found.stability is not Stability.UNSTABLE and bool(held[0] > max(floor, NEUTRAL * held[-1]))


def demand_at(
    problem: Problem,
    pose: RigidTransform,
    lower: Float[np.ndarray, " cables"],
    upper: Float[np.ndarray, " cables"],
) -> Demand:
    """Requirements on tensions at ``pose`` under the problem's load; its rest lengths have no effect."""
    robot, position, rotation = problem.robot, pose.translation, pose.rotation.as_matrix()
    free, units = robot.free, robot.units

    # The stiffness matrix is affine in the tensions, all taut: one more values than cables determine it.
    # With twice as much, half of the shorter cables would be in front of their exits.
    lengths = forces.geometry(robot, position, rotation).lengths
    most = _tensions_at(problem, pose, 0.5 * (lengths + robot.cabling.least_lengths))
    some = np.minimum(problem.load or 1.0, 0.5 * most)
    tensions = np.vstack([some, some + np.diag(some)])
    positions, rotations = np.array([position] * len(tensions)), np.array([rotation] * len(tensions))
    state = _with_lengths(problem, _cut_lengths(robot, positions, rotations, tensions), positions, rotations)
    base, *others = (state.stiffness_matrix / np.outer(units, units))[:, free][:, :, free]
    stiffness_by_tension = (np.array(others) - base) / some[:, None, None]
    return Demand(
        wrench_matrix=(forces.geometry(robot, position, rotation).wrench_matrix / units[:, None])[free],
        load=(forces.load_wrench(problem, rotation) / units)[free],
        lower=lower,
        upper=upper,
        stiffness=base - np.einsum("c,cij->ij", some, stiffness_by_tension),
        stiffness_by_tension=stiffness_by_tension,
    )


def _tensions_at(
    problem: Problem, pose: RigidTransform, least: float | Float[np.ndarray, " cables"]
) -> Float[np.ndarray, " cables"]:
    """Tensions with which the cables' rest lengths at ``pose`` are the least one, (cables,) [N]; inf without one."""
    if not np.all(least > problem.robot.cabling.least_lengths):
        return np.full(problem.robot.cables, np.inf)
    lengths = forces.geometry(problem.robot, pose.translation, pose.rotation.as_matrix()).lengths
    stretching = problem.robot.cabling.stretching(np.asarray(least))
    return np.where(lengths < least, -np.inf, cable_law.tension(lengths - least, stretching, problem.robot.cabling.law))


def _cut_lengths(
    robot: Robot,
    positions: Float[np.ndarray, "*rows 3"],
    rotations: Float[np.ndarray, "*rows 3 3"],
    tensions: Float[np.ndarray, "*rows cables"],
) -> Float[np.ndarray, "*rows cables"]:
    """Unstretched lengths with these tensions at a pose, or at many; ``NotConverged`` where there are none."""
    try:
        return cut(robot, positions, rotations, tensions)[0]
    except InvalidInput as error:
        raise NotConverged(f"compensate: {error}; try other limits of tension") from None


def _with_lengths(
    problem: Problem,
    rest: Float[np.ndarray, "*rows cables"],
    positions: Float[np.ndarray, "*rows 3"],
    rotations: Float[np.ndarray, "*rows 3 3"],
) -> forces.State:
    """Cables of ``problem`` with other rest lengths at a pose, or at many."""
    load = problem.external_wrench, problem.axial_stiffness, np.array(problem.mass)
    shape, falls = rest.shape[:-1], np.array(False)
    return forces.at(Problems(problem.robot, positions, rotations, rest, *load, shape, falls), positions, rotations)


def _reasons(demand: Demand, problem: Problem) -> tuple[str, ...]:
    """Reasons why no tensions within limits hold the commanded pose, the most important first."""
    robot = problem.robot
    if balances(demand):
        return ("tensions within limits balance the load there, but every such equilibrium is unstable",)
    pulling = replace(demand, lower=np.zeros(robot.cables), upper=np.full(robot.cables, np.inf))
    if balances(pulling):
        least = smallest(pulling)
        bounds = "" if least is None else f" (the smallest: {least.min():.3g} to {least.max():.3g} N)"
        return (f"cables that only pull could balance the load there, but not within the limits of tension{bounds}",)
    pushing = np.linalg.lstsq(demand.wrench_matrix, -demand.load, rcond=None)[0]
    can_push = np.abs(demand.wrench_matrix @ pushing + demand.load).max() <= BALANCED * demand.scale
    why = (
        f"cables would have to push to balance the load there: cable {int(np.argmin(pushing)) + 1} "
        f"with {-pushing.min():.3g} N"
        if can_push
        else "the cables cannot balance the load there, whether they pull or push: their wrenches do not span it"
    )
    missing = np.zeros(6)
    missing[robot.free] = leftover(pulling)
    return (
        why,
        "the load can move the platform without any cable getting longer: "
        f"along {describe_twist(missing / robot.units, robot)}",
    )


def _nearest(
    problem: Problem,
    limits: Float[np.ndarray, "2 cables"],
    floor: float,
    directions: Float[np.ndarray, "free held"],
    arm: float,
    least: float,
) -> Equilibrium:
    """The stable equilibrium nearest to the problem's pose among those with tensions within limits.

    SLSQP over (step, tensions) with exact gradients, from the commanded pose and from the equilibria of uncompensated
    cables of several stiffnesses; then, repeatedly, from poses nearer than the nearest found at which tensions within
    limits balance most of the load. Where the result of SLSQP is not stable, the smallest eigenvalue becomes a
    constraint, differentiated by differences; where a cable is shorter than ``least`` [m], so do the rest lengths.
    The balance is that along ``directions`` (``Demand.held``): along others it is always zero, and SLSQP would fail.
    """
    best: Equilibrium | None = None
    away, idle = np.inf, len(directions) - directions.shape[1]

    def nearer(start: _Start, stiffness: float | None, enough: float) -> float:
        """The distance of the pose that the descent finds; its equilibrium becomes the best if it is nearer, and held.

        Infinite in the latter case.
        """
        nonlocal best, away
        reached = _descend(problem, start, limits, stiffness, directions, arm)
        if reached is not None and _shortest(problem, *reached) < (1 - SHORTENED) * least:
            reached = _descend(problem, start, limits, stiffness, directions, arm, least)
        if reached is None or _shortest(problem, *reached) < (1 - SHORTENED) * least:
            return np.finfo(float).max  # tried again only if nothing else is found
        step, tensions = reached
        far = float(np.hypot(np.linalg.norm(step[:3]), arm * Rotation.from_rotvec(step[3:]).magnitude()))
        if far < away:
            found = _settled(problem, step, tensions)
            if found is not None and _holds(found, idle, enough):
                best, away = found, distance(problem.pose, found.pose, arm)
                return np.inf
        return far

    def search(starts: list[_Start]) -> None:
        for start, far in [(start, nearer(start, None, 0.5 * floor)) for start in starts]:
            if far < away:  # else a constraint of stability would only increase the distance
                nearer(start, floor, 0.0)

    search(_starts(problem, limits))
    random = np.random.default_rng(0)
    for _ in range(ROUNDS):
        radius = float(problem.rest_lengths.mean()) if best is None else away
        search(_spread(problem, limits, radius, arm, random))
    if best is None:
        raise NotConverged(
            f"compensate: found no pose near the commanded one that tensions from {limits[0].min():.3g} to "
            f"{limits[1].max():.3g} N hold"
        )
    return best


def _starts(problem: Problem, limits: Float[np.ndarray, "2 cables"]) -> list[_Start]:
    """Poses and tensions to search from: the commanded pose, and equilibria with softer and softer cables."""
    robot, softness = problem.robot, np.array([1.0, 0.1, 0.01])
    hanging = newton.solve_many(
        robot,
        problem.pose,
        problem.rest_lengths,
        external_wrench=problem.external_wrench,
        axial_stiffness=softness[:, None] * robot.axial_stiffness,
    )
    starts = []
    for row in np.flatnonzero(hanging.converged):
        turn = Rotation.from_matrix(hanging.rotations[row] @ problem.at.rotation_matrix.T).as_rotvec()
        step = np.concatenate([hanging.positions[row] - problem.at.position, turn])
        starts.append((step, np.clip(hanging.tensions[row], *limits)))
    return [(np.zeros(6), starts[0][1] if starts else limits[0]), *starts]


def _spread(
    problem: Problem, limits: Float[np.ndarray, "2 cables"], radius: float, arm: float, random: np.random.Generator
) -> list[_Start]:
    """Poses and tensions to search from, anywhere within ``radius`` [m] of the commanded pose.

    Of many poses those where tensions within limits leave the smallest residual, at some distance from each other.
    """
    robot, free = problem.robot, problem.robot.free
    steps = np.zeros((SAMPLES, 6))
    steps[:, free] = random.normal(size=(SAMPLES, len(free)))
    steps *= radius * (random.random(SAMPLES) ** (1 / len(free)) / np.linalg.norm(steps, axis=1))[:, None]
    steps[:, 3:] /= arm
    steps[:, 3:] *= np.minimum(1, np.pi / np.maximum(np.linalg.norm(steps[:, 3:], axis=1), 1e-300))[:, None]
    positions = problem.at.position + steps[:, :3]
    rotations = Rotation.from_rotvec(steps[:, 3:]).as_matrix() @ problem.at.rotation_matrix
    left = over_poses(SHORTFALLS, robot, limits[0], limits[1], problem.external_wrench[None], positions, rotations)
    left = np.where(np.isfinite(left), left, np.inf)
    near, chosen = steps * np.repeat([1.0, arm], 3), []
    while len(chosen) < STARTS and np.isfinite(left).any():
        chosen.append(row := int(np.argmin(left)))
        left[np.linalg.norm(near - near[row], axis=1) <= APART * radius] = np.inf
    W = forces.geometry(robot, positions[chosen], rotations[chosen]).wrench_matrix / robot.units[:, None]
    load = forces.load_wrench(problem, rotations[chosen]) / robot.units
    tensions = -(np.linalg.pinv(W[:, free], robot.cables * np.finfo(float).eps) @ load[:, free, None])[..., 0]
    return [*zip(steps[chosen], np.clip(tensions, *limits), strict=True)]


def _descend(
    problem: Problem,
    start: _Start,
    limits: Float[np.ndarray, "2 cables"],
    floor: float | None,
    directions: Float[np.ndarray, "free held"],
    arm: float,
    least: float = 0.0,
) -> _Start | None:
    """One run of SLSQP over the step from the commanded pose, per characteristic length, and the tensions per load.

    With ``least`` [m], the rest lengths are bounded by it: l >= c + eps (c + g), where eps is the strain of the tension
    and g the length behind the exit. A cable with mass counts as massless there.

    Returns:
        The step and the tensions that it finds.
    """
    robot = problem.robot
    free, units = robot.free, robot.units
    scale, reach = problem.load or 1.0, robot.characteristic_length
    count, grid, per_load = len(free), np.ix_(free, free), 1 / (units * scale)
    idle = count - directions.shape[1]
    origin, level = problem.at.position, problem.at.rotation_matrix

    def decoded(
        unknowns: Float[np.ndarray, "*rows unknowns"],
    ) -> tuple[Float[np.ndarray, "*rows 6"], Float[np.ndarray, "*rows cables"]]:
        step = np.zeros((*unknowns.shape[:-1], 6))
        step[..., free] = unknowns[..., :count] * reach / units[free]
        return step, np.maximum(unknowns[..., count:], 0) * scale

    @functools.lru_cache(maxsize=1)  # SLSQP asks for the balance at a point, and then for its slope there
    def pulling(point: bytes) -> tuple[forces.State, Float[np.ndarray, "6 cables"], Float[np.ndarray, "3 3"]]:
        """Cables under the tensions, and their wrench matrix; the rest lengths of massless ones have no effect.

        And the left Jacobian of the step's rotation.
        """
        step, tensions = decoded(np.frombuffer(point))
        jacobian = _left_jacobian(step[3:])
        position, rotation = origin + step[:3], level + forces.cross_matrix(step[3:]) @ jacobian @ level
        if robot.cabling.springs:
            cables = forces.geometry(robot, position, rotation)
            return forces.State(problem, position, rotation, cables, tensions), cables.wrench_matrix, jacobian
        rest, W = cut(robot, position, rotation, tensions)
        state = forces.at(Problem(robot, problem.at, rest, problem.external_wrench), position, rotation)
        return state, W, jacobian

    def balance(unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " held"]:
        state, W, _ = pulling(unknowns.tobytes())
        return directions.T @ ((W @ unknowns[count:] * scale + state.load_wrench) * per_load)[free]

    def slope(unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "held unknowns"]:
        state, _, jacobian = pulling(unknowns.tobytes())
        geometric, by_tension = derivatives.wrench_under_tensions(state)
        geometric[:, 3:] = geometric[:, 3:] @ jacobian
        by_step = (geometric * (reach / units * per_load[:, None]))[grid]
        return directions.T @ np.concatenate([by_step, (by_tension / units[:, None])[free]], axis=1)

    def held(unknowns: Float[np.ndarray, "*rows unknowns"]) -> Float[np.ndarray, "*rows"]:
        """The least eigenvalue that tensions can change, minus ``floor``."""
        step, tensions = decoded(unknowns)
        where = origin + step[..., :3], Rotation.from_rotvec(step[..., 3:]).as_matrix() @ level
        state = _with_lengths(problem, cut(robot, *where, tensions)[0], *where)
        return (state.eigenvalues[..., idle] - (floor or 0.0)) * reach / scale

    def held_slope(unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
        points = held(np.vstack([unknowns, unknowns + DIFFERENCE * np.eye(len(unknowns))]))
        return (points[1:] - points[0]) / DIFFERENCE

    def spare(unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " cables"]:
        """By how much each cable's length exceeds that of the least rest length."""
        state, _, _ = pulling(unknowns.tobytes())
        strains = _strains(robot, unknowns[count:] * scale)
        return (state.lengths - least - strains * robot.cabling.stretching(np.asarray(least))) / reach

    def spare_slope(unknowns: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "cables unknowns"]:
        state, _, jacobian = pulling(unknowns.tobytes())
        by_step = -robot.cabling.tensions(state.geometry.wrench_matrix).T
        by_step[:, 3:] = by_step[:, 3:] @ jacobian
        softness = 1 / cable_law.tangent(_strains(robot, unknowns[count:] * scale), 1.0, robot.cabling.law)[0]
        by_tension = np.diag(-robot.cabling.stretching(np.asarray(least)) * softness * scale / reach)
        return np.concatenate([(by_step / units)[:, free], by_tension], axis=1)

    constraints = [{"type": "eq", "fun": balance, "jac": slope}]
    if least > 0:
        constraints.append({"type": "ineq", "fun": spare, "jac": spare_slope})
    if floor is not None:
        constraints.append({"type": "ineq", "fun": lambda unknowns: float(held(unknowns)), "jac": held_slope})
    weights = np.zeros(count + robot.cables)
    weights[:count] = np.repeat([1.0, (arm / reach) ** 2], 3)[free]

    def give_up(unknowns: Float[np.ndarray, " unknowns"]) -> None:
        if np.linalg.norm(decoded(unknowns)[0][:3]) > TOO_FAR * problem.rest_lengths.mean():
            raise StopIteration

    try:
        found = minimize(
            lambda unknowns: float(0.5 * weights @ unknowns**2),
            np.concatenate([(start[0] * units / reach)[free], start[1] / scale]),
            jac=lambda unknowns: weights * unknowns,
            bounds=[(None, None)] * count + [*zip(*(limits / scale), strict=True)],
            constraints=constraints,
            method="SLSQP",
            callback=None if floor is None else give_up,
            options={"maxiter": 300, "ftol": CONVERGED * min(1.0, arm / reach)},
        )
        if not np.isfinite(found.x).all() or np.abs(balance(found.x)).max() > 1e-6:
            return None
        return decoded(found.x)
    except (NotConverged, InvalidInput):  # a cable of zero length, or one too heavy for its tension
        return None


def _strains(robot: Robot, tensions: Float[np.ndarray, " cables"]) -> Float[np.ndarray, " cables"]:
    """The strain of each massless rope under these tensions."""
    return cable_law.strain_at(np.maximum(tensions, 0.0), robot.cabling.law)


def _shortest(problem: Problem, step: Float[np.ndarray, "6"], tensions: Float[np.ndarray, " cables"]) -> float:
    """The least rest length with these tensions after the step [m]; 0 where there is none."""
    pose = moved(problem.pose, step)
    try:
        return float(cut(problem.robot, pose.translation, pose.rotation.as_matrix(), tensions)[0].min())
    except InvalidInput:
        return 0.0


def _settled(
    problem: Problem, step: Float[np.ndarray, "6"], tensions: Float[np.ndarray, " cables"]
) -> Equilibrium | None:
    """The equilibrium with these tensions after the step, if the solver finds it there."""
    robot, pose = problem.robot, moved(problem.pose, step)
    try:
        rest, _ = cut(robot, pose.translation, pose.rotation.as_matrix(), tensions)
        equilibrium = newton.solve(Problem.of(robot, pose, rest, problem.external_wrench))
    except (NotConverged, InvalidInput):  # a cable of zero length, or one too heavy for its tension
        return None
    return equilibrium if distance(pose, equilibrium.pose, robot.characteristic_length) <= _EQUAL else None


def _left_jacobian(rotation_vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """J with exp((phi + d)×) = exp((J d)×) exp(phi×) to first order: the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(rotation_vector))
    cross = forces.cross_matrix(rotation_vector)
    if angle < 1e-6:
        return np.eye(3) + 0.5 * cross
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross
