"""Robots of the Gazebo plugin ``oKermorgant/cdpr``: YAML with the points of each cable on the frame and the platform.

Its Gazebo model uses the same numbers: metres, roll-pitch-yaw about fixed axes, inertia about the platform's origin in
the order xx, yy, zz, xy, xz, yz. Cables there are force-controlled and rigid.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from cdpr_sim.robots.importers.documents import Number, Part, Unbounded, Vector, as_model
from cdpr_sim.robots.importers.draft import Draft, symmetric

TITLE = "oKermorgant/cdpr's YAML"
MARKS = {"points", "model"}


class _Attachment(Part):
    frame: Vector
    platform: Vector


class _Inertial(Part):
    xx: Number
    yy: Number
    zz: Number
    xy: Number = 0.0
    xz: Number = 0.0
    yz: Number = 0.0


class _Position(Part):
    xyz: Vector


class _Platform(Part):
    mass: Number
    position: _Position | None = None
    size: Vector | None = None
    inertia: tuple[Number, Number, Number, Number, Number, Number] | None = None
    inertial: _Inertial | None = None


class _Frame(Part):
    lower: Vector
    upper: Vector


class _Actuated(Part):
    min: Number = 0.0
    effort: Unbounded = np.inf


class _Joints(Part):
    actuated: _Actuated = _Actuated()


class _Document(Part):
    points: list[_Attachment] = Field(min_length=1)
    platform: _Platform
    frame: _Frame | None = None
    joints: _Joints = _Joints()


def read(document: Any, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid.
    """
    model = as_model(_Document, document["model"] if "points" not in document else document)
    platform = model.platform
    inertia = platform.inertia
    if inertia is None and (given := platform.inertial) is not None:
        inertia = (given.xx, given.yy, given.zz, given.xy, given.xz, given.yz)
    return Draft(
        name=path.stem,
        exits=[point.frame for point in model.points],
        anchors=[point.platform for point in model.points],
        mass=platform.mass,
        force_min=model.joints.actuated.min,
        force_max=model.joints.actuated.effort,
        inertia=inertia and symmetric(*inertia),
        platform_size=platform.size,
        frame=model.frame and (model.frame.lower, model.frame.upper),
        home=platform.position and platform.position.xyz,
    )
