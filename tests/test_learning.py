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

import cdpr_sim as cdpr
from cdpr_sim.learning import ENVIRONMENTS
from cdpr_sim.learning.controllers import run
from cdpr_sim.learning.domain import Domain
from cdpr_sim.learning.tasks import REWARDS

SAME = 5e-5
"""[m] From the motion of ``track``, which another method integrates: 4.5e-5 measured where some winches control
tensions and the platform swings, else at most 1.1e-5. Cables that are 10 % softer deviate by more."""

WAY = [(0.35, 0.25, 0.1), (0.45, 0.3, 0.15)]


def made(name: str = "Track-v0", **settings):
    return gymnasium.make(f"cdpr_sim/{name}", disable_env_checker=True, **settings)


def wander(environment, steps: int, seed: int) -> list[np.ndarray]:
    """Observations and rewards of an episode with random actions."""
    random = np.random.default_rng(7)
    seen = [environment.reset(seed=seed)[0]]
    for _ in range(steps):
        action = random.uniform(-0.1, 0.1, environment.action_space.shape).astype(np.float32)
        observation, reward, *_ = environment.step(action)
        seen += [observation, np.atleast_1d(reward)]
    return seen


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("robot", ["cogiro", "planar-vertical", "caroca"])
def test_gymnasium_finds_nothing_to_object_to(name, robot):
    """Its checker, with warnings as errors."""
    environment = gymnasium.make(f"cdpr_sim/{name}", robot=robot)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped, skip_render_check=True)


FRESH = """
import sys
import gymnasium
if {imported}:
    import cdpr_sim.learning
assert gymnasium.make({name!r}, robot="cogiro").reset(seed=1)[0].shape == (37,)
assert gymnasium.make_vec({name!r}, num_envs=2, robot="cogiro").reset(seed=1)[0].shape == (2, 37)
"""
"""A new Python in which only Gymnasium is imported, or this package too."""


