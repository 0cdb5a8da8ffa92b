"""A layout that was found, shown: numbers by both roads, maps of tilt, the two robots driven side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from cdpr_sim.analysis.shapes import cable_shapes
from cdpr_sim.analysis.workspace.grids import plane
from cdpr_sim.analysis.workspace.sweep import sweep
from cdpr_sim.core.rests import Rests
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.layout import Proof, Side
from cdpr_sim.drawing.layouts import draw_better_layout
from cdpr_sim.physics.drive import drive

MAP_POINTS = 121
"""Along the longer side of a map of tilt."""


def numbers(proof: Proof) -> list[tuple[str, str, str]]:
    """(what, before, after) in words: all in MuJoCo, at the poses that were asked and midway between them."""
    sides, of = (proof.before, proof.after), proof.found.objective
    return [
        (f"{of.name}, in MuJoCo", *(_said(of.shown(side.score), side.score) for side in sides)),
        ("worst, mean tilt", *(f"{_worst(_tilt(side)):.3g}°, {np.degrees(np.nanmean(_tilt(side))):.3g}°" for side in sides)),
        (
            "worst, mean deviation",
            *(f"{1e3 * np.nanmax(_off(side)):.3g} mm, {1e3 * np.nanmean(_off(side)):.3g} mm" for side in sides),
        ),
        ("most slack cables", *(f"{side.settled.slack[side.settled.converged].sum(-1).max(initial=0)}" for side in sides)),
        ("lowest, highest tension", *(_tensions(side.settled) for side in sides)),
        ("Newton and MuJoCo agree at", *(f"{side.agrees.sum()} of {len(side.agrees)}" for side in sides)),
        ("furthest move of a point", "", f"{1e3 * proof.found.distance:.3g} mm"),
    ]


def _said(words: str, score: float) -> str:
    return "no rest everywhere" if np.isnan(score) else words


def _tilt(side: Side) -> np.ndarray:
    return np.where(side.settled.converged, side.settled.tilt, np.nan)


def _off(side: Side) -> np.ndarray:
    return np.where(side.settled.converged, np.linalg.norm(side.settled.deviation, axis=-1), np.nan)


def _worst(values: np.ndarray) -> float:
    return float(np.degrees(np.nanmax(values)))


def _tensions(rests: Rests) -> str:
    found = rests.tensions[rests.converged]
    return f"{found.min(initial=np.inf):.3g} N, {found.max(initial=0):.3g} N"


def picture(proof: Proof) -> Figure:
    """Both layouts with what moved, the map of tilt through the middle of the poses, and the numbers."""
    found = proof.found
    robots = (found.given, found.robot)
    rests = (proof.before.settled, proof.after.settled)
    asked = found.cases.positions
    across = float(np.median(asked[:, 1]))
    axes = plane("xz", across, MAP_POINTS, [found.given])
    maps = [sweep(robot, axes, quantities=["tilt"], chunk=None)["tilt"].values for robot in robots]
    half = [np.diff(axes[name][:2])[0] / 2 for name in ("x", "z")]
    extent = (axes["x"][0] - half[0], axes["x"][-1] + half[0], axes["z"][0] - half[1], axes["z"][-1] + half[1])
    row = _worst_row(proof.before)
    return draw_better_layout(
        rests, row, (_shapes(rests[0], row), _shapes(rests[1], row)), (maps[0].squeeze(), maps[1].squeeze()), extent,
        asked, numbers(proof), _title(proof),
        f"Robots as MuJoCo settles them where the given one tilts most. Maps: statics, commanded level at y = {across:.4g} m, "
        f"grey where nothing rests; scale ends at 45° at the latest. The numbers are MuJoCo's at {len(proof.cases)} poses: "
        "those asked and those midway between. Nothing is promised of other places, loads and cables.",
    )  # fmt: skip


def _title(proof: Proof) -> str:
    of, found = proof.found.objective, proof.found
    return f"{found.given.name}: {of.name} {of.shown(proof.before.score)} → {of.shown(proof.after.score)}"


def _worst_row(side: Side) -> int:
    tilts = _tilt(side)
    return 0 if np.isnan(tilts).all() else int(np.nanargmax(tilts))


def _shapes(rests: Rests, row: int) -> np.ndarray | None:
    return None if rests.robot.cabling.massless else cable_shapes(rests)[row]


def driven(proof: Proof, states: int) -> list[Trajectory]:
    """Both robots driven by their winches from pose to pose in MuJoCo, for a video side by side."""
    found = proof.found
    each = len(found.cases) // int(np.prod(found.cases.shape, dtype=int))
    line = found.cases.positions[::each]

    def named(robot: Robot, what: str) -> Robot:
        return robot.replace(name=f"{robot.name}, {what}")

    return [drive(named(robot, what), line, states=states) for robot, what in ((found.given, "before"), (found.robot, "after"))]
