"""Pictures of a MuJoCo scene without any OpenGL: its planes, boxes, and round shapes, ray-cast in compiled code.

MuJoCo reduces a simulation's state to a list of a few hundred simple geoms (``mjv_updateScene``), for which it needs no
OpenGL. For each geom the rows and columns of the picture that its bounding box covers are found first; only there are
rays cast. Light is MuJoCo's: what shapes emit, and the ambient and diffuse light of directional lights and the
headlight; no shadows, no mirror images, no highlights, and no texture but the floor's checkers.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from cdpr_sim.core import compiling
from cdpr_sim.drawing import style

SHAPES = {
    name: getattr(mujoco.mjtGeom, f"mjGEOM_{name}").value
    for name in ("PLANE", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
}
PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX = SHAPES.values()
DIRECTIONAL = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value

BAND = 16
"""Rows that a thread draws at a time."""

jit = compiling.jit(nogil=True, fastmath=True)


class RayCaster:
    """Draws scenes of one model on all processors."""

    name = "raycast"

    def __init__(self, model: mujoco.MjModel) -> None:
        self._threads = ThreadPoolExecutor(os.cpu_count() or 1)
        self._floor = _checkers(model)
        self._sky = np.array([model.vis.rgba.haze[:3], _top_of_sky(model)], dtype=float)

    def draw(self, scene: mujoco.MjvScene, width: int, height: int) -> UInt8[np.ndarray, "height width 3"]:
        """The scene, from its own camera.

        One ray per pixel finds what is where; pixels at whose edge something else begins are cast again, finely. A
        shape that MuJoCo draws and this does not (a mesh, an arrow, text) is left out.
        """
        with compiling.first_use("ray caster"):
            return self._draw(scene, width, height)

    def _draw(self, scene: mujoco.MjvScene, width: int, height: int) -> UInt8[np.ndarray, "height width 3"]:
        kinds, floats = _geoms(scene)
        what = np.zeros((height, width), np.int32)
        mixed = np.ones((height, width), np.bool_)
        pixels = np.empty((height, width, 3), np.uint8)
        self._cast(scene, kinds, floats, 1, mixed, what, pixels)
        _find_edges(what, mixed)
        scale = style.SUPERSAMPLING
        fine = np.empty((scale * height, scale * width, 3), np.uint8)
        self._cast(scene, kinds, floats, scale, mixed, what, fine)
        _average(fine, scale, mixed, pixels)
        return pixels

    def _cast(self, scene: mujoco.MjvScene, kinds, floats, scale: int, wanted, what, pixels) -> None:
        """Cast ``scale`` x ``scale`` rays through the ``wanted`` pixels."""
        rows, columns = pixels.shape[:2]
        camera, lights = _camera(scene, columns, rows), _lights(scene)
        ranges = np.empty((2, len(kinds), rows), np.int32)
        _cover(kinds, floats, camera, columns, ranges)

        def band(first: int) -> None:
            _draw_rows(
                first, min(first + BAND, rows), kinds, floats, ranges, camera, lights, self._floor, self._sky,
                scale, wanted, what, pixels,
            )  # fmt: skip

        list(self._threads.map(band, range(0, rows, BAND)))

    def close(self) -> None:
        """Let the threads go."""
        self._threads.shutdown()


def averaged(pixels: UInt8[np.ndarray, "rows columns 3"], scale: int) -> UInt8[np.ndarray, "height width 3"]:
    """Each ``scale`` x ``scale`` block of pixels as one, its mean."""
    if scale == 1:
        return pixels
    result = np.empty((pixels.shape[0] // scale, pixels.shape[1] // scale, 3), np.uint8)
    _average(pixels, scale, np.ones(result.shape[:2], np.bool_), result)
    return result


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
    floats = np.empty((len(known), 20))
    for row, geom in zip(floats, known, strict=True):
        row[0:3], row[3:12], row[12:15], row[15:19] = geom.pos, geom.mat.ravel(), geom.size, geom.rgba
        row[19] = geom.emission
    kinds = np.array([geom.type for geom in known], np.int32)
    clear = floats[:, 18] < 1
    order = np.lexsort((-(floats[:, :3] - position) @ forward, clear))
    first_opaque = np.where(clear[order], order, np.arange(len(order)))  # opaque ones keep MuJoCo's order
    opaque = np.flatnonzero(~clear)
    first_opaque[: len(opaque)] = opaque
    return kinds[first_opaque], floats[first_opaque]


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


@jit
def _average(pixels, scale, wanted, result):
    for i in range(result.shape[0]):
        for j in range(result.shape[1]):
            if not wanted[i, j]:
                continue
            for c in range(3):
                total = 0
                for a in range(scale):
                    for b in range(scale):
                        total += pixels[scale * i + a, scale * j + b, c]
                result[i, j, c] = (total + scale * scale // 2) // (scale * scale)


@jit
def _find_edges(what, mixed):
    """Which pixels have a neighbour that shows something else."""
    rows, columns = what.shape
    for i in range(rows):
        for j in range(columns):
            mine = what[i, j]
            mixed[i, j] = (
                mine != what[max(i - 1, 0), j]
                or mine != what[min(i + 1, rows - 1), j]
                or mine != what[i, max(j - 1, 0)]
                or mine != what[i, min(j + 1, columns - 1)]
            )


@jit
def _extent(kind, size):
    """Half edges of the box around a shape in its own frame."""
    if kind == CAPSULE:
        return size[0], size[0], size[2] + size[0]
    if kind == SPHERE:
        return size[0], size[0], size[0]
    return size[0], size[1], size[2]


@jit
def _cover(kinds, floats, camera, columns, ranges):
    """Per shape and row, the first and last column that its bounding box covers; none where first > last."""
    rows = ranges.shape[2]
    ranges[0], ranges[1] = columns, -1
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
            ranges[0, g], ranges[1, g] = 0, columns - 1
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
                    ranges[0, g, row] = min(ranges[0, g, row], max(0, math.floor(left)))
                    ranges[1, g, row] = max(ranges[1, g, row], min(columns - 1, math.ceil(right)))


@jit
def _hit_ellipsoid(ox, oy, oz, dx, dy, dz, a, b, c):
    """The nearest hit of the ray o + t d with an ellipsoid, and the normal there; t = -1 for none."""
    ox, oy, oz, dx, dy, dz = ox / a, oy / b, oz / c, dx / a, dy / b, dz / c
    p, q, r = dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1
    root = q * q - p * r
    if root < 0:
        return -1.0, 0.0, 0.0, 0.0
    t = (-q - math.sqrt(root)) / p
    return t, (ox + t * dx) / a, (oy + t * dy) / b, (oz + t * dz) / c


@jit
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


@jit
def _slab(o, d, size):
    """Where the ray enters and leaves |x| <= size; from never to always where it runs along inside."""
    if abs(d) < 1e-12:
        return (1e30, -1e30) if abs(o) > size else (-1e30, 1e30)
    middle, reach = -o / d, size / abs(d)
    return middle - reach, middle + reach


@jit
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


@jit
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


@jit
def _checker(x, y, floor, footprint):
    """How much of the floor's second colour there is at (x, y): half where a pixel covers more than a square."""
    edge = floor[2, 0]
    odd = (math.floor(x / edge) + math.floor(y / edge)) & 1
    blur = min(1.0, footprint / edge)
    return odd * (1 - blur) + 0.5 * blur


