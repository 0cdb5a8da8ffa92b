"""Independent computation of clearances: MuJoCo's distances between capsules and boxes, at the same equilibria."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import itertools

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cdpr_sim.analysis.clearance import Clearances, frame_edges
from cdpr_sim.core.robot import Robot

RADIUS = 1e-6
"""[m] Radius of the capsules that represent centre lines; it is subtracted from the distances."""

FAR = 1e3
"""[m] Largest distance that MuJoCo computes."""


def clearances_in_mujoco(
    clearances: Clearances, row: tuple[int, ...] | int
) -> tuple[Float[np.ndarray, " pairs"], Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """One row of ``cable_cable``, ``cable_platform`` and ``cable_frame`` by MuJoCo's ``mj_geomDistance`` [m].

    Each segment of a cable and each edge of the frame is a capsule; the platform is a box.
    """
    robot, equilibria = clearances.equilibria.robot, clearances.equilibria
    model, data, pieces, edges, platform = _model(
        robot, clearances.curves[row], equilibria.positions[row], equilibria.rotations[row]
    )

    def distance(one: list[int], other: list[int], radii: float) -> float:
        return min(mujoco.mj_geomDistance(model, data, a, b, FAR, None) for a in one for b in other) + radii

    cables = np.array([distance(pieces[a], pieces[b], 2 * RADIUS) for a, b in clearances.pairs])
    box = np.array([distance(one, [platform], RADIUS) for one in pieces])
    frame = np.array([distance(one, edges, 2 * RADIUS) for one in pieces])
    return cables, box, frame


def _model(robot: Robot, curves: np.ndarray, position: np.ndarray, rotation: np.ndarray):
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-14, 1000
    count = 0

    def capsule(start: np.ndarray, end: np.ndarray) -> int:
        nonlocal count
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[RADIUS, 0, 0], contype=0, conaffinity=0
        )
        count += 1
        return count - 1

    pieces = [[capsule(a, b) for a, b in itertools.pairwise(curve)] for curve in curves]
    edges = [capsule(a, b) for a, b in frame_edges(robot)]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=robot.platform_size / 2, pos=position,
        quat=Rotation.from_matrix(rotation).as_quat(scalar_first=True), contype=0, conaffinity=0,
    )  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data, pieces, edges, count
