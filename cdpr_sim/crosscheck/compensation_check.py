"""Verification of compensated rest lengths in MuJoCo, from the compensated and from the commanded pose."""

from __future__ import annotations

from dataclasses import dataclass

from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, NotSettled
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import distance
from cdpr_sim.core.problem import Problem
from cdpr_sim.physics.settle import settle

SAME = 1e-5
"""Tolerance of equal poses, as a fraction of the characteristic length. MuJoCo's residual is at most 1e-9 of the load,
which moves a platform as soft as ``compensation.HELD`` by 1e-6."""


@dataclass(frozen=True, eq=False)
class CompensationCheck(HtmlRepr):
    """Verification of a compensation in MuJoCo.

    Attributes:
        compensation: by statics.
        settled_from_compensated: MuJoCo's equilibrium after release at the compensated pose; None if it did not settle.
        settled_from_commanded: MuJoCo's equilibrium after release at the commanded pose; None if it did not settle.
    """

    compensation: Compensation
    settled_from_compensated: Equilibrium | None
    settled_from_commanded: Equilibrium | None

    @property
    def held(self) -> bool:
        """Whether the platform stays at the compensated pose after release there."""
        return self._deviation(self.settled_from_compensated)[0]

    @property
    def reached_from_commanded(self) -> bool:
        """Whether the platform reaches the compensated pose after release at the commanded pose."""
        return self._deviation(self.settled_from_commanded)[0]

    @property
    def reasons(self) -> tuple[str, ...]:
        """What MuJoCo does not confirm, a sentence each."""
        held, result = self._deviation(self.settled_from_compensated)
        reached, result_from_commanded = self._deviation(self.settled_from_commanded)
        if not held:
            return (f"released at the compensated pose, MuJoCo's platform {result}: it is not held",)
        if reached:
            return ()
        return (
            f"released at the commanded pose, MuJoCo's platform {result_from_commanded}: "
            "these lengths hold it at the compensated pose only if it starts there",
        )

    def _deviation(self, settled: Equilibrium | None) -> tuple[bool, str]:
        """Whether MuJoCo's platform settles at the compensated pose, and where it does, as text."""
        if settled is None:
            return False, "does not settle"
        arm = self.compensation.equilibrium.problem.robot.characteristic_length
        away = distance(settled.pose, self.compensation.pose, arm)
        return away <= SAME * arm, f"settles {1e3 * away:.3g} mm from there"

    def __repr__(self) -> str:
        return (
            "<CompensationCheck: "
            f"{'MuJoCo confirms the compensation' if not self.reasons else '; '.join(self.reasons)}>"
        )


def verify_compensation(compensation: Compensation) -> CompensationCheck:
    """Release the platform in MuJoCo with compensated lengths, at the compensated and at the commanded pose.

    Rotations are weighted by the characteristic length in the distance between two poses.

    Args:
        compensation: from ``compensate``.

    Returns:
        MuJoCo's equilibrium in either case, and what it does not confirm.

    Raises:
        InvalidInput: not a ``Compensation``.
    """
    refuse_unless(Compensation, compensation=compensation)
    problem = compensation.equilibrium.problem

    def settled_from(pose) -> Equilibrium | None:
        try:
            return settle(Problem.of(problem.robot, pose, problem.rest_lengths, problem.external_wrench))
        except NotSettled:
            return None

    from_compensated = settled_from(compensation.pose)
    from_commanded = from_compensated if compensation.exact else settled_from(compensation.commanded)
    return CompensationCheck(compensation, from_compensated, from_commanded)


def held(compensation: Compensation) -> Compensation:
    """The compensation, if MuJoCo holds the platform at the compensated pose.

    Raises:
        NotSettled: MuJoCo does not hold it there.
    """
    verification = verify_compensation(compensation)
    if not verification.held:
        x, y, z = compensation.commanded.translation
        robot = compensation.equilibrium.problem.robot
        reason = f"{robot.name}: compensated for ({x:.3g}, {y:.3g}, {z:.3g}) m, {verification.reasons[0]}"
        raise NotSettled(reason, verification.settled_from_compensated)
    return compensation
