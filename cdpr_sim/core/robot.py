"""A cable-driven parallel robot: geometry, cable stiffness and load, frozen and checked."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.errors import InvalidInput, UnknownName
from cdpr_sim.core.materials import load_material
from cdpr_sim.core.pose import PoseLike, as_pose

Mobility = Literal["spatial", "planar"]

FREE_DIRECTIONS: dict[str, tuple[int, ...]] = {"spatial": (0, 1, 2, 3, 4, 5), "planar": (0, 2, 4)}
"""Per mobility, the indices of (x, y, z, rotation about x, about y, about z) in which the platform can move."""

STANDARD_GRAVITY = 9.81
"""Acceleration of gravity [m/s²], as in DemoBot's study."""

_IN_PLANE = 1e-9
"""How far [m, or sine of an angle] out of the x-z plane still counts as rounding."""


@dataclass(init=False, frozen=True, eq=False, repr=False)
class Robot:
    """A platform on elastic cables. Arrays are stored read-only; ``replace`` makes a changed copy.

    Args:
        exits: exit points A_i in the base frame, (cables, 3) [m].
        anchors: anchor points B_i in the platform frame, (cables, 3) [m].
        axial_stiffness: EA [N], one number or one per cable.
        mass: of the platform [kg].
        center_of_mass: in the platform frame, (3,) [m].
        inertia: about the centre of mass in the platform frame [kg m²], (3, 3) or its diagonal (3,);
            default: a uniform box of ``platform_size`` centred there.
        mobility: "spatial" (six free directions) or "planar" (x, z and the rotation about y).
        gravity: acceleration downwards, along -z [m/s²].
        name: what tables, models and pictures call the robot.
        platform_size: edges of the box that is drawn, (3,) [m]; default: the box around the anchors.
        frame: two opposite corners of the frame that is drawn, (2, 3) [m]; default: the box around the
            exits, down to the floor z = 0.
        workspace: two opposite corners of the box in which studies command the platform, (2, 3) [m];
            default: the middle of the frame.
        material: what the cables are called; for display only (``replace(material=...)`` sets the stiffness too).
        description: one line.
        source: where the numbers come from.

    Raises:
        InvalidInput: a field that cannot be right; the message names it.
    """

    exits: Float[np.ndarray, "cables 3"]
    anchors: Float[np.ndarray, "cables 3"]
    axial_stiffness: Float[np.ndarray, " cables"]
    mass: float
    center_of_mass: Float[np.ndarray, "3"] = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    inertia: Float[np.ndarray, "3 3"] = None  # type: ignore[assignment]
    mobility: Mobility = "spatial"
    gravity: float = STANDARD_GRAVITY
    name: str = "robot"
    platform_size: Float[np.ndarray, "3"] = None  # type: ignore[assignment]
    frame: Float[np.ndarray, "2 3"] = None  # type: ignore[assignment]
    workspace: Float[np.ndarray, "2 3"] = None  # type: ignore[assignment]
    material: str | None = None
    description: str = ""
    source: str = ""

    def __init__(
        self,
        exits: ArrayLike,
        anchors: ArrayLike,
        axial_stiffness: ArrayLike,
        mass: float,
        *,
        center_of_mass: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        mobility: Mobility = "spatial",
        gravity: float = STANDARD_GRAVITY,
        name: str = "robot",
        platform_size: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        workspace: ArrayLike | None = None,
        material: str | None = None,
        description: str = "",
        source: str = "",
    ) -> None:
        exits = checked_array("exits", exits, (None, 3))
        cables = len(exits)
        if cables < 1:
            raise InvalidInput("exits: found no cable, expected at least one row (x, y, z)")
        anchors = checked_array("anchors", anchors, (cables, 3))
        stiffness = checked_array("axial_stiffness", axial_stiffness, None)
        if stiffness.ndim:
            stiffness = checked_array("axial_stiffness", stiffness, (cables,))
        stiffness = np.broadcast_to(stiffness, (cables,)).copy()
        if not (stiffness > 0).all():
            raise InvalidInput(f"axial_stiffness: found {stiffness.min():g} N, expected more than 0")
        if mobility not in get_args(Mobility):
            raise UnknownName("mobility", str(mobility), get_args(Mobility))
        center_of_mass = checked_array("center_of_mass", center_of_mass, (3,))
        mass = _positive("mass", mass, "kg")
        gravity = float(checked_array("gravity", gravity, ()))
        if gravity < 0:
            raise InvalidInput(f"gravity: found {gravity:g} m/s², expected 0 or more (it acts downwards)")
        if platform_size is None:
            platform_size = _box_around(anchors)
        platform_size = checked_array("platform_size", platform_size, (3,))
        if not (platform_size > 0).all():
            raise InvalidInput(f"platform_size: found {platform_size.tolist()} m, expected three positive edges")
        if inertia is None:
            inertia = _box_inertia(mass, platform_size)
        inertia = _checked_inertia(inertia)
        if frame is None:
            frame = [np.append(exits[:, :2].min(0), min(0.0, exits[:, 2].min())), exits.max(0)]
        frame = _corners("frame", frame)
        if workspace is None:
            margin = np.array([0.25, 0.25, 0.2]) * (frame[1] - frame[0])
            workspace = [frame[0] + margin, frame[1] - margin]
        workspace = _corners("workspace", workspace)
        if mobility == "planar":
            for field, points in (("exits", exits), ("anchors", anchors), ("center_of_mass", center_of_mass[None])):
                row = int(np.argmax(np.abs(points[:, 1])))
                if abs(points[row, 1]) > _IN_PLANE:
                    where = field if field == "center_of_mass" else f"{field}[{row}]"
                    raise InvalidInput(
                        f"{where}: found y = {points[row, 1]:g} m, expected 0: a planar robot lives in the x-z plane"
                    )
            workspace[:, 1] = 0.0
        values = dict(
            exits=exits,
            anchors=anchors,
            axial_stiffness=stiffness,
            mass=mass,
            center_of_mass=center_of_mass,
            inertia=inertia,
            mobility=mobility,
            gravity=gravity,
            name=str(name),
            platform_size=platform_size,
            frame=frame,
            workspace=workspace,
            material=material,
            description=description,
            source=source,
        )
        for field, value in values.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, field, value)

    @property
    def cables(self) -> int:
        """The number of cables m."""
        return len(self.exits)

    @property
    def free_directions(self) -> tuple[int, ...]:
        """Indices of (x, y, z, rotation about x, about y, about z) in which the platform can move."""
        return FREE_DIRECTIONS[self.mobility]

    @property
    def weight(self) -> float:
        """m g [N]."""
        return self.mass * self.gravity

    @property
    def characteristic_length(self) -> float:
        """A length of the platform [m] that makes rotations comparable with translations.

        The root mean square distance of the anchors from the platform's origin; half the platform's
        diagonal where all anchors lie at the origin.
        """
        radius = float(np.sqrt((self.anchors**2).sum(1).mean()))
        return radius or float(np.linalg.norm(self.platform_size)) / 2

    @property
    def home(self) -> Float[np.ndarray, "3"]:
        """The middle of the workspace, (3,) [m]: where a robot is commanded to if nobody says where."""
        return np.round(self.workspace.mean(0), 12)  # 0.4, not 0.39999999999999997

    def pose(self, pose: PoseLike) -> RigidTransform:
        """``pose`` as a ``RigidTransform``, checked to be one this robot can take.

        Raises:
            InvalidInput: not a pose, or out of the x-z plane of a planar robot.
        """
        transform = as_pose(pose)
        if self.mobility == "planar":
            y, sine = transform.translation[1], np.abs(transform.rotation.as_matrix()[1, [0, 2]]).max()
            if abs(y) > _IN_PLANE or sine > _IN_PLANE:
                found = f"y = {y:g} m" if abs(y) > _IN_PLANE else "a rotation about x or z"
                raise InvalidInput(
                    f"pose: found {found}, but {self.name!r} is planar: expected y = 0 and a rotation about y only"
                )
        return transform

    def rest_lengths(self, pose: PoseLike) -> Float[np.ndarray, " cables"]:
        """Cable lengths l0 at the commanded pose with rigid cables, (cables,) [m] (paper Eq. 1, 2).

        Raises:
            InvalidInput: a bad pose, or an exit that lies on its anchor there.
        """
        transform = self.pose(pose)
        lengths = np.linalg.norm(self.exits - transform.apply(self.anchors), axis=1)
        if not lengths.min() > 0:
            cable = int(np.argmin(lengths))
            raise InvalidInput(f"pose: exits[{cable}] lies on its anchor there, expected a cable longer than 0")
        return lengths

    def replace(self, **changes) -> Robot:
        """A copy with some fields changed; ``material="fishing-0.4mm"`` sets the axial stiffness as well.

        What was derived by default (the uniform box's inertia) follows the change.

        Raises:
            InvalidInput: a field that cannot be right.
            UnknownName: no such field or material.
        """
        fields = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in fields:
                raise UnknownName("field of a robot", name, fields)
        values = {name: getattr(self, name) for name in fields}
        if {"mass", "platform_size"} & changes.keys() and np.array_equal(
            self.inertia, _box_inertia(self.mass, self.platform_size)
        ):
            values["inertia"] = None
        if "material" in changes and changes["material"] is not None and "axial_stiffness" not in changes:
            values["axial_stiffness"] = load_material(changes["material"]).axial_stiffness
        elif "axial_stiffness" in changes:
            values["material"] = None
        return Robot(**(values | changes))

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {self.mobility}, {self.cables} cables, {self.mass:g} kg>"


