"""Ropes with a memory as data: robot files, and paths in small steps."""

import numpy as np
import pytest
from test_refusals_motion import with_memory

import cdpr_sim as cdpr
from cdpr_sim.core.describe import describe_properties
from cdpr_sim.robots.robot_file_text import as_toml

ELEMENTS = [(0.1, 1e-3), (0.1, np.inf, 0.2)]
CABLE_BY_CABLE = {"hysteresis": [ELEMENTS, *[[]] * 6, ELEMENTS[:1]], "creep": [*[[]] * 7, [(4e4, 1.0), (1e4, 2.0)]]}


@pytest.mark.parametrize(
    "changes", [{}, CABLE_BY_CABLE, {"hysteresis": (), "creep": (), "pulley_friction": np.arange(8) / 100}]
)
def test_a_robot_file_has_the_same_memory(tmp_path, changes):
    """To the last bit; the file of a robot without memory has none of its keys."""
    robot = with_memory(**changes)
    (tmp_path / "robot.toml").write_text(as_toml(robot))
    read = cdpr.load_robot(tmp_path / "robot.toml")
    assert read.cabling.same_as(robot.cabling)
    assert describe_properties(read) == describe_properties(robot) != ()
    plain = as_toml(cdpr.load_robot("cogiro"))
    assert not any(name in plain for name in ("pulley_friction", "hysteresis", "creep"))


def test_small_steps_go_along_the_commanded_poses():
    """Four steps between two commands are those of a path with the poses between them, in a quarter of the time."""
    random, robot = np.random.default_rng(0), with_memory()
    poses = random.uniform([0.2, 0.2, 0.1, 0, 0, 0], [0.6, 0.3, 0.12, 0, 0.1, 0], (4, 6))
    times, fine = np.array([0.0, 100.0, 300.0, 300.0]), np.arange(13) / 4
    steps = cdpr.solve_path(robot, poses, times=times, steps=4)
    between = np.stack([np.interp(fine, np.arange(4), column) for column in poses.T], axis=1)
    path = cdpr.solve_path(robot, between, times=np.interp(fine, np.arange(4), times))
    np.testing.assert_allclose(steps.tensions, path.tensions[::4], rtol=0, atol=1e-7)
    np.testing.assert_allclose(steps.memory.strains, path.memory.strains, rtol=0, atol=1e-10)
    at_once = cdpr.solve_path(robot, poses, times=times)
    assert np.abs(at_once.tensions - steps.tensions).max() > 1e-5