@jit
def _draw_rows(first, last, kinds, floats, ranges, camera, lights, floor, sky, scale, wanted, what, pixels):
    """Rows ``first`` to ``last``, where ``wanted``; at one ray per pixel also a number for what each pixel shows."""
    columns = pixels.shape[1]
    depth, color, now = np.empty(columns), np.empty((columns, 3)), np.empty(columns, np.bool_)
    o, d0, du = np.empty(3), np.empty(3), np.empty(3)
    pixel = math.sqrt((camera[1] ** 2).sum())
    for row in range(first, last):
        v = camera[4, 1] - row
        rise = v * camera[2, 2] + camera[3, 2]
        upwards = min(1.0, max(0.0, rise))
        for column in range(columns):
            now[column] = wanted[row // scale, column // scale]
            depth[column] = 1e30
            for c in range(3):
                color[column, c] = sky[0, c] * (1 - upwards) + sky[1, c] * upwards
        for g in range(len(kinds)):
            if ranges[0, g, row] > ranges[1, g, row]:
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
            for column in range(ranges[0, g, row], ranges[1, g, row] + 1):
                if not now[column]:
                    continue
                u = camera[4, 0] + column
                dx, dy, dz = d0[0] + u * du[0], d0[1] + u * du[1], d0[2] + u * du[2]
                t, nx, ny, nz = _hit(kind, ox, oy, oz, dx, dy, dz, a, b, c)
                if t <= 0 or t >= depth[column]:
                    continue
                if opaque:
                    depth[column] = t
                if scale == 1:
                    # Faces of a box count as different things, and so does what is seen through a clear one.
                    side = int(abs(nx) + 2 * abs(ny)) if kind == BOX else 0
                    what[row, column] = 16 * (g + 1) + 4 * side + (0 if opaque else 1021 * what[row, column])
                norm = 1 / math.sqrt(nx * nx + ny * ny + nz * nz)
                x = (shape[3] * nx + shape[4] * ny + shape[5] * nz) * norm
                y = (shape[6] * nx + shape[7] * ny + shape[8] * nz) * norm
                z = (shape[9] * nx + shape[10] * ny + shape[11] * nz) * norm
                px = camera[0, 0] + t * (u * camera[1, 0] + v * camera[2, 0] + camera[3, 0])
                py = camera[0, 1] + t * (u * camera[1, 1] + v * camera[2, 1] + camera[3, 1])
                pz = camera[0, 2] + t * (u * camera[1, 2] + v * camera[2, 2] + camera[3, 2])
                red, green, blue = shape[19], shape[19], shape[19]
                for k in range(len(lights)):
                    lx, ly, lz = -lights[k, 4], -lights[k, 5], -lights[k, 6]
                    if lights[k, 0] == 0:
                        lx = lights[k, 1] - px
                        ly = lights[k, 2] - py
                        lz = lights[k, 3] - pz
                    cosine = max(0.0, (lx * x + ly * y + lz * z) / math.sqrt(lx * lx + ly * ly + lz * lz))
                    red += lights[k, 7] + lights[k, 10] * cosine
                    green += lights[k, 8] + lights[k, 11] * cosine
                    blue += lights[k, 9] + lights[k, 12] * cosine
                red, green, blue = min(1.0, red * shape[15]), min(1.0, green * shape[16]), min(1.0, blue * shape[17])
                if kind == PLANE and floor[2, 0] > 0:
                    footprint = t * pixel / max(1e-3, abs(dz))
                    odd = _checker(px, py, floor, footprint)
                    if scale == 1:
                        what[row, column] += int(2 * odd + 0.5)
                    red *= floor[0, 0] + odd * (floor[1, 0] - floor[0, 0])
                    green *= floor[0, 1] + odd * (floor[1, 1] - floor[0, 1])
                    blue *= floor[0, 2] + odd * (floor[1, 2] - floor[0, 2])
                clear = max(0.0, 1 - shape[18]) ** 2  # MuJoCo draws the near and the far side of what is clear
                color[column, 0] = red + (color[column, 0] - red) * clear
                color[column, 1] = green + (color[column, 1] - green) * clear
                color[column, 2] = blue + (color[column, 2] - blue) * clear
        for column in range(columns):
            if not now[column]:
                continue
            for c in range(3):
                pixels[row, column, c] = np.uint8(255 * min(1.0, max(0.0, color[column, c])) + 0.5)
