"""Machines that people own: the figure against closed forms, the Hangprinter against its firmware's springs."""

import numpy as np
import pytest

import cdpr_sim as cdpr
import machines

ANCHORS = np.array(
    [[0, -1.61098, -0.13153], [1.31422, 1.26814, -0.12128], [-1.41573, 0.70761, -0.12182], [0, 1e-5, 2.29983]]
)
"""[m] From the mover's points: M669 of its ``config.g``."""

PARTS, SPRING = np.array([2, 2, 2, 4]), 20e3
"""M666 U, and S [N]."""

PLUMB = cdpr.Robot(
    exits=[[0, 0, 1]], anchors=[[0, 0, 0]], axial_stiffness=1e3, mass=2.0, reeving=3, platform_size=(0.1, 0.1, 0.1)
)
"""Three parts of line above one another."""


def test_the_hangprinter_is_as_stiff_against_moves_as_its_firmware_counts():
    """Each direction a spring of U² S/(U d + g), g the line to the spools at D; within the rounding of its file."""
    directions = ANCHORS / np.linalg.norm(ANCHORS, axis=1)[:, None]
    behind = np.linalg.norm(ANCHORS - ANCHORS[3], axis=1)
    springs = PARTS**2 * SPRING / (PARTS * np.linalg.norm(ANCHORS, axis=1) + behind)
    expected = np.einsum("i,ij,ik->jk", springs, directions, directions)
    robot = cdpr.load_robot("hangprinter-4")
    chords = robot.exits - robot.anchors
    lengths = np.linalg.norm(chords, axis=1)
    ours = robot.reeving**2 * robot.axial_stiffness / (robot.reeving * lengths + robot.winch_to_exit)
    found = np.einsum("i,ij,ik->jk", ours, chords / lengths[:, None], chords / lengths[:, None])
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-3 * expected.max())


def test_frame_flex_lowers_a_plumb_load_by_its_force(monkeypatch):
    """By F (1/(n EA/l) + c), whatever the number of parts of line; a rigid frame by the first term."""
    monkeypatch.setattr(cdpr, "load_robot", lambda _: PLUMB)
    machine, force, place = machines.MACHINES[0], np.array([0, 0, -1.5]), np.zeros((1, 3))
    softness = 1 / (3 * 1e3)  # l/(n EA) of three parts of 1 m each
    for flex in machines.FRAMES:
        moved = machines._moved(machine.robot(0.0, flex), place, force)
        assert moved == pytest.approx(1.5 * (softness + flex), rel=1e-9)


def test_tightness_is_the_derivative_of_the_tension():
    """The largest of the diagonal of ``sensitivity``, up to the curvature over a millimetre."""
    robot = machines.MACHINES[0].robot(150, 0.0)
    place = np.array([[1.2, 0, 1.1]])
    derivative = -np.diag(cdpr.sensitivity(cdpr.solve(robot, place[0])).tensions["rest_lengths"])
    assert machines._tightness(robot, place) == pytest.approx(derivative.max(), rel=1e-3)


def test_poses_that_no_tensions_hold_are_left_out():
    """Above the corners of its frame the Maslow's belts all pull down."""
    robot = machines.MACHINES[0].robot(150, 0.0)
    moved = machines._moved(robot, np.array([[1.5, 0, 3.0], [1.5, 0, 1.0]]), np.array([0, 0, -1.0]))
    assert np.isnan(moved).tolist() == [True, False]


def test_the_figures_answers_agree_between_methods():
    """At the place of the curves; with frame flex the sled moves 0.728/0.349 as far, as the page says."""
    found = machines.answers(machines.MACHINES[0], each=3, tensions=3)
    assert found.settled == pytest.approx(found.curves, abs=1e-9, nan_ok=True)
    assert found.moved.shape == (2, *found.tightness.shape)
    assert found.curves[1, 1] / found.curves[0, 1] == pytest.approx(0.728 / 0.349, rel=0.01)
    assert len(machines.answers_table(found).rows) == 3
