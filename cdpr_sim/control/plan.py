"""Compensation along a reference motion, computed in advance: corrections of the lengths, and the tensions."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.compensation import Compensation, compensate
from cdpr_sim.core.controller import Reference
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.pretension import without_pretension
from cdpr_sim.core.robot import Robot

SPACING = 0.02
"""[m] Mean distance of the poses that are compensated, along the path; rotations count by the characteristic length."""

KEPT = 4096
"""Number of cached compensations: where no lengths hold a pose, finding the nearest takes tenths of a second."""

Limits = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Plan:
    """Compensations at knots of a reference motion, interpolated in between.

    Attributes:
        robot: the controller's model, on elastic cables without pretension.
        reference: the reference motion.
        knots: fractions of its time, (knots,).
        compensations: one per knot.
        corrections: corrections of the rigid lengths at the reference poses, (knots, cables) [m].
        tensions: (knots, cables) [N].
    """

    robot: Robot
    reference: Reference
    knots: Float[np.ndarray, " knots"]
    compensations: tuple[Compensation, ...]
    corrections: Float[np.ndarray, "knots cables"]
    tensions: Float[np.ndarray, "knots cables"]

    @classmethod
    def of(cls, robot: Robot, reference: Reference, tension_limits: Limits | None) -> Plan:
        """The plan for the controller's model of the robot, on elastic cables if they have a memory there.

        Raises:
            InvalidInput: an invalid pose or invalid limits.
            NotConverged: a pose near which no tensions within limits hold the platform.
        """
        robot = without_pretension(without_memory(robot))
        knots = np.linspace(0, 1, 1 + int(np.ceil(reference.path.length / SPACING)))
        poses = reference.path.at(knots)
        found = tuple(_compensated(robot, pose.as_matrix().tobytes(), tension_limits) for pose in poses)
        rigid = np.array([robot.rest_lengths(pose) for pose in poses])
        corrections = np.array([one.rest_lengths for one in found]) - rigid
        return cls(robot, reference, knots, found, corrections, np.array([one.tensions for one in found]))

    def at(self, time: float) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
        """Correction of the rigid lengths [m], and tensions [N], at ``time`` [s]."""
        fraction = self.reference.fractions(time)[0]
        after = min(int(np.searchsorted(self.knots, fraction, side="right")), len(self.knots) - 1)
        before = max(after - 1, 0)
        gap = self.knots[after] - self.knots[before]
        share = (fraction - self.knots[before]) / gap if gap > 0 else 0.0
        mixed = ((1 - share) * rows[before] + share * rows[after] for rows in (self.corrections, self.tensions))
        correction, tensions = mixed
        return correction, tensions


@functools.lru_cache(maxsize=KEPT)
def _compensated(robot: Robot, frame: bytes, tension_limits: Limits | None) -> Compensation:
    pose = RigidTransform.from_matrix(np.frombuffer(frame).reshape(4, 4))
    return compensate(robot, pose, tension_limits=tension_limits)
