"""Many robots that differ in their parameters, and their equilibria: all layouts in all cases, in one batch."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, SupportsIndex

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim.core import available_memory
from cdpr_sim.core.cable import ANCHOR, COLUMNS, EXIT, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.cable_path import path, wheel_paths, wrapped_lengths
from cdpr_sim.core.checks import Frozen, checked_array, refuse_unless, shown
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problems, positions_and_rotations, refuse_wrench_out_of_plane, warn_where_outside
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.statics import forces
from cdpr_sim.statics.balance_kernel import BALANCED
from cdpr_sim.statics.gufuncs import shortfall_gufunc, stiffness_gufunc
from cdpr_sim.statics.newton import solve_table

BYTES_PER_CABLE = 120
"""Memory of one equilibrium per cable: 87 measured with eight cables, 117 with four
(``scripts/measure_constants.py``)."""

LEAST_WORK = 2000
"""Equilibria per thread: about ten milliseconds, long compared with the start of a thread."""


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

    def __post_init__(self) -> None:
        self._freeze()

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
        poses = int(np.prod(self.shape, dtype=int))
        each = len(self) // poses
        at = self.positions[::each].reshape(*self.shape, 3)
        turned = Rotation.from_matrix(self.rotations[::each]).as_quat().reshape(*self.shape, 4)
        for axis in range(len(self.shape)):
            at, turned = _halved(at, axis), _halved(turned, axis)
        count = int(np.prod(at.shape[:-1], dtype=int))
        turned = Rotation.from_quat(turned.reshape(count, 4)).as_matrix()
        return Cases(
            np.repeat(at.reshape(count, 3), each, axis=0), np.repeat(turned, each, axis=0),
            np.tile(self.wrench[:each], (count, 1)), np.tile(self.factors[:each], count), at.shape[:-1],
        )  # fmt: skip

    def problems(self, robot: Robot, rest_lengths: np.ndarray | None = None) -> Problems:
        """The problems of one robot."""
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
class RobotBatch(Frozen):
    """Robots that differ in some of their parameters.

    Attributes:
        robot: the common parameters.
        exits: (layouts, cables, 3) [m].
        anchors: (layouts, cables, 3) [m].
        axial_stiffness: (layouts, cables) [N].
        linear_density: (layouts, cables) [kg/m].
        center_of_mass: (layouts, 3) [m].
    """

    robot: Robot
    exits: Float[np.ndarray, "layouts cables 3"]
    anchors: Float[np.ndarray, "layouts cables 3"]
    axial_stiffness: Float[np.ndarray, "layouts cables"]
    linear_density: Float[np.ndarray, "layouts cables"]
    center_of_mass: Float[np.ndarray, "layouts 3"]

    def __post_init__(self) -> None:
        self.robot.cabling.refuse_memory("layout")
        self._freeze()

    @classmethod
    def of(cls, robots: Sequence[Robot]) -> RobotBatch:
        """Batch of given robots of one kind."""
        return cls(
            robots[0],
            np.array([robot.exits for robot in robots]),
            np.array([robot.anchors for robot in robots]),
            np.array([robot.axial_stiffness for robot in robots]),
            np.array([robot.cabling.linear_density for robot in robots]),
            np.array([robot.center_of_mass for robot in robots]),
        )

    def __len__(self) -> int:
        return len(self.exits)

    def take(self, rows: slice | Int[np.ndarray, " some"]) -> RobotBatch:
        """The robots of some rows."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return RobotBatch(self.robot, **arrays)

    def robot_at(self, row: int) -> Robot:
        """The robot of one row, with the platform, inertia, workspace and frame of the given robot."""
        robot, changes = self.robot, {}
        for name, given in zip(_ARRAYS, _numbers(robot), strict=True):
            if not np.array_equal(getattr(self, name)[row], given):
                changes[name] = getattr(self, name)[row]
        if not changes:
            return robot
        kept = {"workspace": robot.workspace}
        if "anchors" in changes:
            kept |= {"platform_size": robot.platform_size, "inertia": robot.inertia}
        return robot.replace(**kept, **changes)

    @cached_property
    def characteristic_lengths(self) -> Float[np.ndarray, " layouts"]:
        """Root mean square distances of the anchors from the platform's origin (``Robot.characteristic_length``)."""
        radii = np.sqrt((self.anchors**2).sum(-1).mean(-1))
        return np.where(radii > 0, radii, self.robot.characteristic_length)

    @property
    def cable_weights(self) -> Float[np.ndarray, "layouts cables"]:
        """Weights of the cables per length, with all parts of line (``Robot.cable_weights``) [N/m]."""
        return self.robot.reeving * (self.linear_density * self.robot.gravity)

    @cached_property
    def displacements(self) -> Float[np.ndarray, " layouts"]:
        """Largest displacement of exits, anchors and centre of mass, (layouts,) [m]."""
        exits, anchors, _, _, center = _numbers(self.robot)
        moved = [np.linalg.norm(self.exits - exits, axis=-1), np.linalg.norm(self.anchors - anchors, axis=-1)]
        moved.append(np.linalg.norm(self.center_of_mass - center, axis=-1)[:, None])
        return np.concatenate(moved, axis=1).max(1)

    def tables(self, factors: Float[np.ndarray, " cases"]) -> Float[np.ndarray, "layouts some cables columns"]:
        """Cable tables for compiled code (``Robot.cable_table``); one for all cases if their stiffness is the same."""
        factors = factors[:1] if (factors == factors[0]).all() else factors
        table = np.empty((len(self), len(factors), self.robot.cables, COLUMNS))
        table[:] = self.robot.cabling.packed
        table[..., EXIT : EXIT + 3] = self.exits[:, None]
        table[..., ANCHOR : ANCHOR + 3] = self.anchors[:, None]
        table[..., STIFFNESS] = self.robot.reeving * (self.axial_stiffness[:, None] * factors[:, None])
        if not self.robot.cabling.massless:
            apart = self.exits - self.robot.home - self.anchors
            table[..., WEIGHT] = self.cable_weights[:, None]
            table[..., WRAPPED] = wrapped_lengths(self.robot.cabling, apart)[:, None]
        return table

    def rigid_lengths(self, cases: Cases) -> Float[np.ndarray, "layouts cases cables"]:
        """Rigid rest lengths of each layout at the commanded poses (paper Eq. 1, 2) [m]."""
        turned = cases.rotations
        spans = []
        for i in range(3):
            if (turned == np.eye(3)).all():
                level = self.exits[:, None, :, i] - self.anchors[:, None, :, i]
            else:
                level = self.exits[:, None, :, i] - np.einsum("cj,lmj->lcm", turned[:, i], self.anchors)
            spans.append(level - cases.positions[None, :, None, i])
        found = path(*spans)[0]
        over = self.robot.cabling.pulleys
        if over.any():
            found[..., over] = wheel_paths(self.robot.cabling, *(one[..., over] for one in spans))[0]
        return found


