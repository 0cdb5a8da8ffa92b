"""The problem that both methods solve: the equilibrium of a robot with given rest lengths and load; one or many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, SupportsIndex

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import cable_path
from cdpr_sim.core.checks import Frozen, as_numbers, checked_array, listed, refuse_far, refuse_unless
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.plausibility import warn
from cdpr_sim.core.pose import Pose, Posed, PoseField, PoseLike, poses_of
from cdpr_sim.core.pretension import commanded_lengths
from cdpr_sim.core.robot import IN_PLANE, Robot
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.core.status import IDLE_STRAIN, Status

ORTHOGONAL = 1e-6
"""Tolerance of unit length and orthogonality of the rows of a rotation matrix."""

MOST_FORCE = 1e15
"""[N], [N m] Largest external wrench: as large as the largest axial stiffness that is accepted."""

STRAINS = (3e-10, 1e3)
"""Range of the load over the largest EA. On the catalogue, 5 poses each, with one EA or mass for each ratio: from 3e-9
to 10, both methods find at least 101 of 110 equilibria; at 3e-10 statics finds 4, as rounding of lengths is then more
than a millionth of the load; at 1e3 MuJoCo settles 75, and none at 1e4."""

SHORTEST = 1e-9
"""Smallest rest length, as a fraction of the largest coordinate of an exit or of the platform: rounding of those
coordinates is a strain of 1e-7 in such a cable, and 100 % in one of a millionth of its length."""


@dataclass(frozen=True, eq=False)
class Problem(Posed, HtmlRepr):
    """A robot, the commanded pose, the rest lengths and an external wrench; checked and frozen.

    Attributes:
        robot: the robot.
        pose: the commanded pose, from which both methods start, a ``RigidTransform``.
        rest_lengths: unstretched cable lengths l0, (cables,) [m].
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity.
    """

    robot: Robot
    pose: PoseField
    rest_lengths: Float[np.ndarray, " cables"]
    external_wrench: Float[np.ndarray, "6"]

    @classmethod
    def of(
        cls,
        robot: Robot | Problem,
        pose: PoseLike | None = None,
        rest_lengths: ArrayLike | None = None,
        external_wrench: ArrayLike | None = None,
    ) -> Problem:
        """The problem from users' arguments; rest lengths default to ``robot.rest_lengths(pose)``.

        Those are the rigid ones (paper Eq. 1, 2), or those of the robot's pretension.

        A ``Problem`` is returned unchanged, and no other argument may be given with it.

        Args:
            robot: the robot; or a ``Problem``.
            pose: commanded, (x, y, z) [m], a six-vector [m, rad] or a ``RigidTransform``.
            rest_lengths: (cables,) [m].
            external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity,
                (6,); default: none.

        Returns:
            The problem, checked and frozen.

        Raises:
            InvalidInput: an invalid pose, length or wrench, or a commanded pose at which every exit lies below the
                platform, so that it falls, or at which no tensions near the pretension hold it.
        """
        if isinstance(robot, Problem):
            beside = {"pose": pose, "rest_lengths": rest_lengths, "external_wrench": external_wrench}
            for name, value in beside.items():
                if value is not None:
                    raise InvalidInput(f"{name}: found one beside a Problem, expected it only in the Problem")
            return robot
        refuse_unless(Robot | Problem, robot=robot)
        if pose is None:
            raise InvalidInput("pose: found none, expected (x, y, z), a six-vector or a RigidTransform")
        at = robot.placed(pose)
        if rest_lengths is None:
            rest = robot.rest_lengths(at)
        else:
            rest = checked_array("rest_lengths", rest_lengths, (len(robot.cabling),))
        shortest, field = float(_shortest(robot, at.position)), "pose" if rest_lengths is None else "rest_lengths"
        robot.cabling.refuse_short(field, rest)
        if not rest.min() > shortest:
            raise InvalidInput(
                f"{field}: found a rest length of {rest.min():.1e} m in "
                f"cable {int(rest.argmin()) + 1}, expected more than {shortest:.1e} m, a billionth of the robot's "
                "coordinates, whose rounding would strain it"
            )
        wrench = checked_array("external_wrench", np.zeros(6) if external_wrench is None else external_wrench, (6,))
        refuse_wrench_out_of_plane(robot, wrench)
        if rest_lengths is None and _falls(
            robot.exits, robot.anchors, robot.weight, wrench, at.position, at.rotation_matrix
        ):
            raise InvalidInput(
                f"pose: found every exit of {robot.name!r} below the platform, which falls since cables cannot "
                "push; expected at least one exit above its anchor"
            )
        if rest_lengths is None:
            warn_where_outside(robot, at.position)
        made = cls(robot, at, rest, wrench)
        load = made.load if wrench.any() else robot.weight  # without BLAS, as models are written
        _refuse_strain(robot, load, robot.weight, float(robot.cabling.pulls(robot.axial_stiffness).max()))
        return made

    @property
    def axial_stiffness(self) -> Float[np.ndarray, " cables"]:
        """EA of the robot's cables, (cables,) [N]."""
        return self.robot.axial_stiffness

    @property
    def mass(self) -> float:
        """Mass of the robot's platform [kg]."""
        return self.robot.mass

    @property
    def cable_weights(self) -> Float[np.ndarray, " cables"]:
        """``Robot.cable_weights``, (cables,) [N/m]."""
        return self.robot.cable_weights

    @property
    def center_of_mass(self) -> Float[np.ndarray, "3"]:
        """In the platform frame, (3,) [m]."""
        return self.robot.center_of_mass

    @property
    def characteristic_length(self) -> float:
        """``Robot.characteristic_length`` [m]."""
        return self.robot.characteristic_length

    @property
    def load(self) -> float:
        """The largest of weight, external force and external torque over the characteristic length [N]."""
        return max(self.robot.weight, float(np.abs(self.external_wrench / self.robot.units).max()))

    @property
    def force_scale(self) -> float:
        """Scale of unbalanced forces [N]: the load, or, without one, a thousandth of the mean EA."""
        return self.load or IDLE_STRAIN * float(self.axial_stiffness.mean())

    def same_as(self, other: Problem) -> bool:
        """Whether both have the same robot, rest lengths and load (the starting pose may differ).

        Returns:
            True if equilibria of the two can be compared.
        """
        refuse_unless(Problem, other=other)
        return (
            np.array_equal(self.rest_lengths, other.rest_lengths)
            and np.array_equal(self.external_wrench, other.external_wrench)
            and _same_robot(self.robot, other.robot)
        )

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        least, most = self.rest_lengths.min(), self.rest_lengths.max()
        load = "" if not self.external_wrench.any() else ", under an external wrench"
        return (
            f"<Problem of {self.robot.name!r}: commanded to ({x:.6g}, {y:.6g}, {z:.6g}) m, "
            f"cables of {least:.4g} to {most:.4g} m{load}>"
        )


