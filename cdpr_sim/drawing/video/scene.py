"""Scene of a robot's video or still, state by state, as MuJoCo's abstract scene: neither pixels nor OpenGL.

It shows the platform in MuJoCo; a translucent platform at the commanded pose; the outline of the static solver's pose;
cables coloured by tension, slack ones as chains, those over pulleys on their wheels; the commanded path and the trail
of the platform's origin. Everything is given: poses, tensions and lengths by a ``Trajectory``, the outline by a static
solver, and the profiles of cables with mass by ``cable_profiles``.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import functools
import itertools
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import cable_path
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.drawing import style
from cdpr_sim.drawing.cable_curves import cable_curve, with_moved_exits
from cdpr_sim.physics.mjcf import LEAST_SPARE, place, scene_mjcf, to_mjcf

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

PIECES = 48
"""Straight segments of a path."""

MOST_GEOMS = 4000

HIDDEN = 5
"""Group of tendons hidden in MuJoCo."""

_NOWHERE, _IDENTITY = np.zeros(3), np.eye(3).ravel()


class Stage:
    """One robot, its frame and the floor, set to one state of a trajectory at a time.

    Args:
        trajectory: the motion.
        static: the static solver's pose for each state, a stack of (steps,); nan without an equilibrium.
        largest_tension: [N] the dark end of the tension scale.
        exaggeration: factor by which deviations from the commanded pose, translations and rotations, are drawn larger.
        shapes: profiles of the cables in each state, (steps, cables, points, 3) [m]; required for cables with mass.
        colors: of the cables, (cables, 3), in place of those of their tensions, for a still: no cable is drawn slack,
            and no second platform at the commanded pose.

    Raises:
        InvalidInput: cables with mass without ``shapes``; or ``shapes`` of the wrong size.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        static: RigidTransform | None = None,
        *,
        largest_tension: float,
        exaggeration: float = 1.0,
        shapes: Float[np.ndarray, "steps cables points 3"] | None = None,
        colors: Float[np.ndarray, "cables 3"] | None = None,
    ) -> None:
        self.trajectory, self.largest_tension, self.exaggeration = trajectory, largest_tension, exaggeration
        robot = self.robot = trajectory.robot
        self.shapes = _fitting(trajectory, shapes)
        self._massless = without_mass(robot)  # for drawing only: a cable with mass is one curve
        self.model = _model(self._massless, trajectory.commanded[0])
        self.data = mujoco.MjData(self.model)
        self.scene = mujoco.MjvScene(self.model, maxgeom=MOST_GEOMS)
        # Shadows and mirror images would cost software OpenGL most of its time.
        self.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        self.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._options = mujoco.MjvOption()
        self._drawn = np.flatnonzero(robot.cabling.pulleys | robot.cabling.with_mass)
        self.model.tendon_group[self._drawn] = HIDDEN
        self.diagonal = float(np.linalg.norm(np.ptp(robot.frame, axis=0))) or 1.0
        self.poses = exaggerated(trajectory.poses, trajectory.commanded, exaggeration)
        self.static = None if static is None else exaggerated(static, trajectory.commanded, exaggeration)
        self._reach = _box_around(self.poses, robot.platform_size)
        floor = self.model.geom("floor").pos
        floor[2] = min(floor[2], self._reach[0, 2])  # else a platform below the floor would be hidden
        self._colors, self._slack = colors, trajectory.slack & (colors is None)
        self._way, self._trail = trajectory.commanded.translation, self.poses.translation
        self._any_camera = self.whole(1.5)
        self._look_at(0)

    def set(self, step: int) -> None:
        """Show state ``step`` of the trajectory."""
        self._look_at(step)
        self._move_exits(step)
        place(self.model, self.data, self._massless, self._pose, self._moved.exits - self.robot.exits)
        self._set_cables(step)
        mujoco.mj_fwdPosition(self.model, self.data)
        self._set_lengths(step)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, self.data, self._options, None, self._any_camera, everything, self.scene)
        self._light_slack(step)
        self._draw_cables(step)
        self._draw_paths(step)
        self._draw_commanded()
        if self.static is not None and np.isfinite(self.static[step].translation).all():
            self._draw_outline(self.static[step])

    def _move_exits(self, step: int) -> None:
        """Move exits that give way, as much further as deviations are drawn larger."""
        trajectory, robot = self.trajectory, self.robot
        anchors = trajectory.poses[step].apply(robot.anchors)
        shapes = None if self.shapes is None else self.shapes[step]
        self._moved = with_moved_exits(robot, anchors, trajectory.tensions[step], shapes, self.exaggeration)

    def _look_at(self, step: int) -> None:
        self.step = step
        self._pose, self._commanded = self.poses[step], self.trajectory.commanded[step]

    def look(self, camera: mujoco.MjvCamera) -> mujoco.MjvScene:
        """The scene as ``camera`` sees it."""
        mujoco.mjv_updateCamera(self.model, self.data, camera, self.scene)
        return self.scene

    def whole(self, aspect: float, *others: Robot) -> mujoco.MjvCamera:
        """A camera that sees the whole frame and all poses of the platform, for a picture of this aspect (w/h).

        And the frames of ``others``, which another stage shows from the same place.
        """
        robots = (self.robot, *others)
        corners = [*itertools.product(*self._reach.T), *(corner for one in robots for corner in one.exits)]
        corners = np.array(corners + [corner for one in robots for corner in itertools.product(*one.frame.T)])
        axes = _camera_axes()
        center = corners.mean(0)
        distance = 0.0
        for _ in range(3):  # centre the view, then determine the distance
            seen = (corners - center) @ axes.T
            tangent = np.tan(np.radians(style.FIELD_OF_VIEW) / 2) * style.FILL * np.array([aspect, 1.0])
            distance = float((np.abs(seen[:, :2]) / tangent + seen[:, 2:]).max())
            flat = seen[:, :2] / (distance - seen[:, 2:])
            center = center + (flat.max(0) + flat.min(0)) / 2 * distance @ axes[:2]
        return _camera(center, distance)

    def close_up(self) -> mujoco.MjvCamera:
        """A camera close to the commanded pose and the platform, which shows the deviation."""
        size = float(np.linalg.norm(self.robot.platform_size))
        both = self._commanded.translation, self._pose.translation
        deviation = float(np.linalg.norm(both[1] - both[0]))
        height = max(style.CLOSE_UP * size, deviation + 1.6 * size)
        return _camera(np.mean(both, axis=0), height / 2 / np.tan(np.radians(style.FIELD_OF_VIEW) / 2))

    def _set_cables(self, step: int) -> None:
        model = self.model
        model.tendon_rgba[:, 3] = 1
        tensions = self.trajectory.tensions[step]
        model.tendon_rgba[:, :3] = (
            tension_colors(tensions, self.largest_tension) if self._colors is None else self._colors
        )
        model.tendon_rgba[self._slack[step], :3] = style.SLACK_COLOR
        model.tendon_lengthspring[:] = 0

    def _set_lengths(self, step: int) -> None:
        """Let MuJoCo draw a cable as a hanging chain of its rest length, where that exceeds the distance."""
        trajectory, distance = self.trajectory, self.data.ten_length
        spare = np.maximum(trajectory.rest_lengths[step] - trajectory.lengths[step], 0)
        spare *= np.where(self._slack[step], self.exaggeration, 0)
        self.model.tendon_lengthspring[:, 1] = np.where(spare > LEAST_SPARE * distance, distance + spare, 0)

    def _light_slack(self, step: int) -> None:
        """Let slack cables emit light, so that they have the legend's colour in shade as well."""
        slack = self._slack[step]
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON and slack[geom.objid]:
                geom.emission = style.SLACK_SHINE
                geom.rgba[:3] = np.array(style.SLACK_COLOR) / (1 + style.SLACK_SHINE)

    def _draw_cables(self, step: int) -> None:
        """Draw the cables that MuJoCo would draw differently: with mass, or over pulleys."""
        trajectory, robot = self.trajectory, self._moved
        pose = self._pose
        anchors = pose.apply(robot.anchors)
        further = (1 - 1 / self.exaggeration) * (robot.exits - self.robot.exits)
        ways = cable_path.lengths(robot.cabling, pose.translation, pose.rotation.as_matrix())
        for cable in self._drawn:
            length = None
            if self._slack[step, cable]:
                true = trajectory.lengths[step, cable]
                spare = self.exaggeration * max(0.0, float(trajectory.rest_lengths[step, cable] - true))
                length = float(ways[cable]) + spare
            shape = None if self.shapes is None else self.shapes[step, cable]
            if shape is not None:
                shape = shape + np.linspace(1, 0, len(shape))[:, None] * further[cable]
            curve = cable_curve(robot.cabling, int(cable), anchors[cable], length, shape)
            self._line(curve, style.CABLE_RADIUS, tuple(self.model.tendon_rgba[cable].tolist()))

    def _draw_paths(self, step: int) -> None:
        every = max(1, len(self.trajectory) // PIECES)
        path = self._way[[*range(0, len(self._way), every), len(self._way) - 1]]
        self._line(path, style.PATH_RADIUS, (*style.COMMANDED_COLOR, style.PATH_ALPHA))
        trail = self._trail[[*range(0, step, every), step]]
        self._line(trail, style.TRAIL_RADIUS, (*style.PLATFORM_COLOR, 1))

    def _draw_commanded(self) -> None:
        commanded, pose = self._commanded, self._pose
        box, shape = self.robot.platform_size / 2, mujoco.mjtGeom.mjGEOM_BOX
        matrix, color = commanded.rotation.as_matrix().ravel(), (*style.COMMANDED_COLOR, style.GHOST_ALPHA)
        if self._colors is None:
            self._geom(shape, style.GHOST_SIZE * box, commanded.translation, matrix, color)
        # A dark patch on the floor under the platform indicates its position and height.
        floor = self.data.geom("floor").xpos[2]
        x, y, _ = pose.translation
        turn = Rotation.from_euler("z", pose.rotation.as_euler("zyx")[0]).as_matrix().ravel()
        flat = np.array([box[0], box[1], 1e-4 * self.diagonal])
        self._geom(shape, flat, [x, y, floor], turn, (0, 0, 0, style.SHADOW_ALPHA))

    def _draw_outline(self, pose: RigidTransform) -> None:
        corners = np.array(list(itertools.product((-1, 1), repeat=3)))
        points = pose.apply(corners * self.robot.platform_size / 2)
        for a, b in itertools.combinations(range(8), 2):
            if np.count_nonzero(corners[a] != corners[b]) == 1:
                self._line(points[[a, b]], style.STATIC_RADIUS, (*style.STATIC_COLOR, 1))

    def _line(self, points: Float[np.ndarray, "points 3"], radius: float, color: tuple[float, ...]) -> None:
        capsule, shade = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(color, np.float32)
        moves = (points[1:] != points[:-1]).any(1)
        for start, end in zip(points[:-1][moves], points[1:][moves], strict=True):
            geom = self._geom(capsule, _NOWHERE, _NOWHERE, _IDENTITY, shade)
            mujoco.mjv_connector(geom, capsule.value, radius * self.diagonal, start, end)

    def _geom(self, shape: mujoco.mjtGeom, size, position, matrix, color) -> mujoco.MjvGeom:
        geom, color = self.scene.geoms[self.scene.ngeom], np.array(color, np.float32)
        mujoco.mjv_initGeom(geom, shape.value, np.asarray(size, float), np.asarray(position, float), matrix, color)
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
        geom.objtype = mujoco.mjtObj.mjOBJ_UNKNOWN  # mjv_initGeom leaves there what memory holds
        self.scene.ngeom += 1
        return geom


def seen(camera: mujoco.MjvCamera, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
    """Where ``camera`` sees points [m]: to the right of the picture's middle and up, in halves of its height."""
    at = (points - camera.lookat) @ _camera_axes().T
    return at[:, :2] / (camera.distance - at[:, 2:]) / np.tan(np.radians(style.FIELD_OF_VIEW) / 2)


def _fitting(
    trajectory: Trajectory, shapes: Float[np.ndarray, "steps cables points 3"] | None
) -> Float[np.ndarray, "steps cables points 3"] | None:
    robot = trajectory.robot
    if shapes is None and not robot.cabling.massless:
        raise InvalidInput(
            f"shapes: found none of cable {int(np.argmax(robot.cabling.with_mass)) + 1}, which has mass, expected the "
            "profiles, from cable_profiles"
        )
    expected = (len(trajectory), robot.cables)
    if shapes is not None and shapes.shape[:2] != expected:
        raise InvalidInput(f"shapes: found {shapes.shape}, expected {expected[0]} states of {expected[1]} cables")
    return shapes


def exaggerated(poses: RigidTransform, commanded: RigidTransform, times: float) -> RigidTransform:
    """``poses`` with their deviations from ``commanded`` in position and rotation multiplied by ``times``."""
    if times == 1:
        return poses
    deviation = poses.translation - commanded.translation
    rotation = (poses.rotation * commanded.rotation.inv()).as_rotvec()
    return RigidTransform.from_components(
        commanded.translation + times * deviation, Rotation.from_rotvec(times * rotation) * commanded.rotation
    )


def _box_around(poses: RigidTransform, size: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 3"]:
    """Two opposite corners of the box that contains a platform of this size at all poses."""
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size
    points = poses.translation[:, None] + corners @ np.swapaxes(poses.rotation.as_matrix(), -1, -2)
    return np.array([np.nanmin(points, axis=(0, 1)), np.nanmax(points, axis=(0, 1))])


def tension_colors(tensions: Float[np.ndarray, " n"], largest: float) -> Float[np.ndarray, "n 3"]:
    """Colours of the scale from no tension to ``largest`` [N]."""
    fractions = np.clip(np.asarray(tensions) / largest, 0, 1)
    start, end = style.TENSION_RANGE
    return _tension_map()(start + fractions * (end - start))[..., :3]


@functools.cache
def _tension_map() -> Colormap:
    """The colour map, cached, since matplotlib returns a copy without its lookup table."""
    import matplotlib

    return matplotlib.colormaps[style.TENSION_MAP]


def _model(robot: Robot, pose: RigidTransform) -> mujoco.MjModel:
    """The scene of ``models/``, with round shapes and chains coarse enough for software OpenGL."""
    drawn = Problem.of(without_memory(robot), pose, robot.rest_lengths(pose))  # given, also of one that falls
    model = mujoco.MjModel.from_xml_string(scene_mjcf(robot), assets={"robot.xml": to_mjcf(drawn).encode("utf-8")})
    quality = model.vis.quality
    quality.numslices, quality.numstacks, quality.numquads = style.SLICES, style.STACKS, style.QUADS
    quality.offsamples = 0
    model.vis.global_.fovy = style.FIELD_OF_VIEW
    model.tendon_width[:] = style.CABLE_RADIUS * (np.linalg.norm(np.ptp(robot.frame, axis=0)) or 1.0)
    return model


def _camera_axes() -> Float[np.ndarray, "3 3"]:
    """Right, up and backwards of MuJoCo's free camera."""
    azimuth, elevation = np.radians([style.AZIMUTH, style.ELEVATION])
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    return np.array([right, np.cross(right, forward), -forward])


def _camera(center: Float[np.ndarray, "3"], distance: float) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation, camera.distance = style.AZIMUTH, style.ELEVATION, distance
    camera.lookat[:] = center
    return camera