_ARRAYS = ("exits", "anchors", "axial_stiffness", "linear_density", "center_of_mass")


def _numbers(robot: Robot) -> tuple[np.ndarray, ...]:
    return robot.exits, robot.anchors, robot.axial_stiffness, robot.cabling.linear_density, robot.center_of_mass


@dataclass(frozen=True, eq=False)
class LayoutEquilibria(EquilibriumBatch):
    """Equilibria of many layouts: an ``EquilibriumBatch`` of shape (layouts, cases).

    Attributes:
        layouts: the robots; ``problems.robot`` has their common parameters.
        cases: poses, loads and stiffnesses.
    """

    layouts: RobotBatch
    cases: Cases

    def point(self, row: SupportsIndex | tuple[SupportsIndex, ...]) -> Equilibrium:
        """The equilibrium of a row, with the robot of its layout."""
        refuse_unless(tuple, row=row)
        assert isinstance(row, tuple)
        one = super().point(row)
        robot, factor = self.layouts.robot_at(int(row[0])), self.cases.factors[int(row[1])]
        if factor != 1:
            robot = robot.replace(axial_stiffness=factor * robot.axial_stiffness)
        return dataclasses.replace(one, problem=dataclasses.replace(one.problem, robot=robot))

    @cached_property
    def modes(self) -> tuple[Float[np.ndarray, "layouts cases free"], Float[np.ndarray, "layouts cases"]]:
        """Eigenvalues of the stiffness matrix [N/m], and the lowest natural frequency [Hz].

        The own inertia of cables with mass is neglected.
        """
        layouts, cases, robot = self.layouts, self.cases, self.robot
        with np.errstate(all="ignore"):
            return stiffness_gufunc(bent=robot.cabling.bent, sagging=not robot.cabling.massless)(
                layouts.tables(cases.factors), self.problems.rest_lengths, robot.mass, robot.gravity,
                layouts.center_of_mass[:, None], robot.inertia, np.array(robot.free),
                layouts.characteristic_lengths[:, None], self.positions, self.rotations,
            )  # fmt: skip

    @property
    def frequencies(self) -> Float[np.ndarray, "layouts cases"]:
        """Lowest natural frequency of each [Hz]."""
        return self.modes[1]