OWN_AXES = {
    "positions": 1, "rotations": 2, "rest_lengths": 1, "external_wrench": 1, "axial_stiffness": 1, "mass": 0, "falls": 0
}  # fmt: skip
"""Arrays of ``Problems``, and the number of axes that belong to each row."""


@dataclass(frozen=True, eq=False)
class Problems(Frozen):
    """Many problems of one robot, checked as a whole; arrays broadcast to one ``shape``.

    Indexing gives a single ``Problem``; ``refusals`` gives the reason why a row cannot be solved.

    Attributes:
        robot: the robot.
        positions: commanded positions, (..., 3) [m].
        rotations: commanded rotation matrices, (..., 3, 3).
        rest_lengths: unstretched cable lengths l0, (..., cables) [m].
        external_wrench: force [N] and torque [N m] on the platform's origin, base frame, (..., 6).
        axial_stiffness: EA, (..., cables) [N].
        mass: (...) [kg].
        shape: shape to which all of them broadcast.
        falls: (...) where every exit lies below the platform, which then falls.
        singles: the stacked problems, if there are any.
        robots: the robots of (robots, rows), where they differ in more than stiffness and mass; ``robot`` has their
            common parameters.
    """

    robot: Robot
    positions: Float[np.ndarray, "*#batch 3"]
    rotations: Float[np.ndarray, "*#batch 3 3"]
    rest_lengths: Float[np.ndarray, "*#batch cables"]
    external_wrench: Float[np.ndarray, "*#batch 6"]
    axial_stiffness: Float[np.ndarray, "*#batch cables"]
    mass: Float[np.ndarray, "*#batch"]
    shape: tuple[int, ...]
    falls: Bool[np.ndarray, "*#batch"]
    singles: tuple[Problem, ...] = ()
    robots: RobotBatch | None = None

    @classmethod
    def of(
        cls,
        robot: Robot | Problems,
        poses: RigidTransform | ArrayLike | None = None,
        rest_lengths: ArrayLike | None = None,
        external_wrench: ArrayLike | None = None,
        *,
        rotations: ArrayLike | None = None,
        axial_stiffness: ArrayLike | None = None,
        mass: ArrayLike | None = None,
    ) -> Problems:
        """The problems from users' arguments.

        Args:
            robot: the robot; its cables and mass are the defaults of the other arguments. Or ``Problems``.
            poses: commanded poses, (..., 3) [m], (..., 6) [m, rad], a stack of transforms, or a list of poses of any
                kind.
            rest_lengths: (..., cables) [m]; default: ``robot.rest_lengths`` at each commanded pose, which are the
                rigid lengths (paper Eq. 1, 2) unless the robot has a pretension.
            external_wrench: (..., 6) [N, N m].
            rotations: commanded rotation matrices (..., 3, 3), if ``poses`` are positions; default: level.
            axial_stiffness: EA [N], a number, or with the cables last: (..., cables), or (..., 1) for all cables alike.
            mass: (...) [kg].

        Returns:
            Problems of the shape to which all of these broadcast.

        Raises:
            InvalidInput: shapes that do not fit or are ambiguous, or invalid numbers.
        """
        refuse_unless(Robot | Problems, robot=robot)
        if isinstance(robot, Problems):
            for name, value in {k: v for k, v in locals().items() if k not in ("cls", "robot")}.items():
                if value is not None:
                    raise InvalidInput(f"{name}: found it beside Problems, expected it only in them")
            return robot
        if poses is None:
            raise InvalidInput("poses: found none, expected (..., 3), (..., 6) or a stack of RigidTransform")
        cables = len(robot.cabling)
        at, turned = positions_and_rotations(robot, poses, rotations)
        wrench = _with_last("external_wrench", np.zeros(6) if external_wrench is None else external_wrench, (6,))
        refuse_wrench_out_of_plane(robot, wrench)
        if axial_stiffness is None:
            stiffness = robot.axial_stiffness
        else:
            stiffness = _with_last("axial_stiffness", axial_stiffness, (cables, 1), least=0.0, unit="N", number=True)
            stiffness = np.broadcast_to(stiffness, (*stiffness.shape[:-1], cables))
        masses = np.array(robot.mass) if mass is None else checked_array("mass", mass, None)
        if not (masses > 0).all():
            raise InvalidInput(f"mass: found {masses.min():g} kg, expected more than 0")
        falls = np.array(False)
        if rest_lengths is None:
            _fitting({"poses": at.shape[:-1], "external_wrench": wrench.shape[:-1], "mass": masses.shape})
            rest = commanded_lengths(robot, at, turned, stiffness, masses)
            warn_where_outside(robot, at)
            falls = _falls(robot.exits, robot.anchors, masses * robot.gravity, wrench, at, turned)
        else:
            rest = _with_last("rest_lengths", rest_lengths, (cables,), least=0.0, unit="m")
        parts = {
            "poses": at.shape[:-1], "rotations": turned.shape[:-2], "rest_lengths": rest.shape[:-1],
            "external_wrench": wrench.shape[:-1], "axial_stiffness": stiffness.shape[:-1], "mass": masses.shape,
        }  # fmt: skip
        rows = {before[-1] for name, before in parts.items() if name != "axial_stiffness" and before}
        if cables > 1 and axial_stiffness is not None and np.shape(axial_stiffness) == (cables,) and cables in rows:
            raise InvalidInput(
                f"axial_stiffness: found ({cables},), which could be one per cable or one per row; expected "
                f"(1, {cables}) for one per cable, or ({cables}, 1) for one per row"
            )
        return cls(robot, at, turned, rest, wrench, stiffness, masses, _fitting(parts), falls)

    @classmethod
    def of_robots(
        cls,
        robots: RobotBatch,
        positions: Float[np.ndarray, "rows 3"],
        rotations: Float[np.ndarray, "rows 3 3"],
        external_wrench: Float[np.ndarray, "rows 6"],
        factors: Float[np.ndarray, " rows"],
    ) -> Problems:
        """Each of many robots, commanded to the same poses by the lengths of its own geometry: (robots, rows).

        They are rigid, or those of the common pretension, for which the platform's weight is balanced.

        Args:
            robots: the robots.
            positions: commanded positions [m].
            rotations: commanded rotation matrices.
            external_wrench: external wrenches [N, N m].
            factors: by which the axial stiffness of each row is multiplied.

        Returns:
            (robots, rows) problems.
        """
        robot, exits, anchors = robots.robot, robots.exits[:, None], robots.anchors[:, None]
        factors = factors[:1] if (factors == factors[0]).all() else factors
        if robot.pretension is None:
            rest = cable_path.lengths(robot.cabling, positions, rotations, exits, anchors)
        else:
            rows = (robots.robot_at(row) for row in range(len(robots)))
            each = (
                commanded_lengths(one, positions, rotations, factors[:, None] * one.axial_stiffness) for one in rows
            )
            rest = np.stack([np.broadcast_to(one, (len(positions), robot.cables)) for one in each])
        return cls(
            robot=robot,
            positions=positions,
            rotations=rotations,
            rest_lengths=rest,
            external_wrench=external_wrench,
            axial_stiffness=robots.axial_stiffness[:, None] * factors[:, None],
            mass=np.array(robot.mass),
            shape=(len(robots), len(positions)),
            falls=_falls(exits, anchors, robot.weight, external_wrench, positions, rotations),
            robots=robots,
        )

    @classmethod
    def stack(cls, problems: Sequence[Problem]) -> Problems:
        """(rows,) problems from single problems of the same robot.

        Args:
            problems: the problems, at least one.

        Returns:
            (rows,) problems.

        Raises:
            InvalidInput: an empty list, something else than problems, or different robots.
        """
        for problem in listed("problems", problems, "Problems of one robot"):
            refuse_unless(Problem, problems=problem)
        if len(problems) == 0:
            raise InvalidInput("problems: found none, expected at least one")
        for row, problem in enumerate(problems):
            if not _same_robot(problem.robot, problems[0].robot):
                raise InvalidInput(f"problems: found another robot in row {row}, expected problems of one robot")
        return cls(
            robot=problems[0].robot,
            positions=np.array([problem.position for problem in problems]),
            rotations=np.array([problem.rotation_matrix for problem in problems]),
            rest_lengths=np.array([problem.rest_lengths for problem in problems]),
            external_wrench=np.array([problem.external_wrench for problem in problems]),
            axial_stiffness=problems[0].axial_stiffness,
            mass=np.array(problems[0].mass),
            shape=(len(problems),),
            falls=np.array(False),
            singles=tuple(problems),
        )

    def refuse_several_robots(self, field: str) -> None:
        """Refuse ``robots`` that differ, for what knows the common ``robot`` only.

        Raises:
            InvalidInput: there are such robots.
        """
        if self.robots is not None:
            raise InvalidInput(f"{field}: found those of several robots, expected of one")

    def take(self, rows: Int[np.ndarray, " some"] | Bool[np.ndarray, "*batch"]) -> Problems:
        """Some of (rows, ...) problems, by their indices; or those of any shape where ``rows`` is true.

        Returns:
            (some, ...) problems.

        Raises:
            InvalidInput: problems of several robots.
        """
        self.refuse_several_robots("problems")
        parts = self._rows((rows,))
        return Problems(robot=self.robot, shape=parts["mass"].shape, **parts)

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Problem]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, row: SupportsIndex | tuple[SupportsIndex, ...]) -> Problem:
        """The problem at one index of ``shape``.

        Raises:
            InvalidInput: not as many indices as the problems have axes.
        """
        if self.singles and not isinstance(row, tuple):
            return self.singles[row]
        at = np.index_exp[row] if not isinstance(row, tuple) else row
        if len(at) != len(self.shape):
            raise InvalidInput(
                f"row: found {row} of problems of shape {self.shape}, expected {len(self.shape)} indices"
            )
        found = self._rows(at)
        robot, changes = self.robot if self.robots is None else self.robots.robot_at(int(at[0])), {}
        if not np.array_equal(found["axial_stiffness"], robot.axial_stiffness):
            changes["axial_stiffness"] = found["axial_stiffness"]
        if found["mass"] != robot.mass:
            changes["mass"] = float(found["mass"])
        pose = Pose(found["positions"].copy(), found["rotations"].copy())
        robot = robot.replace(**changes) if changes else robot
        return Problem(robot, pose, found["rest_lengths"].copy(), found["external_wrench"].copy())

    def _rows(self, index: tuple) -> dict[str, Any]:
        """Some rows of each array, by its name."""
        found = {}
        for name, own in OWN_AXES.items():
            array = getattr(self, name)
            whole = self.shape + array.shape[array.ndim - own :]
            found[name] = (array if array.shape == whole else np.broadcast_to(array, whole))[index]
        return found

    def cable_table(self) -> Float[np.ndarray, "*batch cables columns"]:
        """The cables of all rows, or of each robot, as a table for compiled code.

        Returns:
            ``Robot.cable_table``.
        """
        return (self.robots or self.robot).cable_table(self.axial_stiffness)

    @property
    def cable_weights(self) -> Float[np.ndarray, "*#batch cables"]:
        """``Robot.cable_weights``, of all rows or of each robot [N/m]."""
        return self.robot.cable_weights if self.robots is None else self.robots.cable_weights[:, None]

    @property
    def center_of_mass(self) -> Float[np.ndarray, "*batch 3"]:
        """In the platform frame, of all rows or of each robot [m]."""
        return self.robot.center_of_mass if self.robots is None else self.robots.center_of_mass[:, None]

    @property
    def characteristic_length(self) -> float | Float[np.ndarray, "*batch"]:
        """``Robot.characteristic_length``, of all rows or of each robot [m]."""
        return self.robot.characteristic_length if self.robots is None else self.robots.characteristic_lengths[:, None]

    @cached_property
    def finite(self) -> Bool[np.ndarray, "*batch"]:
        """(...) where pose and rest lengths are finite, and no cable is shorter than rounding or too short."""
        known = np.isfinite(self.positions).all(-1) & np.isfinite(self.rotations).all((-1, -2))
        with np.errstate(invalid="ignore"):
            long = self.rest_lengths.min(-1) > _shortest(self.robot, self.positions)
            long &= (self.rest_lengths > self.robot.cabling.least_lengths).all(-1)
        return np.broadcast_to(known & long, self.shape)

    @cached_property
    def refusals(self) -> Int[np.ndarray, "*batch"]:
        """(...) a ``Status`` with the reason why a problem cannot be solved; ``PENDING`` where it can."""
        placed = np.isfinite(self.positions).all(-1) & np.isfinite(self.rotations).all((-1, -2))
        off_wheel = placed & np.isnan(self.rest_lengths).any(-1)  # given rest lengths are finite
        why = np.where(self.finite, Status.PENDING.value, np.where(off_wheel, Status.OFF_WHEEL, Status.NOT_FINITE))
        if self.robot.pretension is not None and off_wheel.any():
            points = () if self.robots is None else (self.robots.exits[:, None], self.robots.anchors[:, None])
            rigid = cable_path.lengths(self.robot.cabling, self.positions, self.rotations, *points)
            why = np.where(off_wheel & ~np.isnan(rigid).any(-1), Status.NO_PRETENSION, why)
        return np.where(self.falls, Status.FALLS.value, why)

    @cached_property
    def poses(self) -> RigidTransform:
        """The commanded poses, a stack of (rows,)."""
        if self.singles:
            return RigidTransform.concatenate([problem.pose for problem in self.singles])
        rows = (np.broadcast_to(self.positions, (*self.shape, 3)), np.broadcast_to(self.rotations, (*self.shape, 3, 3)))
        return poses_of(*rows)

    @cached_property
    def load(self) -> Float[np.ndarray, "*#batch"]:
        """(...) the largest of weight, external force and external torque over the characteristic length [N]."""
        outside = np.abs(self.external_wrench / self.robot.units).max(-1)
        return np.maximum(self.mass * self.robot.gravity, outside)

    @property
    def force_scale(self) -> Float[np.ndarray, "*#batch"]:
        """(...) scale of unbalanced forces [N]: the load, or without one a thousandth of the mean EA."""
        return np.where(self.load > 0, self.load, IDLE_STRAIN * self.axial_stiffness.mean(-1))

    def __repr__(self) -> str:
        return f"<Problems of {self.robot.name!r}: {self.shape}>"


