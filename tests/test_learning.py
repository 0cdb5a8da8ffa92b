"""The environments of Gymnasium: their dynamics are those of ``track``, and episodes are repeatable."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.learning import ENVIRONMENTS
from cdpr_sim.learning.controllers import run
from cdpr_sim.learning.tasks import REWARDS

SAME = 5e-5
"""[m] From the motion of ``track``, which another method integrates: 4.5e-5 measured where some winches control
tensions and the platform swings, else at most 1.1e-5. Cables that are 10 % softer deviate by more."""

WAY = [(0.35, 0.25, 0.1), (0.45, 0.3, 0.15)]
COGIRO = cdpr.load_robot("cogiro")


def made(name: str = "Track-v0", **settings):
    return gymnasium.make(f"cdpr_sim/{name}", disable_env_checker=True, **settings)


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("robot", ["cogiro", "planar-vertical", "caroca"])
def test_gymnasium_finds_nothing_to_object_to(name, robot):
    """Its checker, with warnings as errors."""
    environment = gymnasium.make(f"cdpr_sim/{name}", robot=robot)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped, skip_render_check=True)


MAKE = """
for name in {names!r}:
    assert gymnasium.make(name, robot="cogiro").reset(seed=1)[0].shape == (37,)
    assert gymnasium.make_vec(name, num_envs=2, robot="cogiro").reset(seed=1)[0].shape == (2, 37)
