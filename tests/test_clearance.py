"""Distances between cables, platform and frame, against brute force, closed forms, and MuJoCo's own geometry."""

import numpy as np
import pytest
from mujoco_clearances import clearances_in_mujoco
from scipy.optimize import minimize_scalar

import cdpr_sim as cdpr
from cdpr_sim.analysis.clearance import clearances, segment_box, segment_segment
from cdpr_sim.statics.forces import geometry
from cdpr_sim.studies.real_cables import crane

WITNESS = 1e-9
"""[m] MuJoCo's distances and ours were measured to differ by 2e-16 on DemoBot and 2e-15 on the crane."""


def test_segments_are_as_far_apart_as_a_search_over_both_finds():
    """Against a search along one of the nearest point of the other; crossing, parallel and touching ones included."""
    rng = np.random.default_rng(1)
    a, b, c, d = rng.normal(size=(4, 60, 3))
    b[:10], d[:10] = a[:10] + 1, c[:10] + 1  # parallel
    c[10:20] = a[10:20] + 0.3 * (b - a)[10:20]  # touching

    def searched(i: int) -> float:
        def to_other(s: float) -> float:
            at = a[i] + s * (b - a)[i]
            t = np.clip((at - c[i]) @ (d - c)[i] / ((d - c)[i] @ (d - c)[i]), 0, 1)
            return float(np.linalg.norm(at - c[i] - t * (d - c)[i]))

        found = minimize_scalar(to_other, bounds=(0, 1), method="bounded", options={"xatol": 1e-12})
        return min(float(found.fun), to_other(0), to_other(1))

    assert segment_segment(a, b, c, d) == pytest.approx([searched(i) for i in range(60)], abs=1e-8)


def test_distance_to_a_box_is_that_of_the_nearest_point():
    """Against a fine walk along the segment; 0 where it passes through."""
    rng = np.random.default_rng(2)
    half = np.array([0.5, 0.2, 0.3])
    a, b = rng.normal(size=(2, 100, 3))
    walk = a[:, None] + np.linspace(0, 1, 4001)[:, None] * (b - a)[:, None]
    walked = np.linalg.norm(walk - np.clip(walk, -half, half), axis=-1).min(1)
    found = segment_box(a, b, half)
    assert (found <= walked + 1e-15).all()
    assert found == pytest.approx(walked, abs=1e-3)  # half a step of the walk
    assert (found == 0).any()


def test_two_cables_that_cross_are_as_far_apart_as_they_were_laid():
    """One along x at y = 0, one along y 30 mm above it: 30 mm, whatever the platform does."""
    robot = cdpr.Robot(
        exits=[(-1, 0, 1), (1, 0, 1), (0, -1, 1), (0, 1, 1)],
        anchors=[(-0.1, 0, 0), (0.1, 0, 0), (0, -0.1, 0.03), (0, 0.1, 0.03)],
        axial_stiffness=1e9, mass=1.0, platform_size=(0.2, 0.2, 0.06), name="cross",
    )  # fmt: skip
    found = cdpr.clearances(robot, [(0, 0, 0)], fitting=0.0)
    assert found.cable_cable.shape == (1, 6)
    # From the one's anchor (-0.1, 0, 0) to the other's (0, -0.1, 0.03): both lead away from one another.
    assert found.cable_cable[0, 1] == pytest.approx(np.hypot(np.hypot(0.1, 0.1), 0.03), abs=1e-8)
    assert found.least[0] == 0  # each begins on the platform
    assert "platform" in found.nearest(0)


@pytest.mark.parametrize("kind", ["taut", "slack", "heavy", "pulleys"])
def test_mujocos_own_distances_are_the_same(kind: str):
    """Capsules and a box in MuJoCo, where all of it rests; moving one of its capsules by a micrometre is noticed."""
    robot = {
        "taut": cdpr.load_robot("cogiro"),
        "slack": cdpr.load_robot("parallel"),
        "heavy": crane().replace(linear_density=0.5),
        "pulleys": cdpr.load_robot("cogiro").replace(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    }[kind]
    poses = np.random.default_rng(3).uniform(*robot.workspace, (3, 3))
    found = clearances(robot, poses, points=7)
    assert (kind in ("slack", "heavy")) == (found.curves.shape[-2] == 7)
    for row in range(3):
        ours = found.cable_cable[row], found.cable_platform[row], found.cable_frame[row]
        for mine, theirs in zip(ours, clearances_in_mujoco(found, row), strict=True):
            assert mine == pytest.approx(np.maximum(theirs, 0), abs=WITNESS)
    moved = found.curves.copy()
    moved[0, 0] += 1e-6
    off = cdpr.Clearances(
        found.equilibria, found.fitting, moved, found.cable_cable, found.cable_platform, found.cable_frame
    )
    cables, _, _ = clearances_in_mujoco(off, 0)
    assert np.abs(cables - found.cable_cable[0]).max() > 100 * WITNESS


def test_cables_run_where_they_hang_and_over_their_wheels():
    """Without fittings: the curves of ``cable_profiles``, and the free pieces that statics knows, wheel to anchor."""
    heavy = cdpr.clearances(crane().replace(linear_density=0.5), [(-2.0, 1.0, 2.0)], fitting=0.0)
    assert heavy.curves == pytest.approx(cdpr.cable_profiles(heavy.equilibria), abs=1e-12)
    slack = cdpr.clearances(cdpr.load_robot("parallel"), [(0.17, 0.25, 0.1)], fitting=0.0)
    assert slack.curves == pytest.approx(cdpr.cable_profiles(slack.equilibria), abs=1e-9)
    wheels = cdpr.load_robot("cogiro").replace(pulley_radius=0.01, pulley_axis=(0, 0, 1))
    over = cdpr.clearances(wheels, [(0.3, 0.2, 0.1)], fitting=0.0)
    known = geometry(wheels, over.equilibria.positions, over.equilibria.rotations)
    pieces = over.curves[..., 0, :] - over.curves[..., -1, :]
    assert pieces == pytest.approx(known.directions * known.free_lengths[..., None], abs=1e-12)


def test_where_nothing_rests_nothing_is_said():
    """Nan, and not free."""
    found = cdpr.clearances(cdpr.load_robot("cogiro"), [(0.4, 0.25, 0.2), (0.4, 0.25, 2.0)])
    assert np.isnan(found.least).tolist() == [False, True]
    assert found.free().tolist() == [True, False]
    with pytest.raises(cdpr.InvalidInput, match="fitting: found -1 m"):
        cdpr.clearances(cdpr.load_robot("cogiro"), [(0.4, 0.25, 0.2)], fitting=-1)
