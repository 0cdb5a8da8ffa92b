"""Comparison of the two methods: differences, cross residuals, and a verdict with its reasons."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import positive, refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import angle_between, poses_of
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.slack import slack_limits
from cdpr_sim.core.status import Status
from cdpr_sim.core.tolerances import POSITION_TOLERANCE, ROTATION_TOLERANCE, TENSION_TOLERANCE
from cdpr_sim.physics.settle import residuals_of
from cdpr_sim.statics import forces

CROSS_TOLERANCE = 1e-5
"""Largest unbalanced force that either method may find at the other's pose, as a fraction of the load (without load, of
``Problem.force_scale``). MuJoCo calls a platform at rest at 1e-6; a model that is wrong by 1 % in one taut cable leaves
8e-5 or more (``scripts/dev/measure_constants.py``)."""

REST_LENGTH_TOLERANCE = 1e-7
"""[m] A cable this close to its rest length counts as taut or slack, as in the other method."""

LIMIT_TOLERANCE = 1e-6
"""A cable with mass whose pull is this close to the largest of a slack one (``core.slack``), as a fraction of
``Problem.force_scale``, counts as taut or slack as well. It is the residual with which MuJoCo calls a platform at rest;
the tensions of 800 cables of 4 mm steel by both methods differ by 7e-10."""

BEYOND = {
    "position_error": "position differs by {:.1e} m (tolerance {:.0e})",
    "rotation_error": "rotation differs by {:.1e} rad (tolerance {:.0e})",
    "tension_error": "tension differs by {:.1e} N (tolerance {:.0e})",
    "static_in_mujoco": "MuJoCo at the static pose has a residual of {:.1e} N (tolerance {:.0e})",
    "settled_in_statics": "statics at the settled pose has a residual of {:.1e} N (tolerance {:.0e})",
}
"""Errors and cross residuals of ``Agreement``, and the reason where one is beyond its tolerance."""

CROSS = ("static_in_mujoco", "settled_in_statics")
"""The cross residuals."""

LEVEL = 1e-8
"""Tolerance of equal energies between two equilibria of a continuum, as a fraction of load times characteristic length:
less than the work to lift DemoBot's platform by a nanometre."""


class Verdict(enum.Enum):
    """Outcome of the comparison."""

    AGREE = "the two methods agree"
    AGREE_EXCEPT_NEUTRAL = "the two methods agree except along directions in which the platform is neutrally stable"
    DIFFERENT_EQUILIBRIA = "the two methods found different equilibria, each confirmed by the other method"
    DISAGREE = "the two methods disagree"


AGREEING = (Verdict.AGREE, Verdict.AGREE_EXCEPT_NEUTRAL)


