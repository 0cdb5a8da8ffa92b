"""Robots of the University of Bologna's UACDPR code: a MATLAB file with the structure ``s``.

A cable enters its swivelling pulley at ``CableEnterPosition`` along the third axis of ``FixedFrame``; with the pulley's
radius 0 the exit is a point. ``points`` are the anchors, ``PtoG`` the centre of mass; gravity acts along -z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import AliasPath, Field

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import Matrix, Number, Part, Vector, as_model
from cdpr_sim.robots.importers.draft import Draft

TITLE = "UACDPR's .mat"
MARKS = {"s"}

GRAVITY = 9.81
"""[m/s²] Gravity in the group's code."""


class _Pulley(Part):
    r: Number
    CableEnterPosition: Vector
    FixedFrame: tuple[Vector, Vector, Vector]


def _platform(name: str, **options: Any) -> Any:
    """A field of the platform."""
    return Field(validation_alias=AliasPath("s", "EndEffector", "Platform", name), **options)


class _File(Part):
    pulleys: list[_Pulley] = Field(validation_alias=AliasPath("s", "Trasmission", "Pulley"))  # as it is spelled there
    mass: Number = _platform("m")
    center_of_mass: Vector = _platform("PtoG", default=(0.0, 0.0, 0.0))
    inertia: Matrix | None = _platform("InertialMatrix", default=None)
    points: list[Vector] = _platform("points")


def read(document: Any, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid.
    """
    file = as_model(_File, document)
    if len(file.pulleys) != len(file.points):
        raise InvalidInput(
            f"s.EndEffector.Platform.points: found {len(file.points)}, expected {len(file.pulleys)}, one per pulley"
        )
    return Draft(
        name=path.stem,
        exits=[one.CableEnterPosition for one in file.pulleys],
        anchors=file.points,
        mass=file.mass,
        pulley_radius=[one.r for one in file.pulleys],
        pulley_axis=np.array([one.FixedFrame[2] for one in file.pulleys]),
        center_of_mass=file.center_of_mass,
        inertia=file.inertia,
        gravity=GRAVITY,
    )
