"""Robots of the University of Bologna's UACDPR code: a MATLAB file with the structure ``s``.

A cable enters its swivelling pulley at ``CableEnterPosition`` along the third axis of ``FixedFrame``; with the pulley's
radius 0 the exit is a point. ``points`` are the anchors, ``PtoG`` the centre of mass; gravity acts along -z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

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


class _Platform(Part):
    m: Number
    PtoG: Vector = (0.0, 0.0, 0.0)
    InertialMatrix: Matrix | None = None
    points: list[Vector]


class _EndEffector(Part):
    Platform: _Platform


class _Transmission(Part):
    Pulley: list[_Pulley]


class _Structure(Part):
    EndEffector: _EndEffector
    Trasmission: _Transmission  # as it is spelled there


class _File(Part):
    s: _Structure


def read(document: Any, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid.
    """
    structure = as_model(_File, document).s
    platform, pulleys = structure.EndEffector.Platform, structure.Trasmission.Pulley
    if len(pulleys) != len(platform.points):
        raise InvalidInput(
            f"s.EndEffector.Platform.points: found {len(platform.points)}, expected {len(pulleys)}, one per pulley"
        )
    return Draft(
        name=path.stem,
        exits=[one.CableEnterPosition for one in pulleys],
        anchors=platform.points,
        mass=platform.m,
        pulley_radius=[one.r for one in pulleys],
        pulley_axis=np.array([one.FixedFrame[2] for one in pulleys]),
        center_of_mass=platform.PtoG,
        inertia=platform.InertialMatrix,
        gravity=GRAVITY,
    )
