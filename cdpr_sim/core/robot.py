"""A cable-driven parallel robot: a platform, its cables and its load, frozen and checked."""

from __future__ import annotations

import copy
import dataclasses
import functools
import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core import cable_path
from cdpr_sim.core.cable import COLUMNS, DOWN, PROPERTIES, STIFFNESS, STIFFNESS_RANGE, WEIGHT, WRAPPED, Cables, Cabling
from cdpr_sim.core.checks import (
    checked_array,
    checked_label,
    checked_name,
    checked_text,
    frozen,
    in_range,
    listed,
    one_of,
    positive,
    refuse_far,
    refuse_unless,
)
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.materials import OF_MATERIAL, Origin, each_of, is_of_material, load_material, with_numbers
from cdpr_sim.core.plausibility import OUTSIDE, implausibilities, warn
from cdpr_sim.core.pose import Pose, PoseLike
from cdpr_sim.core.pretension import lengths_under
from cdpr_sim.core.property import Rows

Mobility = Literal["spatial", "planar"]
Kind = Literal["suspended", "fully constrained", "under-actuated"]

FREE_DIRECTIONS: dict[str, tuple[int, ...]] = {"spatial": (0, 1, 2, 3, 4, 5), "planar": (0, 2, 4)}
"""Per mobility, the indices of (x, y, z, rotation about x, about y, about z) in which the platform can move."""

STANDARD_GRAVITY = 9.81
"""Acceleration of gravity [m/s²], as in DemoBot's study."""

IN_PLANE = 1e-9
"""Distance from the x-z plane [m, or sine of an angle] that still counts as rounding."""

MASS_RANGE = (1e-6, 1e12)
"""[kg] Range of masses, from a milligram: MuJoCo accepts no mass and no inertia below 1e-15 in SI units."""

INERTIA_RANGE = (1e-14, 1e24)
"""[kg m²] Range of principal moments."""

LEAST_LENGTH = 1e-9
"""[m] The shortest edge of a platform; and the smallest distance of the farthest anchor from its origin, unless it is
0."""

MOST_GRAVITY = 1e6
"""[m/s²]"""