def in_a_new_python(code: str, folder: Path) -> None:
    """Run code as a user does who has installed the package: elsewhere than in the clone."""
    package = str(Path(cdpr.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": package},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_makes_the_environments_by_their_documented_ids(name, tmp_path):
    """With the package in the id nothing is imported before; the short id needs its import. ``make_vec`` too."""
    in_a_new_python(FRESH.format(imported=False, name=f"cdpr_sim.learning:cdpr_sim/{name}"), tmp_path)
    in_a_new_python(FRESH.format(imported=True, name=f"cdpr_sim/{name}"), tmp_path)


def test_the_package_without_its_environments_imports_no_gymnasium(tmp_path):
    """Nor MuJoCo."""
    in_a_new_python("import sys, cdpr_sim; assert not {'gymnasium', 'mujoco'} & set(sys.modules)", tmp_path)


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
    environment = made(robot=robot, seconds=1.0, control=control)
    motion, _ = run(environment, controller(robot), options={"waypoints": WAY})
    assert len(motion) == len(tracked)
    np.testing.assert_allclose(motion.positions, tracked.positions, rtol=0, atol=SAME)
    if name != "tensions":  # which do not depend on the stiffness
        softer = made(robot=robot.replace(axial_stiffness=0.9 * robot.axial_stiffness), seconds=1.0, control=control)
        motion, _ = run(softer, controller(robot), options={"waypoints": WAY})
        assert np.abs(motion.positions - tracked.positions).max() > SAME


def test_seeded_runs_are_bitwise_equal():
    """The same seed, twice; another one differs. With randomised robots."""
    domain = {"axial_stiffness": 0.2, "mass": 0.1, "exits": 0.003, "friction": 5.0}
    once, again, other = (wander(made(seconds=0.3, domain=domain), 30, seed) for seed in (1, 1, 2))
    for one, two in zip(once, again, strict=True):
        np.testing.assert_array_equal(one, two)
    assert not np.array_equal(once[-2], other[-2])


@pytest.mark.parametrize("robot", ["ipanema-1"])
def test_many_simulations_are_single_ones_bitwise(robot):
    """Whatever the threads; seeds count up, and an episode follows another."""
    settings = {"robot": robot, "seconds": 0.1, "domain": {"mass": 0.1, "exits": 0.002}}
    random = np.random.default_rng(3)
    singles = [made(**settings) for _ in range(3)]
    for row, single in enumerate(singles):
        single.reset(seed=5 + row)
    several = [gymnasium.make_vec("cdpr_sim/Track-v0", num_envs=3, threads=threads, **settings) for threads in (1, 2)]
    for vector in several:
        vector.reset(seed=5)
    over = np.zeros(3, dtype=bool)
    for _ in range(25):
        actions = random.uniform(-0.1, 0.1, several[0].action_space.shape).astype(np.float32)
        found = [vector.step(actions) for vector in several]
        for row, single in enumerate(singles):
            if over[row]:
                observation, reward, fallen, ended = single.reset()[0], 0.0, False, False
            else:
                observation, reward, fallen, ended, _ = single.step(actions[row])
            for observations, rewards, terminated, truncated, _ in found:
                np.testing.assert_array_equal(observations[row], observation)
                assert (rewards[row], terminated[row], truncated[row]) == (reward, fallen, ended)
            over[row] = fallen or ended


def test_a_randomised_robot_is_that_robot(catalogue):
    """Its mass, stiffness and exits: it moves as an environment with this robot, and friction slows it."""
    robot = catalogue["cogiro"]
    environment = made(robot=robot, seconds=0.5, domain={"axial_stiffness": 0.2, "mass": 0.2, "exits": 0.01})
    controller = cdpr.RigidLengths(robot)
    motion, _ = run(environment, controller, seed=3, options={"waypoints": WAY})
    drawn = environment.unwrapped.task.robots[0]
    assert np.abs(drawn.exits - robot.exits).max() > 5e-3
    same, _ = run(made(robot=drawn, seconds=0.5), controller, options={"waypoints": WAY})
    np.testing.assert_allclose(motion.positions, same.positions, rtol=0, atol=SAME)
    nominal, _ = run(made(robot=robot, seconds=0.5), controller, options={"waypoints": WAY})
    assert np.abs(motion.positions - nominal.positions).max() > 1e-3
    rubbed, _ = run(made(robot=robot, seconds=0.5, domain={"friction": 50.0}), controller, options={"waypoints": WAY})
    assert 1e-6 < np.abs(rubbed.positions - nominal.positions).max() < 1e-3


def test_what_is_observed_and_rewarded():
    """In the documented order; the terms with their weights are the reward, and a fall ends an episode."""
    environment = made("Reach-v0", rewards={"slack": 0.5})
    observation, _ = environment.reset(seed=4, options={"waypoints": [(0.4, 0.25, 0.1)], "start": (0.3, 0.25, 0.1)})
    np.testing.assert_allclose(observation[:3], (0.3, 0.25, 0.1), atol=1e-3)
    np.testing.assert_allclose(observation[6:12], 0, atol=1e-12)
    assert (observation[12:20] >= 0).all()
    np.testing.assert_allclose(observation[20:28], environment.unwrapped.task.robot.rest_lengths((0.3, 0.25, 0.1)))
    np.testing.assert_allclose(observation[28:], [0.4, 0.25, 0.1, 0, 0, 0, 0, 0, 0], atol=1e-12)
    observation, reward, *_, info = environment.step(np.full(8, 0.5, dtype=np.float32))
    weights = REWARDS | {"slack": 0.5}
    assert reward == pytest.approx(sum(weights[name] * info[f"reward_{name}"] for name in weights))
    assert info["position_error"] == pytest.approx(np.linalg.norm(observation[:3] - (0.4, 0.25, 0.1)))
    for _ in range(200):
        *_, fallen, ended, info = environment.step(np.ones(8, dtype=np.float32))
        if fallen or ended:
            break
    assert fallen
    assert info["reward_fall"] == -1


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


def test_a_window_without_a_display_is_refused_in_a_sentence(monkeypatch):
    """Before MuJoCo's viewer ends the process."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(cdpr.InvalidInput, match="display: found none"):
        made("Reach-v0", render_mode="human").reset(seed=0)


def test_random_actions_leave_it_finite():
    """Over the whole range, on a stiff robot; episodes end, observations stay finite."""
    environments = gymnasium.make_vec("cdpr_sim/Track-v0", num_envs=4, robot="cogiro", seconds=0.5)
    environments.reset(seed=0)
    environments.action_space.seed(1)
    for _ in range(75):
        observations, rewards, *_ = environments.step(environments.action_space.sample())
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"control": "speed"}, "control"),
        ({"control": (9,)}, "control: found 9"),
        ({"domain": {"mass": 1.5}}, "mass: found 1.5"),
        ({"rewards": {"tilt": 1.0}}, "term of the reward"),
        ({"rate": 0}, "rate: found 0"),
        ({"damping": -1.0}, "damping: found -1, expected 0 or more"),
        ({"cable_damping": np.nan}, "cable_damping: found nan"),
        ({"robot": "crane-with-heavy-cables"}, "crane-with-heavy-cables"),
        ({"robot": cdpr.load_robot("cogiro").replace(linear_density=5e-4)}, "found cables of 0.0005 kg/m"),
        (
            {"robot": cdpr.load_robot("cogiro").replace(stiffening=(100, 2e4))},
            "found cable 1 with nonlinear elasticity",
        ),
    ],
)
def test_invalid_settings_are_refused_in_a_sentence(settings, words):
    """Each names the field and what was found."""
    with pytest.raises(cdpr.CdprError, match=words):
        made(**settings)


def test_invalid_calls_are_refused_in_a_sentence(catalogue):
    """A step before the reset, actions and options that are none, and a controller of other winches."""
    environment = made(seconds=0.1)
    with pytest.raises(cdpr.InvalidInput, match="expected reset"):
        environment.step(np.zeros(8))
    with pytest.raises(cdpr.CdprError, match="option"):
        environment.reset(options={"pose": 1})
    environment.reset(seed=0)
    with pytest.raises(cdpr.InvalidInput, match="not finite"):
        environment.step(np.full(8, np.nan))
    with pytest.raises(cdpr.InvalidInput, match=r"expected control=\[1, 2, 3"):
        run(environment, cdpr.HeldTensions(catalogue["cogiro"]), options={"waypoints": WAY})
    with pytest.raises(cdpr.InvalidInput, match="mass: found"):
        Domain(mass=-0.1)
