"""Exits that give way, in MuJoCo: each on a body ``frame_1``, ... with slides, whose springs are those of the frame.

The body carries the exit's site and its wheel, without weight. There is no slide along an axis in which the exit does
not move. The frame has no motion of its own: where forces are evaluated, the exits are where theirs balance, found by
Newton's method on MuJoCo's forces. Each depends on its own cable alone, so that differences along x, y and z are those
of all exits at once. In motions, the forces of tendons are known, and their slopes take the place of differences.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.number_format import LEAST_INERTIA, add, add_inertia

LIGHT = 1e-3
"""Mass of the body, as a fraction of the platform's: MuJoCo requires one. Its weight is compensated."""

FIRM = 8.0
"""Multiple of the stiffness of a chain's first segment that the slides of its exit resist in each time step: MuJoCo's
``implicitfast`` neglects how dampers of tendons couple bodies of different branches. Models of ``cogiro`` become
unstable with 1; with 4 they oscillate by 2e-7 m; with 8 they are 2e-14 m from rest after 8 s, with 32 still 9e-8."""

STEPS, TRIALS = 20, 10
"""Newton steps of the exits; two or three do. Step lengths that are tried, each half the last."""

DIFFERENCE = 1e-6
"""Displacement for differences, as a fraction of the mean cable length."""

BALANCED = 1e-13
"""Displacement of an exit in a motion that changes nothing, as a fraction of its tendon's length."""

ROUNDING = 1e-15
"""Step that changes nothing but rounding, as a fraction of the mean cable length."""


def refuse_wound(cabling: Cabling) -> None:
    """Refuse models with winches of exits that give way beside mass or a nonlinear law.

    Chains become unstable in time steps with the light bodies of exits; and drums do not move with these.

    Raises:
        InvalidInput: some cable gives way, and some has mass or a nonlinear law.
    """
    if not cabling.rigid_exits and not (cabling.massless and cabling.linear):
        cable = int(np.argmax(cabling.moving_exits))
        beside = "nonlinear cables" if cabling.massless else "cables with mass"
        raise InvalidInput(
            f"winches: found exit_compliance in cable {cable + 1} beside {beside}, expected one of them in a model "
            "with winches; drive and track take both"
        )


def holder(
    world: ET.Element, robot: Robot, cable: int, resisting: float = 0.0, pulled: float = 0.0
) -> tuple[ET.Element, Float[np.ndarray, "3"]]:
    """The element that carries an exit and its wheel, and its position [m]: the body of its frame, or the world.

    Where the integrator does not know springs, slides resist motion by ``resisting`` [s], a time step, times their
    stiffness and ``FIRM`` of that of the tendon by which they are ``pulled`` [N/m].
    """
    softness = robot.exit_compliance[cable]
    if not softness.any():
        return world, np.zeros(3)
    for body in world.iter("body"):
        if body.get("name") == f"frame_{cable + 1}":
            return body, robot.exits[cable]
    body = add(world, "body", name=f"frame_{cable + 1}", pos=robot.exits[cable], gravcomp=1)
    mass = LIGHT * robot.mass
    add_inertia(body, mass, LEAST_INERTIA)
    for axis, direction, compliance in zip("xyz", np.eye(3), softness, strict=True):
        if compliance > 0:
            slide = {"name": f"frame_{cable + 1}_{axis}", "type": "slide", "axis": direction}
            damping = max(2 * np.sqrt(mass / compliance), resisting * (1 / compliance + FIRM * pulled))
            add(body, "joint", slide, stiffness=1 / compliance, damping=damping)
    add(body, "site", {"name": f"exit_{cable + 1}", "class": "exit"})
    return body, robot.exits[cable]


