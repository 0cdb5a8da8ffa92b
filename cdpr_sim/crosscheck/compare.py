"""Comparison of the two methods: differences, cross residuals, and a verdict with its reasons."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import positive, refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import angle_between
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import residual_of
from cdpr_sim.statics import forces

POSITION_TOLERANCE = 1e-6
"""[m] A thousandth of a millimetre. DemoBot's settled poses are 1e-9 m from the solver's at most
(``scripts/measure_constants.py``), where a residual of 1e-9 of the weight meets the softest stiffness (a few N/m)."""

ROTATION_TOLERANCE = 1e-5
"""[rad]"""

TENSION_TOLERANCE = 1e-3
"""[N]"""

CROSS_TOLERANCE = 1e-5
"""Largest unbalanced force that either method may find at the other's pose, as a fraction of the load (without load, of
``Problem.force_scale``). MuJoCo calls a platform at rest at 1e-6; a model that is wrong by 1 % in one taut cable leaves
8e-5 or more (``scripts/measure_constants.py``)."""

REST_LENGTH_TOLERANCE = 1e-7
"""[m] A cable this close to its rest length counts as taut or slack, as in the other method."""


LEVEL = 1e-8
"""Tolerance of equal energies between two equilibria of a continuum, as a fraction of load times characteristic length:
less than the work to lift DemoBot's platform by a nanometre."""


class Verdict(enum.Enum):
    """Outcome of the comparison."""

    AGREE = "the two methods agree"
    AGREE_EXCEPT_NEUTRAL = "the two methods agree except along directions in which the platform is neutrally stable"
    DIFFERENT_EQUILIBRIA = "the two methods found different equilibria, each confirmed by the other method"
    DISAGREE = "the two methods disagree"


@dataclass(frozen=True)
class Agreement(HtmlRepr):
    """Comparison of the static and the simulated equilibrium of one problem.

    Attributes:
        verdict: outcome of the comparison.
        reasons: reasons of the verdict, a sentence each; empty for plain agreement.
        position_error: distance between the platform's origins [m].
        rotation_error: angle between the platforms [rad].
        tension_error: largest difference in a cable [N].
        same_slack: whether the same cables are slack; one within 1e-7 m of its rest length counts as either.
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
        return self.verdict in (Verdict.AGREE, Verdict.AGREE_EXCEPT_NEUTRAL)

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
    position_tolerance = positive("position_tolerance", position_tolerance, "m")
    rotation_tolerance = positive("rotation_tolerance", rotation_tolerance, "rad")
    tension_tolerance = positive("tension_tolerance", tension_tolerance, "N")
    problem = static.problem
    if not problem.same_as(settled.problem):
        raise InvalidInput("compare: found equilibria of two problems, expected the same robot, rest lengths and load")
    differences = {
        "position": (np.linalg.norm(static.position - settled.position), position_tolerance, "m"),
        "rotation": (angle_between(static.rotation_matrix, settled.rotation_matrix), rotation_tolerance, "rad"),
        "tension": (np.abs(static.tensions - settled.tensions).max(), tension_tolerance, "N"),
    }
    cross = dict.fromkeys(("MuJoCo at the static pose", "statics at the settled pose"), float("nan"))
    if not has_memory(problem.robot):
        at = settled.position, settled.rotation_matrix
        cross = dict(
            zip(cross, (residual_of(problem, static.at), float(forces.at(problem, *at).residual)), strict=True)
        )
    other_slack = slack_differs(static, settled)

    deviations = [
        f"{name} differs by {error:.1e} {unit} (tolerance {tolerance:.0e})"
        for name, (error, tolerance, unit) in differences.items()
        if not error <= tolerance
    ]
    if other_slack.any():
        cables = ", ".join(str(i + 1) for i in np.flatnonzero(other_slack))
        deviations.append(f"cable {cables} is slack by one method only")
    unbalanced = [
        f"{where} has a residual of {force:.1e} N (tolerance {CROSS_TOLERANCE * problem.force_scale:.0e})"
        for where, force in cross.items()
        if not (has_memory(problem.robot) or force <= CROSS_TOLERANCE * problem.force_scale)
    ]
    if unbalanced or (deviations and has_memory(problem.robot)):
        verdict = Verdict.DISAGREE
    elif not deviations:
        verdict = Verdict.AGREE
    elif not other_slack.any() and differences["tension"][0] <= tension_tolerance and _connected(static, settled):
        verdict = Verdict.AGREE_EXCEPT_NEUTRAL
        deviations.append("the energy is constant between the two poses: the platform is neutrally stable")
    else:
        verdict = Verdict.DIFFERENT_EQUILIBRIA
        deviations += [
            f"the equilibrium by {one.source} is {one.stability.name.lower()}"
            for one in (static, settled)
            if not one.stable
        ]
    return Agreement(
        verdict=verdict,
        reasons=tuple(unbalanced + deviations),
        position_error=float(differences["position"][0]),
        rotation_error=float(differences["rotation"][0]),
        tension_error=float(differences["tension"][0]),
        same_slack=not other_slack.any(),
        static_in_mujoco=cross["MuJoCo at the static pose"],
        settled_in_statics=cross["statics at the settled pose"],
    )


def has_memory(robot: Robot) -> bool:
    """Whether cables have a memory: an equilibrium of a path does not contain the memory that determines its forces.

    So neither method can evaluate its forces at the pose of the other one.
    """
    return bool(robot.cabling.has_memory.any())


def slack_differs(
    static: Equilibrium | EquilibriumBatch, settled: Equilibrium | EquilibriumBatch
) -> Bool[np.ndarray, "*rows cables"]:
    """Which cables are slack by one method only; one at its rest length counts as either."""
    near = [np.abs(one.lengths - one.rest_lengths) <= REST_LENGTH_TOLERANCE for one in (static, settled)]
    return (static.slack != settled.slack) & ~near[0] & ~near[1]


def _connected(static: Equilibrium, settled: Equilibrium) -> bool:
    """``connected`` of one problem."""
    poses = (one.pose for one in (static, settled))
    return bool(connected(Problems.stack([static.problem]), *(RigidTransform.concatenate([pose]) for pose in poses))[0])


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
