"""Equilibria of many layouts of a robot, each in all of the same cases, in one batch."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim.core import free_ram
from cdpr_sim.core.checks import Frozen, checked_array, shown
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problems, positions_and_rotations, refuse_wrench_out_of_plane, warn_where_outside
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.statics import forces
from cdpr_sim.statics.balance_kernel import BALANCED
from cdpr_sim.statics.derivatives import NEUTRAL
from cdpr_sim.statics.gufuncs import SHORTFALLS
from cdpr_sim.statics.newton import solve_many, stiffness_of

BYTES_PER_CABLE = 120
"""Memory of one equilibrium per cable: 73 measured with eight cables, 101 with four
(``scripts/dev/measure_constants.py``)."""


@dataclass(frozen=True, eq=False)
class Cases(Frozen):
    """Cases that every layout is evaluated in: poses, each under every load and with every cable stiffness.

    Attributes:
        positions: commanded, (cases, 3) [m].
        rotations: commanded rotation matrices, (cases, 3, 3).
        wrench: external force [N] and torque [N m], (cases, 6).
        factors: by which the axial stiffness is multiplied, (cases,).
        shape: of the given poses.
    """

    positions: Float[np.ndarray, "cases 3"]
    rotations: Float[np.ndarray, "cases 3 3"]
    wrench: Float[np.ndarray, "cases 6"]
    factors: Float[np.ndarray, " cases"]
    shape: tuple[int, ...]

    @classmethod
    def of(
        cls, robot: Robot, poses: Any, external_wrench: ArrayLike | None = None, stiffness: ArrayLike | None = None
    ) -> Cases:
        """Cases as users give them: one load or several (loads, 6), one factor of stiffness or several.

        Raises:
            InvalidInput: invalid poses, loads or factors.
        """
        at, turned = positions_and_rotations(robot, poses, None)
        warn_where_outside(robot, at)
        shape = np.broadcast_shapes(at.shape[:-1], turned.shape[:-2])
        at = np.broadcast_to(at, (*shape, 3)).reshape(-1, 3)
        turned = np.broadcast_to(turned, (*shape, 3, 3)).reshape(-1, 3, 3)
        if not (np.isfinite(at).all() and np.isfinite(turned).all()):
            raise InvalidInput("poses: found one that is not finite, expected numbers")
        loads = np.atleast_2d(
            checked_array("external_wrench", np.zeros(6) if external_wrench is None else external_wrench, None)
        )
        loads = checked_array("external_wrench", loads, (None, 6))
        refuse_wrench_out_of_plane(robot, loads)
        factors = np.atleast_1d(checked_array("stiffness", 1.0 if stiffness is None else stiffness, None))
        if factors.ndim != 1 or factors.size == 0 or not (factors > 0).all():
            raise InvalidInput(f"stiffness: found {shown(stiffness)}, expected factors of the axial stiffness above 0")
        each, load, factor = (
            one.ravel() for one in np.meshgrid(*(np.arange(len(x)) for x in (at, loads, factors)), indexing="ij")
        )
        return cls(at[each], turned[each], loads[load], factors[factor], shape)

    def __len__(self) -> int:
        return len(self.positions)

    def finer(self) -> Cases:
        """These poses and the midpoints between neighbours, along every dimension of ``shape``."""
        each = self.per_pose
        at = self.positions[::each].reshape(*self.shape, 3)
        turned = Rotation.from_matrix(self.rotations[::each]).as_quat().reshape(*self.shape, 4)
        for axis in range(len(self.shape)):
            at, turned = _halved(at, axis), _halved(turned, axis)
        count = int(np.prod(at.shape[:-1], dtype=int))
        return self.elsewhere(at, Rotation.from_quat(turned.reshape(count, 4)).as_matrix())

    @property
    def per_pose(self) -> int:
        """Number of cases of each pose: its loads times its stiffnesses."""
        return len(self) // int(np.prod(self.shape, dtype=int))

    def elsewhere(self, at: Float[np.ndarray, "*shape 3"], turned: Float[np.ndarray, "poses 3 3"]) -> Cases:
        """The same loads and stiffnesses at other poses."""
        count, each = len(turned), self.per_pose
        return Cases(
            np.repeat(at.reshape(count, 3), each, axis=0), np.repeat(turned, each, axis=0),
            np.tile(self.wrench[:each], (count, 1)), np.tile(self.factors[:each], count), at.shape[:-1],
        )  # fmt: skip

    def layout_problems(self, layouts: RobotBatch) -> Problems:
        """The problems of all layouts, (layouts, cases)."""
        return Problems.of_robots(layouts, self.positions, self.rotations, self.wrench, self.factors)

    def problems(self, robot: Robot, rest_lengths: np.ndarray | None = None) -> Problems:
        """The problems of one robot, (cases,)."""
        return Problems.of(
            robot,
            self.positions,
            rest_lengths,
            self.wrench,
            rotations=self.rotations,
            axial_stiffness=self.factors[:, None] * robot.axial_stiffness,
        )


def _halved(points: np.ndarray, axis: int) -> np.ndarray:
    """Insert the mean between neighbours; quaternions of either sign are allowed."""
    lined = np.moveaxis(points, axis, 0)
    if len(lined) < 2:
        return points
    after = lined[1:]
    if points.shape[-1] == 4:
        after = after * np.where((lined[:-1] * after).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    dense = np.empty((2 * len(lined) - 1, *lined.shape[1:]))
    dense[::2], dense[1::2] = lined, (lined[:-1] + after) / 2
    return np.moveaxis(dense, 0, axis)


@dataclass(frozen=True, eq=False)
class LayoutEquilibria(EquilibriumBatch):
    """Equilibria of many layouts: an ``EquilibriumBatch`` of shape (layouts, cases).

    Attributes:
        cases: poses, loads and stiffnesses.
    """

    cases: Cases

    @property
    def layouts(self) -> RobotBatch:
        """The robots; ``problems.robot`` has their common parameters."""
        assert self.problems.robots is not None
        return self.problems.robots

    @cached_property
    def held(self) -> Bool[np.ndarray, "layouts cases"]:
        """Which equilibria are held in every direction, beyond rounding."""
        sizes = np.abs(self.eigenvalues)
        return np.asarray(sizes.min(-1) > NEUTRAL * sizes.max(-1))

    @cached_property
    def frequencies(self) -> Float[np.ndarray, "layouts cases"]:
        """Lowest natural frequency of each [Hz]."""
        return stiffness_of(self)[1]


def solve_layouts(layouts: RobotBatch, cases: Cases, threads: int = 0) -> LayoutEquilibria:
    """Equilibria of every layout in every case, by the compiled solver on all cores.

    Args:
        layouts: the robots.
        cases: poses, loads and stiffnesses.
        threads: 0 for one per processor.

    Raises:
        InvalidInput: more than fit into memory.
    """
    need = float(len(layouts)) * len(cases) * layouts.robot.cables * BYTES_PER_CABLE
    if need > 1e8:
        what = f"poses: {len(cases):,} of them in each of {len(layouts):,} layouts"
        free_ram.refuse_beyond(what, need, "fewer poses or layouts")
    found = solve_many(cases.layout_problems(layouts), threads=threads)
    return LayoutEquilibria(**{one.name: getattr(found, one.name) for one in dataclasses.fields(found)}, cases=cases)


def feasible_cases(
    layouts: RobotBatch, cases: Cases, limits: tuple[np.ndarray, np.ndarray]
) -> Bool[np.ndarray, "layouts cases"]:
    """Whether rigid cables hold the platform within ``limits`` and the robot's own limits."""
    robot = layouts.robot
    lower, upper = np.maximum(limits[0], robot.force_min), np.minimum(limits[1], robot.force_max)
    with np.errstate(all="ignore"):
        # Massless cables have no weight in any layout.
        robots = [layouts.robot_at(row) for row in range(1 if robot.cabling.massless else len(layouts))]
        found = [forces.weight_of_cables(one, cases.positions, cases.rotations) for one in robots]
        difference, weight = (np.stack(column) for column in zip(*found, strict=True))
        lower, upper = lower + difference, upper - difference
        left = SHORTFALLS(
            layouts.cable_table(layouts.axial_stiffness[:, None]), lower, upper, robot.weight,
            layouts.center_of_mass[:, None], cases.wrench[:, None] + weight[..., None, :], np.array(robot.free),
            layouts.characteristic_lengths[:, None], cases.positions, cases.rotations,
        )  # fmt: skip
    return (np.asarray(left) <= BALANCED) & (lower <= upper).all(-1)