@dataclass(frozen=True)
class Slides:
    """Indices in a model of the slides of exits that give way; -1 where an exit does not.

    Attributes:
        coordinates: in ``qpos``.
        dofs: in ``qvel``.
    """

    coordinates: Int[np.ndarray, "cables 3"]
    dofs: Int[np.ndarray, "cables 3"]

    @classmethod
    def of(cls, model: mujoco.MjModel, cables: int, prefix: str = "") -> Slides:
        """The indices, by name, in a model of so many ``cables``; all names begin with ``prefix``."""
        names = [[f"{prefix}frame_{cable}_{axis}" for axis in "xyz"] for cable in range(1, cables + 1)]
        kind = mujoco.mjtObj.mjOBJ_JOINT.value
        joints = np.array([[mujoco.mj_name2id(model, kind, name) for name in three] for three in names])
        some = joints >= 0
        return cls(*(np.where(some, address[joints], -1) for address in (model.jnt_qposadr, model.jnt_dofadr)))

    @property
    def some(self) -> Bool[np.ndarray, "cables 3"]:
        """Which exits give way along which axes."""
        return self.dofs >= 0

    def __bool__(self) -> bool:
        return bool(self.some.any())

    def settle(
        self,
        qpos: Float[np.ndarray, "rows coordinates"],
        rows: Int[np.ndarray, " some"],
        length: Float[np.ndarray, " some"],
        springs: Callable[[], Float[np.ndarray, "rows dofs"]],
    ) -> None:
        """Move the exits of some rows to where their forces balance, with the platforms where they are.

        Args:
            qpos: coordinates of all rows, which are changed.
            rows: which.
            length: of their cables [m].
            springs: MuJoCo's forces of springs at ``qpos``, with wheels turned towards the anchors.
        """
        if not len(rows):
            return
        some, at = self.some, (rows[:, None], self.coordinates[self.some])
        each = np.flatnonzero(some.any(1))

        def forces() -> Float[np.ndarray, "rows cables 3"]:
            found = np.zeros((len(rows), *some.shape))
            found[:, some] = springs()[rows[:, None], self.dofs[some]]
            return found[:, each]

        def put(moves: Float[np.ndarray, "rows cables 3"]) -> None:
            whole = np.zeros((len(rows), *some.shape))
            whole[:, each] = moves
            qpos[at] = whole[:, some]

        here = np.zeros((len(rows), *some.shape))
        here[:, some] = qpos[at]
        here, step = here[:, each], DIFFERENCE * length[:, None]
        left = forces()
        for _ in range(STEPS):
            slope = np.tile(np.eye(3), (*here.shape[:2], 1, 1))
            for axis in range(3):
                moves = here.copy()
                moves[..., axis] += step
                put(moves)
                slope[..., axis] -= np.eye(3)[axis]
                slope[..., axis] += (left - forces()) / step[..., None]
            slope = np.where(some[each][:, None, :] & some[each][:, :, None], slope, np.eye(3))
            slope[~np.isfinite(slope).all((2, 3))] = np.eye(3)
            slope[np.linalg.det(slope) == 0] = np.eye(3)  # of forces so large that rounding makes rows equal
            move = np.linalg.solve(slope, left[..., None])[..., 0]
            move = np.where(np.isfinite(move).all(-1, keepdims=True), move, 0.0)
            far = np.abs(move).max(-1, keepdims=True) / length[:, None, None]
            move /= np.maximum(far, 1.0)  # at coordinates without bounds MuJoCo would reset the simulation, loads too
            size, share = np.abs(move).max(-1), np.ones(left.shape[:2])
            there, after = left, size
            for _ in range(TRIALS):
                put(here + share[..., None] * move)
                there = forces()
                after = np.abs(np.linalg.solve(slope, there[..., None])[..., 0]).max(-1)
                worse = ~(after < size) & (size > 1e2 * ROUNDING * length[:, None])
                if not worse.any():
                    break
                share = np.where(worse, share / 2, share)
            here, left = here + share[..., None] * move, there
            if not (size > ROUNDING * length[:, None]).any() or not ((after < 0.5 * size) & (after > 0)).any():
                break


@dataclass(frozen=True)
class MovingExits:
    """Exits that give way in one simulation whose tendons' forces are known.

    Attributes:
        cables: theirs, (moving,).
        tendons: that leave them.
        coordinates, dofs: of their slides, as in ``Slides``.
        softness: their compliance [m/N].
    """

    cables: Int[np.ndarray, " moving"]
    tendons: Int[np.ndarray, " moving"]
    coordinates: Int[np.ndarray, "moving 3"]
    dofs: Int[np.ndarray, "moving 3"]
    softness: Float[np.ndarray, "moving 3"]

    @classmethod
    def of(cls, slides: Slides, robot: Robot, first: Int[np.ndarray, " cables"]) -> MovingExits:
        """Those of a robot, whose exits are left by the tendons ``first``."""
        moving = np.flatnonzero(slides.some.any(1))
        at = slides.coordinates[moving], slides.dofs[moving]
        return cls(moving, first[moving], *at, robot.exit_compliance[moving])

    def __len__(self) -> int:
        return len(self.cables)

    def move(
        self,
        qpos: Float[np.ndarray, " coordinates"],
        jacobian: Float[np.ndarray, "tendons dofs"],
        lengths: Float[np.ndarray, " moving"],
        pulls: Float[np.ndarray, " moving"],
        slopes: Float[np.ndarray, " moving"],
    ) -> tuple[Float[np.ndarray, " moving"], bool]:
        """Move the exits by one step of Newton's method, unless forces balance.

        With the pull T and the slope k of its tendon, the unit vector u towards the anchor and its length l, an exit of
        the compliance C moves by d = C T u; by d, C T u changes by -C (k uuᵀ + T/l (1 - uuᵀ)).

        Args:
            qpos: coordinates, which are changed.
            jacobian: of the tendons there.
            lengths: of these tendons [m].
            pulls: theirs [N].
            slopes: of their pulls by length [N/m].

        Returns:
            uᵀ C u, by how much each exit gives way along its tendon, [m/N]; and whether exits moved.
        """
        some, softness, across = self.dofs >= 0, self.softness, (pulls / lengths)[:, None]
        ways = np.where(some, -jacobian[self.tendons[:, None], self.dofs], 0.0)
        moves = np.where(some, qpos[self.coordinates], 0.0)
        along = (slopes[:, None] - across)[..., None] * ways[:, :, None] * ways[:, None, :]
        slope = np.eye(3) * (1 + softness * across)[:, None] + softness[..., None] * along
        steps = np.linalg.solve(slope, (softness * pulls[:, None] * ways - moves)[..., None])[..., 0]
        moved = bool((np.abs(steps) > BALANCED * lengths[:, None]).any())  # not after it became unstable
        if moved:
            qpos[self.coordinates[some]] += steps[some]
        return (softness * ways * ways).sum(1), moved


def beside_slides(robot: Robot, swivels: ArrayLike) -> Float[np.ndarray, " coordinates"]:
    """Coordinates of slides, at rest, and swivels, in the order of a model: of exits that give way, then of others."""
    cabling, found = robot.cabling, []
    angles = dict(zip(np.flatnonzero(cabling.pulleys).tolist(), np.asarray(swivels).tolist(), strict=False))
    for cable in np.argsort(~cabling.moving_exits, kind="stable").tolist():
        found += [0.0] * np.count_nonzero(cabling.exit_compliance[cable])
        found += [angles[cable]] if cable in angles else []
    return np.array(found)
