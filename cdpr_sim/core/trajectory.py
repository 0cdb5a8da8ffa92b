"""A motion of the platform and its commands: a batch with times, computed by MuJoCo."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.status import Status


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(EquilibriumBatch):
    """A motion of the platform, state by state: a batch of (steps,), and the time of each; usable without rendering.

    A moving platform is not in equilibrium: residuals and eigenvalues are nan, and the status is ``MOVING``.

    Attributes:
        times: (steps,) [s].
    """

    times: Float[np.ndarray, " steps"]

    @classmethod
    def of(
        cls,
        problems: Problems,
        times: Float[np.ndarray, " steps"],
        poses: RigidTransform,
        lengths: Float[np.ndarray, "steps cables"],
        tensions: Float[np.ndarray, "steps cables"],
    ) -> Trajectory:
        """A motion from its states.

        Args:
            problems: (steps,), the commands, and the rest lengths that the winches had let out.
            times: (steps,) [s].
            poses: (steps,) of the platform.
            lengths: (steps, cables) of the cables [m].
            tensions: (steps, cables) of the ropes [N].

        Returns:
            A motion of (steps,) states.
        """
        steps = len(times)
        motion = cls(
            problems=problems,
            positions=np.array(poses.translation),
            rotations=poses.rotation.as_matrix(),
            lengths=lengths,
            tensions=tensions,
            residuals=np.full(steps, np.nan),
            iterations=np.zeros(steps, dtype=int),
            status=np.full(steps, Status.MOVING.value),
            source="mujoco",
            stiffness=np.full((steps, len(problems.robot.free)), np.nan),
            times=times,
        )
        motion.__dict__["poses"] = poses
        return motion

    @classmethod
    def through(cls, equilibria: EquilibriumBatch, times: Float[np.ndarray, " steps"]) -> Trajectory:
        """A motion so slow that each state, (steps,), is one of ``equilibria``: without ``drive``.

        Args:
            equilibria: (steps,).
            times: (steps,) [s].

        Returns:
            A motion of (steps,) states, each in equilibrium.
        """
        return cls(
            **{field.name: getattr(equilibria, field.name) for field in dataclasses.fields(EquilibriumBatch)},
            times=times,
        )

    def __repr__(self) -> str:
        away = 1e3 * np.linalg.norm(self.deviation, axis=-1).max()
        return (
            f"<Trajectory of {self.robot.name!r} by {self.source}: {len(self)} states in {np.ptp(self.times):.3g} s, "
            f"tilt up to {np.degrees(self.tilt.max()):.3g}°, deviation up to {away:.3g} mm>"
        )


class PlatformFell(CdprError):
    """The platform fell in MuJoCo while it was driven.

    Attributes:
        trajectory: the motion so far; its last state is the fallen one.
    """

    def __init__(self, reason: str, trajectory: Trajectory | None = None) -> None:
        super().__init__(reason)
        self.trajectory = trajectory


class BadCommand(InvalidInput):
    """A controller gave no command, or one that no winch can carry out.

    Attributes:
        trajectory: the motion so far.
    """

    def __init__(self, reason: str, trajectory: Trajectory | None = None) -> None:
        super().__init__(reason)
        self.trajectory = trajectory
