"""The path of a cable from its exit to its anchor: its length and its free segment. Geometry, without elasticity.

A winch that assumes rigid cables uses this length (paper Eq. 1, 2), so it is part of the problem that both methods
solve: the rest lengths. Beyond that, only the mathematics uses this module; MuJoCo has its own paths.

Functions of coordinates work on arrays and, compiled, on numbers alike.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.compiling import for_kernels, inline


@inline
def path(x, y, z):
    """Path of a cable whose exit lies at (x, y, z) from its anchor, base frame [m]: (length, free segment, its length).

    The free segment runs from the anchor to the point where the cable leaves its guide; a straight cable is free over
    its whole length. The cable pulls along the free segment. When the anchor moves across it, its direction changes
    like that of a rod of this length.
    """
    length = np.sqrt(x * x + y * y + z * z)
    return length, x, y, z, length


@inline
def wheel_at(numbers, first, step):
    """The wheel (radius, axis) whose numbers are in an array, at ``first`` and at steps from there."""
    return numbers[first], numbers[first + step], numbers[first + 2 * step], numbers[first + 3 * step]


def wheel_of(cabling: Cabling, which: Any) -> tuple[Float[np.ndarray, "*pulleys"], ...]:
    """``wheel_at`` of some cables, by an index."""
    return cabling.pulley_radius[which], *cabling.pulley_axis[which].T


@inline
def pulley_path(x, y, z, wheel):
    """Path over a swivelling wheel: (length, free segment, its length, across, bend, wrap angle, clear).

    The cable arrives along the unit vector e, touches the wheel at the exit, and leaves it on the tangent to the
    anchor; the wheel turns about e so that its plane contains the anchor (Pott 2012, "Influence of pulley kinematics on
    cable-driven parallel robots", doi:10.1007/978-94-007-4620-6_25). With the anchor at height h along e and at the
    distance rho from that axis, the free segment has length s, and with the wrap angle theta

        s² = (rho − r)² + h² − r²,   theta = atan2(rho − r, h) + atan2(r, s),   l = r theta + s.

    Sine and cosine of theta are those of the sum of two angles whose own are known.

    In the wheel's plane the cable's direction changes like that of a rod of length s. Across it, along the unit vector
    ``across``, the cable turns about the axis e, and its direction changes by ``bend`` [1/m] less: sin(theta)/rho −
    1/s.

    Inside the wheel and on its rim, where no free segment has a direction, all results are nan. Below the wheel
    (rho < r) a cable leaves its wheel and has no path: the formula is continued there, so that a search for an
    equilibrium can pass, and ``clear`` = rho − r is negative.
    """
    radius, ex, ey, ez = wheel
    h = -(x * ex + y * ey + z * ez)
    nx, ny, nz = -x - h * ex, -y - h * ey, -z - h * ez
    rho = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / rho, ny / rho, nz / rho
    clear = rho - radius
    square = clear * clear + h * h
    s = np.sqrt(square - radius * radius)
    s = s * (s / s)  # nan on the rim
    sine, cosine = (clear * s + h * radius) / square, (h * s - clear * radius) / square
    theta = wrap_angle(sine, cosine, h)
    along = (-(sine * nx + cosine * ex), -(sine * ny + cosine * ey), -(sine * nz + cosine * ez))
    across = (ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx)
    return (
        radius * theta + s,
        along[0] * s,
        along[1] * s,
        along[2] * s,
        s,
        across[0],
        across[1],
        across[2],
        sine / rho - 1 / s,
        theta,
        clear + 0.0 * s,
    )


FIRST_THIRD, MIDDLE, SECOND_THIRD = (math.tan(part * math.pi / 16) for part in (1, 2, 3))
"""Bounds between angles near 0, near 22.5° and near 45°, and the second of these, as slopes. The series of
``wrap_angle`` is exact to rounding up to the first."""


@for_kernels(lambda condition, one, other: one if condition else other, forceinline=True)
def where(condition, one, other):
    """``one`` where the condition is true, ``other`` elsewhere; of numbers, a number."""
    return np.where(condition, one, other)[()]


@inline
def wrap_angle(sine, cosine, height):
    """Wrap angle of a cable over a wheel, from 0 to 270°; where it has left the wheel, from −90° to 360°.

    By the series of atan((y − c x)/(x + c y)) = atan(y/x) − atan(c), c the nearest of 0, tan 22.5° and 1. Without a
    branch or a call, so that compiled code has several cables at once; and with the same last digit on every processor,
    which ``np.arctan2`` has not, since rest lengths are written into models.
    """
    tall, wide = abs(sine), abs(cosine)
    upright = tall > wide
    y, x = where(upright, wide, tall), where(upright, tall, wide)
    steep, middle = y > SECOND_THIRD * x, y > FIRST_THIRD * x
    c = where(steep, 1.0, where(middle, MIDDLE, 0.0))
    z = (y - c * x) / (x + c * y)
    q = z * z
    series = 1 / 19 - q * (1 / 21)
    series = 1 / 15 - q * (1 / 17 - q * series)
    series = 1 / 11 - q * (1 / 13 - q * series)
    series = 1 / 7 - q * (1 / 9 - q * series)
    series = 1 / 3 - q * (1 / 5 - q * series)
    angle = where(steep, 0.25 * np.pi, where(middle, 0.125 * np.pi, 0.0)) + z * (1.0 - q * series)
    angle = where(upright, 0.5 * np.pi - angle, angle)
    angle = where(cosine < 0, np.pi - angle, angle)
    return where(sine < 0, where(height < 0, 2 * np.pi, 0.0) - angle, angle)


def paths(cabling: Cabling, chords: Float[np.ndarray, "*batch cables 3"]) -> Float[np.ndarray, "10 *batch cables"]:
    """Results of ``pulley_path``, or ``path`` for straight cables, by the vectors from anchors to exits."""
    x, y, z = np.moveaxis(chords, -1, 0)
    found = np.zeros((10, *x.shape))
    found[:5] = path(x, y, z)
    over = cabling.pulleys
    if over.any():
        found[..., over] = wheel_paths(cabling, x[..., over], y[..., over], z[..., over])
    return found


def wheel_paths(
    cabling: Cabling,
    x: Float[np.ndarray, "*batch pulleys"],
    y: Float[np.ndarray, "*batch pulleys"],
    z: Float[np.ndarray, "*batch pulleys"],
) -> Float[np.ndarray, "10 *batch pulleys"]:
    """Results of ``pulley_path`` without ``clear`` for each cable over a pulley; nan where it has no path.

    It has none either where its rigid end would lie on the wheel.
    """
    over = cabling.pulleys
    with np.errstate(invalid="ignore", divide="ignore"):
        *found, clear = pulley_path(x, y, z, wheel_of(cabling, over))
    bends = (clear >= 0) & (found[4] > cabling.rigid_length[over])
    return np.where(bends, np.array(found), np.nan)


def wrapped_lengths(
    cabling: Cabling, chords: Float[np.ndarray, "*batch cables 3"]
) -> Float[np.ndarray, "*batch cables"]:
    """What lies on each cable's wheel [m], by where its exit is from its anchor; 0 where it has no path."""
    return np.nan_to_num(cabling.pulley_radius * paths(cabling, chords)[9])


PIECE = 500
"""Poses at which paths over wheels are computed at once: then intermediate results stay in the processor's cache."""

MOVES = 30
"""Newton steps for the moves of exits; three or four do."""


def exit_moves(
    cabling: Cabling, chords: Float[np.ndarray, "*batch cables 3"], pulls: Float[np.ndarray, "*#batch cables"]
) -> Float[np.ndarray, "*batch cables 3"]:
    """How exits move under massless cables that pull with these forces [m]: d = C t, t in the direction after the move.

    Args:
        cabling: of these cables.
        chords: from anchors to exits that have not moved, (..., cables, 3) [m].
        pulls: of all parts of line, (..., cables) [N].

    Returns:
        (..., cables, 3) [m]; nan where a cable has no path.
    """
    moves = np.zeros(chords.shape)
    if cabling.rigid_exits:
        return moves
    softness = cabling.exit_compliance * pulls[..., None]
    for _ in range(MOVES):
        _, x, y, z, free, bx, by, bz, bend, _ = paths(cabling, chords + moves)
        with np.errstate(invalid="ignore"):
            u, b = np.stack([x, y, z], axis=-1) / free[..., None], np.stack([bx, by, bz], axis=-1)
            turning = (np.eye(3) - u[..., :, None] * u[..., None, :]) / free[..., None, None]
            turning = turning + bend[..., None, None] * b[..., :, None] * b[..., None, :]
        step = np.linalg.solve(np.eye(3) + softness[..., None] * turning, (softness * u + moves)[..., None])[..., 0]
        moves = moves - step
        if not (np.abs(step) > 1e-15 * np.abs(chords).max()).any():
            break
    return moves


def wheel(
    cabling: Cabling, cable: int, anchor: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"], float, float]:
    """The wheel of a cable to ``anchor``, base frame [m], turned towards it.

    Its centre; the unit vector from the pulley's axis to the centre; the axis, the direction in which the cable
    arrives; the radius [m]; and the angle over which the cable lies on it [rad], nan if the anchor lies within it.
    """
    exit_, axis, radius = cabling.exits[cable], cabling.pulley_axis[cable], float(cabling.pulley_radius[cable])
    with np.errstate(invalid="ignore"):
        *_, x, y, z, _, wrap, _ = pulley_path(*(exit_ - anchor), wheel_of(cabling, cable))  # pyright: ignore[reportCallIssue]
    outwards = np.cross([x, y, z], axis)
    return exit_ + radius * outwards, outwards, axis, radius, float(wrap)


def leaves_wheel(
    cabling: Cabling, directions: Float[np.ndarray, "*batch cables 3"]
) -> tuple[Float[np.ndarray, "*batch cables 3"], Float[np.ndarray, "*batch cables"]]:
    """Where cables that leave their wheels along unit vectors do so, from their exits; and the lengths before [m]."""
    axis, radius = cabling.pulley_axis, cabling.pulley_radius
    cosine = (directions * axis).sum(-1)[..., None]
    outwards = directions - cosine * axis
    sine = np.linalg.norm(outwards, axis=-1, keepdims=True)
    points = radius[:, None] * ((1 - cosine) * outwards / sine + sine * axis)
    return points, radius * np.arctan2(sine, cosine)[..., 0]


def swivel_angles(
    cabling: Cabling, positions: Float[np.ndarray, "*#batch 3"], rotations: Float[np.ndarray, "*#batch 3 3"]
) -> tuple[Float[np.ndarray, "*batch cables"], Float[np.ndarray, "*batch cables 3"]]:
    """Swivel angles of the pulleys [rad], and their derivatives by the anchors' positions, base frame [rad/m].

    The angle of the wheel's plane about ``pulley_axis``, right-handed, from the direction downwards; where the axis is
    nearer to the vertical than 45°, from the direction of the base's x axis. Both are projected on the plane normal to
    the axis. Without a pulley: nan.
    """
    axes = np.where(cabling.pulleys[:, None], cabling.pulley_axis, np.nan)
    upright = np.abs(axes[:, 2:]) > np.sqrt(0.5)
    reference = np.where(upright, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]))
    reference = reference - (reference * axes).sum(1, keepdims=True) * axes
    sideways = np.cross(axes, reference)
    anchors = np.einsum("...ij,cj->...ci", rotations, cabling.anchors) + np.asarray(positions)[..., None, :]
    chords = anchors - cabling.exits
    radial = chords - (chords * axes).sum(-1, keepdims=True) * axes
    angles = np.arctan2((radial * sideways).sum(-1), (radial * reference).sum(-1))
    return angles, np.cross(axes, radial) / (radial**2).sum(-1, keepdims=True)


