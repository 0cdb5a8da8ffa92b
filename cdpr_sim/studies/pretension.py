"""What pretension does to a fully constrained robot, by both methods: stiffness, slack cables, one wrong length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.newton import solve_many

FORCE, TORQUE = 100.0, 2.0
"""[N], [N m] With which the platform is pushed and turned."""

PUSHES = {
    "pushed down": np.array([0, 0, -FORCE, 0, 0, 0]),
    "pushed along y": np.array([0, FORCE, 0, 0, 0, 0]),
    "pushed along x": np.array([FORCE, 0, 0, 0, 0, 0]),
    "turned about x": np.array([0, 0, 0, TORQUE, 0, 0]),
    "turned about z": np.array([0, 0, 0, 0, 0, TORQUE]),
}
"""What is done to the platform: external wrenches [N, N m]."""

DRAWN, HELD = 90.0, 300.0
"""Pretensions [N]: of the robot that is drawn, pushed down until cables are slack; of the one with a wrong length."""

MOST_ERROR = 0.01
"""Of one rest length, as a fraction of it."""

LEAST_MARGIN = 1e-3
"""[N] The least tension at the lowest pretension that is looked at."""

ABOVE, BELOW = 0, 4
"""A cable from above and one from below: at the middle, all others are as these two."""


@dataclass(frozen=True, eq=False)
class Stiffening:
    """The stiffness of the platform against pretension, nothing pushing it.

    Attributes:
        pretensions: (pretensions,) [N].
        eigenvalues: of the stiffness matrix by statics, ascending, (pretensions, 6) [N/m].
        settled_pretensions: (some,) [N].
        settled: eigenvalues by MuJoCo, (some, 6) [N/m].
        directions: in which the platform is that stiff, by eigenvalue: "along x", "about z".
        rigid: eigenvalues on the lengths of rigid cables, without pretension, (6,) [N/m].
    """

    pretensions: Float[np.ndarray, " pretensions"]
    eigenvalues: Float[np.ndarray, "pretensions 6"]
    settled_pretensions: Float[np.ndarray, " some"]
    settled: Float[np.ndarray, "some 6"]
    directions: tuple[str, ...]
    rigid: Float[np.ndarray, "6"]


@dataclass(frozen=True, eq=False)
class Push:
    """How far a wrench moves the platform, against pretension.

    Attributes:
        what: is done.
        wrench: external, (6,) [N, N m].
        shifts: by statics, (pretensions,) [m].
        turns: likewise [rad].
        settled_shifts: by MuJoCo, (some,) [m].
        settled_turns: likewise [rad].
        taut: the pretension from which on no cable hangs slack under this wrench [N].
    """

    what: str
    wrench: Float[np.ndarray, "6"]
    shifts: Float[np.ndarray, " pretensions"]
    turns: Float[np.ndarray, " pretensions"]
    settled_shifts: Float[np.ndarray, " some"]
    settled_turns: Float[np.ndarray, " some"]
    taut: float


@dataclass(frozen=True, eq=False)
class WrongLength:
    """What an error of one cable's rest length does.

    Attributes:
        cable: whose, counted from 0.
        errors: of its rest length, (errors,) [m].
        shifts: of the platform, by statics, (errors,) [m].
        turns: likewise [rad].
        tightest: the largest tension of all cables, likewise [N].
        slack: how many cables hang slack, (errors,).
        settled_errors: (some,) [m].
        settled_shifts, settled_turns, settled_tightest: by MuJoCo, (some,) [m], [rad], [N].
    """

    cable: int
    errors: Float[np.ndarray, " errors"]
    shifts: Float[np.ndarray, " errors"]
    turns: Float[np.ndarray, " errors"]
    tightest: Float[np.ndarray, " errors"]
    slack: Int[np.ndarray, " errors"]
    settled_errors: Float[np.ndarray, " some"]
    settled_shifts: Float[np.ndarray, " some"]
    settled_turns: Float[np.ndarray, " some"]
    settled_tightest: Float[np.ndarray, " some"]

    def short_by(self, tension: float) -> float:
        """By how much this length is too short [m] where the tightest cable pulls with ``tension`` [N]."""
        short = self.errors <= 0
        return float(np.interp(tension, self.tightest[short][::-1], -self.errors[short][::-1]))


@dataclass(frozen=True, eq=False)
class Pretension:
    """The whole study.

    Attributes:
        robot: fully constrained, commanded to its home.
        stiffening: without a wrench.
        pushes: under each of ``PUSHES``.
        wrong: for a cable from above and one from below.
        drawn: where MuJoCo's platform rests at ``DRAWN``, pushed down, (1,).
        apart: the largest distance between the methods [m], and the largest difference of an eigenvalue, as a fraction.
    """

    robot: Robot
    stiffening: Stiffening
    pushes: tuple[Push, ...]
    wrong: tuple[WrongLength, ...]
    drawn: EquilibriumBatch
    apart: tuple[float, float]


def pretension(points: int = 121, every: int = 10, errors: int = 81) -> Pretension:
    """IPAnema 1 in the middle of its workspace, from the least pretension that keeps its cables taut to its limit.

    Args:
        points: pretensions.
        every: so many of them, and of the errors, one is settled in MuJoCo as well.
        errors: of one length.

    Raises:
        NotConverged: the static solver found no rest somewhere.
        NotSettled: MuJoCo's platform did not come to rest somewhere.
    """
    robot = load_robot("ipanema-1")
    home = robot.home
    least = least_pretension(robot)
    sizes = np.geomspace(least, float(robot.force_max.min()) - least, points)  # up to where cables from above pull that
    lengths = np.array([robot.rest_lengths(home, size) for size in sizes])
    still = _both(robot, lengths, every)
    moved = {what: _both(robot, lengths, every, wrench) for what, wrench in PUSHES.items()}
    held = robot.rest_lengths(home, HELD)
    wrong, misfits = [], []
    for cable in (ABOVE, BELOW):
        changes = np.linspace(-MOST_ERROR, MOST_ERROR, errors) * held[cable]
        cut = np.repeat(held[None], errors, axis=0)
        cut[:, cable] += changes
        static, settled = methods = _both(robot, cut, every // 2)
        misfits.append(methods)
        wrong.append(
            WrongLength(
                cable, changes, _shifts(static), _turns(static), static.tensions.max(-1), static.slack.sum(-1),
                changes[:: every // 2], _shifts(settled), _turns(settled), settled.tensions.max(-1),
            )
        )  # fmt: skip
    pushes = tuple(
        Push(what, PUSHES[what], _shifts(static), _turns(static), _shifts(settled),
             _turns(settled), taut_from(robot, PUSHES[what]))
        for what, (static, settled) in moved.items()
    )  # fmt: skip
    static, settled = still
    compared = [(*methods, every) for methods in (still, *moved.values())] + [
        (*methods, every // 2) for methods in misfits
    ]
    apart = np.max([_apart(static, settled, step) for static, settled, step in compared], axis=0)
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
        apart=(float(apart[0]), float(apart[1])),
    )


def least_pretension(robot: Robot) -> float:
    """The least pretension [N] at which no cable would have to push, at the robot's home; tensions grow with it."""
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
    """The pretension [N] from which on no cable hangs slack under a wrench; between slack ones and its limit, by roots.

    A cable that is about to go slack has its rest length: the root of the least stretch over all cables.
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
    """By statics all rows, by MuJoCo one of ``every``, commanded to the robot's home."""
    methods = []
    for method, some in ((solve_many, lengths), (settle_many, lengths[::every])):
        equilibria = method(robot, np.repeat(robot.home[None], len(some), axis=0), some, external_wrench=wrench)
        for row in np.flatnonzero(~equilibria.converged)[:1]:
            equilibria[int(row)]  # raises
        methods.append(equilibria)
    return methods[0], methods[1]


def _shifts(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    return np.linalg.norm(equilibria.deviation, axis=-1)


def _turns(equilibria: EquilibriumBatch) -> Float[np.ndarray, " rows"]:
    return np.asarray(Rotation.from_matrix(equilibria.rotations).magnitude())


def _directions(equilibria: EquilibriumBatch) -> tuple[str, ...]:
    """What each eigenvalue of the first row belongs to: amid a symmetric robot the stiffness matrix is diagonal."""
    state = forces.at(equilibria[0].problem, equilibria.positions[0], equilibria.rotations[0])
    stiffness = np.diag(state.stiffness_matrix) / equilibria.robot.units**2
    return tuple(f"{'along' if i < 3 else 'about'} {'xyzxyz'[i]}" for i in np.argsort(stiffness))


def _apart(static: EquilibriumBatch, settled: EquilibriumBatch, every: int) -> tuple[float, float]:
    """The largest distance between the methods' positions [m], and between their eigenvalues, over the largest one."""
    away = np.abs(static.positions[::every] - settled.positions).max()
    values = static.eigenvalues[::every]
    return float(away), float((np.abs(values - settled.eigenvalues).max(-1) / values.max(-1)).max())
