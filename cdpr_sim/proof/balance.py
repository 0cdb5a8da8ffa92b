"""The balance of forces on the platform about a pose, in balls: zero at an equilibrium, with its derivatives.

The pose has the coordinates x: the translation p of the platform's origin, and a rotation by the quaternion q₀ + E δ
divided by its norm, so that R is a rotation for every δ. Only the directions in which the platform can move are
unknowns. With the weight m g at c, an external force f and torque t, cable forces Fᵢ on the anchors bᵢ, and the angular
velocities ω_k of δ_k, the balance along the coordinate k is

    −Σ Fᵢ·∂bᵢ/∂x_k + m g ∂c_z/∂x_k − f·∂p/∂x_k − t·ω_k = 0,

without t the slope of the energy. Each cable with mass adds three unknowns with their own equations (``cables``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.balls import Ball, balls, dot, exact, matrix, middle
from cdpr_sim.proof.cables import Cable, Pull

PLANE = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
"""Quaternions (w, x, y, z) of rotations about y."""


@dataclass(frozen=True)
class At:
    """The balance at a point, or over a box.

    Attributes:
        forces: the left sides of all equations, (unknowns,).
        slope: their derivatives, (unknowns, unknowns); over a box, an enclosure of all of them.
        pulls: pull of each cable.
        rotation: R, (3, 3).
    """

    forces: list[Ball]
    slope: list[list[Ball]]
    pulls: list[Pull]
    rotation: list[list[Ball]]


class Balance:
    """The equations of a problem about a pose. The first ``free`` unknowns are the pose's, all in metres.

    Attributes:
        free: number of coordinates of the pose.
        unknowns: total number of unknowns.
        cables: cables of the problem.
    """

    def __init__(self, problem: Problem, about: Pose, cables: Sequence[Cable] = ()) -> None:
        robot = problem.robot
        self.cables = cables or cables_of(problem)
        self.with_mass = [index for index, cable in enumerate(self.cables) if cable.has_mass]
        self.axes = [axis for axis in robot.free if axis < 3]
        self.origin = balls(about.position)
        w = np.roll(Rotation.from_matrix(about.rotation_matrix).as_quat(), 1)
        if robot.mobility == "planar":
            w = w @ PLANE.T
            tangents = np.array([[-w[1], w[0]]]) @ PLANE
            w = w @ PLANE
        else:
            tangents = np.linalg.svd(w[None])[2][1:]
        tangents = tangents / (2 * robot.characteristic_length)  # a rotation by 1 rad is one characteristic length
        self.quaternion, self.tangents = balls(w), [balls(row) for row in tangents]
        self.free = len(self.axes) + len(self.tangents)
        self.unknowns = self.free + 3 * len(self.with_mass)
        self.weight = exact(robot.mass) * exact(robot.gravity)
        self.center_of_mass = balls(robot.center_of_mass)
        self.force, self.torque = balls(problem.external_wrench[:3]), balls(problem.external_wrench[3:])
        self.twisted = bool(problem.external_wrench[3:].any())
        turn = about.rotation_matrix
        starts = [
            part
            for index in self.with_mass
            for part in self.cables[index].tension_near(about.position + turn @ robot.anchors[index])
        ]
        self.start = [*balls([*about.position[self.axes], *[0.0] * len(self.tangents)]), *starts]

    def position(self, x: Sequence[Ball]) -> list[Ball]:
        """p, (3,) [m]."""
        p = list(self.origin)
        for unknown, axis in enumerate(self.axes):
            p[axis] = x[unknown]
        return p

    def rotation(self, x: Sequence[Ball]) -> list[list[Ball]]:
        """R, (3, 3)."""
        return self._turned(x)[0]

    def at(self, x: Sequence[Ball], taken_as: dict[int, bool] | None = None) -> At:
        """The balance at x, a point or a box.

        Args:
            x: (unknowns,), the pose's in metres.
            taken_as: taut or slack, for cables whose length may be more or less than their rest length.
        """
        n, translations, taken_as = self.free, len(self.axes), taken_as or {}
        zero, one = exact(0), exact(1)
        p = self.position(x)
        R, R_k, R_kl, spins, spin_slopes = self._turned(x)
        forces = [zero] * self.unknowns
        slope = [[zero] * self.unknowns for _ in range(self.unknowns)]
        pulls, turns = [], range(len(self.tangents))

        total = list(self.force)  # Σ F
        total[2] -= self.weight
        moment = [[zero] * 3, [zero] * 3, [-self.weight * part for part in self.center_of_mass]]  # Σ F bᵀ
        for k in turns if self.twisted else ():
            forces[translations + k] -= dot(self.torque, spins[k])
            for m in turns:
                slope[translations + k][translations + m] -= dot(self.torque, spin_slopes[k][m])
        for index, cable in enumerate(self.cables):
            anchor = [p[i] + dot(R[i], cable.anchor) for i in range(3)]
            first = n + 3 * self.with_mass.index(index) if cable.has_mass else None
            pull = cable.pull(anchor, None if first is None else x[first : first + 3], taken_as.get(index))
            pulls.append(pull)
            if pull.taut is False and first is None:
                continue
            for i in range(3):
                total[i] += pull.force[i]
                moment[i] = [entry + pull.force[i] * part for entry, part in zip(moment[i], cable.anchor, strict=True)]
            columns = [[one if i == axis else zero for i in range(3)] for axis in self.axes]
            columns += [[dot(R_k[k][i], cable.anchor) for i in range(3)] for k in turns]
            if first is not None:
                for i in range(3):
                    forces[first + i] = pull.gap[i]
                    slope[first + i][first : first + 3] = pull.compliance[i]
                    for k in range(n):
                        slope[k][first + i] = columns[k][i]
                        slope[first + i][k] = -columns[k][i]
                continue
            D = matrix(columns)  # a row for each coordinate
            stiffness = (D * matrix(pull.slope) * D.transpose()).tolist()
            for k in range(n):
                for m in range(n):
                    slope[k][m] -= stiffness[k][m]
        for unknown, axis in enumerate(self.axes):
            forces[unknown] -= total[axis]
        moments = _flat(moment)
        for k in turns:
            forces[translations + k] -= dot(_flat(R_k[k]), moments)
            for m in turns:
                slope[translations + k][translations + m] -= dot(_flat(R_kl[k][m]), moments)
        return At(forces, slope, pulls, R)

    def _turned(self, x: Sequence[Ball]) -> tuple:
        """R, its first and second derivatives by δ, the angular velocities of each δ_k, and their derivatives."""
        turns = range(len(self.tangents))
        deltas = x[len(self.axes) : self.free]
        q = [self.quaternion[a] + dot([tangent[a] for tangent in self.tangents], deltas) for a in range(4)]
        E = self.tangents
        n, n_k = dot(q, q), [2 * dot(q, E[k]) for k in turns]
        n_kl = [[2 * dot(E[k], E[m]) for m in turns] for k in turns]
        R = _over(_product(q, q), n)
        R_k = [_over(_less(_scaled(_product(q, E[k]), 2), _scaled(R, n_k[k])), n) for k in turns]
        R_kl = [[[] for _ in turns] for _ in turns]
        for k in turns:
            for m in range(k + 1):
                bend = _less(_scaled(_product(E[k], E[m]), 2), _scaled(R_k[k], n_k[m]))
                bend = _less(_less(bend, _scaled(R_k[m], n_k[k])), _scaled(R, n_kl[k][m]))
                R_kl[k][m] = R_kl[m][k] = _over(bend, n)
        if not self.twisted:
            return R, R_k, R_kl, [], []
        spins = [[2 * part / n for part in _turning(E[k], q)] for k in turns]
        slopes = [
            [
                [(2 * bend - spin * n_k[m]) / n for bend, spin in zip(_turning(E[k], E[m]), spins[k], strict=True)]
                for m in turns
            ]
            for k in turns
        ]
        return R, R_k, R_kl, spins, slopes


def cables_of(problem: Problem) -> list[Cable]:
    """The cables of a problem, which all its balances can share."""
    return [Cable(problem, index) for index in range(problem.robot.cables)]


def _product(a: Sequence[Ball], b: Sequence[Ball]) -> list[list[Ball]]:
    """The symmetric bilinear form of quaternions (w, x, y, z) whose square, over |q|², is the rotation of q."""
    (w, x, y, z), (W, X, Y, Z) = a, b
    wx, wy, wz = (w * X + x * W), (w * Y + y * W), (w * Z + z * W)
    xy, xz, yz = (x * Y + y * X), (x * Z + z * X), (y * Z + z * Y)
    ww, xx, yy, zz = w * W, x * X, y * Y, z * Z
    return [
        [ww + xx - yy - zz, xy - wz, xz + wy],
        [xy + wz, ww - xx + yy - zz, yz - wx],
        [xz - wy, yz + wx, ww - xx - yy + zz],
    ]


def _turning(rate: Sequence[Ball], q: Sequence[Ball]) -> list[Ball]:
    """The vector part of q̇ q*, half of |q|² ω."""
    (w, x, y, z), (W, X, Y, Z) = rate, q
    return [W * x - w * X - (y * Z - z * Y), W * y - w * Y - (z * X - x * Z), W * z - w * Z - (x * Y - y * X)]


def _flat(rows: list[list[Ball]]) -> list[Ball]:
    return [entry for row in rows for entry in row]


def _scaled(rows: list[list[Ball]], by: Ball | int) -> list[list[Ball]]:
    return [[entry * by for entry in row] for row in rows]


def _over(rows: list[list[Ball]], by: Ball) -> list[list[Ball]]:
    return [[entry / by for entry in row] for row in rows]


def _less(one: list[list[Ball]], other: list[list[Ball]]) -> list[list[Ball]]:
    return [[a - b for a, b in zip(*rows, strict=True)] for rows in zip(one, other, strict=True)]


def middles(rows: Sequence[Sequence[Ball]]) -> np.ndarray:
    """Midpoints as doubles."""
    return np.array([[middle(entry) for entry in row] for row in rows])
