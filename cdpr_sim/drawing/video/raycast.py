"""Pictures of a MuJoCo scene without any OpenGL: its planes, boxes, and round shapes, ray-cast in compiled code.

MuJoCo reduces a simulation's state to a list of a few hundred simple geoms (``mjv_updateScene``), for which it needs no
OpenGL. For each geom the rows and columns of the picture that its bounding box covers are found first; only there are
rays cast. Light is MuJoCo's: what shapes emit, and the ambient and diffuse light of directional lights and the
headlight; no shadows, no mirror images, no highlights, and no texture but the floor's checkers.

From picture to picture little moves. What does not, the floor and the frame, is drawn once; from then on rays are cast
only where something else is.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int32, UInt8

from cdpr_sim.core import compiling
from cdpr_sim.drawing import style

SHAPES = {
    name: getattr(mujoco.mjtGeom, f"mjGEOM_{name}").value
    for name in ("PLANE", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
}
PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX = SHAPES.values()
DIRECTIONAL = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value

part = compiling.for_kernels(fastmath=True)

Picture = UInt8[np.ndarray, "height width 3"]


@dataclass(frozen=True)
class _Shot:
    """Input of a picture: shapes, coarse and fine camera, and lights."""

    kinds: Int32[np.ndarray, " shapes"]
    floats: Float[np.ndarray, "shapes 20"]
    cameras: Float[np.ndarray, "2 5 3"]
    lights: Float[np.ndarray, "lights 13"]

    def alike(self, other: _Shot) -> int:
        """Number of leading shapes that are the same in both; 0 if camera or lights have moved."""
        if not (np.array_equal(self.cameras, other.cameras) and np.array_equal(self.lights, other.lights)):
            return 0
        count = min(len(self.kinds), len(other.kinds))
        same = (self.kinds[:count] == other.kinds[:count]) & (self.floats[:count] == other.floats[:count]).all(1)
        return int(np.argmin(np.append(same, False)))

    def first(self, count: int) -> _Shot:
        """The shot with its first ``count`` shapes only."""
        return _Shot(self.kinds[:count], self.floats[:count], self.cameras, self.lights)


@dataclass(frozen=True)
class _Backdrop:
    """Picture of the ``known`` shapes that have not moved since the last picture; 0 of them after the first picture."""

    shot: _Shot
    known: int
    what: Int32[np.ndarray, "height width"]
    pixels: Picture


class RayCaster:
    """Draws scenes of one model: one processor per picture, several pictures in parallel."""

    name = "raycast"

    def __init__(self, model: mujoco.MjModel) -> None:
        self._draw = _DRAW.compiled  # compiled here, where Ctrl-C works, and not in a thread
        self._threads = ThreadPoolExecutor(os.cpu_count() or 1)
        self._floor = _checkers(model)
        self._sky = np.array([model.vis.rgba.haze[:3], _top_of_sky(model)], dtype=float)
        self._backdrops: dict[tuple[int, int], _Backdrop] = {}

    def start(self, scene: mujoco.MjvScene, width: int, height: int) -> Callable[[], Picture]:
        """Start to draw the present scene, from its own camera, in a thread; the returned function waits for it.

        One ray per pixel identifies the visible shape; pixels at edges are supersampled. Shapes of other types (meshes,
        arrows, text) are left out.
        """
        scale = style.SUPERSAMPLING
        cameras = np.array([_camera(scene, width, height), _camera(scene, scale * width, scale * height)])
        shot = _Shot(*_geoms(scene), cameras, _lights(scene))
        drawing = self._threads.submit(self._drawn, shot, self._backdrop(shot, width, height))
        return lambda: drawing.result().pixels

    def close(self) -> None:
        """Stop the threads."""
        self._threads.shutdown(cancel_futures=True)

    def _backdrop(self, shot: _Shot, width: int, height: int) -> _Backdrop:
        """The backdrop of shapes that have not moved since the last pictures of this size."""
        size = width, height
        before = self._backdrops.get(size)
        alike = shot.alike(before.shot) if before else 0
        if before and 0 < alike == before.known:
            return before
        nothing = _Backdrop(shot, 0, np.empty((height, width), np.int32), np.empty((height, width, 3), np.uint8))
        self._backdrops[size] = self._drawn(shot.first(alike), nothing) if alike else nothing
        return self._backdrops[size]

    def _drawn(self, shot: _Shot, backdrop: _Backdrop) -> _Backdrop:
        what, pixels = backdrop.what.copy(), backdrop.pixels.copy()
        self._draw(
            backdrop.known, shot.kinds, shot.floats, shot.cameras, shot.lights, self._floor, self._sky,
            style.SUPERSAMPLING, what, pixels,
        )  # fmt: skip
        return _Backdrop(shot, len(shot.kinds), what, pixels)


def averaged(pixels: UInt8[np.ndarray, "rows columns 3"], scale: int) -> UInt8[np.ndarray, "height width 3"]:
    """Each ``scale`` x ``scale`` block of pixels as one, its mean."""
    if scale == 1:
        return pixels
    total = np.full((pixels.shape[0] // scale, pixels.shape[1] // scale, 3), scale**2 // 2, np.uint16)
    for row, column in np.ndindex(scale, scale):
        total += pixels[row::scale, column::scale]
    return (total // scale**2).astype(np.uint8)


def _camera(scene: mujoco.MjvScene, columns: int, rows: int) -> Float[np.ndarray, "5 3"]:
    """Position; right and up, a pixel long, at unit distance; forward; and the top left pixel's offset from there."""
    one, other = scene.camera[0], scene.camera[1]
    position = (np.array(one.pos, float) + np.array(other.pos, float)) / 2
    forward, up = np.array(one.forward, float), np.array(one.up, float)
    right = np.cross(forward, up)
    top, bottom = one.frustum_top / one.frustum_near, one.frustum_bottom / one.frustum_near
    size = (top - bottom) / rows
    return np.array([position, size * right, size * up, forward, [(1 - columns) / 2, (rows - 1) / 2, 1.0]])


