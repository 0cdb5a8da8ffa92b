"""The border of a feasible workspace as a surface, and its volume: by rays from a point inside, as far as poses hold.

A sphere of triangles around the centre is expanded until each of its corners lies on the border, found by bisection:
the method of Pott's WireX (2006-2019, ``CWorkspaceHull``), whose numbers it reproduces. It assumes a star-shaped
workspace: every pose of it is visible from the centre. Where it is convex, its chords cut corners: the
volume converges from below with the number of triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim.analysis.workspace.feasibility import closed_form_feasible, feasible
from cdpr_sim.core.checks import FLAG, Frozen, checked_array, positive, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot

MOST_DEPTH = 7
"""131,072 triangles."""

OCTAHEDRON = ((0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5))
"""Faces of an octahedron, counter-clockwise from outside, with the corners x, y, z, −x, −y, −z."""


@dataclass(frozen=True, eq=False)
class Hull(Frozen, HtmlRepr):
    """A closed surface of triangles around a workspace.

    Attributes:
        center: origin of the rays, (3,) [m].
        vertices: points on the border, (vertices, 3) [m].
        triangles: three indices each, counter-clockwise from outside, (triangles, 3).
    """

    center: Float[np.ndarray, "3"]
    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]

    @property
    def volume(self) -> float:
        """Volume within the surface [m³]."""
        return float(self._tetrahedra.sum())

    @property
    def surface(self) -> float:
        """Area of the surface [m²]."""
        a, b, c = self._corners
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def centroid(self) -> Float[np.ndarray, "3"]:
        """Centroid of the volume, (3,) [m]."""
        middles = self.center + sum(self._corners) / 4
        return self._tetrahedra @ middles / self.volume

    @property
    def _corners(self) -> Float[np.ndarray, "3 triangles 3"]:
        return (self.vertices - self.center)[self.triangles.T]

    @property
    def _tetrahedra(self) -> Float[np.ndarray, " triangles"]:
        """Volume of each triangle's tetrahedron with the centre [m³]."""
        a, b, c = self._corners
        return np.einsum("ij,ij->i", np.cross(a, b), c) / 6

    def __repr__(self) -> str:
        return f"<Hull: {self.volume:.4g} m³ within {self.surface:.4g} m², {len(self.triangles):,} triangles>"


def workspace_hull(
    robot: Robot,
    *,
    center: ArrayLike | None = None,
    orientation: ArrayLike = (0.0, 0.0, 0.0),
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
    closed_form: bool = False,
    depth: int = 4,
    reach: float | None = None,
    tolerance: float = 1e-4,
) -> Hull:
    """Border of the workspace where rigid cables hold the platform with tensions within limits, against all loads.

    Args:
        robot: the robot, spatial.
        center: a position from which all of the workspace is visible, (3,) [m]; default: the middle of the robot's own.
        orientation: (alpha, beta, gamma) [rad]; default: level.
        tension_limits: smallest and largest tension [N], each one number or one per cable; default: the robot's
            ``force_min`` and ``force_max``.
        wrenches: external forces and torques besides gravity, (6,) or a set (sets, 6) [N, N m], all of which are held.
        closed_form: count only poses that ``closed_form_feasible`` holds, as WireX does by default.
        depth: number of divisions by four of the eight triangles of an octahedron.
        reach: largest length of the rays [m]; default: to the faces of the robot's frame, since for a suspended robot
            poses below the floor are feasible at any depth.
        tolerance: accuracy of the border along each ray [m].

    Returns:
        A closed surface of 8·4**depth triangles [m]; its ``volume`` is in m³.

    Raises:
        InvalidInput: an invalid argument, a planar robot, or a centre that is not feasible itself or outside the frame.
    """
    refuse_unless(Robot, robot=robot)
    refuse_unless(FLAG, closed_form=closed_form)
    if robot.mobility == "planar":
        raise InvalidInput(
            f"robot: found {robot.name!r}, which is planar, expected a spatial one: a plane has no volume"
        )
    start = robot.home if center is None else checked_array("center", center, (3,))
    whole("depth", depth, 0, MOST_DEPTH)
    tolerance = positive("tolerance", tolerance, "m")
    rotation = Rotation.from_euler("xyz", checked_array("orientation", orientation, (3,))).as_matrix()
    test = closed_form_feasible if closed_form else feasible

    def held(positions: Float[np.ndarray, "*batch 3"]) -> Bool[np.ndarray, "*batch"]:
        return test(robot, positions, rotations=rotation, tension_limits=tension_limits, wrenches=wrenches)

    rays, triangles = _sphere(depth)
    if reach is not None:
        high = np.full(len(rays), positive("reach", reach, "m"))
    else:  # to the faces of the robot's frame; not positive where a ray starts outside
        faces = np.where(rays > 0, robot.frame[1], robot.frame[0]) - start
        with np.errstate(divide="ignore", invalid="ignore"):
            high = np.where(rays != 0, faces / rays, np.inf).min(-1)
    if not (held(start) and high.min() > 0):
        x, y, z = start
        where = "which is not feasible" if high.min() > 0 else "outside the robot's frame"
        raise InvalidInput(f"center: found ({x:g}, {y:g}, {z:g}) m, {where}, expected a feasible position within")
    low = np.where(held(start + high[:, None] * rays), high, 0.0)
    while (high - low).max() > tolerance:
        middle = (low + high) / 2
        inside = held(start + middle[:, None] * rays)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return Hull(start, start + (low + high)[:, None] / 2 * rays, triangles)


def _sphere(depth: int) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]:
    """Unit vectors, and the triangles between them: an octahedron whose faces are divided ``depth`` times."""
    vertices = np.vstack([np.eye(3), -np.eye(3)])
    triangles = np.array(OCTAHEDRON)
    for _ in range(depth):
        ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which = np.unique(ends, axis=0, return_inverse=True)
        middles = vertices[edges].sum(1)
        ab, bc, ca = (len(vertices) + which.reshape(-1, 3)).T
        vertices = np.vstack([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        a, b, c = triangles.T
        triangles = np.vstack([np.transpose(one) for one in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return vertices, triangles