@dataclass(frozen=True)
class Agreement(HtmlRepr):
    """Comparison of the static and the simulated equilibrium of one problem.

    Attributes:
        verdict: outcome of the comparison.
        reasons: reasons of the verdict, a sentence each; empty for plain agreement.
        position_error: distance between the platform's origins [m].
        rotation_error: angle between the platforms [rad].
        tension_error: largest difference in a cable [N].
        same_slack: whether the same cables are slack; one within 1e-7 m of its rest length counts as either, and one
            with mass that pulls within 1e-6 of the load by as much as a slack one may.
        static_in_mujoco: residual (unbalanced force) of MuJoCo at the static pose [N]; nan for cables with a memory,
            whose forces depend on the path.
        settled_in_statics: residual of statics at the settled pose [N]; nan as well.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    position_error: float
    rotation_error: float
    tension_error: float
    same_slack: bool
    static_in_mujoco: float
    settled_in_statics: float

    @property
    def agrees(self) -> bool:
        """Whether the two methods agree."""
        return self.verdict in AGREEING

    def __repr__(self) -> str:
        return (
            f"<Agreement: {self.verdict.value}: {1e3 * self.position_error:.1e} mm, "
            f"{np.degrees(self.rotation_error):.1e}° and {self.tension_error:.1e} N difference, "
            f"{'the same' if self.same_slack else 'different'} slack cables>"
        )


def compare(
    static: Equilibrium,
    settled: Equilibrium,
    *,
    position_tolerance: float = POSITION_TOLERANCE,
    rotation_tolerance: float = ROTATION_TOLERANCE,
    tension_tolerance: float = TENSION_TOLERANCE,
) -> Agreement:
    """Compare an equilibrium of statics with one settled in MuJoCo.

    Args:
        static: from ``solve``, or a step of ``solve_path``.
        settled: from ``settle``, of the same robot, rest lengths and load; or that step of ``settle_path``.
        position_tolerance: [m].
        rotation_tolerance: [rad].
        tension_tolerance: [N].

    Returns:
        The verdict with its reasons, and the differences [m, rad, N].

    Raises:
        InvalidInput: equilibria of different problems, or a tolerance that is not above 0.
    """
    refuse_unless(Equilibrium, static=static, settled=settled)
    tolerances = {
        "position_error": positive("position_tolerance", position_tolerance, "m"),
        "rotation_error": positive("rotation_tolerance", rotation_tolerance, "rad"),
        "tension_error": positive("tension_tolerance", tension_tolerance, "N"),
    }
    if not static.problem.same_as(settled.problem):
        raise InvalidInput("compare: found equilibria of two problems, expected the same robot, rest lengths and load")
    return compare_many(_as_batch(static), _as_batch(settled), tolerances=tolerances, threads=1).agreement(0)


def _as_batch(one: Equilibrium) -> EquilibriumBatch:
    return EquilibriumBatch(
        Problems.stack([one.problem]), one.position[None], one.rotation_matrix[None], one.lengths[None],
        one.tensions[None], np.array([one.residual]), np.array([one.iterations]), np.array([Status.CONVERGED]),
        one.source, lambda _: one.eigenvalues[None],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of static and simulated equilibria, row by row.

    Attributes:
        solved: static equilibria, (rows,).
        settled: the same problems by MuJoCo.
        errors: errors and cross residuals of ``Agreement``, (rows,) each; nan without equilibria of both methods.
        tolerances: of those that count, a number or (rows,) each.
        other_slack: which cables are slack by one method only, (rows, cables).
        verdicts: (rows,) a ``Verdict`` each; None without equilibria of both methods.
    """

    solved: EquilibriumBatch
    settled: EquilibriumBatch
    errors: dict[str, Float[np.ndarray, " rows"]]
    tolerances: dict[str, float | Float[np.ndarray, " rows"]]
    other_slack: Bool[np.ndarray, "rows cables"]
    verdicts: np.ndarray

    @property
    def agrees(self) -> Bool[np.ndarray, " rows"]:
        """Whether the two methods agree, as ``Agreement.agrees``."""
        return np.array([verdict in AGREEING for verdict in self.verdicts])

    def agreement(self, row: int) -> Agreement:
        """The comparison of one row, with its reasons; both methods must have an equilibrium there."""
        verdict, other_slack = self.verdicts[row], self.other_slack[row]
        errors = {name: float(column[row]) for name, column in self.errors.items()}
        limits = {name: np.broadcast_to(one, len(self.verdicts))[row] for name, one in self.tolerances.items()}
        reasons = [
            BEYOND[name].format(errors[name], limit) for name, limit in limits.items() if not errors[name] <= limit
        ]
        if other_slack.any():
            cables = ", ".join(str(i + 1) for i in np.flatnonzero(other_slack))
            reasons.append(f"cable {cables} is slack by one method only")
        if verdict is Verdict.AGREE_EXCEPT_NEUTRAL:
            reasons.append("the energy is constant between the two poses: the platform is neutrally stable")
        elif verdict is Verdict.DIFFERENT_EQUILIBRIA:
            reasons += [
                f"the equilibrium by {one.source} is {one.stability.name.lower()}"
                for one in (self.solved[row], self.settled[row])
                if not one.stable
            ]
        return Agreement(verdict, tuple(reasons), same_slack=not other_slack.any(), **errors)


