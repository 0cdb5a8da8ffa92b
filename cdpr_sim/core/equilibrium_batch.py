"""``EquilibriumBatch``: a stack of equilibria of one robot, with a status for each row; ``EquilibriumPath``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import SupportsIndex

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import Frozen
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled, Stability, stability_of
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.pose import Pose, euler_of_matrices, poses_of, tilt_of_matrices
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.slack import slack_cables
from cdpr_sim.core.status import Status


@dataclass(frozen=True, eq=False)
class EquilibriumBatch(Frozen, HtmlRepr):
    """A stack of equilibria of one robot, as arrays over the dimensions of the problems.

    Indexing gives a single ``Equilibrium``, and raises where there is none. Data only: each method computes its own
    residuals and eigenvalues, by its own means.

    Attributes:
        problems: the problems.
        positions: (..., 3) [m]; where a row did not converge, this and all fields below are those of the best point
            found.
        rotations: rotation matrices of the platform, (..., 3, 3).
        lengths: (..., cables) [m].
        tensions: tensions of the ropes at their anchors, (..., cables) [N]; ``pulls`` are the forces on the platform.
        residuals: (...) largest unbalanced force [N], torques divided by the characteristic length.
        iterations: (...) Newton iterations, or steps in MuJoCo.
        status: (...) a ``Status`` each.
        source: "newton" or "mujoco".
        stiffness: the eigenvalues, or a function that computes them at their first use.
    """

    problems: Problems
    positions: Float[np.ndarray, "*batch 3"]
    rotations: Float[np.ndarray, "*batch 3 3"]
    lengths: Float[np.ndarray, "*batch cables"]
    tensions: Float[np.ndarray, "*batch cables"]
    residuals: Float[np.ndarray, "*batch"]
    iterations: Int[np.ndarray, "*batch"]
    status: Int[np.ndarray, "*batch"]
    source: str
    stiffness: Float[np.ndarray, "*batch free"] | Callable[[EquilibriumBatch], Float[np.ndarray, "*batch free"]]

    @property
    def robot(self) -> Robot:
        """The robot of all rows."""
        return self.problems.robot

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the batch."""
        return self.problems.shape

    def __len__(self) -> int:
        return len(self.problems)

    def __iter__(self) -> Iterator[Equilibrium]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, row: SupportsIndex | tuple[SupportsIndex, ...]) -> Equilibrium:
        """The equilibrium at one index.

        Raises:
            NotConverged: statics found none there; carries the best point.
            NotSettled: the platform did not come to rest in MuJoCo; carries its last state.
        """
        point, status = self.point(row), Status(int(self.status[row]))
        if status is Status.CONVERGED:
            return point
        kind = NotSettled if self.source == "mujoco" else NotConverged
        raise kind.because(status, point)

    def point(self, row: SupportsIndex | tuple[SupportsIndex, ...]) -> Equilibrium:
        """One row, whether it is an equilibrium or not.

        Returns:
            That row as an ``Equilibrium``, with its residual [N].
        """
        return Equilibrium(
            problem=self.problems[row],
            pose=self._pose(row),
            tensions=self.tensions[row].copy(),
            lengths=self.lengths[row].copy(),
            residual=float(self.residuals[row]),
            eigenvalues=self.eigenvalues[row].copy(),
            iterations=int(self.iterations[row]),
            source=self.source,
        )

    def _pose(self, row: SupportsIndex | tuple[SupportsIndex, ...]) -> Pose:
        pose = Pose(self.positions[row].copy(), self.rotations[row].copy())
        if "poses" in self.__dict__ and isinstance(row, (int, np.integer)):
            pose.__dict__["transform"] = self.poses[row]  # made already; Pose.of would refuse one without numbers
        return pose

    @cached_property
    def poses(self) -> RigidTransform:
        """(...) the poses; for a row without one, the position is nan."""
        return poses_of(self.positions, self.rotations)

    @property
    def commanded(self) -> RigidTransform:
        """The commanded poses, a stack of (rows,)."""
        return self.problems.poses

    @property
    def rest_lengths(self) -> Float[np.ndarray, "*batch cables"]:
        """Unstretched cable lengths l0, (..., cables) [m]."""
        return np.broadcast_to(self.problems.rest_lengths, self.lengths.shape)

    @property
    def converged(self) -> Bool[np.ndarray, "*batch"]:
        """(...) whether each one is an equilibrium."""
        return self.status == Status.CONVERGED

    @property
    def euler(self) -> Float[np.ndarray, "*batch 3"]:
        """(..., 3) (alpha, beta, gamma) [rad] with R = Rz(gamma) Ry(beta) Rx(alpha), the paper's convention."""
        return euler_of_matrices(self.rotations)

    @property
    def tilt(self) -> Float[np.ndarray, "*batch"]:
        """(...) the angle [rad] between the platform's z axis and the vertical."""
        return tilt_of_matrices(self.rotations)

    @property
    def deviation(self) -> Float[np.ndarray, "*batch 3"]:
        """(..., 3) position minus commanded position [m]."""
        return self.positions - self.problems.positions

    @property
    def pulls(self) -> Float[np.ndarray, "*batch cables"]:
        """Forces with which the cables pull on the platform, (..., cables) [N]: tensions times parts of line."""
        return self.robot.cabling.pulls(self.tensions)

    @property
    def slack(self) -> Bool[np.ndarray, "*batch cables"]:
        """(..., cables) which cables are slack, as ``Equilibrium.slack``."""
        return slack_cables(self.problems, self.lengths, self.tensions)

    @cached_property
    def eigenvalues(self) -> Float[np.ndarray, "*batch free"]:
        """(..., free) eigenvalues of the stiffness matrix on the free directions, ascending [N/m]."""
        return self.stiffness(self) if callable(self.stiffness) else self.stiffness

    @property
    def stability(self) -> np.ndarray:
        """(...) a ``Stability`` each."""
        rows = self.eigenvalues.reshape(-1, self.eigenvalues.shape[-1])
        kinds = np.empty(len(rows), dtype=object)
        kinds[:] = [stability_of(row) for row in rows]
        return kinds.reshape(self.eigenvalues.shape[:-1])

    @property
    def stable(self) -> Bool[np.ndarray, "*batch"]:
        """(...) whether the stiffness matrix is positive definite on the free directions."""
        return self.stability == Stability.STABLE

    def __repr__(self) -> str:
        done = int(self.converged.sum())
        return f"<{type(self).__name__} of {self.robot.name!r} by {self.source}: {self.shape}, {done} in equilibrium>"


def all_solved(equilibria: EquilibriumBatch) -> EquilibriumBatch:
    """The same equilibria.

    Raises:
        NotConverged, NotSettled: some row has no equilibrium.
    """
    for row in np.flatnonzero(~equilibria.converged):
        equilibria[int(row)]  # raises, with the reason
    return equilibria


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumPath(EquilibriumBatch):
    """Equilibria along a path, (steps, ...): a batch whose rows follow one another; further dimensions are paths.

    Attributes:
        times: time of each step, (steps,) [s].
        memory: the memory at the end, with which ``solve_path`` and ``settle_path`` can continue.
    """

    times: Float[np.ndarray, " steps"]
    memory: Memory
