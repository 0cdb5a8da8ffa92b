"""Sensors on a model in MuJoCo: their readings, noise and delay."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections import deque
from typing import TypeAlias

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.controller import Measurement, Sensors
from cdpr_sim.core.pose import moved
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.physics import pulleys

INSTANT = 1e-9
"""[s] Tolerance of equal times."""


Seen: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""One state: position [m] and quaternion w x y z of the platform, (7,); lengths of the cables from their exits [m],
tensions of the ropes [N] and rest lengths that winches have let out [m], (cables,) each."""


class Readings:
    """Exact readings of a model's own sensors, of one simulation or of many; after ``mj_forward``."""

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        cables = range(1, robot.cables + 1)
        names = "position", "orientation", *(f"length_{i}" for i in cables), *(f"tension_{i}" for i in cables)
        sensors = [model.sensor(name) for name in names]
        self._numbers = np.concatenate([np.arange(one.adr[0], one.adr[0] + one.dim[0]) for one in sensors])
        self._offsets = np.concatenate([np.zeros(7), pulleys.entries(robot.cabling), np.zeros(robot.cables)])
        # The sensors read the pulls of all parts of line.
        self._parts = np.concatenate([np.ones(7 + robot.cables), robot.cabling.pulls(np.ones(robot.cables))])

    def of(
        self, sensed: Float[np.ndarray, "*rows numbers"]
    ) -> tuple[Float[np.ndarray, "*rows 7"], Float[np.ndarray, "*rows cables"], Float[np.ndarray, "*rows cables"]]:
        """The first three numbers of ``Seen``, from MuJoCo's ``sensordata``."""
        read = sensed.take(self._numbers, axis=-1) / self._parts - self._offsets
        end = (7 + read.shape[-1]) // 2  # of the lengths
        return read[..., :7], read[..., 7:end], read[..., end:]


def pose_of(reading: Float[np.ndarray, "*rows 7"]) -> RigidTransform:
    """The pose of a reading of position and quaternion, or of many."""
    frames = np.zeros((*reading.shape[:-1], 4, 4))  # one of components takes SciPy twice as long
    frames[..., :3, :3] = Rotation.from_quat(reading[..., 3:], scalar_first=True).as_matrix()
    frames[..., :3, 3], frames[..., 3, 3] = reading[..., :3], 1.0
    return RigidTransform.from_matrix(frames)


def recorded(robot: Robot, wanted: RigidTransform, times: Float[np.ndarray, " ticks"], seen: list[Seen]) -> Trajectory:
    """The motion of which these states have been ``seen`` at the first of ``times`` [s], with the ``wanted`` poses."""
    poses, lengths, tensions, rest_lengths = (np.array(column) for column in zip(*seen, strict=True))
    rows = np.arange(len(seen))
    problems = Problems.of(robot, wanted[rows], rest_lengths)
    return Trajectory.of(problems, times[rows], pose_of(poses), lengths, tensions)


class Sensing:
    """Queue of samples from the sensors to the controller."""

    def __init__(self, sensors: Sensors) -> None:
        self._sensors = sensors
        self._random = np.random.default_rng(sensors.seed)
        self._taken = 0
        self._waiting: deque[Measurement] = deque()
        self._newest: Measurement | None = None

    def due(self, time: float) -> bool:
        """Whether it is time for another sample."""
        return time >= self._taken * self._sensors.period - INSTANT

    def sample(self, time: float, seen: Seen) -> None:
        """Take a sample of this state."""
        sensors, (read, _, tensions, rest_lengths) = self._sensors, seen
        noise = self._random.standard_normal(6 + len(tensions))
        step = noise[:6] * np.repeat([sensors.position_noise, sensors.rotation_noise], 3)
        pose = moved(pose_of(read), step) if step.any() else pose_of(read)
        self._waiting.append(Measurement(time, pose, tensions + sensors.tension_noise * noise[6:], rest_lengths))
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