def checked_array(field: str, value: ArrayLike, shape: tuple[int | None, ...] | None) -> Float[np.ndarray, "..."]:
    """A fresh float array of ``value``; ``None`` in ``shape`` stands for any length.

    Raises:
        InvalidInput: not numbers, not finite, or of another shape.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{field}: found {value!r}, expected numbers") from None
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
        expected = "a single number" if shape == () else f"shape {wanted}"
        raise InvalidInput(f"{field}: found an array of shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise InvalidInput(f"{field}: found {array[~np.isfinite(array)][0]}, expected finite numbers")
    return array


def _positive(field: str, value: float, unit: str) -> float:
    number = float(checked_array(field, value, ()))
    if not number > 0:
        raise InvalidInput(f"{field}: found {number:g} {unit}, expected more than 0")
    return number


def _corners(field: str, value: ArrayLike) -> Float[np.ndarray, "2 3"]:
    corners = checked_array(field, value, (2, 3))
    return np.array([corners.min(0), corners.max(0)])


def _box_around(anchors: Float[np.ndarray, "cables 3"]) -> Float[np.ndarray, "3"]:
    """Edges [m] of the box around the anchors and the origin; a flat side gets a tenth of the longest."""
    extent = np.vstack([anchors, -anchors]).max(0) * 2
    if not extent.max() > 0:
        raise InvalidInput("platform_size: not given, and expected since all anchors lie at the platform's origin")
    return np.maximum(extent, 0.1 * extent.max())


def _box_inertia(mass: float, size: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Inertia of a uniform box about its centre [kg m²]: m/12 (b² + c²) about the edge a."""
    squares = size**2
    return np.diag(mass / 12 * (squares.sum() - squares))


def _checked_inertia(value: ArrayLike) -> Float[np.ndarray, "3 3"]:
    inertia = checked_array("inertia", value, None)
    if inertia.shape == (3,):
        inertia = np.diag(inertia)
    inertia = checked_array("inertia", inertia, (3, 3))
    moments = np.linalg.eigvalsh((inertia + inertia.T) / 2)
    slack = 1e-9 * np.abs(moments).max()
    if not np.allclose(inertia, inertia.T, rtol=0, atol=slack):
        raise InvalidInput("inertia: found an unsymmetric matrix, expected a symmetric one")
    if moments[0] <= 0 or moments[0] + moments[1] < moments[2] - slack:
        raise InvalidInput(
            f"inertia: found principal moments {np.array2string(moments, precision=3)} kg m², expected all positive "
            "and none larger than the sum of the other two"
        )
    return inertia
