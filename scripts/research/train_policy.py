"""Train a policy with Stable-Baselines3, and print its score beside those of the package's controllers.

    pip install stable-baselines3
    python scripts/research/train_policy.py --minutes 20 --cores 2

Minutes are the processor's, on all cores together divided by their number, so that other programs cost no training.
Ctrl-C ends the training sooner; the score is of what was learnt until then.
The task is that of ``Track-v0`` with randomised robots: EA by 20 %, the mass by 10 %, exits by 3 mm in each coordinate.
All get the same episodes; the controllers' model is the nominal robot.
"""

# pyright: reportMissingImports=false
import argparse
import time
from contextlib import suppress

import gymnasium
import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

import cdpr_sim as cdpr
from cdpr_sim.learning.controllers import run
from cdpr_sim.learning.tasks import Task

SIMULATIONS = 32
EPISODES = 20  # of the score
SETTINGS = {
    "robot": "cogiro",
    "rate": 50.0,  # Hz
    "winch_speed": 0.5,  # m/s; motions of 4 s through the workspace need 0.3
    "domain": {"axial_stiffness": 0.2, "mass": 0.1, "exits": 0.003},
}


class BatchedEnvironments(VecEnv):
    """A task's simulations as Stable-Baselines3 wants them: an episode is followed by another one in the same step."""

    def __init__(self, task: Task, seed: int) -> None:
        observations = gymnasium.spaces.Box(-np.inf, np.inf, (task.size,), np.float64)
        actions = gymnasium.spaces.Box(-1.0, 1.0, (task.robot.cables,), np.float32)
        super().__init__(task.count, observations, actions)
        self.task, self.randoms = task, np.random.default_rng(seed).spawn(task.count)
        self.asked = np.zeros((task.count, task.robot.cables))

    def reset(self):
        for row, random in enumerate(self.randoms):
            self.task.begin(row, random)
        return self.task.observe()

    def step_async(self, actions):
        self.asked = np.asarray(actions, dtype=float)

    def step_wait(self):
        rewards, fallen, ended, _ = self.task.step(self.asked)
        observations, infos = self.task.observe(), [{} for _ in self.randoms]
        over = fallen | ended
        for row in np.flatnonzero(over):
            infos[row] = {"terminal_observation": observations[row], "TimeLimit.truncated": bool(~fallen[row])}
            self.task.begin(int(row), self.randoms[row])
        return (self.task.observe() if over.any() else observations), rewards, over, infos

    def close(self):
        pass

    def get_attr(self, attr_name, indices=None):
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


class Budget(BaseCallback):
    """Ends the training after some seconds of processor time."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.began, self.seconds, self.told = time.process_time(), seconds, 0.0

    def _on_step(self) -> bool:
        used = time.process_time() - self.began
        if used > self.told + 60:
            self.told = used
            length = np.mean([one["l"] for one in self.model.ep_info_buffer] or [np.nan])
            reward = np.mean([one["r"] for one in self.model.ep_info_buffer] or [np.nan])
            print(f"{self.num_timesteps} steps, {used / 60:.1f} min, {reward:.1f} in {length:.0f} periods", flush=True)
        return used < self.seconds


def trained(seconds: float, cores: int, steps: int):
    """A function from observations to actions, and the number of steps it was trained for."""
    torch.set_num_threads(1)  # the networks are too small for more
    environment = VecNormalize(
        VecMonitor(BatchedEnvironments(Task(count=SIMULATIONS, threads=cores, **SETTINGS), seed=0)), gamma=0.97
    )
    model = stable_baselines3.PPO(
        "MlpPolicy",
        environment,
        n_steps=128,
        batch_size=512,
        n_epochs=5,
        gamma=0.97,
        gae_lambda=0.95,
        learning_rate=5e-4,
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -3.0},
        seed=0,
        device="cpu",
    )
    with suppress(KeyboardInterrupt):
        model.learn(steps, callback=Budget(seconds))
    environment.training = False

    def policy(observation):
        return model.predict(environment.normalize_obs(observation), deterministic=True)[0]

    return policy, model.num_timesteps


def row(name: str, episodes: list[tuple[np.ndarray, float, bool]]) -> str:
    """A row of the table: of all periods of all episodes, but for those that ended in a fall."""
    errors = np.concatenate([errors for errors, _, fell in episodes if not fell] or [np.full(1, np.nan)])
    rewards = np.mean([reward for _, reward, _ in episodes])
    falls = sum(fell for *_, fell in episodes)
    return f"{name:24}{1e3 * np.sqrt((errors**2).mean()):10.2f}{rewards:10.1f}{falls:8}"


def of_policy(environment, policy) -> list[tuple[np.ndarray, float, bool]]:
    episodes = []
    for seed in range(EPISODES):
        observation, _ = environment.reset(seed=1000 + seed)
        errors, total, over, fell = [], 0.0, False, False
        while not over:
            observation, reward, fell, ended, info = environment.step(policy(observation))
            errors.append(info["position_error"])
            total, over = total + reward, fell or ended
        episodes.append((np.array(errors), total, fell))
    return episodes


def of_controller(environment, controller) -> list[tuple[np.ndarray, float, bool]]:
    episodes = []
    for seed in range(EPISODES):
        motion, total = run(environment, controller, seed=1000 + seed)
        fell = len(motion) <= environment.unwrapped.task.periods
        episodes.append((np.linalg.norm(motion.deviation[1:], axis=1), total, fell))
    return episodes


def main() -> None:
    arguments = argparse.ArgumentParser(description="Train a policy, and score it beside controllers.")
    arguments.add_argument("--minutes", type=float, default=20.0, help="of each core; 0 for the controllers alone")
    arguments.add_argument("--cores", type=int, default=2)
    arguments.add_argument("--steps", type=int, default=10**9, help="end the training after so many, if it is sooner")
    arguments.add_argument("--policy-only", action="store_true", help="without the controllers")
    given = arguments.parse_args()
    print(f"{'':24}{'RMS [mm]':>10}{'reward':>10}{'falls':>8}   of {EPISODES} episodes")
    robot = cdpr.load_robot(SETTINGS["robot"])
    controllers = {
        "rigid lengths": cdpr.RigidLengths(robot),
        "elastic lengths": cdpr.ElasticLengths(robot),
        "rigid, pose feedback": cdpr.PoseFeedback(cdpr.RigidLengths(robot)),
        "tensions": cdpr.HeldTensions(robot),
    }
    for name, controller in () if given.policy_only else controllers.items():
        control = "tensions" if name == "tensions" else "speeds"
        environment = gymnasium.make("cdpr_sim/Track-v0", control=control, **SETTINGS)
        print(row(name, of_controller(environment, controller)), flush=True)
    if given.minutes:
        began = time.process_time()
        policy, steps = trained(60 * given.minutes * given.cores, given.cores, given.steps)
        used = (time.process_time() - began) / 60
        environment = gymnasium.make("cdpr_sim/Track-v0", **SETTINGS)
        print(row("PPO", of_policy(environment, policy)))
        print(f"trained for {steps} steps, {used:.1f} minutes of a processor core")


if __name__ == "__main__":
    main()