def compare_many(
    solved: EquilibriumBatch,
    settled: EquilibriumBatch,
    *,
    tolerances: Mapping[str, float] | None = None,
    threads: int = 0,
) -> Comparison:
    """Compare static equilibria with those settled in MuJoCo, row by row.

    Args:
        solved: static equilibria, (rows,).
        settled: the same problems by MuJoCo.
        tolerances: of the errors, by name; default: the constants above.
        threads: for MuJoCo; 0 for one per processor.
    """
    memory, rows = has_memory(solved.robot), np.flatnonzero(solved.converged & settled.converged)
    cross = () if memory else CROSS
    limits: dict[str, Any] = dict.fromkeys(cross, CROSS_TOLERANCE * solved.problems.force_scale)
    limits |= tolerances or {
        "position_error": POSITION_TOLERANCE, "rotation_error": ROTATION_TOLERANCE, "tension_error": TENSION_TOLERANCE
    }  # fmt: skip
    errors, verdicts = {name: np.full(len(solved), np.nan) for name in BEYOND}, np.full(len(solved), None)
    static, at_rest = ((one.positions[rows], one.rotations[rows]) for one in (solved, settled))
    errors["position_error"][rows] = np.linalg.norm(static[0] - at_rest[0], axis=-1)
    errors["rotation_error"][rows] = angle_between(static[1], at_rest[1])
    errors["tension_error"][rows] = np.abs(solved.tensions[rows] - settled.tensions[rows]).max(-1)
    if rows.size and not memory:
        problems = solved.problems.take(rows)
        errors["static_in_mujoco"][rows] = residuals_of(problems, poses_of(*static), threads=threads)
        errors["settled_in_statics"][rows] = forces.at(problems, *at_rest).residual
    other_slack = (solved.slack != settled.slack) & ~_near_slack(solved) & ~_near_slack(settled)
    within = {name: errors[name] <= limit for name, limit in limits.items()}
    balanced = np.all([within[name] for name in cross], axis=0)
    same_tensions = balanced & within["tension_error"] & ~other_slack.any(-1)
    same_pose = within["position_error"] & within["rotation_error"]
    verdicts[rows] = Verdict.DISAGREE
    if not memory:
        verdicts[balanced] = Verdict.DIFFERENT_EQUILIBRIA
        elsewhere = np.flatnonzero(same_tensions & ~same_pose)
        if elsewhere.size:
            poses = (poses_of(one.positions[elsewhere], one.rotations[elsewhere]) for one in (solved, settled))
            verdicts[elsewhere[connected(solved.problems.take(elsewhere), *poses)]] = Verdict.AGREE_EXCEPT_NEUTRAL
    verdicts[same_tensions & same_pose] = Verdict.AGREE
    return Comparison(solved, settled, errors, limits, other_slack, verdicts)


def _near_slack(equilibria: EquilibriumBatch) -> Bool[np.ndarray, "rows cables"]:
    """Which cables may be slack or taut within the errors of lengths and tensions."""
    problems = equilibria.problems
    at_rest_length = np.abs(equilibria.lengths - equilibria.rest_lengths) <= REST_LENGTH_TOLERANCE
    beside = np.abs(equilibria.pulls - slack_limits(problems)) <= LIMIT_TOLERANCE * problems.force_scale[..., None]
    return at_rest_length | (beside & (problems.cable_weights > 0))


def has_memory(robot: Robot) -> bool:
    """Whether cables have a memory: an equilibrium of a path does not contain the memory that determines its forces.

    So neither method can evaluate its forces at the pose of the other one.
    """
    return bool(robot.cabling.has_memory.any())


def connected(problems: Problems, static: RigidTransform, settled: RigidTransform) -> Bool[np.ndarray, " rows"]:
    """Which pairs of equilibria belong to one continuum: constant energy along the screw motion between them.

    The energy is compared and not the forces: rounding of the two poses times a high stiffness is a noticeable force,
    but a negligible energy.

    Args:
        problems: (rows,) problems.
        static: their poses by statics, a stack.
        settled: by MuJoCo.
    """
    fractions, rows = np.linspace(0, 1, 17), len(problems)
    between = (static.inv() * settled).as_exp_coords()
    each = np.tile(np.arange(rows), len(fractions))
    poses = static[each] * RigidTransform.from_exp_coords(np.repeat(fractions, rows)[:, None] * between[each])
    shape = len(fractions), rows
    at = poses.translation.reshape(*shape, 3), poses.rotation.as_matrix().reshape(*shape, 3, 3)
    turn = (settled.rotation * static.rotation.inv()).as_rotvec()
    work = fractions[:, None] * (turn * problems.external_wrench[..., 3:]).sum(-1)
    energies = forces.at(problems, *at).energy - work
    tolerance = LEVEL * problems.force_scale * problems.robot.characteristic_length
    return np.ptp(energies, axis=0) <= tolerance