"""


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium" + MAKE.format(names=[f"cdpr_sim.learning:cdpr_sim/{name}" for name in ENVIRONMENTS]),
        "import gymnasium, cdpr_sim.learning" + MAKE.format(names=[f"cdpr_sim/{name}" for name in ENVIRONMENTS]),
        "import sys, cdpr_sim; assert not {'gymnasium', 'mujoco'} & set(sys.modules)",
    ],
    ids=["with the package in the id", "short, after an import", "not imported"],
)
def test_gymnasium_makes_the_environments_by_their_documented_ids(code, tmp_path):
    """In a new Python, elsewhere than in the clone; the package without its environments imports no Gymnasium."""
    environment = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


CONTROLLERS = {
    "rigid": ("cogiro", cdpr.RigidLengths, "speeds"),
    "elastic": ("cogiro", cdpr.ElasticLengths, "speeds"),
    "tensions": ("cogiro", cdpr.HeldTensions, "tensions"),
    "some tensions": ("cogiro", lambda robot: cdpr.LengthsAndTensions(robot, by_tension=(1, 5)), (1, 5)),
    "feedback": ("parallel", lambda robot: cdpr.PoseFeedback(cdpr.RigidLengths(robot)), "speeds"),
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controllers_move_the_platform_as_in_track(name, catalogue):
    """At every control instant; in an environment whose cables are softer they do not."""
    robot, controller, control = CONTROLLERS[name]
    robot = catalogue[robot].replace(material="fishing-0.4mm")
    tracked = cdpr.track(robot, WAY, controller(robot), seconds=1.0)
    motion, _ = run(made(robot=robot, seconds=1.0, control=control), controller(robot), options={"waypoints": WAY})
    assert len(motion) == len(tracked)
    np.testing.assert_allclose(motion.positions, tracked.positions, rtol=0, atol=SAME)
    np.testing.assert_allclose(motion.commanded.translation, tracked.commanded.translation, rtol=0, atol=1e-12)
    if name != "tensions":  # which do not depend on the stiffness
        softer = made(robot=robot.replace(axial_stiffness=0.9 * robot.axial_stiffness), seconds=1.0, control=control)
        motion, _ = run(softer, controller(robot), options={"waypoints": WAY})
        assert np.abs(motion.positions - tracked.positions).max() > SAME


# Episodes.


def test_many_simulations_are_single_ones_bitwise():
    """Whatever the threads; seeds count up and repeat, all stays finite, and an episode follows another."""
    settings = {
        "robot": "ipanema-1",
        "seconds": 0.1,
        "domain": {"axial_stiffness": 0.2, "mass": 0.1, "exits": 0.002, "friction": 5.0},
    }
    random = np.random.default_rng(3)
    singles = [made(**settings) for _ in range(3)]
    for row, single in enumerate(singles):
        single.reset(seed=5 + row)
    several = [gymnasium.make_vec("cdpr_sim/Track-v0", num_envs=3, threads=threads, **settings) for threads in (1, 2)]
    for vector in several:
        vector.reset(seed=5)
    over = np.zeros(3, dtype=bool)
    for _ in range(25):
        actions = random.uniform(-1, 1, several[0].action_space.shape).astype(np.float32)
        found = [vector.step(actions) for vector in several]
        for row, single in enumerate(singles):
            if over[row]:
                observation, reward, fallen, ended = single.reset()[0], 0.0, False, False
            else:
                observation, reward, fallen, ended, _ = single.step(actions[row])
            assert np.isfinite(observation).all()
            for observations, rewards, terminated, truncated, _ in found:
                np.testing.assert_array_equal(observations[row], observation)
                assert (rewards[row], terminated[row], truncated[row]) == (reward, fallen, ended)
            over[row] = fallen or ended


def test_a_randomised_robot_is_that_robot():
    """Its mass, stiffness and exits: it moves as an environment with this robot, and friction slows it.

    The parameters lie in their ranges, and most of the range is used.
    """
    domain, controller = {"axial_stiffness": 0.2, "mass": 0.2, "exits": 0.01}, cdpr.RigidLengths(COGIRO)

    def motion(robot: cdpr.Robot, **settings) -> tuple[np.ndarray, cdpr.Robot]:
        environment = made(robot=robot, seconds=0.5, **settings)
        found, _ = run(environment, controller, seed=3, options={"waypoints": WAY})
        return found.positions, environment.unwrapped.task.robots[0]

    (drawn_motion, drawn), (nominal, _) = motion(COGIRO, domain=domain), motion(COGIRO)
    for found, given, most in (
        (drawn.exits - COGIRO.exits, 0.0, 0.01),
        (drawn.axial_stiffness / COGIRO.axial_stiffness, 1.0, 0.2),
        (drawn.mass / COGIRO.mass, 1.0, 0.2),
        (drawn.inertia.diagonal() / COGIRO.inertia.diagonal(), drawn.mass / COGIRO.mass, 1e-12),
    ):
        assert np.abs(found - given).max() <= most
    assert np.abs(drawn.exits - COGIRO.exits).max() > 5e-3
    np.testing.assert_allclose(drawn_motion, motion(drawn)[0], rtol=0, atol=SAME)
    assert np.abs(drawn_motion - nominal).max() > 1e-3
    rubbed, _ = motion(COGIRO, domain={"friction": 50.0})
    assert 1e-6 < np.abs(rubbed - nominal).max() < 1e-3


# Observations and rewards.


def test_what_is_observed_and_rewarded():
    """In the documented order; the terms with their weights are the reward."""
    environment = made("Reach-v0", rewards={"slack": 0.5})
    goal, start = np.array([0.4, 0.25, 0.1]), (0.3, 0.25, 0.1)
    observation, _ = environment.reset(seed=4, options={"waypoints": [goal], "start": start})
    np.testing.assert_allclose(observation[:3], start, atol=1e-3)
    np.testing.assert_allclose(observation[6:12], 0, atol=1e-12)
    assert (observation[12:20] >= 0).all()
    np.testing.assert_allclose(observation[20:28], COGIRO.rest_lengths(start))
    np.testing.assert_allclose(observation[28:], [*goal, 0, 0, 0, 0, 0, 0], atol=1e-12)
    action = np.array([0.5, -0.25, 2.0, -3.0, 0, 0, 0, 0], dtype=np.float32)  # beyond 1 is 1
    before = observation[20:28]
    observation, reward, *_, info = environment.step(action)
    moved = np.clip(action, -1, 1) * 1.0 * 0.01  # at 1 m/s for a period of 10 ms
    np.testing.assert_allclose(observation[20:28] - before, moved, atol=1e-9)
    error, angle = np.linalg.norm(observation[:3] - goal), np.linalg.norm(observation[3:6])
    assert info["position_error"] == pytest.approx(error)
    assert info["rotation_error"] == pytest.approx(angle, rel=1e-6)
    half = 0.005 * COGIRO.rest_lengths(COGIRO.home).mean()
    terms = {
        "position": 1 / (1 + error / half), "rotation": 1 / (1 + angle / 0.01), "fall": 0.0,
        "effort": -np.mean(np.clip(action, -1, 1) ** 2), "slack": -np.mean(observation[12:20] <= 0),
    }  # fmt: skip
    assert terms["slack"] < 0
    for name, term in terms.items():
        assert info[f"reward_{name}"] == pytest.approx(term, rel=1e-6), name
    weights = REWARDS | {"slack": 0.5}
    assert reward == pytest.approx(sum(weights[name] * term for name, term in terms.items()), rel=1e-6)


@pytest.mark.parametrize(("robot", "why"), [("cogiro", "turned"), ("planar-vertical", "far")])
def test_a_platform_that_is_far_away_or_turned_over_has_fallen(robot, why):
    """Farther than half the mean length of its cables, as ``track`` judges, or upside down: this ends an episode."""
    environment, reasons = made("Reach-v0", robot=robot), {"far": False, "turned": False}
    home = environment.unwrapped.task.robot.home
    environment.reset(seed=4, options={"waypoints": [home]})
    let_out = np.ones(environment.action_space.shape, dtype=np.float32)
    if why == "turned":
        let_out[:3] = 0
    for _ in range(200):
        seen, _, fallen, ended, info = environment.step(let_out)
        n = len(let_out)
        reasons["far"] = info["position_error"] > 0.5 * seen[12 + n : 12 + 2 * n].mean()
        reasons["turned"] = Rotation.from_rotvec(seen[3:6]).as_matrix()[2, 2] < 0
        assert fallen == any(reasons.values())
        assert info["reward_fall"] == -fallen
        if fallen or ended:
            break
    assert reasons[why]


def test_at_the_target_errors_are_zero_and_finite():
    """The cosine of half the angle between equal orientations is more than 1 by rounding in some of them."""
    environment, random = made("Reach-v0"), np.random.default_rng(0)
    for _ in range(20):
        start = [*random.uniform([0.3, 0.2, 0.1], [0.5, 0.3, 0.2]), *random.uniform(-0.2, 0.2, 3)]
        there = cdpr.solve(COGIRO, start).pose
        environment.reset(seed=0, options={"waypoints": [there], "start": start})
        *_, info = environment.step(np.zeros(8, dtype=np.float32))
        assert info["position_error"] < 1e-6
        assert info["rotation_error"] < 1e-6  # and is a number


def test_an_episode_ends_after_its_seconds():
    """Of ``seconds`` at ``rate``; its last target is the last waypoint, nearly at rest."""
    environment = made(seconds=0.2, rate=50.0)
    environment.reset(seed=0, options={"waypoints": WAY})
    ends = [environment.step(np.zeros(8, dtype=np.float32)) for _ in range(10)]
    assert [end[3] for end in ends] == [False] * 9 + [True]
    np.testing.assert_allclose(ends[-1][0][28:31], WAY[-1], atol=1e-12)
    speeds = [np.linalg.norm(end[0][34:]) for end in ends]  # at the end of the coming period; 0.12 m in 0.2 s
    assert speeds[-1] < 0.1
    assert speeds[4] > 0.5


def test_a_picture_shows_the_state():
    """Of the size that is asked for; another pose is another picture."""
    environment = made(render_mode="rgb_array", size=(96, 64))
    pictures = []
    for x in (0.3, 0.5):
        environment.reset(seed=0, options={"waypoints": [(x, 0.25, 0.1)]})
        pictures.append(environment.render())
    environment.close()
    assert pictures[0].shape == (64, 96, 3)
    assert pictures[0].dtype == np.uint8
    assert (pictures[0] != pictures[1]).any()