def off_wheel(cabling: Cabling, position: Float[np.ndarray, "3"], rotation: Float[np.ndarray, "3 3"]) -> str:
    """Message about the first anchor whose cable has no path with the platform at this pose; "" if there is none."""
    chords = cabling.exits - position - cabling.anchors @ rotation.T
    lost = np.isnan(paths(cabling, chords)[0])
    if not lost.any():
        return ""
    cable = int(np.argmax(lost))
    axis, radius, rigid = cabling.pulley_axis[cable], cabling.pulley_radius[cable], cabling.rigid_length[cable]
    with np.errstate(invalid="ignore", divide="ignore"):
        found = pulley_path(*chords[cable], wheel_of(cabling, cable))  # pyright: ignore[reportCallIssue]
    if found[-1] >= 0 and np.isfinite(found[4]):
        return (
            f"the rigid end of cable {cable + 1} on its pulley's wheel, {found[4]:.3g} m from the anchor, expected a "
            f"larger distance than its rigid_length, {rigid:g} m"
        )
    distance, where, centre = float(np.linalg.norm(np.cross(axis, chords[cable]))), "inside or below", "pulley's axis"
    if distance >= radius:
        distance, where, centre = float(np.hypot(distance - radius, axis @ chords[cable])), "inside", "wheel's centre"
    return (
        f"the anchor of cable {cable + 1} {where} its pulley's wheel, {distance:.3g} m from the {centre}, "
        f"expected a larger distance than the radius, {radius:g} m"
    )


