"""Does MuJoCo hold the platform on compensated lengths where statics says: from there, and from where it should be?"""

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
"""Of the characteristic length: MuJoCo's platform is back where it was. It rests with 1e-9 of the load unbalanced,
which moves a platform that is as soft as ``compensation.HELD`` by 1e-6."""


@dataclass(frozen=True, eq=False)
class CompensationCheck(HtmlRepr):
    """What MuJoCo says of a compensation.

    Attributes:
        compensation: what statics says.
        stayed: where MuJoCo's platform rests when it is let go at the compensated pose; None where it does not rest.
        reached: where it rests when it is let go at the commanded pose; None where it does not rest.
    """

    compensation: Compensation
    stayed: Equilibrium | None
    reached: Equilibrium | None

    @property
    def held(self) -> bool:
        """Whether the platform stays at the compensated pose."""
        return self._is_there(self.stayed)

    @property
    def reached_from_commanded(self) -> bool:
        """Whether it comes there by itself from the commanded pose."""
        return self._is_there(self.reached)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What MuJoCo does not confirm, a sentence each."""
        told = []
        if not self.held:
            told.append(f"let go at the compensated pose, MuJoCo's platform {self._goes(self.stayed)}: it is not held")
        if self.held and not self.reached_from_commanded:
            told.append(
                f"let go at the commanded pose, MuJoCo's platform {self._goes(self.reached)}: "
                "these lengths hold it at the compensated pose once it is there"
            )
        return tuple(told)

    def _is_there(self, rest: Equilibrium | None) -> bool:
        arm = self.compensation.equilibrium.problem.robot.characteristic_length
        return rest is not None and distance(rest.pose, self.compensation.pose, arm) <= SAME * arm

    def _goes(self, rest: Equilibrium | None) -> str:
        if rest is None:
            return "does not come to rest"
        arm = self.compensation.equilibrium.problem.robot.characteristic_length
        return f"rests {1e3 * distance(rest.pose, self.compensation.pose, arm):.3g} mm from there"

    def __repr__(self) -> str:
        return (
            "<CompensationCheck: "
            f"{'MuJoCo confirms the compensation' if not self.reasons else '; '.join(self.reasons)}>"
        )


def verify_compensation(compensation: Compensation) -> CompensationCheck:
    """Let the platform go in MuJoCo on compensated lengths, at the compensated pose and at the commanded one.

    The distance between two rests counts rotations by the characteristic length.

    Args:
        compensation: from ``compensate``.

    Returns:
        Where MuJoCo's platform rests in either case, and what it does not confirm.

    Raises:
        InvalidInput: no compensation.
    """
    refuse_unless(Compensation, compensation=compensation)
    problem = compensation.equilibrium.problem

    def rest_from(pose) -> Equilibrium | None:
        try:
            return settle(Problem.of(problem.robot, pose, problem.rest_lengths, problem.external_wrench))
        except NotSettled:
            return None

    stayed = rest_from(compensation.pose)
    reached = stayed if compensation.exact else rest_from(compensation.commanded)
    return CompensationCheck(compensation, stayed, reached)


def held(compensation: Compensation) -> Compensation:
    """The compensation, if MuJoCo holds the platform where it says.

    Raises:
        NotSettled: it does not.
    """
    hold = verify_compensation(compensation)
    if not hold.held:
        x, y, z = compensation.commanded.translation
        robot = compensation.equilibrium.problem.robot
        raise NotSettled(f"{robot.name}: compensated for ({x:.3g}, {y:.3g}, {z:.3g}) m, {hold.reasons[0]}", hold.stayed)
    return compensation
