"""Cables with a memory by both methods: along a path and over a load cycle they come to the same equilibria."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.core.equilibrium_batch import EquilibriumPath
from cdpr_sim.robots.robot_file_text import as_toml
from cdpr_sim.studies.robot_summary import settled_along, solved_along

AGREE = 1e-9
"""[m] Farthest anchor: 4e-13 m on cogiro, 8e-11 on parallel, 2e-11 on the crane and on ipanema-1, measured."""

SEEN = 1e-8
"""[m] Least effect of one percent of any property of a memory: ten times what the methods may differ by."""

MEMORY = dict(
    hysteresis=[(0.1, 5e-5), (0.1, np.inf, 0.3)],
    winch_to_exit=0.5,
    pulley_friction=0.05,
    creep=[(4e4, 600.0), (2e4, 60.0)],
)
"""Of DemoBot; the elements yield within its strains."""

CRANE = dict(hysteresis=[(0.1, 3e-4), (0.1, np.inf, 0.3)], winch_to_exit=6.0, pulley_friction=0.05)

LINE = np.linspace([0.17, 0.25, 0.1], [0.63, 0.25, 0.1], 9)
"""The paper's line."""

SOME = dict(
    hysteresis=[MEMORY["hysteresis"], [], MEMORY["hysteresis"], []] * 2,
    pulley_friction=[0.05, 0.0, 0.05, 0.0] * 2,
    creep=[MEMORY["creep"], [], [], []] * 2,
    winch_to_exit=0.5,
    stiffening=[(0, 0), (0, 0), (100, 2e4), (100, 2e4)] * 2,
    pulley_radius=[0.0, 0.01] * 4,
)
"""Of DemoBot: each mixture of a memory, a law and a wheel on another cable."""

HEAVY = CRANE | dict(creep=[(4e6, 60.0)], pulley_radius=0.1, linear_density=0.064)

CASES = {
    "hysteresis": ("cogiro", dict(hysteresis=MEMORY["hysteresis"])),
    "friction, cables slack": ("parallel", dict(winch_to_exit=0.5, pulley_friction=0.05)),
    "creep": ("cogiro", dict(creep=MEMORY["creep"])),
    "all": ("cogiro", MEMORY),
    "all, cables slack": ("parallel", MEMORY),
    "over wheels": ("cogiro", MEMORY | dict(pulley_radius=0.02, pulley_axis=(0, 0, 1))),
    "on some cables": (
        "parallel",
        dict(hysteresis=[MEMORY["hysteresis"], *[[]] * 6, [(0.2, 1e-4)]], creep=MEMORY["creep"]),
    ),
    "crane over wheels": ("cogiro-crane", CRANE | dict(pulley_radius=0.03)),
    "reeved crane": ("cogiro-crane", CRANE | dict(reeving=2)),
    "ipanema, cables slack": ("ipanema-1", CRANE),
    "nonlinear, cables slack": ("parallel", MEMORY | dict(stiffening=(100.0, 2e4), pulley_radius=0.01)),
    "each cable of another kind": ("cogiro", SOME),
    "some with mass": ("cogiro", SOME | dict(linear_density=[5e-4, 5e-4, 0, 5e-4, 0, 0, 0, 0])),
    "crane with mass": ("cogiro-crane", HEAVY),
    "nonlinear crane with mass": ("cogiro-crane", HEAVY | dict(hysteresis=(), stiffening=(100.0, 2e4))),
}


def there_and_back(robot: cdpr.Robot, every: int = 2) -> np.ndarray:
    """The paper's line, or one of its kind across another robot's workspace, and back."""
    line = LINE
    if robot.name not in ("cogiro", "parallel"):
        line = robot.home + np.linspace(-0.3, 0.3, 9)[:, None] * [np.ptp(robot.workspace[:, 0]), 0, 0]
    return np.concatenate([line, line[-2::-1]])[::every]


def apart(one: EquilibriumPath, other: EquilibriumPath) -> float:
    """Largest distance of the same anchor [m]."""
    ends = [path.positions[:, None] + path.robot.anchors @ np.swapaxes(path.rotations, 1, 2) for path in (one, other)]
    return float(np.linalg.norm(ends[0] - ends[1], axis=-1).max())


@pytest.mark.parametrize("case", CASES)
def test_both_methods_come_to_the_same_equilibria_there_and_back(case):
    """Anchors, tensions, stiffness and memory; on the way back, a command leads to another equilibrium than before."""
    name, changes = CASES[case]
    robot = cdpr.load_robot(name).replace(**changes)
    path = there_and_back(robot, every=2 if robot.cabling.linear and robot.cabling.massless else 4)
    times = 10.0 * np.arange(len(path))
    solved, settled = cdpr.solve_path(robot, path, times=times), cdpr.settle_path(robot, path, times=times)
    assert solved.converged.all()
    assert settled.converged.all()
    assert apart(solved, settled) < AGREE
    np.testing.assert_allclose(settled.tensions, solved.tensions, rtol=0, atol=1e-8 * robot.weight)
    np.testing.assert_allclose(settled.eigenvalues, solved.eigenvalues, rtol=1e-5)
    assert settled.slack.any() == ("slack" in case or case == "on some cables")
    for part in ("strains", "beyond", "creep"):
        np.testing.assert_allclose(
            getattr(settled.memory, part), getattr(solved.memory, part), rtol=0, atol=AGREE, err_msg=part
        )
    loop = np.linalg.norm(settled.positions - settled.positions[::-1], axis=1).max()
    assert loop > 100 * AGREE
    if case == "all":
        assert all(cdpr.compare(*both).agrees for both in zip(solved, settled, strict=True))
        again = cdpr.settle_path(robot, path, times=times + times[-1], memory=solved.memory)  # goes on from the other's
        assert apart(again, cdpr.solve_path(robot, path, times=times + times[-1], memory=settled.memory)) < AGREE


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("cogiro-crane", dict(linear_density=0.064)),
        ("cogiro", dict(linear_density=5e-4, stiffening=(100.0, 2e4), pulley_radius=0.01, winch_to_exit=0.5)),
    ],
)
def test_paths_of_robots_without_a_memory_have_the_same_equilibria(name, changes):
    """With mass, and with everything else: along a path, by both methods, as each commanded pose on its own."""
    robot = cdpr.load_robot(name).replace(**changes)
    path = there_and_back(robot, every=1)[7:10]
    solved, settled = cdpr.solve_path(robot, path), cdpr.settle_path(robot, path, steps=2)
    assert settled.converged.all()
    assert apart(solved, settled) < AGREE
    assert np.abs(cdpr.settle_many(robot, path).positions - settled.positions).max() < AGREE
    assert all(cdpr.compare(*both).agrees for both in zip(solved, settled, strict=True))
    more = robot.replace(linear_density=1.01 * robot.linear_density)
    assert apart(solved, cdpr.settle_path(more, path)) > SEEN


