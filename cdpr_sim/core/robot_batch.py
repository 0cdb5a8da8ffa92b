"""``RobotBatch``: robots that differ in points, stiffness or mass of cables, as arrays: layouts of one robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.core import cable_path
from cdpr_sim.core.cable import ANCHOR, COLUMNS, EXIT, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.checks import Frozen
from cdpr_sim.core.robot import Robot


@dataclass(frozen=True, eq=False)
class RobotBatch(Frozen):
    """Robots that differ in some of their parameters; a layout each.

    Attributes:
        robot: the common parameters.
        exits: (layouts, cables, 3) [m].
        anchors: (layouts, cables, 3) [m].
        axial_stiffness: (layouts, cables) [N].
        linear_density: (layouts, cables) [kg/m].
        center_of_mass: (layouts, 3) [m].
    """

    robot: Robot
    exits: Float[np.ndarray, "layouts cables 3"]
    anchors: Float[np.ndarray, "layouts cables 3"]
    axial_stiffness: Float[np.ndarray, "layouts cables"]
    linear_density: Float[np.ndarray, "layouts cables"]
    center_of_mass: Float[np.ndarray, "layouts 3"]

    def __post_init__(self) -> None:
        super().__post_init__()
        self.robot.cabling.refuse_memory()

    @classmethod
    def of(cls, robots: Sequence[Robot]) -> RobotBatch:
        """Batch of given robots of one kind."""
        return cls(robots[0], *(np.array([getattr(robot, name) for robot in robots]) for name in VARIED))

    def __len__(self) -> int:
        return len(self.exits)

    def take(self, rows: slice | Int[np.ndarray, " some"]) -> RobotBatch:
        """The robots of some rows."""
        arrays = {name: getattr(self, name)[rows] for name in VARIED}
        return RobotBatch(self.robot, **arrays)

    def robot_at(self, row: int) -> Robot:
        """The robot of one row, with the platform, inertia, workspace and frame of the given robot."""
        robot, changes = self.robot, {}
        for name in VARIED:
            if not np.array_equal(getattr(self, name)[row], getattr(robot, name)):
                changes[name] = getattr(self, name)[row]
        if not changes:
            return robot
        kept = {"workspace": robot.workspace}
        if "anchors" in changes:
            kept |= {"platform_size": robot.platform_size, "inertia": robot.inertia}
        return robot.replace(**kept, **changes)

    @cached_property
    def characteristic_lengths(self) -> Float[np.ndarray, " layouts"]:
        """Root mean square distances of the anchors from the platform's origin (``Robot.characteristic_length``)."""
        radii = np.sqrt((self.anchors**2).sum(-1).mean(-1))
        return np.where(radii > 0, radii, self.robot.characteristic_length)

    @property
    def cable_weights(self) -> Float[np.ndarray, "layouts cables"]:
        """Weights of the cables per length, with all parts of line (``Robot.cable_weights``) [N/m]."""
        return self.robot.cabling.pulls(self.linear_density * self.robot.gravity)

    @cached_property
    def displacements(self) -> Float[np.ndarray, " layouts"]:
        """Largest displacement of exits, anchors and centre of mass, (layouts,) [m]."""
        steps = self.exits - self.robot.exits, self.anchors - self.robot.anchors
        center = (self.center_of_mass - self.robot.center_of_mass)[:, None]
        return np.linalg.norm(np.concatenate([*steps, center], axis=1), axis=-1).max(1)

    def cable_table(
        self, axial_stiffness: Float[np.ndarray, "layouts rows cables"]
    ) -> Float[np.ndarray, "layouts rows cables columns"]:
        """``Robot.cable_table`` of each robot, with these axial stiffnesses of the ropes [N]."""
        robot, table = self.robot, np.empty((*axial_stiffness.shape, COLUMNS))
        table[:] = robot.cabling.packed
        table[..., EXIT : EXIT + 3] = self.exits[:, None]
        table[..., ANCHOR : ANCHOR + 3] = self.anchors[:, None]
        table[..., STIFFNESS] = robot.cabling.pulls(axial_stiffness)
        if not robot.cabling.massless:
            chords = self.exits - robot.home - self.anchors
            table[..., WEIGHT] = self.cable_weights[:, None]
            table[..., WRAPPED] = cable_path.wrapped_lengths(robot.cabling, chords)[:, None]
        return table


VARIED = tuple(one.name for one in dataclasses.fields(RobotBatch) if one.name != "robot")
"""What may differ from robot to robot."""
