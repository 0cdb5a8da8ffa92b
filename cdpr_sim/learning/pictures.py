"""Pictures of a task's simulations: as arrays by the package's offscreen renderer, or in MuJoCo's window."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import UInt8

from cdpr_sim.core.checks import whole
from cdpr_sim.core.problem import Problem
from cdpr_sim.drawing.video.render import Renderer, open_renderer
from cdpr_sim.drawing.video.scene import Stage
from cdpr_sim.learning.tasks import Task
from cdpr_sim.physics.sensing import pose_of, recorded
from cdpr_sim.physics.viewer import refuse_without_display, scene_with_winches
from cdpr_sim.physics.winches import hang

DARK = 1.5
"""Dark end of the scale of tensions, as a multiple of the platform's weight."""


class Camera:
    """Draws simulations as in videos of the package: platform, target, and cables coloured by tension."""

    def __init__(self, task: Task, size: tuple[int, int]) -> None:
        self._task, self._width, self._height = task, whole("size", size[0], 16, 4096), whole("size", size[1], 16, 4096)
        self._renderer: Renderer | None = None

    def show(self, row: int) -> UInt8[np.ndarray, "height width 3"]:
        """A picture of one simulation."""
        task, robot = self._task, self._task.robot
        wanted, times = pose_of(task.target(row)[None]), task.period * task.ticks[[row]].astype(float)
        state = recorded(robot, wanted, times, [task.simulations.seen(row)])
        stage = Stage(state, largest_tension=DARK * robot.mass * max(robot.gravity, 1.0))
        stage.set(0)
        if self._renderer is None:
            self._renderer = open_renderer(stage.model, self._width, self._height)
        return self._renderer.start(stage.look(stage.whole(self._width / self._height)), self._width, self._height)()

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()


class Window:
    """MuJoCo's viewer of one simulation.

    Raises:
        InvalidInput: there is no display.
    """

    def __init__(self, task: Task) -> None:
        refuse_without_display()
        from mujoco import viewer

        self._task, self._model = task, scene_with_winches(Problem.of(task.robot, task.robot.home))
        self._data = mujoco.MjData(self._model)
        self._viewer = viewer.launch_passive(self._model, self._data, show_left_ui=False, show_right_ui=False)

    def show(self, row: int) -> None:
        """Show the present state of one simulation."""
        machine = self._task.simulations.machine
        with self._viewer.lock():
            self._data.qpos[:] = self._task.simulations.batch.bind("qpos")[row]
            self._data.ctrl[:] = machine.controls(self._task.simulations.rest_lengths[row])
            mujoco.mj_forward(self._model, self._data)
            hang(self._model, self._data)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()
