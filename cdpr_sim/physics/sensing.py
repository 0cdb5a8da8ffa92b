"""Sensors on a model in MuJoCo: their readings, noise and delay."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections import deque

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.controller import Measurement, Sensors
from cdpr_sim.core.pose import moved
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import pulleys

INSTANT = 1e-9
"""[s] Tolerance of equal times."""


class Readings:
    """Exact readings of a model's own sensors; after ``mj_forward``."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        def addresses(*names: str) -> Int[np.ndarray, " numbers"]:
            sensors = [model.sensor(name) for name in names]
            return np.concatenate([np.arange(one.adr[0], one.adr[0] + one.dim[0]) for one in sensors])

        cables = range(1, robot.cables + 1)
        self._pose = addresses("position", "orientation")
        self._lengths = addresses(*(f"length_{i}" for i in cables))
        self._tensions = addresses(*(f"tension_{i}" for i in cables))
        self._entries, self._parts = pulleys.entries(robot.cabling), robot.reeving
        self._every = np.concatenate([self._pose, self._lengths, self._tensions])
        self._scale = np.concatenate([np.ones(7 + robot.cables), 1 / self._parts])
        self._offset = np.concatenate([np.zeros(7), self._entries, np.zeros(robot.cables)])

    def all(self, sensed: Float[np.ndarray, "*rows numbers"]) -> Float[np.ndarray, "*rows together"]:
        """Pose, lengths and tensions, one after the other, from the ``sensordata`` of one simulation or of many."""
        return sensed.take(self._every, axis=-1) * self._scale - self._offset

    def pose(self, data: mujoco.MjData) -> Float[np.ndarray, "7"]:
        """Pose of the platform: position [m], and quaternion w x y z."""
        return data.sensordata[self._pose]

    def lengths(self, data: mujoco.MjData) -> Float[np.ndarray, " cables"]:
        """Lengths of the cables, from their exits [m]."""
        return data.sensordata[self._lengths] - self._entries

    def tensions(self, data: mujoco.MjData) -> Float[np.ndarray, " cables"]:
        """Tensions of the ropes [N]: the sensors read the pulls of all parts of line."""
        return data.sensordata[self._tensions] / self._parts


def pose_of(reading: Float[np.ndarray, "*rows 7"]) -> RigidTransform:
    """The pose of a reading of position and quaternion, or of many."""
    return RigidTransform.from_components(reading[..., :3], Rotation.from_quat(reading[..., 3:], scalar_first=True))


class Sensing:
    """Queue of samples from the sensors to the controller."""

    def __init__(self, sensors: Sensors, readings: Readings) -> None:
        self._sensors, self._readings = sensors, readings
        self._random = np.random.default_rng(sensors.seed)
        self._taken = 0
        self._waiting: deque[Measurement] = deque()
        self._newest: Measurement | None = None

    def due(self, time: float) -> bool:
        """Whether it is time for another sample."""
        return time >= self._taken * self._sensors.period - INSTANT

    def sample(self, data: mujoco.MjData, time: float, rest_lengths: Float[np.ndarray, " cables"]) -> None:
        """Take a sample; after ``mj_forward``."""
        sensors, tensions = self._sensors, self._readings.tensions(data)
        noise = self._random.standard_normal(6 + len(tensions))
        step = noise[:6] * np.repeat([sensors.position_noise, sensors.rotation_noise], 3)
        pose = pose_of(self._readings.pose(data))
        pose = moved(pose, step) if step.any() else pose
        self._waiting.append(Measurement(time, pose, tensions + sensors.tension_noise * noise[6:], rest_lengths.copy()))
        self._taken += 1

    def newest(self, time: float) -> Measurement:
        """The newest sample that has arrived; before the first, the initial state of the platform."""
        while self._waiting and self._waiting[0].time + self._sensors.delay <= time + INSTANT:
            self._newest = self._waiting.popleft()
        if self._newest is None:
            first = self._waiting[0]
            return Measurement(
                min(first.time, time - self._sensors.delay), first.pose, first.tensions, first.rest_lengths
            )
        return self._newest
