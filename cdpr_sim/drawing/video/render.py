"""Pictures of a MuJoCo scene: by OpenGL if it can be loaded without set-up, else by the ray caster."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Literal

import mujoco
import numpy as np

from cdpr_sim.core.errors import CdprError
from cdpr_sim.drawing import style
from cdpr_sim.drawing.video.raycast import Picture, RayCaster, averaged

Backend = Literal["auto", "opengl", "raycast"]


INSTALL = "for instance Debian's libegl1 libopengl0 libgl1-mesa-dri, or libosmesa6"


class OpenGLUnavailable(CdprError):
    """No OpenGL could be loaded on this machine."""


class OpenGL:
    """MuJoCo's own renderer, offscreen.

    Raises:
        OpenGLUnavailable: none could be loaded.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        scale = style.SUPERSAMPLING
        model.vis.global_.offwidth, model.vis.global_.offheight = scale * width, scale * height
        self.name, self._window = _open_context(scale * width, scale * height)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        except Exception as error:
            self._window.free()
            raise OpenGLUnavailable(f"OpenGL: MuJoCo cannot draw with {self.name}: {error}") from None

    def start(self, scene: mujoco.MjvScene, width: int, height: int) -> Callable[[], Picture]:
        """Draw the scene, from its own camera, at once: a context belongs to one thread."""
        scale = style.SUPERSAMPLING
        self._window.make_current()
        rectangle = mujoco.MjrRect(0, 0, scale * width, scale * height)
        pixels = np.empty((scale * height, scale * width, 3), np.uint8)
        mujoco.mjr_render(rectangle, scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rectangle, self._context)
        picture = averaged(pixels, scale)[::-1]
        return lambda: picture

    def close(self) -> None:
        """Free MuJoCo's and OpenGL's objects."""
        self._window.make_current()
        self._context.free()
        self._window.free()


Renderer = OpenGL | RayCaster


def open_renderer(model: mujoco.MjModel, width: int, height: int, backend: Backend = "auto") -> Renderer:
    """A renderer of pictures up to ``width`` x ``height``: OpenGL if available, else the ray caster.

    Raises:
        OpenGLUnavailable: ``backend`` is "opengl" and there is none.
    """
    if backend != "raycast":
        try:
            return OpenGL(model, width, height)
        except OpenGLUnavailable:
            if backend == "opengl":
                raise
    return RayCaster(model)


def _open_context(width: int, height: int):
    """The first OpenGL context that this machine can make current, and its name."""
    reasons = []
    for name in _candidates():
        before = os.environ.get("PYOPENGL_PLATFORM")
        try:
            window = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
            window.make_current()
            return name, window
        except Exception as error:  # a missing library shows as any of half a dozen types
            reasons.append(f"{name}: {str(error).strip() or type(error).__name__}")
            _forget(name, before)
    tried = "; ".join(reasons) or "MUJOCO_GL disables it"
    raise OpenGLUnavailable(f"OpenGL: none could be loaded, expected {INSTALL} ({tried})")


def _candidates() -> list[str]:
    """Names of MuJoCo's modules with a ``GLContext``, in the order to try; MUJOCO_GL, where set, comes first."""
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in ("disable", "disabled", "off", "false", "0"):
        return []
    names = {"linux": ["egl", "osmesa"], "darwin": ["cgl"]}.get(sys.platform, ["glfw"])
    return sorted(names, key=lambda name: name != wanted)


def _forget(name: str, platform: str | None) -> None:
    """Undo a failed import, since PyOpenGL binds itself to the first platform requested."""
    for module in list(sys.modules):
        if module.split(".")[0] == "OpenGL" or module.startswith(f"mujoco.{name}"):
            del sys.modules[module]
    if platform is None:
        os.environ.pop("PYOPENGL_PLATFORM", None)
    else:
        os.environ["PYOPENGL_PLATFORM"] = platform
