"""Look where the platform is, and want it as far on the other side."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import positive, refuse_unless
from cdpr_sim.core.controller import Command, Controller, Measurement, Reference
from cdpr_sim.core.pose import moved

GAIN = 1.0
"""[1/s] Rate at which a constant error is removed. An integral swings a platform up that is damped more slowly than
that: ``parallel`` on its softer cables by a centimetre at 2, and slowly at 1; ``cogiro`` comes to rest at either
(``scripts/measure_constants.py``)."""

REACH, TURN = 0.05, 0.3
"""[m], [rad] Largest correction: beyond, the cables are not at fault, or nothing helps."""


@dataclass
class PoseFeedback:
    """Another controller, which is told a pose that makes up for the errors seen so far: their integral.

    For controllers that hold lengths. On tensions, which leave the platform swing, an integral swings it up.

    Attributes:
        inner: makes commands of poses.
        gain: rate at which a constant error is removed [1/s].
    """

    inner: Controller
    gain: float = GAIN
    _course: Reference = field(init=False, repr=False)
    _correction: Float[np.ndarray, "6"] = field(init=False, repr=False)
    _seen: float = field(init=False, repr=False)
    _told: deque[tuple[float, RigidTransform]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        refuse_unless(Controller, inner=self.inner)
        positive("gain", self.gain, "1/s")

    def start(self, reference: Reference) -> ArrayLike:
        """With no correction yet.

        Returns:
            (cables,) rest lengths [m], where the other controller starts.
        """
        self._course, self._correction, self._seen, self._told = reference, np.zeros(6), 0.0, deque()
        return self.inner.start(reference)

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command | ArrayLike:
        """What the other commands for a corrected pose; a sample is held against what was wanted when it was taken.

        Returns:
            The other controller's answer.
        """
        self._told.append((time, pose))
        if measurement.time > self._seen:
            wanted = self._wanted(measurement.time)
            turn = (wanted.rotation * measurement.pose.rotation.inv()).as_rotvec()
            error = np.concatenate([wanted.translation - measurement.pose.translation, turn])
            self._correction += self.gain * (measurement.time - self._seen) * error
            for part, most in ((slice(0, 3), REACH), (slice(3, 6), TURN)):
                size = float(np.linalg.norm(self._correction[part]))
                self._correction[part] *= min(1.0, most / size) if size > 0 else 1.0
            self._seen = measurement.time
        return self.inner.command(time, moved(pose, self._correction), measurement)

    def _wanted(self, time: float) -> RigidTransform:
        """What was wanted at ``time`` [s], mostly as it was told then."""
        while self._told[0][0] < time:
            self._told.popleft()
        return self._told[0][1] if self._told[0][0] == time else self._course.pose(time)
