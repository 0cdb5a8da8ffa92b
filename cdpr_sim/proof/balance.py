"""The balance of forces on the platform about a pose, in balls: zero at an equilibrium, with its derivatives.

The pose has the coordinates x: the translation p of the platform's origin, and a rotation by the quaternion q₀ + E δ
divided by its norm, so that R is a rotation for every δ. Only the directions in which the platform can move are
unknowns. With the weight m g at c, an external force f and torque t, cable forces Fᵢ at the arms uᵢ = R bᵢ of the
anchors, and the angular velocities ω_k of δ_k, the balances along the coordinates p_k and δ_k are

    −(Σ Fᵢ + f)_k + m g ∂p_z/∂p_k = 0,   −ω_k·(Σ uᵢ × Fᵢ − m g R c × e_z + t) = 0,

without t the slope of the energy. Each cable with mass adds three unknowns with their own equations (``cables``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.balls import Balls, exact, zeros
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

    forces: Balls
    slope: Balls
    pulls: list[Pull]
    rotation: Balls


class Balance:
    """The equations of a problem about a pose. The first ``free`` unknowns are the pose's, all in metres.

    Attributes:
        problem: the problem.
        free: number of coordinates of the pose.
        unknowns: total number of unknowns.
        cables: cables of the problem.
    """

    def __init__(self, problem: Problem, about: Pose, cables: list[Cable] | None = None) -> None:
        robot = problem.robot
        self.problem, self.cables = problem, cables or [Cable(problem, index) for index in range(robot.cables)]
        self.with_mass = [index for index, cable in enumerate(self.cables) if cable.has_mass]
        self.axes = [axis for axis in robot.free if axis < 3]
        self.origin = exact(about.position)
        w = np.roll(Rotation.from_matrix(about.rotation_matrix).as_quat(), 1)
        if robot.mobility == "planar":
            w = w @ PLANE.T
            tangents = np.array([[-w[1], w[0]]]) @ PLANE
            w = w @ PLANE
        else:
            tangents = np.linalg.svd(w[None])[2][1:]
        tangents = tangents / (2 * robot.characteristic_length)  # a rotation by 1 rad is one characteristic length
        self.quaternion, self.tangents = exact(w), exact(tangents)
        self.shifts = exact(np.eye(3)[self.axes])  # ∂p/∂x
        self.turnings = 2 * np.array([self.tangents @ _turning(tangent) for tangent in self.tangents])
        self.free = len(self.axes) + len(tangents)
        self.unknowns = self.free + 3 * len(self.with_mass)
        self.weight = np.array([exact(0), exact(0), -exact(robot.mass) * exact(robot.gravity)])
        self.center_of_mass = exact(robot.center_of_mass)
        self.force, self.torque = exact(problem.external_wrench[:3]), exact(problem.external_wrench[3:])
        anchors = about.position + robot.anchors @ about.rotation_matrix.T
        starts = [self.cables[index].tension_near(anchors[index]) for index in self.with_mass]
        self.start = np.concatenate([self.origin[self.axes], zeros(len(tangents)), *starts])

    def position(self, x: Balls) -> Balls:
        """p, (3,) [m]."""
        p = self.origin.copy()
        p[self.axes] = x[: len(self.axes)]
        return p

    def quaternion_at(self, x: Balls) -> Balls:
        """q₀ + E δ, (4,)."""
        return self.quaternion + x[len(self.axes) : self.free] @ self.tangents

    def at(self, x: Balls, taken_as: dict[int, bool] | None = None) -> At:
        """The balance at x, a point or a box.

        Args:
            x: (unknowns,), the pose's in metres.
            taken_as: stretched or not, for cables whose length may be more or less than their rest length.
        """
        n, turns, taken_as = self.free, slice(len(self.axes), self.free), taken_as or {}
        q, p, E = self.quaternion_at(x), self.position(x), self.tangents
        size, R = q @ q, _rotation(q)
        spins = 2 * (E @ _turning(q)) / size  # ω_k
        spin_slopes = (self.turnings - 2 * (E @ q)[:, None, None] * spins) / size  # by δ_m, for each m
        forces, slope = zeros(self.unknowns), zeros(self.unknowns, self.unknowns)
        arm, pulled = R @ self.center_of_mass, _cross(self.weight)
        total, twist, turning = self.force + self.weight, self.torque + arm @ pulled, pulled @ _cross(arm)
        pulls, first = [], n
        for index, cable in enumerate(self.cables):
            arm, own = R @ cable.anchor, slice(first, first + 3) if cable.has_mass else None
            pull = cable.pull(p + arm, None if own is None else x[own], taken_as.get(index))
            pulls.append(pull)
            if pull.stretched is False and own is None:
                continue
            turned, pulled = _cross(arm), _cross(pull.force)
            total, twist = total + pull.force, twist + arm @ pulled  # Σ F, Σ u × F
            turning = turning + pulled @ turned  # (ω × u) × F is ω @ this matrix's transpose
            D = np.concatenate([self.shifts, spins @ turned])  # ∂b/∂x, a row for each coordinate
            if own is None:
                slope[:n, :n] -= D @ pull.slope @ D.T
            else:
                forces[own], slope[own, own] = pull.gap, pull.compliance
                slope[:n, own], slope[own, :n] = D, -D.T
                first += 3
        forces[: turns.start], forces[turns] = -total[self.axes], -spins @ twist
        slope[turns, turns] -= (spin_slopes @ twist).T + spins @ turning @ spins.T
        return At(forces, slope, pulls, R)


def _rotation(q: Balls) -> Balls:
    """The rotation of a quaternion (w, x, y, z) of any length, (3, 3)."""
    w, x, y, z = q
    ww, xx, yy, zz = q * q
    rows = [
        [ww + xx - yy - zz, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), ww - xx + yy - zz, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), ww - xx - yy + zz],
    ]
    return np.array(rows) / (q @ q)


def _turning(q: Balls) -> Balls:
    """The matrix (4, 3) of the vector part of q̇ q*, half of |q|² ω, by q̇."""
    w, x, y, z = q
    return np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])


def _cross(a: Balls) -> Balls:
    """The matrix (3, 3) by which r × a = r @ matrix."""
    x, y, z = a
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
