"""Integral feedback of the pose around another controller."""

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
"""[1/s] Rate at which a constant error is removed. An integral destabilises a platform whose damping rate is lower than
this: ``parallel`` on its softer cables oscillates by a centimetre at 2, and slowly at 1; ``cogiro`` comes to rest at
either (``scripts/dev/measure_constants.py``)."""

REACH, TURN = 0.05, 0.3
"""[m], [rad] Largest correction: a larger error has other causes than the cables, or cannot be corrected."""


@dataclass
class PoseFeedback:
    """Integral feedback around another controller: it gets a pose that is corrected by the integral of the errors.

    For controllers of lengths. With controlled tensions, the platform can swing, and an integral amplifies the swing.

    Attributes:
        inner: controller that turns poses into commands.
        gain: rate at which a constant error is removed [1/s].
    """

    inner: Controller
    gain: float = GAIN
    _reference: Reference = field(init=False, repr=False)
    _correction: Float[np.ndarray, "6"] = field(init=False, repr=False)
    _sampled: float = field(init=False, repr=False)
    _poses: deque[tuple[float, RigidTransform]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        refuse_unless(Controller, inner=self.inner)
        positive("gain", self.gain, "1/s")

    def start(self, reference: Reference) -> ArrayLike:
        """Start the inner controller, without any correction.

        Returns:
            (cables,) rest lengths [m] of the inner controller.
        """
        self._reference, self._correction, self._sampled, self._poses = reference, np.zeros(6), 0.0, deque()
        return self.inner.start(reference)

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command | ArrayLike:
        """Command of the inner controller for a corrected pose; a sample is compared with the reference at its time.

        Returns:
            The inner controller's command.
        """
        self._poses.append((time, pose))
        if measurement.time > self._sampled:
            while self._poses[0][0] < measurement.time:
                self._poses.popleft()
            sampled, wanted = self._poses[0]  # usually, a sample was taken at the time of a command
            if sampled != measurement.time:
                wanted = self._reference.pose(measurement.time)
            turn = (wanted.rotation * measurement.pose.rotation.inv()).as_rotvec()
            error = np.concatenate([wanted.translation - measurement.pose.translation, turn])
            self._correction += self.gain * (measurement.time - self._sampled) * error
            for part, most in ((slice(0, 3), REACH), (slice(3, 6), TURN)):
                size = float(np.linalg.norm(self._correction[part]))
                self._correction[part] *= min(1.0, most / size) if size > 0 else 1.0
            self._sampled = measurement.time
        return self.inner.command(time, moved(pose, self._correction), measurement)
