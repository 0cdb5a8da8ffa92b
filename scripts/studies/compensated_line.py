"""Compensation along a line: equilibria with rigid and with compensated lengths, by both methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.analysis.compensation import Compensation, compensate
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many


@dataclass(frozen=True, eq=False)
class CompensatedLine:
    """A robot's compensation at poses along a line.

    Attributes:
        title: names of the robot and its cables.
        before: by statics, with the rigid lengths, one per pose.
        after: by statics, with the compensated lengths.
        settled_before: by MuJoCo, with the rigid lengths.
        settled_after: by MuJoCo, with the compensated lengths.
        compensations: one per pose.
        position_only: by MuJoCo, with lengths compensated for the position only; empty if all poses are held exactly.
    """

    title: str
    before: Sequence[Equilibrium]
    after: Sequence[Equilibrium]
    settled_before: Sequence[Equilibrium]
    settled_after: Sequence[Equilibrium]
    compensations: Sequence[Compensation]
    position_only: Sequence[Equilibrium] = ()

    @property
    def exact(self) -> Bool[np.ndarray, " poses"]:
        """(poses,) where the commanded pose is held exactly."""
        return np.array([one.exact for one in self.compensations])

    def position_errors(self, results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        """Distance of each of ``results`` from the commanded position [m]."""
        pairs = zip(results, self.compensations, strict=True)
        return np.array([np.linalg.norm(found.position - one.commanded.translation) for found, one in pairs])

    def rotation_errors(self, results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        """Angle of each of ``results`` to the commanded rotation [rad]."""
        pairs = zip(results, self.compensations, strict=True)
        return np.array([(found.rotation * one.commanded.rotation.inv()).magnitude() for found, one in pairs])


def compensated_line(robot: Robot, title: str, commanded: ArrayLike, *, arm: float | None = None) -> CompensatedLine:
    """Compensate ``robot`` along a line; compensated equilibria start at the uncompensated ones.

    Args:
        robot: the robot.
        title: name of the robot and its cables.
        commanded: level poses, (poses, 3) [m].
        arm: as in ``compensate`` [m].

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    commanded = np.asarray(commanded, dtype=float)
    compensations = [compensate(robot, pose, arm=arm) for pose in commanded]
    lengths = np.array([one.rest_lengths for one in compensations])
    before, settled_before = solve_many(robot, commanded), settle_many(robot, commanded)
    position_only: Sequence[Equilibrium] = ()
    if not all(one.exact for one in compensations):
        for_position = np.array([compensate(robot, pose, arm=0).rest_lengths for pose in commanded])
        position_only = tuple(settle_many(robot, settled_before.poses, for_position))
    return CompensatedLine(
        title=title,
        before=tuple(before),
        after=tuple(solve_many(robot, before.poses, lengths)),
        settled_before=tuple(settled_before),
        settled_after=tuple(settle_many(robot, settled_before.poses, lengths)),
        compensations=compensations,
        position_only=position_only,
    )