@pytest.mark.parametrize("name", ["cogiro", "parallel"])
def test_both_methods_come_to_the_same_equilibria_over_a_load_cycle(name):
    """Forces to all sides at one commanded pose, in small steps of both methods too."""
    robot = cdpr.load_robot(name).replace(**MEMORY)
    wrench = np.zeros((9, 6))
    wrench[:, :3] = [
        (0, 0, 0),
        (1, 0, 0),
        (0, 0, -2),
        (-1, 1, 0),
        (0, 0, 0),
        (0, -1, 0),
        (0, 0, 2),
        (1, 0, 0),
        (0, 0, 0),
    ]
    poses = np.tile(robot.home, (9, 1))
    paths = [method(robot, poses, external_wrench=wrench, steps=3) for method in (cdpr.solve_path, cdpr.settle_path)]
    assert paths[1].converged.all()
    assert apart(*paths) < AGREE
    assert np.linalg.norm(paths[1].positions[0] - paths[1].positions[-1]) > SEEN


@pytest.mark.parametrize(
    ("name", "given", "wrong"),
    [
        ("cogiro", MEMORY, dict(pulley_friction=1.01 * 0.05)),
        ("cogiro", MEMORY, dict(hysteresis=[(0.1, 1.01 * 5e-5), (0.1, np.inf, 0.3)])),
        ("cogiro", MEMORY, dict(hysteresis=[(0.1, 5e-5), (0.1, np.inf, 1.01 * 0.3)])),
        ("cogiro", MEMORY, dict(hysteresis=[(1.01 * 0.1, 5e-5), (0.1, np.inf, 0.3)])),
        ("cogiro", MEMORY, dict(creep=[(1.01 * 4e4, 600.0), (2e4, 60.0)])),
        ("cogiro", MEMORY, dict(creep=[(4e4, 600.0), (2e4, 1.01 * 60.0)])),
        ("cogiro-crane", HEAVY, dict(pulley_friction=1.01 * 0.05)),
        ("cogiro-crane", HEAVY, dict(hysteresis=[(0.1, 3e-4), (0.1, np.inf, 1.01 * 0.3)])),
        ("cogiro-crane", HEAVY, dict(creep=[(1.01 * 4e6, 60.0)])),
        ("cogiro-crane", HEAVY | dict(hysteresis=(), stiffening=(100.0, 2e4)), dict(stiffening=(101.0, 2e4))),
    ],
    ids=["friction", "yield strain", "width", "share", "EA of creep", "time of creep",
         "friction, mass", "width, mass", "EA of creep, mass", "law, mass"],
)  # fmt: skip
def test_one_percent_of_a_memory_is_seen(name, given, wrong):
    """Negative control, with and without mass: MuJoCo with something that is 1 % wrong."""
    robot = cdpr.load_robot(name).replace(**given)
    path, times = there_and_back(robot)[2:7:2], 20.0 * np.arange(3)
    settled = cdpr.settle_path(robot.replace(**wrong), path, times=times)
    assert apart(cdpr.solve_path(robot, path, times=times), settled) > SEEN


def test_check_video_and_the_command_line_follow_a_path(tmp_path):
    """``check`` along poses, the states of a video, and the commands ``settle`` and ``check`` with waypoints."""
    robot = cdpr.load_robot("cogiro").replace(**MEMORY)
    path = there_and_back(robot, every=4)
    checked = cdpr.check(robot, poses=path)
    assert checked.agrees
    assert np.isnan(checked.dataset["static_in_mujoco"]).all()
    one_by_one = cdpr.settle_many(robot, path)
    assert np.linalg.norm(one_by_one.positions - cdpr.settle_path(robot, path).positions, axis=1).max() > SEEN
    motion = settled_along(robot, path, 60.0)
    np.testing.assert_allclose(solved_along(motion).positions, motion.positions, rtol=0, atol=AGREE)
    file = tmp_path / "ropes.toml"
    file.write_text(as_toml(robot))
    for words in (
        ["settle", str(file), "--pose", "0.3", "0.25", "0.1"],
        ["settle", str(file), "--waypoint", "0.2,0.25,0.1", "--waypoint", "0.4,0.25,0.1"],
        ["check", str(file), "--waypoint", "0.2,0.25,0.1", "--waypoint", "0.4,0.25,0.1", "--path-points", "5"],
    ):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, (words, result.output, result.exception)
        assert "agree" in result.output
        assert "nan" not in result.output, result.output
