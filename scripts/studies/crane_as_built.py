"""All properties of a crane's cables together, and each of them left out."""

from __future__ import annotations

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.studies.real_cables import POSES, CableEffect, StudiedRobot, both, effect_of

TOGETHER = "all together"


def together(case: StudiedRobot, poses: int = POSES) -> tuple[CableEffect, ...]:
    """Effect of all properties of the cables together, and by how much each of them changes that equilibrium.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
    """
    robot, commanded = case.robot, case.commanded(poses)

    def with_all_but(left_out: str) -> tuple[EquilibriumBatch, EquilibriumBatch]:
        changes = [changes for what, changes in case.properties.items() if what != left_out]
        return both(robot.replace(**{name: value for one in changes for name, value in one.items()}), commanded)

    whole = with_all_but("")
    effects = [effect_of(case.title, TOGETHER, whole, both(robot, commanded))]
    effects += [effect_of(case.title, f"without {what}", with_all_but(what), whole) for what in case.properties]
    return tuple(effects)
