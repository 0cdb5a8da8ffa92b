"""A draft of a robot: the data of another project's file in SI units, before it becomes a ``Robot``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import DOWN
from cdpr_sim.core.checks import LONGEST_NAME, checked_array, positive
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import STANDARD_GRAVITY, Mobility, Robot

STRAIN = 1e-3
"""Strain under the platform's weight of cables whose elasticity a file does not give."""

IN_PLANE = 1e-9
"""[m] Largest distance of a planar robot's points from one plane."""

SHALLOW = 0.1
"""Fraction of a frame's width: lower exits leave no room for a platform between them and the floor."""

UNCHANGED = ("linear_density", "reeving", "winch_to_exit", "force_min", "force_max", "gravity")
"""Fields of a draft that are those of its robot."""

TO_XZ = {
    "xz": np.eye(3),
    "xy": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "yz": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""Matrices that rotate a plane into the x-z plane, in which planar robots of this package move."""


@dataclass
class Draft:
    """Fields of ``Robot``, as far as the file gives them; ``notes`` lists what is missing on either side.

    ``axial_stiffness`` is None for rigid cables; ``plane`` is that of a planar robot, and its gravity that
    along the plane; ``home`` is the file's initial position of the platform.
    """

    name: str
    exits: ArrayLike
    anchors: ArrayLike
    mass: float
    axial_stiffness: Sequence[float] | float | None = None
    force_min: ArrayLike = 0.0
    force_max: ArrayLike = np.inf
    linear_density: ArrayLike = 0.0
    reeving: ArrayLike = 1
    winch_to_exit: ArrayLike = 0.0
    pulley_radius: ArrayLike = 0.0
    pulley_axis: ArrayLike = DOWN
    center_of_mass: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None
    plane: str | None = None
    turns: bool = True
    gravity: float = STANDARD_GRAVITY
    platform_size: ArrayLike | None = None
    frame: ArrayLike | None = None
    home: ArrayLike | None = None
    description: str = ""
    source: str = ""
    notes: list[str] = field(default_factory=list)

    def robot(self) -> Robot:
        """The robot, with a note for each thing that had to be assumed or left out.

        Raises:
            InvalidInput: an invalid field, or a platform that only translates.
        """
        mass = positive("mass", self.mass, "kg")
        exits = checked_array("exits", self.exits, (None, 3))
        anchors = checked_array("anchors", self.anchors, (len(exits), 3))
        if not self.turns:
            self._refuse_rigid_translation(anchors)
        turn = TO_XZ[self.plane or "xz"]
        frame = None if self.frame is None else checked_array("frame", self.frame, (2, 3)) @ turn.T
        home = None if self.home is None else turn @ checked_array("home", self.home, (3,))
        mobility: Mobility = "spatial" if self.plane is None else "planar"
        exits, anchors = exits @ turn.T, anchors @ turn.T
        axes = np.broadcast_to(checked_array("pulley_axis", self.pulley_axis, None), exits.shape) @ turn.T
        center = turn @ checked_array("center_of_mass", self.center_of_mass, (3,))
        radius = np.broadcast_to(checked_array("pulley_radius", self.pulley_radius, None), len(exits))
        axes[radius == 0] = DOWN
        if self.plane is not None:
            exits, anchors, center = self._flat(exits, anchors, center)
            radius = self._upright_wheels(radius, axes)
        frame = self._deep(exits) if frame is None else frame
        return Robot(
            exits=exits,
            anchors=anchors,
            axial_stiffness=self._stiffness(),
            mass=mass,
            pulley_radius=radius,
            pulley_axis=axes,
            center_of_mass=center,
            inertia=self._inertia(turn),
            mobility=mobility,
            name=plain(self.name)[:LONGEST_NAME].replace("/", "-").replace("\\", "-").strip(". ") or "robot",
            platform_size=self._size(anchors),
            frame=frame,
            workspace=_workspace(exits, frame, home),
            description=plain(self.description),
            source=plain(self.source),
            notes=[plain(note) for note in self.notes],
            **{name: getattr(self, name) for name in UNCHANGED},
        )

    def _refuse_rigid_translation(self, anchors: np.ndarray) -> None:
        if np.ptp(anchors, axis=0).any():
            raise InvalidInput(
                "the platform translates and does not rotate, expected one that rotates, or all anchors in one point"
            )
        self.notes.append(
            "The platform does not rotate there; here it rotates freely about the point where all cables meet."
        )

    def _flat(self, exits: np.ndarray, anchors: np.ndarray, center: np.ndarray) -> tuple[np.ndarray, ...]:
        """Exits, anchors and centre of mass in y = 0, where cables and platform lie in one plane."""
        depths = np.concatenate([exits[:, 1], anchors[:, 1]])
        if np.ptp(depths) > IN_PLANE:
            raise InvalidInput(
                f"cables leave the plane by {np.ptp(depths):g} m, expected those of a planar robot in the plane"
            )
        if self.plane != "xz":
            self.notes.append(f"Its {self.plane[0]}-{self.plane[1]} plane became the x-z plane.")  # type: ignore[index]
        return tuple(points * [1, 0, 1] for points in (exits, anchors, center))

    def _deep(self, exits: np.ndarray) -> np.ndarray | None:
        """A frame as deep as it is wide, where the exits lie on the floor or below it; else None."""
        top, width = exits[:, 2].max(), np.ptp(exits[:, :2], axis=0).max() or 1.0  # for a single exit, a metre
        if top - min(exits[:, 2].min(), 0.0) > SHALLOW * width:
            return None
        self.notes.append(
            f"Its exits lie on the floor, z = 0: the platform was assumed to hang {width:.3g} m below them."
        )
        return np.array([np.append(exits[:, :2].min(0), top - width), exits.max(0)])

    def _stiffness(self) -> Sequence[float] | float:
        if self.axial_stiffness is not None:
            return self.axial_stiffness
        assumed = float(f"{self.mass * STANDARD_GRAVITY / STRAIN:.1e}")
        self.notes.append(
            f"The elasticity of its cables is not given: an axial stiffness of {assumed:g} N was assumed, with which "
            "one of them stretches by a thousandth under the platform's weight."
        )
        return assumed

    def _upright_wheels(self, radius: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """Wheels whose cables arrive in the plane; others are left out."""
        across = (radius > 0) & (np.abs(axes[:, 1]) > IN_PLANE)
        if across.any():
            self.notes.append("Its pulleys were left out: their cables arrive from outside the plane.")
        axes[across] = DOWN
        return np.where(across, 0.0, radius)

    def _inertia(self, turn: np.ndarray) -> ArrayLike | None:
        """Inertia rotated with the robot; None, for a uniform box, if the file's is physically impossible."""
        if self.inertia is None:
            return None
        inertia = checked_array("inertia", self.inertia, (3, 3))
        moments = np.linalg.eigvalsh((inertia + inertia.T) / 2)
        if moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 - 1e-9):
            return turn @ inertia @ turn.T
        about = float((turn @ inertia @ turn.T)[1, 1])
        if self.plane is not None and about > 0:
            self.notes.append(
                "Of its inertia only the moment about the plane's normal was used: all are physically impossible."
            )
            return [about / 2, about, about / 2]
        self.notes.append("Its inertia is physically impossible, and was replaced by that of a uniform box.")
        return None

    def _size(self, anchors: np.ndarray) -> ArrayLike | None:
        if self.platform_size is not None or anchors.any():
            return self.platform_size
        self.notes.append("All cables meet at the platform's origin: it is drawn as a box of 0.1 m, with its inertia.")
        return (0.1, 0.1, 0.1)


def _workspace(exits: np.ndarray, frame: np.ndarray | None, home: np.ndarray | None) -> np.ndarray | None:
    """A box around ``home`` within the frame, at most half as large; None if there is no home in the frame."""
    if frame is None:
        frame = np.array([np.append(exits[:, :2].min(0), min(exits[:, 2].min(), 0.0)), exits.max(0)])
    lower, upper = frame.min(0), frame.max(0)
    if home is None or (home < lower).any() or (home > upper).any():
        return None
    half = np.minimum((upper - lower) / 4, np.minimum(home - lower, upper - home))
    return np.array([home - half, home + half])


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> np.ndarray:
    """A tensor of inertia by its entries, in the order of most formats."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def plain(text: str) -> str:
    """One line of printable text."""
    return " ".join("".join(one if one.isprintable() else " " for one in text).split())
