"""Simulations of one robot side by side in MuJoCo, period by period, for learning.

The model, the winches and the damping are those of ``track``, and so are the motions. Here MuJoCo itself integrates
each control period, by its Runge-Kutta method of fourth order: many simulations on threads, and with longer steps than
``track``'s method of second order allows.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import Batch
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.pretension import without_pretension
from cdpr_sim.core.robot import Robot
from cdpr_sim.learning.driven_model import DrivenModel
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.mjcf import place
from cdpr_sim.physics.sensing import Seen

STEPS = 7
"""Least number of time steps per period of the platform's fastest oscillation: 0.9 of its inverse angular frequency,
where the Runge-Kutta method is stable up to 2.8. Positions then deviate from those of ``track`` by at most 0.03 mm in a
motion of 0.2 m in a second."""

DECAY = 0.5
"""Largest time step as a multiple of the damping time of that oscillation; the method is stable up to 2.8."""


LEAST = 1e-150
"""Length of a vector that counts as zero; its square is still a number."""

FIELDS = (
    "site_pos", "body_pos", "body_mass", "body_inertia", "dof_damping", "actuator_gainprm", "actuator_biasprm"
)  # fmt: skip
"""Of the model, in which simulations differ."""

PARTS_OF_EXITS = (
    (mujoco.mjtObj.mjOBJ_SITE, "site_pos", "exit"),
    (mujoco.mjtObj.mjOBJ_SITE, "site_pos", "entry"),
    (mujoco.mjtObj.mjOBJ_BODY, "body_pos", "pulley"),
)
"""What lies at the exit of a cable: the kind of element, the field of its position, and its name."""


class TaskSimulations:
    """``count`` simulations of a robot and of robots that differ from it in ``Domain``.

    Args:
        machine: the nominal robot in MuJoCo, on massless linear cables; its model becomes that of the simulations.
        count: number of simulations.
        period: control period [s].
        by_tension: (cables,) winches that control their tension; the others control their length.
        largest: largest tensions of the winches, (cables,) [N].
        threads: number of threads; 0 is one per core.

    Attributes:
        machine: the nominal robot in MuJoCo.
        batch: MuJoCo's simulations.
        rest_lengths: that winches have let out, (count, cables) [m].
        poses: positions [m], and quaternions w x y z, (count, 7).
        rotations: rotation matrices, (count, 3, 3); a view of MuJoCo's.
        lengths: of the cables, (count, cables) [m].
        tensions: of the ropes, (count, cables) [N].
        failed: (count,) simulations that became unstable.
    """

    def __init__(
        self,
        machine: DrivenModel,
        count: int,
        *,
        period: float,
        by_tension: Bool[np.ndarray, " cables"],
        largest: Float[np.ndarray, " cables"],
        threads: int,
    ) -> None:
        robot = machine.robot
        self.machine, self.robot, self.period = machine, robot, period
        self.by_tension, self.largest = by_tension, largest
        self._most, (self._shortest, self._longest) = machine.winch_speed * period, machine.reach
        self._some = bool(by_tension.any())
        model = machine.model
        longest = min(model.opt.timestep, 2 * np.pi / machine.fastest / STEPS, DECAY * machine.damping_time)
        steps = max(1, int(np.ceil(period / longest)))
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, period / steps
        model.actuator_gainprm[by_tension] = model.actuator_biasprm[by_tension] = 0
        model.actuator_gainprm[by_tension, 0] = robot.cabling.pulls(np.ones(robot.cables))[by_tension]
        model.actuator_ctrlrange[by_tension] = np.stack([np.zeros(by_tension.sum()), largest[by_tension]], axis=1)
        # A step is made with the length at its middle; the last one is that at the end of the period.
        self._steps, self._at = steps, np.append((np.arange(steps) + 0.5) / steps, 1.0)[:, None]
        self.batch = Batch(model, count, threads)
        self._qpos, self._qvel, self._ctrl = (self.batch.bind(name) for name in ("qpos", "qvel", "ctrl"))
        self._time, self._sensed = self.batch.bind("time").reshape(count), self.batch.bind("sensordata")
        self.rotations = self.batch.bind("xmat")[:, machine.platform].reshape(count, 3, 3)
        self._upwards = self.rotations[:, 2, 2]
        self._fields = {name: self.batch.expand(name) for name in FIELDS}
        self._still = self._fields["actuator_biasprm"][:, :, 0].copy()  # of winches that stand still
        self.batch.forward()
        self._read()
        self._scratch, self._data = self.batch.get_model(0), mujoco.MjData(model)
        self._mean = machine.let_out.mean()
        self._least_time = np.full(count, -0.5 * period)
        self.rest_lengths = np.tile(machine.let_out, (count, 1))
        self._stiffness, self._law = np.tile(robot.axial_stiffness, (count, 1)), Law.of(robot.cabling)
        self.failed = np.zeros(count, dtype=bool)

    def begin(
        self,
        row: int,
        robot: Robot,
        friction: Float[np.ndarray, " cables"],
        pose: RigidTransform,
        rest_lengths: Float[np.ndarray, " cables"],
    ) -> None:
        """Start a simulation of ``robot`` at rest at ``pose``, on ``rest_lengths`` [m]."""
        self._become(row, robot)
        self._fields["actuator_biasprm"][row, :, 2] -= np.where(self.by_tension, 0.0, robot.cabling.pulls(friction))
        self._still[row] = self._fields["actuator_biasprm"][row, :, 0]
        # Air damps the pendulum of the cables: as in ``track``, of their lengths at the first pose.
        swing = np.sqrt(self._mean / without_pretension(self.robot).rest_lengths(self.robot.pose(pose)).mean())
        self._fields["dof_damping"][row, : len(robot.free)] *= swing
        self._scratch = self.batch.get_model(row, self._scratch)
        mujoco.mj_resetData(self._scratch, self._data)
        place(self._scratch, self._data, robot, pose)
        self._qpos[row], self._qvel[row], self._time[row] = self._data.qpos, 0.0, 0.0
        self._least_time[row], self.failed[row] = -0.5 * self.period, False
        self.rest_lengths[row] = rest_lengths
        # Tensions of springs; winches that control tensions begin with those, in equilibrium as well.
        self._ctrl[row] = self.machine.controls(self.rest_lengths[row])
        if self._some:
            mujoco.mj_forward(self._scratch, self._data)
            _, lengths, _ = self.machine.readings.of(self._data.sensordata)
            tensions = robot.axial_stiffness * Law.of(robot.cabling).strains(lengths, rest_lengths)
            tensions = tensions.clip(0, self.largest)
            self._ctrl[row] = np.where(self.by_tension, tensions, self._ctrl[row])
        self.batch.forward(ids=[row])
        self._read()

    def _become(self, row: int, robot: Robot) -> None:
        """Give a simulation the parameters of ``robot``: those that are not nominal."""
        model, nominal, fields = self.machine.model, self.robot, self._fields
        self._stiffness[row] = robot.axial_stiffness
        for name, values in fields.items():
            values[row] = getattr(model, name)
        if robot is nominal:
            return
        factors = np.where(self.by_tension, 1.0, robot.axial_stiffness / nominal.axial_stiffness)[:, None]
        fields["actuator_gainprm"][row] *= factors
        fields["actuator_biasprm"][row, :, :3] *= factors
        for name in ("body_mass", "body_inertia"):
            fields[name][row, self.machine.platform] *= robot.mass / nominal.mass
        fields["dof_damping"][row, : len(robot.free)] *= robot.mass / nominal.mass
        for cable, shift in enumerate(robot.exits - nominal.exits, start=1):
            for kind, field, name in PARTS_OF_EXITS:
                number = mujoco.mj_name2id(model, kind.value, f"{name}_{cable}")
                if number >= 0:
                    fields[field][row, number] += shift

    def advance(self, actions: Float[np.ndarray, "count cables"]) -> None:
        """Simulate a control period; ``actions`` are between -1 and 1.

        A winch that controls its length lets out rope at this fraction of its largest speed, at most to the ends of its
        range; one that controls its tension goes from 0 at -1 to the largest at 1.
        """
        machine, by_tension, rest_lengths = self.machine, self.by_tension, self.rest_lengths
        ahead = np.minimum(np.maximum(rest_lengths + self._most * actions, self._shortest), self._longest)
        controls = machine.controls(rest_lengths[:, None] + self._at * (ahead - rest_lengths)[:, None])
        if self._some:
            controls = np.where(by_tension, (0.5 * (1 + actions) * self.largest)[:, None], controls)
        laws = self._fields[
            "actuator_biasprm"
        ]  # dampers resist strains, not the winding: their force is -laws[2] * rate
        laws[:, :, 0] = self._still + laws[:, :, 2] * (ahead - rest_lengths) / self.period
        self.batch.rollout(self._steps, controls[:, :-1], record=())
        self._ctrl[:] = controls[:, -1]
        self.batch.forward()
        self._read()
        self.rest_lengths = ahead
        if self._some:
            held = self._law.rest_lengths(self.tensions / self._stiffness, self.lengths)
            self.rest_lengths = np.where(by_tension, held, ahead)
        self._least_time += self.period
        # MuJoCo resets a simulation that becomes unstable, its time included.
        self.failed |= self._time < self._least_time

    @property
    def overturned(self) -> Bool[np.ndarray, " count"]:
        """Platforms whose upper side points downwards."""
        return self._upwards < 0

    def _read(self) -> None:
        self.poses, self.lengths, self.tensions = self.machine.readings.of(self._sensed)

    def seen(self, row: int) -> Seen:
        """The present state of one simulation."""
        parts = self.poses, self.lengths, self.tensions, self.rest_lengths
        pose, lengths, tensions, rest_lengths = (part[row].copy() for part in parts)
        return pose, lengths, tensions, rest_lengths

    def twists(self) -> Float[np.ndarray, "count 6"]:
        """Velocities [m/s] and angular velocities [rad/s] of the platforms, base frame."""
        if self.robot.mobility == "planar":
            twists = np.zeros((len(self._qvel), 6))
            twists[:, [0, 2, 4]] = self._qvel[:, :3]
            return twists
        twists = self._qvel[:, :6].copy()
        # Those of a ball joint are in the platform's frame.
        twists[:, 3:] = np.add.reduce(self.rotations * twists[:, None, 3:], 2)
        return twists


def rotation_vectors(quaternions: Float[np.ndarray, "rows 4"]) -> Float[np.ndarray, "rows 3"]:
    """Rotation vectors [rad] of quaternions w x y z, at most a turn: continuous where the quaternions are."""
    axes = quaternions[:, 1:]
    sizes = np.maximum(np.sqrt(np.add.reduce(axes * axes, 1, keepdims=True)), LEAST)
    return axes * (2 * np.arctan2(sizes, quaternions[:, :1]) / sizes)