def positions_and_rotations(
    robot: Robot, poses: RigidTransform | ArrayLike, rotations: ArrayLike | None, field: str = "poses"
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*#batch 3 3"]]:
    """Positions (..., 3) [m] and rotation matrices, for all or for each, from poses as users give them.

    Raises:
        InvalidInput: not poses, positions beyond any robot, or out of the plane of a planar robot.
    """
    vectors = np.empty(0)
    if not isinstance(poses, RigidTransform):
        try:
            vectors = as_numbers(field, poses, "numbers or transforms")
        except InvalidInput:  # a list with transforms, or of vectors that differ in length
            if not isinstance(poses, (list, tuple)):
                raise
            poses = RigidTransform.concatenate([Pose.of(pose).transform for pose in poses])
    if isinstance(poses, RigidTransform):
        at, turned = poses.translation, poses.rotation.as_matrix()
        if rotations is not None:
            raise InvalidInput("rotations: found them beside transforms, expected one of the two")
    elif vectors.shape[-1:] == (3,):
        at = vectors
        turned = np.eye(3) if rotations is None else _checked_rotations(rotations)
    elif vectors.shape[-1:] == (6,) and rotations is None:
        at = vectors[..., :3]
        angles = np.where(np.isfinite(vectors[..., 3:]), vectors[..., 3:], 0.0).reshape(-1, 3)
        turned = Rotation.from_euler("xyz", angles).as_matrix().reshape(*vectors.shape[:-1], 3, 3)
        turned[~np.isfinite(vectors[..., 3:]).all(-1)] = np.nan
    else:
        raise InvalidInput(f"{field}: found an array of shape {vectors.shape}, expected (..., 3) or (..., 6)")
    if 0 in at.shape:
        raise InvalidInput(f"{field}: found none, expected at least one")
    refuse_far(field, at)
    _fitting({field: at.shape[:-1], "rotations": turned.shape[:-2]})
    if robot.mobility == "planar":
        beside = np.abs(at[..., 1])
        tipped = np.abs(turned[..., 1, [0, 2]]).max(-1)
        if (beside > IN_PLANE).any() or (tipped > IN_PLANE).any():
            found = f"y = {np.nanmax(beside):g} m" if (beside > IN_PLANE).any() else "a rotation about x or z"
            raise InvalidInput(
                f"{field}: found {found}, but {robot.name!r} is planar: expected y = 0 and a rotation about y only"
            )
    return at, turned


def _same_robot(one: Robot, other: Robot) -> bool:
    """Whether both have the same cables, load and free directions, to the last bit."""
    return one is other or (
        (one.mass, one.gravity, one.mobility) == (other.mass, other.gravity, other.mobility)
        and np.array_equal(one.center_of_mass, other.center_of_mass)
        and (one.cabling is other.cabling or one.cabling.same_as(other.cabling))
    )


def _fitting(parts: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The shape to which these broadcast."""
    try:
        return np.broadcast_shapes(*parts.values())
    except ValueError:
        listed_shapes = ", ".join(f"{name} {found}" for name, found in parts.items() if found)
        raise InvalidInput(f"shapes before the last dimensions do not fit one another: {listed_shapes}") from None


def _checked_rotations(rotations: ArrayLike) -> Float[np.ndarray, "*batch 3 3"]:
    matrices = as_numbers("rotations", rotations)
    if matrices.shape[-2:] != (3, 3):
        raise InvalidInput(f"rotations: found an array of shape {matrices.shape}, expected (..., 3, 3)")
    known = np.asarray(np.isfinite(matrices).all((-1, -2)))
    finite = np.where(known[..., None, None], matrices, np.eye(3))
    square = finite @ finite.swapaxes(-1, -2)
    wrong = (np.abs(square - np.eye(3)).max((-1, -2)) > ORTHOGONAL) | (np.linalg.det(finite) < 0)
    if wrong.any():
        raise InvalidInput(
            f"rotations: found a matrix that is no rotation{_place(wrong)}, expected orthogonal ones of determinant 1"
        )
    return matrices


def _with_last(
    field: str,
    value: ArrayLike,
    last: tuple[int, ...],
    *,
    least: float | None = None,
    unit: str = "",
    number: bool = False,
) -> Float[np.ndarray, "*batch last"]:
    """``value`` as finite numbers with a last dimension of one of the lengths ``last``; a single number, if allowed."""
    array = checked_array(field, value, None)
    if array.ndim == 0 and number:
        array = array[None]
    if array.shape[-1:] not in [(length,) for length in last]:
        expected = " or ".join(f"(..., {length})" for length in last) + (" or a single number" if number else "")
        raise InvalidInput(f"{field}: found an array of shape {array.shape}, expected {expected}")
    if least is not None and not (array > least).all():
        raise InvalidInput(f"{field}: found {array.min():g} {unit}, expected more than {least:g}")
    return array


def _refuse_strain(robot: Robot, load: float, weight: float, stiffness: float) -> None:
    """Refuse loads [N] that strain cables of this EA [N], with all parts of line, by what no method can compute."""
    least, most = STRAINS
    if not load or least <= load / stiffness <= most:
        return
    if load / stiffness < least:
        raise InvalidInput(
            f"axial_stiffness: found {robot.axial_stiffness.max():g} N, which a load of {load:.3g} N strains by "
            f"{load / stiffness:.1g}, expected at least {least:g}: double precision does not resolve such lengths"
        )
    field, found = ("mass", f"{robot.mass:g} kg") if load == weight else ("external_wrench", f"{load:.3g} N")
    raise InvalidInput(
        f"{field}: found {found}, a load of {load / stiffness:.1g} times the axial stiffness of {robot.name!r}, "
        f"{stiffness:g} N, expected at most {most:g} times"
    )


def _place(wrong: Bool[np.ndarray, "..."]) -> str:
    """Index of the first wrong entry, as text."""
    return f" at {[int(i) for i in np.argwhere(wrong)[0]]}" if wrong.ndim else ""


def refuse_wrench_out_of_plane(
    robot: Robot, wrench: Float[np.ndarray, "*batch 6"], field: str = "external_wrench"
) -> None:
    """Refuse wrenches out of the plane of a planar robot, and any beyond ``MOST_FORCE``.

    Raises:
        InvalidInput: such a wrench.
    """
    if np.abs(wrench).max(initial=0.0) > MOST_FORCE:
        raise InvalidInput(f"{field}: found {np.abs(wrench).max():g}, expected at most {MOST_FORCE:g} N or N m")
    if robot.mobility == "planar" and wrench[..., [1, 3, 5]].any():
        rows = wrench.reshape(-1, 6)
        first = rows[rows[:, [1, 3, 5]].any(-1)][0]
        raise InvalidInput(
            f"{field}: found {first.tolist()}, but {robot.name!r} is planar: "
            "expected only forces along x and z and a torque about y"
        )


def warn_where_outside(robot: Robot, positions: Float[np.ndarray, "*batch 3"]) -> None:
    """Warn if a commanded position is implausible."""
    ends = (positions, positions)
    if positions.ndim > 1:
        ends = np.fmin.reduce(positions.reshape(-1, 3)), np.fmax.reduce(positions.reshape(-1, 3))
    least, most = (end.tolist() for end in ends)  # comparing Python numbers is ten times faster
    (x, y, _), (right, back, top) = robot.surroundings
    if least[0] < x or least[1] < y or most[0] > right or most[1] > back or most[2] > top:
        lower, upper = (f"({', '.join(f'{edge:.4g}' for edge in corner)})" for corner in robot.frame)
        warn(
            f"{robot.name}: found a commanded position beside or above the frame, which reaches from {lower} to "
            f"{upper} m; are its units the same?"
        )


def _shortest(robot: Robot, positions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    """Cable length [m] below which coordinates are all rounding, with the platform at these positions."""
    return SHORTEST * np.maximum(np.abs(positions).max(-1), np.abs(robot.exits).max())


def _falls(
    exits: Float[np.ndarray, "*#batch cables 3"],
    anchors: Float[np.ndarray, "*#batch cables 3"],
    weight: float | Float[np.ndarray, "*#batch"],
    wrench: Float[np.ndarray, "*#batch 6"],
    positions: Float[np.ndarray, "*#batch 3"],
    rotations: Float[np.ndarray, "*#batch 3 3"],
) -> Bool[np.ndarray, "*batch"]:
    """Whether the platform falls: every exit is below its anchor, and the load pushes down."""
    turn, (a, b, c) = rotations[..., 2, :, None], np.moveaxis(anchors, -1, 0)
    highest = (exits[..., 2] - (turn[..., 0, :] * a + turn[..., 1, :] * b + turn[..., 2, :] * c)).max(-1)
    return (weight > wrench[..., 2]) & (positions[..., 2] >= highest)
