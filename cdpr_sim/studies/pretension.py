"""Effect of pretension on a fully constrained robot, by both methods: stiffness, slack cables, one length error."""

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
        wrench: external, (6,) [N, N m].
        shifts: displacements by statics, (pretensions,) [m].
        turns: rotations by statics, (pretensions,) [rad].
        settled_shifts: displacements by MuJoCo, (some,) [m].
        settled_turns: rotations by MuJoCo, (some,) [rad].
        taut: smallest pretension without slack cables under this wrench [N].
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
    sizes = np.geomspace(
        least, float(robot.force_max.min()) - least, points
    )  # up to the tension limit of the upper cables
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
        Push(what, PUSHES[what], _shifts(static), _turns(static), _shifts(settled),
             _turns(settled), taut_from(robot, PUSHES[what]))
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