@dataclass(init=False, frozen=True, eq=False, repr=False)
class Robot(Cables, HtmlRepr):
    """A platform on elastic cables. Arrays are stored read-only; ``replace`` makes a changed copy.

    Its attributes have the names and units of the arguments below. What is one number, pair or direction for all cables
    has a row for each of them, (cables, ...): ``pulley_axis`` unit vectors; ``hysteresis`` (share, yield strain, w) of
    each element, where a share of 0 is none; ``creep`` its terms, where an infinite EA1 is none.

    Args:
        exits: exit points A_i in the base frame, (cables, 3) [m].
        anchors: anchor points B_i in the platform frame, (cables, 3) [m].
        axial_stiffness: EA [N], one number or one per cable; or "material".
        mass: mass of the platform [kg].
        linear_density: mass per length of the cables [kg/m], one number or one per cable; 0 is a massless cable; or
            "material".
        pulley_radius: radius of the swivelling wheels at the exits [m], one number or one per cable; 0 is a point.
        pulley_axis: direction in which the cable arrives at its wheel, (3,) or (cables, 3).
        stiffening: (a2, a3) of the nonlinear law tau = EA (eps + a2 eps² + a3 eps³), one pair or one per cable;
            defined up to a strain of 20 %, beyond which no equilibrium is accepted.
        force_min: smallest allowed tension of a cable [N], one number or one per cable.
        force_max: largest tension that a cable or its winch allows [N], one number or one per cable; infinite
            without a limit. Both limits are used by ``compensate`` and ``sweep`` (feasibility); they do not change
            the equilibrium.
        breaking_load: smallest tension at which a cable breaks [N], one number or one per cable; infinite if
            unknown; default: that of the material, if the axial stiffness is the material's. Equilibria report
            overloaded cables. All three are limits of the rope's tension, as ``tensions``.
        winch_to_exit: length of rope between the winch and the exit [m], one number or one per cable; it does not
            depend on the pose, and it stretches with the rope.
        exit_compliance: by how much the exit, with its wheel, moves under each newton with which the cable pulls it
            towards the anchor [m/N]: one number, three along x, y and z of the base frame, one number for each cable,
            (cables, 1), or three, (cables, 3). Rest lengths of rigid cables are those from exits that do not move.
        rigid_length: part of the rest length, at the anchor and along the cable, that neither stretches nor weighs, as
            of a clamp, an arm or a hook [m], one number or one per cable.
        reeving: parts of line between exit and platform, an integer, one or one per cable. A rope under the tension T
            pulls the platform with ``reeving`` T; ``axial_stiffness`` and ``linear_density`` are those of the rope.
        pulley_friction: c, the fraction of the tension that is lost at the exit, one number or one per cable: the
            tensions before and behind the exit have a ratio of at most (1 + c/2)/(1 − c/2).
        hysteresis: elements (share, yield strain) or (share, yield strain, w), a sequence for all cables, or one per
            cable: springs of these shares of ``axial_stiffness``, which yield at the smaller of the yield strain, which
            may be infinite, and w times the cable's strain; w is 1 unless given.
        creep: terms (EA1 [N], tau1 [s]), a sequence for all cables, or one per cable: under a constant tension T the
            cable gets longer by the strain Σ T/EA1 (1 − exp(−t/tau1)). With friction, hysteresis or creep,
            equilibria depend on the path (``solve_path``); where the cable has mass, all three depend on the tension at
            its exit.
        center_of_mass: in the platform frame, (3,) [m].
        inertia: inertia about the centre of mass in the platform frame [kg m²], (3, 3) or its diagonal (3,);
            default: a uniform box of ``platform_size`` centred there.
        mobility: "spatial" (six free directions) or "planar" (x, z and the rotation about y).
        gravity: acceleration downwards, along -z [m/s²].
        name: name of the robot in tables, models and pictures.
        platform_size: edges of the box that is drawn, (3,) [m]; default: the box around the anchors.
        frame: two opposite corners of the frame that is drawn, (2, 3) [m]; default: the box around the exits, down
            to the floor z = 0.
        workspace: two opposite corners of the box in which studies command the platform, (2, 3) [m]; default: the
            middle of the frame.
        material: name of the cables. ``axial_stiffness``, ``linear_density`` and ``breaking_load`` that are "material",
            for all cables or in the place of one, are those of this material; with numbers, the name is for display.
            ``replace(material=...)`` changes the stiffness, and of the other two what came from a material.
        from_material: names of the materials from which numbers came, by the names of those three fields, each one for
            all cables or one per cable, None for a number given by hand; ``load_robot`` sets it. As an attribute, with
            a name for each cable.
        pretension: [N] rest lengths at a commanded pose are those whose tensions balance the weight there and are
            closest to this value (``rest_lengths``); default: None, those of rigid cables. An external wrench is no
            part of that load: it moves the platform.
        description: one line.
        source: source of the numbers.
        notes: properties of another project's file that this robot does not have, a sentence each; and assumptions.

    Raises:
        InvalidInput: a field is invalid; the message names it.
    """

    cabling: Cabling
    mass: float
    center_of_mass: Float[np.ndarray, "3"]
    inertia: Float[np.ndarray, "3 3"]
    mobility: Mobility
    gravity: float
    name: str
    platform_size: Float[np.ndarray, "3"]
    frame: Float[np.ndarray, "2 3"]
    workspace: Float[np.ndarray, "2 3"]
    material: str | None
    from_material: Mapping[str, tuple[str | None, ...]]
    pretension: float | None
    description: str
    source: str
    notes: tuple[str, ...]
    _given: dict[str, Any] = field(repr=False)

    def __init__(
        self,
        exits: ArrayLike,
        anchors: ArrayLike,
        axial_stiffness: ArrayLike,
        mass: float,
        *,
        linear_density: ArrayLike = 0.0,
        pulley_radius: ArrayLike = 0.0,
        pulley_axis: ArrayLike = DOWN,
        stiffening: ArrayLike = (0.0, 0.0),
        force_min: ArrayLike = 0.0,
        force_max: ArrayLike = np.inf,
        breaking_load: ArrayLike | None = None,
        winch_to_exit: ArrayLike = 0.0,
        exit_compliance: ArrayLike = 0.0,
        rigid_length: ArrayLike = 0.0,
        reeving: ArrayLike = 1,
        pulley_friction: ArrayLike = 0.0,
        hysteresis: Rows = (),
        creep: Rows = (),
        center_of_mass: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        mobility: Mobility = "spatial",
        gravity: float = STANDARD_GRAVITY,
        name: str = "robot",
        platform_size: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        workspace: ArrayLike | None = None,
        material: str | None = None,
        from_material: Mapping[str, Origin] | None = None,
        pretension: float | None = None,
        description: str = "",
        source: str = "",
        notes: Sequence[str] = (),
    ) -> None:
        given = {name: value for name, value in locals().items() if name != "self"}
        refuse_unless(Mapping | None, from_material=from_material)
        cables = len(checked_array("exits", exits, (None, 3)))
        given = with_numbers(given, cables)
        cabling = Cabling.of(given)
        name = checked_name("name", name)
        if material is not None:
            checked_label("material", material)
        checked_text("description", description)
        checked_text("source", source)
        for note in listed("notes", notes, "a list of sentences"):
            checked_text("notes", note)
        one_of("mobility", mobility, get_args(Mobility))
        if pretension is not None:
            pretension = float(checked_array("pretension", pretension, ()))
            in_range("pretension", pretension, 0, STIFFNESS_RANGE[1], "N")
        center_of_mass = checked_array("center_of_mass", center_of_mass, (3,))
        refuse_far("center_of_mass", center_of_mass)
        mass = positive("mass", mass, "kg")
        in_range("mass", mass, *MASS_RANGE, "kg")
        gravity = float(checked_array("gravity", gravity, ()))
        if gravity < 0:
            raise InvalidInput(f"gravity: found {gravity:g} m/s², expected 0 or more (it acts downwards)")
        in_range("gravity", gravity, 0, MOST_GRAVITY, "m/s²")
        if platform_size is None:
            platform_size = _box_around(cabling.anchors)
        platform_size = checked_array("platform_size", platform_size, (3,))
        if not (platform_size > 0).all():
            raise InvalidInput(f"platform_size: found {platform_size.tolist()} m, expected three positive edges")
        refuse_far("platform_size", platform_size)
        if platform_size.min() < LEAST_LENGTH:
            raise InvalidInput(f"platform_size: found {platform_size.min():g} m, expected at least {LEAST_LENGTH:g} m")
        inertia = _checked_inertia(_box_inertia(mass, platform_size) if inertia is None else inertia)
        if frame is None:
            lower, upper = cabling.exits.min(0), cabling.exits.max(0)
            frame = [np.append(lower[:2], min(0.0, lower[2])), upper]
        frame = _corners("frame", frame)
        if workspace is None:
            margin = np.array([0.25, 0.25, 0.2]) * (frame[1] - frame[0])
            workspace = [frame[0] + margin, frame[1] - margin]
        workspace = _corners("workspace", workspace)
        if mobility == "planar":
            _refuse_out_of_plane(cabling, center_of_mass)
            workspace[:, 1] = 0.0
        checked = {one: getattr(cabling, one) for one in PROPERTIES} | dict(
            cabling=cabling,
            mass=mass,
            center_of_mass=frozen(center_of_mass),
            inertia=frozen(inertia),
            gravity=gravity,
            platform_size=frozen(platform_size),
            frame=frozen(frame),
            workspace=frozen(workspace),
            pretension=pretension,
            from_material={name: each_of(origin, cables) for name, origin in given["from_material"].items()},
            notes=tuple(notes),
            _given=given if hasattr(self, "_copied") else copy.deepcopy(given),
        )
        for name, value in (given | checked).items():
            object.__setattr__(self, name, value)
        if 0 < np.abs(cabling.anchors).max() < LEAST_LENGTH:
            raise InvalidInput(
                f"anchors: found all within {np.abs(cabling.anchors).max():g} m of the platform's origin, expected "
                f"all there, or at least one {LEAST_LENGTH:g} m from it"
            )
        if not hasattr(self, "_copied"):
            for sentence in self.warnings:
                warn(sentence)

    @property
    def cables(self) -> int:
        """The number of cables m."""
        return len(self.cabling)

    @property
    def free_directions(self) -> tuple[int, ...]:
        """Indices of (x, y, z, rotation about x, about y, about z) in which the platform can move."""
        return FREE_DIRECTIONS[self.mobility]

    @cached_property
    def free(self) -> list[int]:
        """``free_directions`` as a list, which is an index of NumPy arrays."""
        return list(self.free_directions)

    @cached_property
    def units(self) -> Float[np.ndarray, "6"]:
        """Scales that turn (translation, rotation) into lengths, and torques into forces: 1 and a length [m]."""
        return frozen(np.repeat([1.0, self.characteristic_length], 3))

    @property
    def kind(self) -> Kind:
        """Kind of cabling in the middle of the workspace: too few cables, all from above, or some from below."""
        if self.cables < len(self.free_directions):
            return "under-actuated"
        above = self.exits[:, 2] >= self.home[2] + self.anchors[:, 2]
        return "suspended" if above.all() else "fully constrained"

    @property
    def weight(self) -> float:
        """m g [N]."""
        return self.mass * self.gravity

    @cached_property
    def cable_weights(self) -> Float[np.ndarray, " cables"]:
        """Weight of the cables per length from exit to anchor, with all parts of line, (cables,) [N/m]."""
        return frozen(self.cabling.pulls(self.cabling.linear_density * self.gravity))

    @cached_property
    def wrapped_lengths(self) -> Float[np.ndarray, " cables"]:
        """Length of each cable on its wheel with the platform level at ``home``, (cables,) [m]; 0 without a wheel.

        Of a cable with mass, this first part of the rest length counts as massless at every pose: weight that the wheel
        carries.
        """
        return frozen(cable_path.wrapped_lengths(self.cabling, self.exits - self.home - self.anchors))

    def cable_table(
        self, axial_stiffness: Float[np.ndarray, "*batch cables"] | None = None
    ) -> Float[np.ndarray, "*batch cables columns"]:
        """Cables as one table for compiled code, a row for all parts of line of a cable; columns of ``core.cable``.

        Args:
            axial_stiffness: of the ropes [N], or of many; default: the robot's.

        Returns:
            (..., cables, columns).

        Raises:
            InvalidInput: cables with a memory, whose law depends on it.
        """
        self.cabling.refuse_memory()
        if axial_stiffness is None or axial_stiffness is self.axial_stiffness:
            return self._cable_table
        table = np.broadcast_to(self._cable_table, (*axial_stiffness.shape, COLUMNS)).copy()
        table[..., STIFFNESS] = self.cabling.pulls(axial_stiffness)
        return table

    @cached_property
    def _cable_table(self) -> Float[np.ndarray, "cables columns"]:
        if self.cabling.massless:
            return self.cabling.packed
        table = self.cabling.packed.copy()
        table[:, WEIGHT], table[:, WRAPPED] = self.cable_weights, self.wrapped_lengths
        return frozen(table)

    @cached_property
    def characteristic_length(self) -> float:
        """A length of the platform [m] that makes rotations comparable with translations.

        The root mean square distance of the anchors from the platform's origin; half the platform's
        diagonal where all anchors lie at the origin.
        """
        radius = float(np.sqrt((self.anchors**2).sum(1).mean()))
        return radius or float(np.linalg.norm(self.platform_size)) / 2

    @cached_property
    def home(self) -> Float[np.ndarray, "3"]:
        """The middle of the workspace, (3,) [m]: the default of commanded positions."""
        return frozen(np.round(self.workspace.mean(0), 12))  # 0.4, not 0.39999999999999997

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons why the robot is implausible, a sentence each; none is an error."""
        return tuple(
            f"{self.name}: {sentence}"
            for sentence in implausibilities(
                self.cabling,
                self.mass,
                self.weight,
                self.center_of_mass,
                self.platform_size,
                self.frame,
                self.workspace,
                self.mobility == "planar",
            )
        )

    @cached_property
    def surroundings(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Two opposite corners of the box of plausible positions [m]; unbounded below, or if the frame is a point."""
        margin = OUTSIDE * math.dist(*self.frame) or np.inf
        lower, upper = (self.frame + np.array([[-margin], [margin]])).tolist()
        return (*lower[:2], -np.inf), tuple(upper)

    def pose(self, pose: PoseLike) -> RigidTransform:
        """``pose`` as a ``RigidTransform``, checked to be possible for this robot.

        Returns:
            The pose, position [m] and rotation of the platform frame in the base frame.

        Raises:
            InvalidInput: not a pose, or out of the x-z plane of a planar robot.
        """
        return self.placed(pose).transform

    def placed(self, pose: PoseLike) -> Pose:
        """``pose`` as plain arrays, checked in the same way.

        Returns:
            The pose, with position (3,) [m] and rotation matrix (3, 3).
        """
        at = Pose.of(pose)
        if self.mobility == "planar":
            refuse_out_of_plane(at, repr(self.name))
        return at

    def rest_lengths(
        self, pose: PoseLike, tensions: ArrayLike | None = None, *, external_wrench: ArrayLike | None = None
    ) -> Float[np.ndarray, " cables"]:
        """Unstretched cable lengths l0 for a pose, (cables,) [m].

        Without tensions, those of the robot's ``pretension``, which balance the weight, or, if it has none, those of
        rigid cables (paper Eq. 1, 2), with which the equilibrium is below the pose. With tensions, each elastic cable
        gets the unstretched length with which it has its tension at the pose, which is then an equilibrium: this is how
        a fully constrained robot is pretensioned. Lengths are from exit to anchor; tensions are those of the ropes, of
        which ``reeving`` parts pull; of cables with mass, at the platform's end.

        Args:
            pose: the commanded pose.
            tensions: (cables,) [N], which have to balance the load at the pose. Or one number p [N], a pretension: the
                tensions that balance the load and are nearest to p in every cable, tau = p − W⁺ (W p + w_e) (Pott,
                Bruckmann, Mikelsons, "Closed-form force distribution for parallel wire robots", Computational
                Kinematics 2009); W has the directions in which cables with mass pull under these tensions.
                ``compensate`` finds any that balance the load within limits.
            external_wrench: force [N] and torque [N m] on the platform's origin, base frame, besides gravity: part of
                the load that the tensions balance.

        Returns:
            (cables,) [m].

        Raises:
            InvalidInput: an invalid pose, an exit that lies on its anchor there, or tensions that do not balance the
                load or strain a cable beyond the range of its law, or are less than what a cable's weight alone gives;
                a pretension near which no tensions within the force limits balance the load.
        """
        at = self.placed(pose)
        lengths = cable_path.lengths(self.cabling, at.position, at.rotation_matrix)
        if not lengths.min() > 0:
            if np.isnan(lengths).any():
                raise InvalidInput(f"pose: found {cable_path.off_wheel(self.cabling, at.position, at.rotation_matrix)}")
            cable = int(np.argmin(lengths))
            raise InvalidInput(
                f"pose: the exit of cable {cable + 1} lies on its anchor there, expected a cable longer than 0"
            )
        if tensions is not None:
            return lengths_under(self, at, tensions, external_wrench)
        if external_wrench is not None:
            raise InvalidInput("external_wrench: found one without tensions, expected both or neither")
        return lengths if self.pretension is None else lengths_under(self, at, self.pretension, None, "pretension")

    def replace(self, **changes) -> Robot:
        """A copy with some fields changed; ``material="fishing-0.4mm"`` sets what the material gives.

        That is the axial stiffness of all cables; and the mass per length and the breaking load of those cables where
        these came from a material as well (``from_material``), or where no breaking load is known. Numbers given by
        hand stay. With another ``axial_stiffness``, a breaking load that came from the material becomes unknown,
        unless it is given too; the mass per length stays.

        What was derived by default (the uniform box's inertia, the frame, the workspace) follows the change.

        Returns:
            The changed copy; this robot stays as it is.

        Raises:
            InvalidInput: an invalid field; a material whose mass per length is not known, where it came from one.
            UnknownName: no such field or material.
        """
        for name in changes:
            if name not in FIELDS and name in ("diameter", "modulus"):
                raise InvalidInput(
                    f"{name}: found it in replace, expected material='steel-rope-4mm', which has the diameter in its "
                    "name, or axial_stiffness [N]"
                )
            one_of("field of a robot", name, FIELDS)
        given = self._given | copy.deepcopy(changes)
        if set(changes) & {"material", "from_material", *OF_MATERIAL}:
            given |= self._materials_after(changes)
        return _robot_of(given)

    def _materials_after(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Arguments that a material gives, and ``from_material``, after these changes."""
        given: dict[str, Any] = {}
        origins = dict(changes.get("from_material", self._given["from_material"]) or {})
        for name in {*OF_MATERIAL} & {*changes}:
            if "from_material" not in changes:
                origins.pop(name, None)
        if changes.get("material") is not None and "axial_stiffness" not in changes:
            load_material(changes["material"])
            given["axial_stiffness"] = "material"
            for name in {*OF_MATERIAL[1:]} - {*changes}:
                numbers, names = getattr(self, name), each_of(origins.get(name), self.cables)
                unknown = np.isinf(numbers)
                if any(names) or unknown.any():
                    entries = [
                        "material" if own or none else float(number)
                        for own, none, number in zip(names, unknown, numbers, strict=True)
                    ]
                    given[name] = "material" if set(entries) == {"material"} else entries
            origins = {}
        elif "axial_stiffness" in changes and not is_of_material(changes["axial_stiffness"]):
            given["material"] = changes.get("material")
            if "breaking_load" not in changes and (names := origins.pop("breaking_load", None)) is not None:
                each = each_of(names, self.cables)
                given["breaking_load"] = [
                    np.inf if own else float(load) for own, load in zip(each, self.breaking_load, strict=True)
                ] if isinstance(names, tuple) else np.inf  # fmt: skip
            if "from_material" not in changes:
                origins = {}
        return given | {"from_material": origins}

    def __reduce__(self) -> tuple:
        """Copies and pickles are constructed from the arguments, so that their arrays are read-only as well."""
        return _robot_of, (self._given,)

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {self.mobility}, {self.cables} cables, {self.mass:g} kg>"


FIELDS = tuple(inspect.signature(Robot).parameters)
"""Fields of a robot, which ``replace`` can change."""


def beside(robot: Robot, name: str, value: Float[np.ndarray, "cables ..."]) -> Robot:
    """A copy with another value of one property of the cables, which is not checked: for differences.

    Args:
        robot: the robot.
        name: of an attribute of the cables; or "wrapped_lengths".
        value: with a row for each cable.
    """
    made = object.__new__(Robot)
    own = {one.name: getattr(robot, one.name) for one in dataclasses.fields(robot)}
    if name in own:
        own["cabling"] = dataclasses.replace(robot.cabling, **{name: value})
    made.__dict__.update(own | {name: value})
    return made


def _robot_of(given: dict[str, Any]) -> Robot:
    """A copy, perhaps changed, of a robot with these arguments, without the warnings about implausible properties."""
    robot = object.__new__(Robot)
    object.__setattr__(robot, "_copied", True)
    Robot.__init__(robot, **given)
    return robot


@functools.lru_cache(maxsize=16)
def without_mass(robot: Robot) -> Robot:
    """The same robot with massless cables; cached, since simulations of it are cached too."""
    return robot if robot.cabling.massless else robot.replace(linear_density=0.0)


def _refuse_out_of_plane(cabling: Cabling, center_of_mass: Float[np.ndarray, "3"]) -> None:
    placed = [name for name, one in PROPERTIES.items() if one.image in ("point", "axis") and cabling.has(name).any()]
    points = {name: getattr(cabling, name) for name in placed} | {"center_of_mass": center_of_mass[None]}
    for field_name, rows in points.items():
        row = int(np.argmax(np.abs(rows[:, 1])))
        if abs(rows[row, 1]) > IN_PLANE:
            where = field_name if field_name == "center_of_mass" else f"{field_name} of cable {row + 1}"
            raise InvalidInput(
                f"{where}: found y = {rows[row, 1]:g} m, expected 0: a planar robot moves in the x-z plane"
            )


def refuse_out_of_plane(pose: Pose, name: str) -> None:
    """Refuse a pose of the planar robot ``name`` that is out of its plane.

    Raises:
        InvalidInput: y is not 0, or a rotation about another axis than y.
    """
    y, sine = pose.position[1], np.abs(pose.rotation_matrix[1, [0, 2]]).max()
    if abs(y) > IN_PLANE or sine > IN_PLANE:
        found = f"y = {y:g} m" if abs(y) > IN_PLANE else "a rotation about x or z"
        raise InvalidInput(f"pose: found {found}, but {name} is planar: expected y = 0 and a rotation about y only")


def _corners(field: str, value: ArrayLike) -> Float[np.ndarray, "2 3"]:
    corners = checked_array(field, value, (2, 3))
    refuse_far(field, corners)
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
    if np.abs(inertia).max(initial=0) > INERTIA_RANGE[1]:
        raise InvalidInput(
            f"inertia: found {np.abs(inertia).max():g} kg m², expected at most {INERTIA_RANGE[1]:g} kg m²"
        )
    if inertia.shape == (3,):
        inertia = np.diag(inertia)
    inertia = checked_array("inertia", inertia, (3, 3))
    moments = np.linalg.eigvalsh((inertia + inertia.T) / 2)
    margin = 1e-9 * np.abs(moments).max()
    if not np.allclose(inertia, inertia.T, rtol=0, atol=margin):
        raise InvalidInput("inertia: found an unsymmetric matrix, expected a symmetric one")
    if moments[0] <= 0 or moments[0] + moments[1] < moments[2] - margin:
        raise InvalidInput(
            f"inertia: found principal moments {np.array2string(moments, precision=3)} kg m², expected all positive "
            "and none larger than the sum of the other two"
        )
    least, most = INERTIA_RANGE
    if moments[0] < least or moments[2] > most:
        wrong = moments[0] if moments[0] < least else moments[2]
        raise InvalidInput(f"inertia: found a moment of {wrong:g} kg m², expected {least:g} to {most:g} kg m²")
    return inertia
