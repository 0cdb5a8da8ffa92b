"""Ropes with a memory: friction at the exit, hysteresis and creep as data."""

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.describe import describe_properties
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.path_problem import PathProblem
from cdpr_sim.robots.robot_file_text import as_toml

ELEMENTS = [(0.1, 1e-3), (0.1, np.inf, 0.2)]
LINE = np.linspace([0.2, 0.25, 0.1], [0.6, 0.25, 0.1], 5)


def with_memory(**changes) -> cdpr.Robot:
    """DemoBot with every kind of memory on all cables."""
    kinds = dict(pulley_friction=0.02, hysteresis=ELEMENTS, creep=[(4e4, 600.0)])
    return cdpr.load_robot("cogiro").replace(**(kinds | changes))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hysteresis": [ELEMENTS, *[[]] * 6, ELEMENTS[:1]], "creep": [*[[]] * 7, [(4e4, 1.0), (1e4, 2.0)]]},
        {"hysteresis": (), "creep": (), "pulley_friction": np.arange(8) / 100},
    ],
)
def test_a_robot_file_has_the_same_memory(tmp_path, changes):
    """Written and read again, elements, terms and friction are the same to the last bit, also cable by cable."""
    robot = with_memory(**changes)
    (tmp_path / "robot.toml").write_text(as_toml(robot))
    read = cdpr.load_robot(tmp_path / "robot.toml")
    assert read.cabling.same_as(robot.cabling)
    assert describe_properties(read) == describe_properties(robot) != ()


def test_a_robot_without_memory_is_written_and_described_as_before():
    """None of the new keys stands in its file."""
    robot = cdpr.load_robot("cogiro")
    assert not robot.cabling.has_memory.any()
    assert not any(name in as_toml(robot) for name in ("pulley_friction", "hysteresis", "creep"))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"hysteresis": 3}, "hysteresis: found 3, expected rows of 2 or 3 numbers"),
        ({"hysteresis": [(1,)]}, "hysteresis: found a row of shape"),
        ({"hysteresis": [(0.1, -1)]}, "hysteresis: found .* in cable 1, expected numbers above 0"),
        ({"hysteresis": [(0.1, 0.1, 2)]}, "w of at most 1"),
        ({"hysteresis": [(0.5, 1e-3)]}, "expected less than 1: the tension could fall"),
        ({"hysteresis": [(0.49, 1e-3)], "pulley_friction": 0.05}, "expected less than 1"),
        ({"hysteresis": [[(0.1, 1)], []]}, "found rows of 2 cables, expected those of 8"),
        ({"creep": [(1e4, np.inf)]}, "creep: found an infinite time"),
        ({"creep": [(1e4, 1, 1)]}, "creep: found a row of shape"),
        ({"pulley_friction": -1}, "pulley_friction: found -1 in cable 1, expected 0 to 1"),
        (
            {"linear_density": 0.1, "stiffening": (1, 0)},
            "together with mass and a nonlinear law, expected at most two",
        ),
        ({"stiffening": (-2, 0)}, "expected less than 1, as the law's slope falls to 0.2 EA: the tension could fall"),
    ],
)
def test_a_memory_that_no_rope_has_is_refused_in_one_sentence(changes, sentence):
    """The sentence names the field, what was found and what is expected."""
    with pytest.raises(cdpr.InvalidInput, match=sentence) as caught:
        with_memory(**changes)
    assert "\n" not in str(caught.value)


def test_small_steps_go_along_the_commanded_poses():
    """Rest lengths between two commands are the rigid ones of the poses between them; the commands stay themselves."""
    rng = np.random.default_rng(0)
    poses = rng.uniform([0.2, 0.2, 0.1, 0, 0, 0], [0.6, 0.3, 0.12, 0.1, 0.1, 0.1], (5, 3, 6))
    path = PathProblem.of(cdpr.Problems.of(with_memory(), poses), steps=4, times=[0, 0, 1, 3, 3])
    again = cdpr.Problems.of(path.robot, path.fine.positions, rotations=path.fine.rotations)
    assert np.abs(path.fine.rest_lengths - again.rest_lengths).max() < 1e-15
    assert (path.fine.rest_lengths[path.kept] == path.problems.rest_lengths).all()
    assert path.durations.tolist() == [0] * 5 + [0.25] * 4 + [0.5] * 4 + [0] * 4


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"poses": LINE[0]}, "found a single pose, expected a path"),
        ({"times": [0, 1, 2, 1, 3]}, "times: found 1 s at step 4, after 2 s"),
        ({"times": [0, 1]}, "times: found an array of shape"),
        ({"steps": 0}, "steps: found 0"),
        ({"memory": Memory.fresh(cdpr.load_robot("two-cable"))}, "memory: found .* those of 'cogiro'"),
    ],
)
def test_a_path_that_cannot_be_followed_is_refused(arguments, sentence):
    """One sentence each."""
    with pytest.raises(cdpr.InvalidInput, match=sentence):
        PathProblem.of(cdpr.Problems.of(with_memory(), arguments.pop("poses", LINE)), **arguments)