def _geoms(scene: mujoco.MjvScene) -> tuple[np.ndarray, np.ndarray]:
    """Kinds (geoms,), and (geoms, 20) of position, matrix, size, colour, own light; opaque first, then far to near."""
    known = [geom for geom in scene.geoms[: scene.ngeom] if geom.type in SHAPES.values()]
    forward, position = np.array(scene.camera[0].forward), np.array(scene.camera[0].pos)
    parts = {"pos": 3, "mat": 9, "size": 3, "rgba": 4, "emission": 1}
    floats = np.hstack(
        [np.array([getattr(geom, name) for geom in known], float).reshape(-1, width) for name, width in parts.items()]
    )
    kinds = np.array([geom.type for geom in known], np.int32)
    clear = np.flatnonzero(floats[:, 18] < 1)
    opaque = np.flatnonzero(floats[:, 18] >= 1)  # in MuJoCo's order
    nearness = -(floats[clear, :3] - position) @ forward
    order = np.concatenate([opaque, clear[np.argsort(nearness, kind="stable")]])
    return kinds[order], floats[order]


def _lights(scene: mujoco.MjvScene) -> Float[np.ndarray, "lights 13"]:
    """Per light: whether it is directional; position; direction; ambient; diffuse."""
    lights = [scene.lights[i] for i in range(scene.nlight)]
    return np.array(
        [[light.type == DIRECTIONAL, *light.pos, *light.dir, *light.ambient, *light.diffuse] for light in lights],
        dtype=float,
    ).reshape(-1, 13)