def solve_layouts(layouts: RobotBatch, cases: Cases, threads: int | None = None) -> LayoutEquilibria:
    """Equilibria of every layout in every case, by the compiled solver on all cores.

    Args:
        layouts: the robots.
        cases: poses, loads and stiffnesses.
        threads: number of threads; default: one per core.

    Raises:
        InvalidInput: more than fit into memory.
    """
    need = float(len(layouts)) * len(cases) * layouts.robot.cables * BYTES_PER_CABLE
    if need > 1e8:
        what = f"poses: {len(cases):,} of them in each of {len(layouts):,} layouts"
        available_memory.refuse_beyond(what, need, "fewer poses or layouts")
    threads = (os.cpu_count() or 1) if threads is None else threads
    pieces = max(1, min(2 * threads, len(layouts), len(layouts) * len(cases) // LEAST_WORK))
    if pieces == 1 or threads == 1:
        parts = [_solve(layouts, cases)]
    else:
        edges = np.linspace(0, len(layouts), pieces + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:
            spans = [layouts.take(slice(a, b)) for a, b in itertools.pairwise(edges)]
            parts = list(pool.map(lambda span: _solve(span, cases), spans))
    lengths0, positions, rotations, lengths, tensions, residuals, iterations, status, falls = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    problems = Problems(
        robot=layouts.robot,
        positions=cases.positions,
        rotations=cases.rotations,
        rest_lengths=lengths0,
        external_wrench=cases.wrench,
        axial_stiffness=layouts.axial_stiffness[:, None] * cases.factors[:, None],
        mass=np.array(layouts.robot.mass),
        shape=(len(layouts), len(cases)),
        falls=falls,
    )
    return LayoutEquilibria(
        problems, positions, rotations, lengths, tensions, residuals, iterations, status, "newton", _eigenvalues,
        layouts, cases,
    )  # fmt: skip


def _eigenvalues(equilibria: EquilibriumBatch) -> Float[np.ndarray, "layouts cases free"]:
    """Eigenvalues on demand; a named function, so that a batch can be pickled."""
    assert isinstance(equilibria, LayoutEquilibria)
    return equilibria.modes[0]


def _solve(layouts: RobotBatch, cases: Cases) -> tuple[np.ndarray, ...]:
    robot = layouts.robot
    table, rest_lengths = layouts.tables(cases.factors), layouts.rigid_lengths(cases)
    up = (layouts.exits[:, None, :, 2] - np.einsum("cj,lmj->lcm", cases.rotations[:, 2], layouts.anchors)).max(-1)
    falls = (cases.positions[:, 2] >= up) & (robot.weight > cases.wrench[:, 2])
    start = np.where(falls[..., None], np.nan, cases.positions)
    *found, status = solve_table(
        robot, table, rest_lengths, robot.weight, cases.wrench, start, cases.rotations,
        layouts.center_of_mass[:, None], layouts.characteristic_lengths[:, None],
    )  # fmt: skip
    status = np.where(falls, int(Status.FALLS), status)
    return rest_lengths, *found, status, falls


def feasible_share(
    layouts: RobotBatch, cases: Cases, limits: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, " layouts"]:
    """Share of the cases in which rigid cables hold the platform within ``limits`` and the robot's own limits."""
    robot = layouts.robot
    lower, upper = np.maximum(limits[0], robot.force_min), np.minimum(limits[1], robot.force_max)
    with np.errstate(all="ignore"):
        # Massless cables have no weight in any layout.
        robots = [layouts.robot_at(row) for row in range(1 if robot.cabling.massless else len(layouts))]
        found = [forces.weight_of_cables(one, cases.positions, cases.rotations) for one in robots]
        difference, weight = (np.stack(column) for column in zip(*found, strict=True))
        lower, upper = lower + difference, upper - difference
        left = shortfall_gufunc(bent=robot.cabling.bent)(
            layouts.tables(np.ones(len(cases))), lower, upper, robot.weight, layouts.center_of_mass[:, None],
            cases.wrench[:, None] + weight[..., None, :], np.array(robot.free),
            layouts.characteristic_lengths[:, None], cases.positions, cases.rotations,
        )  # fmt: skip
    return ((np.asarray(left) <= BALANCED) & (lower <= upper).all(-1)).mean(-1)
