"""Distances between cables, platform and frame in equilibrium.

Taut cables are straight; slack cables and cables with mass have the profiles of ``cable_profiles``, as chains of
straight pieces; over a pulley, only the free segment counts. Distances are those of centre lines, to the
platform's box and to the twelve edges of the frame; 0 where a cable passes through the box.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.cable_path import wheel_paths
from cdpr_sim.core.checks import Frozen, checked_array, refuse_unless, whole
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import profiles
from cdpr_sim.statics.newton import solve_many

POINTS = 25
"""Number of points along a hanging cable: where it is shallow, its 24 pieces deviate by at most 1/575 of its sag
(``scripts/dev/measure_constants.py``); those of a parabola, with n pieces, by 1/n²."""

SEARCH_POINTS = 9
"""The same number in a search for layouts."""

BYTES_PER_POINT = 200
"""[bytes] Memory for distances at a pose, per point along each cable: 172 are measured for 5,000 poses
(``scripts/dev/measure_constants.py``)."""

ROWS = 16
"""Number of poses at a time: their pairs of pieces take some 50 MB, with eight cables
(``scripts/dev/measure_constants.py``)."""


@dataclass(frozen=True, eq=False)
class Clearances(Frozen, HtmlRepr):
    """Distances [m] between centre lines of cables, the platform and the frame; nan for rows without equilibrium.

    Attributes:
        equilibria: equilibria of the platform.
        fitting: length of each cable next to its exit and to its anchor that is left out [m].
        curves: the cables without those ends, (..., cables, points, 3) [m].
        cable_cable: (..., pairs) distances of ``pairs``.
        cable_platform: (..., cables).
        cable_frame: (..., cables).
    """

    equilibria: EquilibriumBatch
    fitting: float
    curves: Float[np.ndarray, "*batch cables points 3"]
    cable_cable: Float[np.ndarray, "*batch pairs"]
    cable_platform: Float[np.ndarray, "*batch cables"]
    cable_frame: Float[np.ndarray, "*batch cables"]

    @property
    def pairs(self) -> Int[np.ndarray, "pairs 2"]:
        """The two cables of each distance of ``cable_cable``, counted from 0."""
        return pairs(self.equilibria.robot.cables)

    @cached_property
    def least(self) -> Float[np.ndarray, "*batch"]:
        """The smallest of all distances."""
        return np.concatenate([self.cable_cable, self.cable_platform, self.cable_frame], axis=-1).min(
            -1, keepdims=True
        )[..., 0]

    def free(self, least: float = 0.0) -> Bool[np.ndarray, "*batch"]:
        """Where all distances are at least ``least`` [m]: the interference-free workspace.

        Returns:
            (...) True where ``least`` is kept; False for rows without equilibrium.
        """
        return np.asarray(self.least > checked_array("least", least, ()))

    def nearest(self, row: tuple[int, ...] | int) -> str:
        """The smallest distance of one row, as text.

        Returns:
            Two parts by name and their distance in millimetres; nan mm for a row without equilibrium.
        """
        found = {
            f"cables {a + 1} and {b + 1}": float(one)
            for (a, b), one in zip(self.pairs, self.cable_cable[row], strict=True)
        }
        for what, distances in (("platform", self.cable_platform[row]), ("frame", self.cable_frame[row])):
            found |= {f"cable {i + 1} and the {what}": float(one) for i, one in enumerate(distances)}
        name = min(found, key=lambda one: found[one])
        return f"{name}: {1e3 * found[name]:.3g} mm"

    def __repr__(self) -> str:
        known = self.least[np.isfinite(self.least)]
        least = f"{1e3 * known.min():.3g} mm at the nearest" if known.size else "no equilibrium"
        return f"<Clearances of {self.equilibria.robot.name!r}: {self.equilibria.shape}, {least}>"


def clearances(
    robot: Robot | EquilibriumBatch,
    poses: RigidTransform | ArrayLike | None = None,
    *,
    fitting: float | None = None,
    points: int = POINTS,
) -> Clearances:
    """Distances between cables, platform and frame in equilibrium.

    Args:
        robot: the robot; or equilibria by either method, without other arguments.
        poses: commanded, as for ``solve_many``.
        fitting: length of each cable next to its exit and to its anchor that is left out [m], since there it touches
            its fixture; default: half the characteristic length of the platform.
        points: number of points along a hanging cable.

    Returns:
        Every distance [m] for each pose, and the curves between which they were measured.

    Raises:
        InvalidInput: as in ``solve_many``, equilibria of several robots, or a fitting below 0.
    """
    refuse_unless(Robot | EquilibriumBatch, robot=robot)
    equilibria = robot if isinstance(robot, EquilibriumBatch) else solve_many(robot, poses)
    if isinstance(robot, EquilibriumBatch) and poses is not None:
        raise InvalidInput("poses: found them beside equilibria, expected the equilibria only")
    equilibria.problems.refuse_several_robots("equilibria")
    machine, points = equilibria.robot, whole("points", points, 2)
    fitting = default_fitting(machine) if fitting is None else float(checked_array("fitting", fitting, ()))
    if fitting < 0:
        raise InvalidInput(f"fitting: found {fitting:g} m, expected 0 or more")
    curves = cable_curves(equilibria, fitting, points)
    found = _distances(equilibria, curves)
    lost = ~equilibria.converged
    for one in found:
        one[lost] = np.nan
    return Clearances(equilibria, fitting, curves, *found)


def default_fitting(robot: Robot) -> float:
    """Half the characteristic length [m]."""
    return 0.5 * robot.characteristic_length


def least_clearance(equilibria: EquilibriumBatch) -> Float[np.ndarray, "*batch"]:
    """The smallest distance [m], also in equilibria of several layouts, by curves of few points."""
    curves = cable_curves(equilibria, default_fitting(equilibria.robot), SEARCH_POINTS)
    return np.concatenate(_distances(equilibria, curves), axis=-1).min(-1)


def cable_curves(
    equilibria: EquilibriumBatch, fitting: float, points: int
) -> Float[np.ndarray, "*batch cables points 3"]:
    """Each cable's curve without its two ends; of two points where all are straight."""
    robot, positions, slack = equilibria.robot, equilibria.positions, equilibria.slack
    exits, anchors, weights = robot.exits, robot.anchors, robot.cable_weights
    if (layouts := equilibria.problems.robots) is not None:
        exits, anchors, weights = (one[:, None] for one in (layouts.exits, layouts.anchors, layouts.cable_weights))
    cabling = robot.cabling
    ends = positions[..., None, :] + np.einsum(
        "...ij,...mj->...mi", equilibria.rotations, np.broadcast_to(anchors, (*positions.shape[:-1], robot.cables, 3))
    )
    exits = profiles.moved_exits(equilibria, exits, ends)
    starts = np.broadcast_to(exits, ends.shape).copy()
    over = cabling.pulleys
    if over.any():
        chords = np.moveaxis(starts - ends, -1, 0)[..., over]
        starts[..., over, :] = ends[..., over, :] + np.moveaxis(wheel_paths(cabling, *chords)[1:4], 0, -1)
    straight = cabling.massless and not (slack & ~over).any()
    fractions = np.linspace(0, 1, 2 if straight else points)
    curves = starts[..., None, :] + fractions[:, None] * (ends - starts)[..., None, :]
    if not straight:
        hung = profiles.profiles(
            robot, exits, ends, equilibria.rest_lengths, equilibria.problems.axial_stiffness, weights, points
        )
        hangs = (slack & ~over) | (weights > 0) | ((not cabling.massless) & ~over)
        curves = np.where(hangs[..., None, None], hung, curves)
    lengths = np.linalg.norm(np.diff(curves, axis=-2), axis=-1).sum(-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cut = np.minimum(fitting / lengths, 0.5)[..., None]
    at = (cut + fractions * (1 - 2 * cut)) * (len(fractions) - 1)  # index of the equally spaced points
    at = np.nan_to_num(at)
    before = np.clip(at.astype(int), 0, len(fractions) - 2)
    part = (at - before)[..., None]
    low, high = (np.take_along_axis(curves, (before + step)[..., None], axis=-2) for step in (0, 1))
    return low + part * (high - low)


def pairs(cables: int) -> Int[np.ndarray, "pairs 2"]:
    """All pairs of cables, counted from 0."""
    return np.array(list(itertools.combinations(range(cables), 2)), dtype=int).reshape(-1, 2)


def frame_edges(robot: Robot) -> Float[np.ndarray, "edges 2 3"]:
    """The edges of the frame, except those of zero length."""
    corners = np.array(list(itertools.product(*robot.frame.T)))
    edges = [(a, b) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(a != b) == 1]
    return np.array(edges).reshape(-1, 2, 3)


def _distances(
    equilibria: EquilibriumBatch, curves: Float[np.ndarray, "*batch cables points 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances of cables to cables, to the platform and to the frame; some rows at a time."""
    robot = equilibria.robot
    shape, cables = curves.shape[:-3], robot.cables
    rows = curves.reshape(-1, *curves.shape[-3:])
    at, turned = equilibria.positions.reshape(-1, 3), equilibria.rotations.reshape(-1, 3, 3)
    a, b = pairs(cables).T
    edges = frame_edges(robot)
    found = np.empty((len(rows), len(a))), np.empty((len(rows), cables)), np.empty((len(rows), cables))
    for first in range(0, len(rows), ROWS):
        some = slice(first, first + ROWS)
        starts, ends = rows[some, :, :-1], rows[some, :, 1:]
        between = segment_segment(
            starts[:, a, :, None], ends[:, a, :, None], starts[:, b, None, :], ends[:, b, None, :]
        )
        found[0][some] = between.min((-1, -2))
        home = np.einsum("rji,rmkj->rmki", turned[some], rows[some] - at[some, None, None])
        found[1][some] = segment_box(home[:, :, :-1], home[:, :, 1:], robot.platform_size / 2).min(-1)
        beams = segment_segment(starts[..., None, :], ends[..., None, :], edges[:, 0], edges[:, 1])
        found[2][some] = beams.min((-1, -2))
    cable_cable, cable_platform, cable_frame = (one.reshape(*shape, one.shape[-1]) for one in found)
    return cable_cable, cable_platform, cable_frame


def segment_segment(
    a: Float[np.ndarray, "*#batch 3"],
    b: Float[np.ndarray, "*#batch 3"],
    c: Float[np.ndarray, "*#batch 3"],
    d: Float[np.ndarray, "*#batch 3"],
) -> Float[np.ndarray, "*batch"]:
    """Distance between the segments ab and cd.

    Between the feet of the lines' common normal, each moved into its segment and then to where it is nearest to the
    other (Ericson, Real-Time Collision Detection, 2005, ch. 5.1.9).
    """
    u, v, w = b - a, d - c, a - c
    normal, uv = np.cross(u, v), _dot(u, v)  # products of vectors do not cancel where the segments are nearly parallel
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.nan_to_num(np.clip(_dot(np.cross(v, w), normal) / _dot(normal, normal), 0, 1))
        t = np.nan_to_num(np.clip((uv * s + _dot(v, w)) / _dot(v, v), 0, 1))
        s = np.nan_to_num(np.clip((uv * t - _dot(u, w)) / _dot(u, u), 0, 1))
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1)


def segment_box(
    a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"], half: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*batch"]:
    """Distance between the segment ab and a box about the origin with these half edges; 0 where they meet.

    Along the segment the squared distance is convex and piecewise quadratic; its pieces end where a coordinate crosses
    a face. Its minimum is at such an end, or where the slope, linear on a piece, vanishes.
    """
    along = b - a
    with np.errstate(invalid="ignore", divide="ignore"):
        faces = np.concatenate([(half - a) / along, (-half - a) / along], axis=-1)
    knots = np.concatenate(
        [np.nan_to_num(np.clip(faces, 0, 1)), np.zeros((*a.shape[:-1], 1)), np.ones((*a.shape[:-1], 1))], axis=-1
    )
    knots = np.sort(knots, axis=-1)

    def outside(t: np.ndarray) -> np.ndarray:
        at = a[..., None, :] + t[..., None] * along[..., None, :]
        return at - np.clip(at, -half, half)

    slope = _dot(outside(knots), along[..., None, :])
    before, after = slope[..., :-1], slope[..., 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.nan_to_num(np.clip(-before / (after - before), 0, 1))
    roots = knots[..., :-1] + part * np.diff(knots, axis=-1)
    return np.linalg.norm(outside(np.concatenate([knots, roots], axis=-1)), axis=-1).min(-1)
