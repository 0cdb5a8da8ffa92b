"""Distances between cables, platform and frame, against closed forms, and MuJoCo's own geometry."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import dataclasses
import itertools

import mujoco
import numpy as np
import oracle
import pytest
from sample_problems import garage_crane
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.clearance import frame_edges

WITNESS = 1e-9
"""[m] MuJoCo's distances and ours were measured to differ by 2e-16 on DemoBot and 2e-15 on a crane."""

RADIUS, FAR = 1e-6, 1e3
"""[m] Of the capsules that represent centre lines, which is subtracted; largest distance that MuJoCo computes."""

WHEELS = {"pulley_radius": 0.01, "pulley_axis": (0, 0, 1)}


def in_mujoco(found: cdpr.Clearances, row: int) -> list[np.ndarray]:
    """One row of ``cable_cable``, ``cable_platform`` and ``cable_frame`` by MuJoCo's ``mj_geomDistance`` [m].

    Each segment of a cable and each edge of the frame is a capsule; the platform is a box.
    """
    equilibria, robot, spec = found.equilibria, found.equilibria.robot, mujoco.MjSpec()
    spec.option.ccd_tolerance, spec.option.ccd_iterations = 1e-14, 1000
    counted = itertools.count()

    def geom(kind: mujoco.mjtGeom, **given) -> int:
        spec.worldbody.add_geom(type=kind, contype=0, conaffinity=0, **given)
        return next(counted)

    def capsule(start: np.ndarray, end: np.ndarray) -> int:
        return geom(mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[RADIUS, 0, 0])

    pieces = [[capsule(a, b) for a, b in itertools.pairwise(curve)] for curve in found.curves[row]]
    edges = [capsule(a, b) for a, b in frame_edges(robot)]
    turned = Rotation.from_matrix(equilibria.rotations[row]).as_quat(scalar_first=True)
    at = dict(pos=equilibria.positions[row], quat=turned)
    platform = geom(mujoco.mjtGeom.mjGEOM_BOX, size=robot.platform_size / 2, **at)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def distance(some: list[int], others: list[int], radii: float) -> float:
        apart = min(mujoco.mj_geomDistance(model, data, a, b, FAR, None) for a in some for b in others)
        return max(apart + radii, 0.0)

    return [
        np.array([distance(pieces[a], pieces[b], 2 * RADIUS) for a, b in found.pairs]),
        np.array([distance(one, [platform], RADIUS) for one in pieces]),
        np.array([distance(one, edges, 2 * RADIUS) for one in pieces]),
    ]


@pytest.mark.parametrize(
    ("robot", "curved"),
    [
        (cdpr.load_robot("cogiro"), False),
        (cdpr.load_robot("parallel"), True),  # slack
        (garage_crane(linear_density=0.5), True),
        (cdpr.load_robot("cogiro").replace(**WHEELS), False),
    ],
    ids=["taut", "slack", "heavy", "pulleys"],
)
def test_mujocos_own_distances_are_the_same(robot, curved):
    """Capsules and a box in MuJoCo, where all of it rests; moving one of its capsules by a micrometre is noticed."""
    found = cdpr.clearances(robot, np.random.default_rng(3).uniform(*robot.workspace, (3, 3)), points=7)
    assert (found.curves.shape[-2] == 7) == curved
    for row in range(3):
        ours = found.cable_cable[row], found.cable_platform[row], found.cable_frame[row]
        for mine, theirs in zip(ours, in_mujoco(found, row), strict=True):
            assert mine == pytest.approx(theirs, abs=WITNESS)
    moved = found.curves.copy()
    moved[0, 0] += 1e-6
    off = in_mujoco(dataclasses.replace(found, curves=moved), 0)[0]
    assert np.abs(off - found.cable_cable[0]).max() > 100 * WITNESS


def test_cables_run_where_they_hang_and_over_their_wheels():
    """Without fittings: the curves of ``cable_profiles``, and the oracle's free pieces, wheel to anchor."""
    for robot, pose in (
        (garage_crane(linear_density=0.5), (-0.5, 0.3, 1.0)),
        (cdpr.load_robot("parallel"), (0.17, 0.25, 0.1)),
    ):
        found = cdpr.clearances(robot, [pose], fitting=0.0)
        assert found.curves == pytest.approx(cdpr.cable_profiles(found.equilibria), abs=1e-9)
    wheels = cdpr.load_robot("cogiro").replace(**WHEELS)
    over = cdpr.clearances(wheels, [(0.3, 0.2, 0.1)], fitting=0.0)
    one, rig = over.equilibria[0], oracle.Rig.of(wheels)
    _, s, u = oracle.over_wheel(rig, one.position + wheels.anchors @ one.rotation_matrix.T - wheels.exits)
    pieces = over.curves[0, :, -1, :] - over.curves[0, :, 0, :]
    assert pieces == pytest.approx(u * s[:, None], abs=1e-12)


def test_where_nothing_rests_nothing_is_said():
    """Nan, and not free."""
    found = cdpr.clearances(cdpr.load_robot("cogiro"), [(0.4, 0.25, 0.2), (0.4, 0.25, 2.0)])
    assert np.isnan(found.least).tolist() == [False, True]
    assert found.free().tolist() == [True, False]
