"""Environments of Gymnasium for the tasks of ``tasks``: single ones, and vectorised ones on threads."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from jaxtyping import Float

from cdpr_sim.core.checks import one_of
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.learning import tasks
from cdpr_sim.learning.pictures import Camera, Window

FPS = 25
"""Frames per second of the pictures of an environment at its default rate: one for four periods."""

OPTIONS = {"waypoints", "start"}
"""Of ``reset``: poses of the reference motion, and the pose at which the platform is commanded first."""


def _spaces(task: tasks.Task) -> tuple[spaces.Box, spaces.Box]:
    """Observations and actions of one simulation; beyond these numbers MuJoCo calls a state unstable."""
    return (
        spaces.Box(-mujoco.mjMAXVAL, mujoco.mjMAXVAL, (task.size,), np.float64),
        spaces.Box(-1.0, 1.0, (task.robot.cables,), np.float32),
    )


def _checked(options: dict[str, Any] | None) -> dict[str, Any]:
    for name in options or {}:
        one_of("option", name, OPTIONS)
    return dict(options or {})


class Environment(gymnasium.Env):
    """One simulation of a task.

    Args:
        robot: a name of the catalogue, a robot file, or a ``Robot``.
        render_mode: "rgb_array", "human" (a window, which needs a display) or None.
        size: width and height of pictures [pixels].
        settings: arguments of ``tasks.Task``.

    Raises:
        InvalidInput: an invalid argument; in ``step``, an action that is not finite.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": FPS}  # noqa: RUF012
    kind: ClassVar[type[tasks.Task]] = tasks.Task

    def __init__(
        self,
        robot: str | Robot = "cogiro",
        *,
        render_mode: str | None = None,
        size: tuple[int, int] = (640, 480),
        **settings: Any,
    ) -> None:
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.task = self.kind(robot, 1, **settings)
        self.metadata = self.metadata | {"render_fps": max(1, round(1 / self.task.period))}
        self.observation_space, self.action_space = _spaces(self.task)
        self.render_mode, self._size = render_mode, size
        self._drawn: Camera | Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float[np.ndarray, " size"], dict[str, Any]]:
        """Begin an episode; ``options`` may give ``waypoints`` and ``start``.

        Raises:
            InvalidInput: invalid options, or no equilibrium at the start.
        """
        super().reset(seed=seed)
        self.task.begin(0, self.np_random, **_checked(options))
        if self.render_mode == "human":
            self.render()
        return self.task.observe()[0], {}

    def step(self, action: np.ndarray) -> tuple[Float[np.ndarray, " size"], float, bool, bool, dict[str, Any]]:
        """Simulate a control period."""
        rewards, fallen, ended, info = self.task.step(_finite(action)[None])
        if self.render_mode == "human":
            self.render()
        several = {name: float(of[0]) for name, of in info.items()}
        return self.task.observe()[0], float(rewards[0]), bool(fallen[0]), bool(ended[0]), several

    def render(self) -> Any:
        """A picture as an array (height, width, 3), or the state in the window.

        Raises:
            InvalidInput: there is no display for the window.
        """
        if self.render_mode is None:
            return None
        if self._drawn is None:
            self._drawn = Camera(self.task, self._size) if self.render_mode == "rgb_array" else Window(self.task)
        return self._drawn.show(0)

    def close(self) -> None:
        """Close the window, or the renderer."""
        if self._drawn is not None:
            self._drawn.close()
            self._drawn = None


def _finite(actions: Any) -> np.ndarray:
    found = np.asarray(actions, dtype=float)
    if not np.logical_and.reduce(np.isfinite(found), axis=None):
        raise InvalidInput("action: found a number that is not finite, expected numbers from -1 to 1")
    return found


class VectorEnvironment(gymnasium.vector.VectorEnv):
    """Many simulations of a task, on threads; bitwise those of ``Environment`` with seeds that count up from the first.

    Where an episode has ended, the next step begins another one, whatever the action.

    Args:
        num_envs: number of simulations.
        robot: a name of the catalogue, a robot file, or a ``Robot``.
        render_mode: "rgb_array" or None: pictures of all simulations.
        size: width and height of pictures [pixels].
        threads: number of threads; 0 is one per core. Results do not depend on it.
        settings: arguments of ``tasks.Task``.

    Raises:
        InvalidInput: an invalid argument; in ``step``, an action that is not finite.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"], "render_fps": FPS, "autoreset_mode": AutoresetMode.NEXT_STEP
    }  # fmt: skip
    kind: ClassVar[type[tasks.Task]] = tasks.Task

    def __init__(
        self,
        num_envs: int = 1,
        robot: str | Robot = "cogiro",
        *,
        render_mode: str | None = None,
        size: tuple[int, int] = (640, 480),
        threads: int = 0,
        **settings: Any,
    ) -> None:
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.task = self.kind(robot, num_envs, threads=threads, **settings)
        self.metadata = self.metadata | {"render_fps": max(1, round(1 / self.task.period))}
        self.num_envs, self.render_mode = num_envs, render_mode
        self.single_observation_space, self.single_action_space = _spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.randoms = [np.random.default_rng() for _ in range(num_envs)]
        self._over = np.zeros(num_envs, dtype=bool)
        self._camera = None if render_mode is None else Camera(self.task, size)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float[np.ndarray, "count size"], dict[str, Any]]:
        """Begin an episode in each simulation; a seed, or the first of those that count up.

        Raises:
            InvalidInput: invalid options, or no equilibrium at the start.
        """
        options = _checked(options)
        seeds = [None] * self.num_envs if seed is None else seed
        seeds = [seeds + row for row in range(self.num_envs)] if isinstance(seeds, int) else list(seeds)
        for row, own in enumerate(seeds):
            if own is not None:
                self.randoms[row], _ = seeding.np_random(own)
            self.task.begin(row, self.randoms[row], **options)
        self._over[:] = False
        return self.task.observe(), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[Float[np.ndarray, "count size"], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate a control period of all, or begin another episode where one has ended."""
        again = self._over
        rewards, fallen, ended, info = self.task.step(_finite(actions))
        if again.any():
            for row in np.flatnonzero(again):
                self.task.begin(int(row), self.randoms[row])
            rewards, fallen, ended = np.where(again, 0.0, rewards), fallen & ~again, ended & ~again
        self._over = fallen | ended
        return self.task.observe(), rewards, fallen, ended, info | {f"_{name}": ~again for name in info}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each simulation, (height, width, 3)."""
        return self._camera and tuple(map(self._camera.show, range(self.num_envs)))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the renderer."""
        if self._camera is not None:
            self._camera.close()


class Track(Environment):
    """Follow a reference motion through three poses in the workspace: ``tasks.Task``."""


class Reach(Environment):
    """Reach a pose in the workspace from another one: ``tasks.ReachTask``."""

    kind = tasks.ReachTask


class TrackVector(VectorEnvironment):
    """``Track`` in many simulations."""


class ReachVector(VectorEnvironment):
    """``Reach`` in many simulations."""

    kind = tasks.ReachTask
