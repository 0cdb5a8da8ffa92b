"""MuJoCo's own viewer for a robot that is driven by its winches, with their sliders."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import warnings

import mujoco

from cdpr_sim.core import extras
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problem
from cdpr_sim.physics.mjcf import scene_mjcf, to_mjcf
from cdpr_sim.physics.winches import hang

FILE = "winch.xml"


def open_viewer(problem: Problem) -> None:
    """Open the viewer, and return when it is closed.

    Raises:
        MissingExtra: a library of the extra ``view`` is not installed.
        InvalidInput: there is no display.
    """
    extras.require("view", "view")
    model = scene_with_winches(problem)
    refuse_without_display()
    from mujoco import viewer

    mujoco.set_mjcb_control(hang)
    try:
        viewer.launch(model, mujoco.MjData(model))
    finally:
        mujoco.set_mjcb_control(None)


def scene_with_winches(problem: Problem) -> mujoco.MjModel:
    """The model that is driven by its winches, in its scene."""
    assets = {FILE: to_mjcf(problem, winches=True).encode()}
    return mujoco.MjModel.from_xml_string(scene_mjcf(problem.robot, FILE), assets)


def refuse_without_display() -> None:
    """Check for a display before MuJoCo's viewer ends the process for lack of one."""
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the same, in GLFW's words
        if not glfw.init():
            raise InvalidInput("display: found none, expected one on which MuJoCo's viewer can open its window")