def wrench_matrix(
    cabling: Cabling, positions: Float[np.ndarray, "*#batch 3"], rotations: Float[np.ndarray, "*#batch 3 3"]
) -> Float[np.ndarray, "*batch 6 cables"]:
    """W, whose column i is nᵢ (uᵢ, R bᵢ × uᵢ): the wrench on the platform of unit tension in rope i (paper Eq. 4).

    nᵢ is its number of parts of line.
    """
    arms = cabling.anchors @ np.swapaxes(rotations, -1, -2)
    _, *free_piece, free_length = paths(cabling, cabling.exits - positions[..., None, :] - arms)[:5]
    directions = np.moveaxis(cabling.reeving * (np.array(free_piece) / free_length), 0, -1)
    arms = np.broadcast_to(arms, directions.shape)
    return np.swapaxes(np.concatenate([directions, np.cross(arms, directions)], axis=-1), -1, -2)


def lengths(
    cabling: Cabling,
    positions: Float[np.ndarray, "*#batch 3"],
    rotations: Float[np.ndarray, "*#batch 3 3"],
    exits: Float[np.ndarray, "*#batch cables 3"] | None = None,
    anchors: Float[np.ndarray, "*#batch cables 3"] | None = None,
) -> Float[np.ndarray, "*batch cables"]:
    """Length of each cable's path with the platform at these poses, (..., cables) [m] (paper Eq. 1, 2).

    By default with the exits and anchors of ``cabling``.
    """
    exits, anchors = cabling.exits if exits is None else exits, cabling.anchors if anchors is None else anchors
    at, turn = np.asarray(positions)[..., None], rotations[..., None]
    many = at.ndim > 2 and rotations.shape[:-2] in ((), at.shape[:-2])
    if many and (rotations == np.eye(3)).all():  # the same numbers, sooner
        chords = at + anchors.swapaxes(-1, -2)
    else:
        a, b, c = (anchors[..., None, :, axis] for axis in range(3))
        # The same order of additions as SciPy's RigidTransform.apply: identical to the last bit, for one pose or many.
        chords = turn[..., 1, :] * b + at
        chords += turn[..., 0, :] * a + turn[..., 2, :] * c
    np.subtract(exits.swapaxes(-1, -2), chords, out=chords)
    coordinates = chords[..., 0, :], chords[..., 1, :], chords[..., 2, :]
    found = path(*coordinates)[0]
    over = cabling.pulleys
    if over.any():
        rows = np.array(coordinates)[..., over].reshape(3, -1, over.sum())
        for first in range(0, rows.shape[1], PIECE):
            piece = rows[:, first : first + PIECE]
            piece[0] = wheel_paths(cabling, *piece)[0]
        found[..., over] = rows[0].reshape(*found.shape[:-1], -1)
    return found
