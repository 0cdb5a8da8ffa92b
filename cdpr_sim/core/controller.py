"""What a controller is asked and answers: the motion that is wanted, what sensors say, what winches are to hold.

A controller knows the robot that it believes in, and of the true one what sensors say. What becomes of its commands is
the business of whoever runs it: ``cdpr_sim.track``, or a real robot.
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
from cdpr_sim.core.path import Path

INSTANT = 0.01
"""[s] Over which accelerations are taken."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The motion that is wanted: a path in time, which begins after a pause at its first pose.

    Attributes:
        path: where it leads.
        seconds: how long it takes, the pause not counted.
        pause: how long the platform stands still before it sets off [s].
    """

    path: Path
    seconds: float
    pause: float = 0.0

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.pause + self.seconds

    def fractions(self, times: ArrayLike) -> Float[np.ndarray, " times"]:
        """Of the path's time that have passed at these ``times`` [s]: 0 before it begins, 1 after its end.

        Returns:
            (times,) between 0 and 1.
        """
        return np.clip((np.atleast_1d(checked_array("times", times, None)) - self.pause) / self.seconds, 0, 1)

    def poses(self, times: ArrayLike) -> RigidTransform:
        """What is wanted at these ``times`` [s], a stack.

        Returns:
            A stack of (times,) poses [m].
        """
        return self.path.at(self.fractions(times))

    def pose(self, time: float) -> RigidTransform:
        """What is wanted at ``time`` [s].

        Returns:
            A single pose [m].
        """
        return self.poses(checked_array("time", time, ()))[0]

    def acceleration(self, time: float) -> Float[np.ndarray, "3"]:
        """Of the wanted position at ``time`` [m/s²]; where the path bends, over an instant.

        Returns:
            (3,) [m/s²], base frame.
        """
        before, now, after = self.poses(checked_array("time", time, ()) + INSTANT * np.array([-1, 0, 1])).translation
        return (before - 2 * now + after) / INSTANT**2

    def __repr__(self) -> str:
        return f"<Reference: {self.seconds:.3g} s, after a pause of {self.pause:.3g} s>"


@dataclass(frozen=True, eq=False)
class Measurement:
    """What sensors say: the newest sample that has come through.

    Attributes:
        time: when it was taken [s], which is some delay ago.
        pose: of the platform.
        tensions: of the cables, (cables,) [N].
        rest_lengths: that winches had let out, by their encoders, (cables,) [m].
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
    """What winches are to hold: lengths, or tensions.

    Attributes:
        rest_lengths: to be let out, (cables,) [m].
        tensions: (cables,) [N].
        by_tension: (cables,) which winches hold their tension, whatever the length; the others hold their length.
    """

    rest_lengths: Float[np.ndarray, " cables"]
    tensions: Float[np.ndarray, " cables"]
    by_tension: Bool[np.ndarray, " cables"]

    @classmethod
    def of(cls, answer: Command | ArrayLike, cables: int) -> Command:
        """A controller's answer, checked; plain numbers are lengths.

        Returns:
            The command, with one entry for each of the ``cables``.

        Raises:
            InvalidInput: what no winch can hold.
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
    """What moves a robot along a course. Any class with these two methods is one."""

    def start(self, reference: Reference) -> ArrayLike:
        """Begin anew: nothing of an earlier run may be left.

        Returns:
            The rest lengths (cables,) [m] on which the platform hangs at rest when the run begins.
        """
        ...

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command | ArrayLike:
        """What winches are to hold at ``time`` [s], one period from now; they run there evenly.

        Args:
            time: for which the command is.
            pose: that is wanted then: the course's, or one that corrects it.
            measurement: the newest that sensors say.

        Returns:
            A ``Command``; or rest lengths, (cables,) [m].
        """
        ...


@dataclass(frozen=True)
class Sensors:
    """What sensors are like: they sample the pose and the tensions together, and what they say comes late.

    Attributes:
        period: between two samples [s].
        delay: until a sample comes through [s].
        position_noise: of each coordinate, standard deviation [m].
        rotation_noise: of the rotation vector's coordinates, standard deviation [rad].
        tension_noise: of each tension, standard deviation [N].
        seed: of the noise; the same seed, the same noise.
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
