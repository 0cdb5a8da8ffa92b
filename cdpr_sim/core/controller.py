"""Interface of controllers: the reference motion, sensors' measurements, and commands to the winches.

A controller has a model of the robot, and about the true robot only the measurements. Its commands are carried out by
the caller: ``cdpr_sim.track``, or a real robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import checked_array, positive, shown, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose_path import PosePath

INSTANT = 0.01
"""[s] Time step of the second difference for accelerations."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference motion: a path in time, which begins after a pause at its first pose.

    Attributes:
        path: the path.
        seconds: duration, without the pause.
        pause: time for which the platform stands still before the motion [s].
    """

    path: PosePath
    seconds: float
    pause: float = 0.0

    @property
    def end(self) -> float:
        """End of the motion [s]."""
        return self.pause + self.seconds

    def fractions(self, times: ArrayLike) -> Float[np.ndarray, " times"]:
        """Fractions of the path's duration at these ``times`` [s]: 0 before it begins, 1 after its end.

        Returns:
            (times,) between 0 and 1.

        Raises:
            InvalidInput: times that are neither a number nor a row of finite numbers.
        """
        row = checked_array("times", np.atleast_1d(checked_array("times", times, None)), (None,))
        return np.clip((row - self.pause) / self.seconds, 0, 1)

    def poses(self, times: ArrayLike) -> RigidTransform:
        """Reference poses at these ``times`` [s], a stack.

        Returns:
            A stack of (times,) poses [m].
        """
        return self.path.at(self.fractions(times))

    def pose(self, time: float) -> RigidTransform:
        """Reference pose at ``time`` [s].

        Returns:
            A single pose [m].
        """
        return self.poses(checked_array("time", time, ()))[0]

    def acceleration(self, time: float) -> Float[np.ndarray, "3"]:
        """Acceleration of the reference position at ``time`` [m/s²]; at a corner of the path, a mean over a short time.

        Returns:
            (3,) [m/s²], base frame.
        """
        before, now, after = self.poses(checked_array("time", time, ()) + INSTANT * np.array([-1, 0, 1])).translation
        return (before - 2 * now + after) / INSTANT**2

    def __repr__(self) -> str:
        return f"<Reference: {self.seconds:.3g} s, after a pause of {self.pause:.3g} s>"


@dataclass(frozen=True, eq=False)
class Measurement:
    """Measurement of the sensors: the newest sample that has arrived.

    Attributes:
        time: time of the sample [s], which is earlier than now by a delay.
        pose: pose of the platform.
        tensions: cable tensions at the platform, (cables,) [N].
        rest_lengths: unstretched lengths that the winches had let out, by their encoders, (cables,) [m].
    """

    time: float
    pose: RigidTransform
    tensions: Float[np.ndarray, " cables"]
    rest_lengths: Float[np.ndarray, " cables"]

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        return f"<Measurement at {self.time:.4g} s: ({x:.6f}, {y:.6f}, {z:.6f}) m>"


@dataclass(frozen=True, eq=False)
class Command:
    """A command to the winches: lengths, or tensions.

    Attributes:
        rest_lengths: unstretched lengths to be let out, (cables,) [m].
        tensions: (cables,) [N]; with friction at the exit, the tensions behind it.
        by_tension: (cables,) which winches control their tension, at any length; the others control their length.
    """

    rest_lengths: Float[np.ndarray, " cables"]
    tensions: Float[np.ndarray, " cables"]
    by_tension: Bool[np.ndarray, " cables"]

    @classmethod
    def of(cls, answer: Command | ArrayLike, cables: int) -> Command:
        """Check the return value of a controller; plain numbers are lengths.

        Args:
            answer: what the controller returned: a command, or rest lengths (cables,) [m].
            cables: number of cables.

        Returns:
            The command, with one entry for each of the ``cables``.

        Raises:
            InvalidInput: a command that no winch can carry out.
        """
        whole("cables", cables, 1)
        if not isinstance(answer, Command):
            lengths = checked_array("rest_lengths", answer, (cables,))
            answer = cls(lengths, np.zeros(cables), np.zeros(cables, dtype=bool))
        lengths = checked_array("rest_lengths", answer.rest_lengths, (cables,))
        tensions = checked_array("tensions", answer.tensions, (cables,))
        by_tension = np.asarray(answer.by_tension)
        if by_tension.shape != (cables,) or by_tension.dtype != bool:
            raise InvalidInput(
                f"by_tension: found {shown(by_tension)}, expected True or False for each of {cables} cables"
            )
        if not (lengths > 0).all():
            raise InvalidInput(f"rest_lengths: found {lengths.min():g} m, expected more than 0")
        if not (tensions >= 0).all():
            raise InvalidInput(f"tensions: found {tensions.min():g} N, expected 0 or more: cables only pull")
        return cls(lengths, tensions, by_tension)

    def __repr__(self) -> str:
        held = int(self.by_tension.sum())
        return f"<Command: {held} of {len(self.by_tension)} cables by tension, the others by length>"


@runtime_checkable
class Controller(Protocol):
    """A controller of a robot along a reference motion. Any class with these two methods is one."""

    def start(self, reference: Reference) -> ArrayLike:
        """Begin a new run, without any state of an earlier one.

        Args:
            reference: the motion to be followed.

        Returns:
            The rest lengths (cables,) [m] with which the platform is in equilibrium when the run begins.
        """
        ...

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command | ArrayLike:
        """Command to the winches for ``time`` [s], one period from now; they move to it at constant speed.

        Args:
            time: time of the command.
            pose: reference pose at that time: the one of the motion, or a corrected one.
            measurement: the newest measurement.

        Returns:
            A ``Command``; or rest lengths, (cables,) [m].
        """
        ...


@dataclass(frozen=True)
class Sensors:
    """Properties of the sensors: they sample the pose and the tensions together, and samples arrive after a delay.

    Attributes:
        period: time between two samples [s].
        delay: time until a sample arrives [s].
        position_noise: standard deviation of each coordinate [m].
        rotation_noise: standard deviation of each coordinate of the rotation vector [rad].
        tension_noise: standard deviation of each tension [N].
        seed: seed of the noise; the same seed gives the same noise.
    """

    period: float = 0.01
    delay: float = 0.0
    position_noise: float = 0.0
    rotation_noise: float = 0.0
    tension_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        positive("period", self.period, "s")
        whole("seed", self.seed, 0)
        for field in ("delay", "position_noise", "rotation_noise", "tension_noise"):
            value = float(checked_array(field, getattr(self, field), ()))
            if value < 0:
                raise InvalidInput(f"{field}: found {value:g}, expected 0 or more")