def _checkers(model: mujoco.MjModel) -> Float[np.ndarray, "3 3"]:
    """The floor's two colours, and (edge of a square [m], 0, 0); an edge of 0 is a floor without texture."""
    floor = np.zeros((3, 3))
    for material in range(model.nmat):
        texture = model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB.value]
        if texture < 0 or model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D.value:
            continue
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        first = model.tex_adr[texture]
        image = model.tex_data[first : first + height * width * 3].reshape(height, width, 3) / 255
        floor[0], floor[1] = image[height // 4, 3 * width // 4], image[height // 4, width // 4]
        floor[2, 0] = 0.5 / model.mat_texrepeat[material, 0]
    return floor


def _top_of_sky(model: mujoco.MjModel) -> Float[np.ndarray, "3"]:
    for texture in range(model.ntex):
        if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value:
            first, edge = model.tex_adr[texture], int(model.tex_width[texture])
            middle = first + 3 * (edge * edge * 2 + edge * edge // 2 + edge // 2)
            return model.tex_data[middle : middle + 3] / 255
    return np.array(model.vis.rgba.haze[:3])


@part
def _extent(kind, size):
    """Half edges of the box around a shape in its own frame."""
    if kind == CAPSULE:
        return size[0], size[0], size[2] + size[0]
    if kind == SPHERE:
        return size[0], size[0], size[0]
    return size[0], size[1], size[2]


@part
def _cover(kinds, floats, camera, columns, ranges):
    """Per shape and row, the first and last column that its bounding box covers; none where first > last."""
    rows = len(ranges)
    ranges[:, :, 0], ranges[:, :, 1] = columns, -1
    x, y, depth = np.empty(8), np.empty(8), np.empty(8)
    pixel = math.sqrt((camera[1] ** 2).sum())
    for g in range(len(kinds)):
        hx, hy, hz = _extent(kinds[g], floats[g, 12:15])
        everywhere = kinds[g] == PLANE
        for k in range(8):
            cx, cy, cz = hx * (1 - 2 * (k & 1)), hy * (1 - (k & 2)), hz * (1 - (k & 4) // 2)
            px = floats[g, 0] + floats[g, 3] * cx + floats[g, 4] * cy + floats[g, 5] * cz - camera[0, 0]
            py = floats[g, 1] + floats[g, 6] * cx + floats[g, 7] * cy + floats[g, 8] * cz - camera[0, 1]
            pz = floats[g, 2] + floats[g, 9] * cx + floats[g, 10] * cy + floats[g, 11] * cz - camera[0, 2]
            depth[k] = px * camera[3, 0] + py * camera[3, 1] + pz * camera[3, 2]
            if depth[k] <= 1e-3 * (hx + hy + hz):
                everywhere = True
                break
            scale = 1 / (depth[k] * pixel * pixel)
            x[k] = (px * camera[1, 0] + py * camera[1, 1] + pz * camera[1, 2]) * scale - camera[4, 0]
            y[k] = camera[4, 1] - (px * camera[2, 0] + py * camera[2, 1] + pz * camera[2, 2]) * scale
        if everywhere:
            ranges[:, g, 0], ranges[:, g, 1] = 0, columns - 1
            continue
        for k in range(8):
            for bit in (1, 2, 4):
                if k & bit:
                    continue
                ax, ay, bx, by = x[k], y[k], x[k | bit], y[k | bit]
                if ay > by:
                    ax, ay, bx, by = bx, by, ax, ay
                slope = (bx - ax) / (by - ay) if by - ay > 1e-9 else 0.0
                for row in range(max(0, math.ceil(ay - 1)), min(rows - 1, math.floor(by + 1)) + 1):
                    if slope == 0:
                        left, right = min(ax, bx), max(ax, bx)
                    else:
                        u = ax + slope * (max(row - 1.0, ay) - ay)
                        v = ax + slope * (min(row + 1.0, by) - ay)
                        left, right = min(u, v), max(u, v)
                    ranges[row, g, 0] = min(ranges[row, g, 0], max(0, math.floor(left)))
                    ranges[row, g, 1] = max(ranges[row, g, 1], min(columns - 1, math.ceil(right)))


@part
def _hit_ellipsoid(ox, oy, oz, dx, dy, dz, a, b, c):
    """The nearest hit of the ray o + t d with an ellipsoid, and the normal there; t = -1 for none."""
    ox, oy, oz, dx, dy, dz = ox / a, oy / b, oz / c, dx / a, dy / b, dz / c
    p, q, r = dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1
    root = q * q - p * r
    if root < 0:
        return -1.0, 0.0, 0.0, 0.0
    t = (-q - math.sqrt(root)) / p
    return t, (ox + t * dx) / a, (oy + t * dy) / b, (oz + t * dz) / c


@part
def _hit_round(ox, oy, oz, dx, dy, dz, radius, half, capped):
    """A cylinder along z, with flat ends or (``capped``) with half spheres."""
    p, q, r = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - radius * radius
    root = q * q - p * r
    z = oz
    if p > 1e-18:
        if root < 0:
            return -1.0, 0.0, 0.0, 0.0
        t = (-q - math.sqrt(root)) / p
        z = oz + t * dz
        if abs(z) <= half:
            return t, ox + t * dx, oy + t * dy, 0.0
    end = half if z > half or (z >= -half and dz < 0) else -half
    if capped:
        oz -= end
        p, q, r = p + dz * dz, q + oz * dz, r + oz * oz
        root = q * q - p * r
        if root < 0:
            return -1.0, 0.0, 0.0, 0.0
        t = (-q - math.sqrt(root)) / p
        return t, ox + t * dx, oy + t * dy, oz + t * dz
    if dz == 0:
        return -1.0, 0.0, 0.0, 0.0
    t = (end - oz) / dz
    if (ox + t * dx) ** 2 + (oy + t * dy) ** 2 > radius * radius:
        return -1.0, 0.0, 0.0, 0.0
    return t, 0.0, 0.0, end


@part
def _slab(o, d, size):
    """Ray parameters at entry to and exit from |x| <= size; unbounded for a parallel ray inside."""
    if abs(d) < 1e-12:
        return (1e30, -1e30) if abs(o) > size else (-1e30, 1e30)
    middle, reach = -o / d, size / abs(d)
    return middle - reach, middle + reach


@part
def _hit_box(ox, oy, oz, dx, dy, dz, a, b, c):
    x, out_x = _slab(ox, dx, a)
    y, out_y = _slab(oy, dy, b)
    z, out_z = _slab(oz, dz, c)
    t = max(x, y, z)
    if t > min(out_x, out_y, out_z):
        return -1.0, 0.0, 0.0, 0.0
    if t == x:
        return t, -math.copysign(1.0, dx), 0.0, 0.0
    if t == y:
        return t, 0.0, -math.copysign(1.0, dy), 0.0
    return t, 0.0, 0.0, -math.copysign(1.0, dz)


@part
def _hit(kind, ox, oy, oz, dx, dy, dz, a, b, c):
    """The nearest hit of the ray o + t d with a shape of size (a, b, c) in its own frame, and the normal there."""
    if kind == BOX:
        return _hit_box(ox, oy, oz, dx, dy, dz, a, b, c)
    if kind in (CAPSULE, CYLINDER):
        return _hit_round(ox, oy, oz, dx, dy, dz, a, c, kind == CAPSULE)
    if kind == SPHERE:
        return _hit_ellipsoid(ox, oy, oz, dx, dy, dz, a, a, a)
    if kind == ELLIPSOID:
        return _hit_ellipsoid(ox, oy, oz, dx, dy, dz, a, b, c)
    if oz <= 0 or dz >= 0:  # a plane is seen from above only
        return -1.0, 0.0, 0.0, 0.0
    t = -oz / dz
    if (a > 0 and abs(ox + t * dx) > a) or (b > 0 and abs(oy + t * dy) > b):
        return -1.0, 0.0, 0.0, 0.0
    return t, 0.0, 0.0, 1.0


@part
def _checker(x, y, floor, footprint):
    """Share of the floor's second colour at (x, y): half where a pixel covers more than a square."""
    edge = floor[2, 0]
    odd = (math.floor(x / edge) + math.floor(y / edge)) & 1
    blur = min(1.0, footprint / edge)
    return odd * (1 - blur) + 0.5 * blur


def _draw(known, kinds, floats, cameras, lights, floor, sky, scale, what, pixels):
    """Draw all shapes over a picture of the first ``known`` shapes, and the id of the shape at each pixel."""
    rows, columns = what.shape
    coarse, fine = np.empty((rows, len(kinds), 2), np.int32), np.empty((scale * rows, len(kinds), 2), np.int32)
    _cover(kinds, floats, cameras[0], columns, coarse)
    _cover(kinds, floats, cameras[1], scale * columns, fine)
    touched = np.empty((rows, columns), np.bool_)
    _touch(known, coarse, touched)
    most = scale * columns
    wanted, color, number = np.empty(most, np.int64), np.empty((most, 3), np.uint8), np.empty(most, np.int32)
    total = np.empty((columns, 3), np.int32)
    for row in range(rows):
        hit = np.flatnonzero(touched[row])
        _cast(row, hit, kinds, floats, coarse, cameras[0], lights, floor, sky, color, number)
        for k, column in enumerate(hit):
            what[row, column] = number[k]
            for c in range(3):
                pixels[row, column, c] = color[k, c]
    for row in range(rows):
        count = 0
        for column in np.flatnonzero(touched[row]):
            if _is_edge(what, row, column):
                for b in range(scale):
                    wanted[count + b] = scale * column + b
                count += scale
        total[:] = 0
        for line in range(scale * row, scale * (row + 1)):
            _cast(line, wanted[:count], kinds, floats, fine, cameras[1], lights, floor, sky, color, number)
            for k in range(count):
                for c in range(3):
                    total[k // scale, c] += color[k, c]
        for k in range(count // scale):
            for c in range(3):
                pixels[row, wanted[scale * k] // scale, c] = (total[k, c] + scale * scale // 2) // (scale * scale)


_DRAW = compiling.Compiled(
    "ray caster", _draw,
    "void(int64, int32[::1], float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], "
    "int64, int32[:, ::1], uint8[:, :, ::1])",
    nogil=True, fastmath=True,
)  # fmt: skip


@part
def _touch(known, ranges, touched):
    """Pixels that shapes beyond the first ``known`` may cover, or whose edges they may change; all if none is known."""
    rows, columns = touched.shape
    touched[:] = known == 0
    for row in range(rows):
        for g in range(known, ranges.shape[1]):
            left, right = ranges[row, g, 0], ranges[row, g, 1]
            if left > right:
                continue
            for near in range(max(0, row - 1), min(rows, row + 2)):
                for column in range(max(0, left - 1), min(columns, right + 2)):
                    touched[near, column] = True


@part
def _is_edge(what, row, column):
    """Whether a pixel has a neighbour with another shape."""
    rows, columns = what.shape
    mine = what[row, column]
    return (
        mine != what[max(row - 1, 0), column]
        or mine != what[min(row + 1, rows - 1), column]
        or mine != what[row, max(column - 1, 0)]
        or mine != what[row, min(column + 1, columns - 1)]
    )


@part
def _cast(row, wanted, kinds, floats, ranges, camera, lights, floor, sky, pixels, what):
    """Cast a ray through each of a row's ``wanted`` columns (ascending): its colour, and the id of what it hits."""
    count = len(wanted)
    if count == 0:
        return
    depth, color = np.full(count, 1e30), np.empty((count, 3))
    what[:count] = 0
    o, d0, du = np.empty(3), np.empty(3), np.empty(3)
    pixel = math.sqrt((camera[1] ** 2).sum())
    v = camera[4, 1] - row
    rise = v * camera[2, 2] + camera[3, 2]
    upwards = min(1.0, max(0.0, rise))
    for k in range(count):
        for c in range(3):
            color[k, c] = sky[0, c] * (1 - upwards) + sky[1, c] * upwards
    for g in range(len(kinds)):
        if ranges[row, g, 0] > ranges[row, g, 1]:
            continue
        first, last = np.searchsorted(wanted, ranges[row, g, 0]), np.searchsorted(wanted, ranges[row, g, 1] + 1)
        if first == last:
            continue
        # The ray in the shape's own frame: from o along d0 + u du.
        shape, kind = floats[g], kinds[g]
        for i in range(3):
            o[i], d0[i], du[i] = 0.0, 0.0, 0.0
            for j in range(3):
                axis = shape[3 + 3 * j + i]
                o[i] += axis * (camera[0, j] - shape[j])
                d0[i] += axis * (v * camera[2, j] + camera[3, j])
                du[i] += axis * camera[1, j]
        ox, oy, oz, opaque = o[0], o[1], o[2], shape[18] >= 1
        a, b, c = shape[12], shape[13], shape[14]
        for k in range(first, last):
            u = camera[4, 0] + wanted[k]
            dx, dy, dz = d0[0] + u * du[0], d0[1] + u * du[1], d0[2] + u * du[2]
            t, nx, ny, nz = _hit(kind, ox, oy, oz, dx, dy, dz, a, b, c)
            if t <= 0 or t >= depth[k]:
                continue
            if opaque:
                depth[k] = t
            # Faces of a box have different ids, and so has what is seen through a transparent shape.
            side = int(abs(nx) + 2 * abs(ny)) if kind == BOX else 0
            what[k] = 16 * (g + 1) + 4 * side + (0 if opaque else 1021 * what[k])
            norm = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
            x = (shape[3] * nx + shape[4] * ny + shape[5] * nz) * norm
            y = (shape[6] * nx + shape[7] * ny + shape[8] * nz) * norm
            z = (shape[9] * nx + shape[10] * ny + shape[11] * nz) * norm
            px = camera[0, 0] + t * (u * camera[1, 0] + v * camera[2, 0] + camera[3, 0])
            py = camera[0, 1] + t * (u * camera[1, 1] + v * camera[2, 1] + camera[3, 1])
            pz = camera[0, 2] + t * (u * camera[1, 2] + v * camera[2, 2] + camera[3, 2])
            red, green, blue = shape[19], shape[19], shape[19]
            for light in range(len(lights)):
                lx, ly, lz = -lights[light, 4], -lights[light, 5], -lights[light, 6]
                if lights[light, 0] == 0:
                    lx = lights[light, 1] - px
                    ly = lights[light, 2] - py
                    lz = lights[light, 3] - pz
                cosine = max(0.0, (lx * x + ly * y + lz * z) / math.sqrt(lx * lx + ly * ly + lz * lz))
                red += lights[light, 7] + lights[light, 10] * cosine
                green += lights[light, 8] + lights[light, 11] * cosine
                blue += lights[light, 9] + lights[light, 12] * cosine
            red, green, blue = min(1.0, red * shape[15]), min(1.0, green * shape[16]), min(1.0, blue * shape[17])
            if kind == PLANE and floor[2, 0] > 0:
                footprint = t * pixel / max(1e-3, abs(dz))
                odd = _checker(px, py, floor, footprint)
                what[k] += int(2 * odd + 0.5)
                red *= floor[0, 0] + odd * (floor[1, 0] - floor[0, 0])
                green *= floor[0, 1] + odd * (floor[1, 1] - floor[0, 1])
                blue *= floor[0, 2] + odd * (floor[1, 2] - floor[0, 2])
            clear = max(0.0, 1 - shape[18]) ** 2  # MuJoCo draws the near and the far side of what is clear
            color[k, 0] = red + (color[k, 0] - red) * clear
            color[k, 1] = green + (color[k, 1] - green) * clear
            color[k, 2] = blue + (color[k, 2] - blue) * clear
    for k in range(count):
        for c in range(3):
            pixels[k, c] = np.uint8(255 * min(1.0, max(0.0, color[k, c])) + 0.5)
