"""Steps per second of the environments, beside a loop written by hand on the same model in MuJoCo.

    python scripts/benchmarks/benchmark_learning.py

The loop has the same dynamics, observation and reward, without Gymnasium, episodes and this package's classes. Times
of one thread are the processor's, and the loop and the environment take turns: their ratio is the median of those of
neighbouring turns, so that what else runs on the machine counts little. Times of two threads are the wall clock's.
"""

# pyright: reportAttributeAccessIssue=false
import time

import gymnasium
import mujoco
import numpy as np

from cdpr_sim.learning.tasks import LEVEL, NEAR, Task
from cdpr_sim.physics.drive import FALLEN

ROBOTS = ("cogiro", "caroca", "planar-vertical")
PERIODS = 400  # of 10 ms: an episode
TURNS = 15
REPEATS = 3  # of many simulations; the best counts
SIMULATIONS = 64
ACTION = 0.02  # of the winches' speed


def by_hand(robot: str, actions: np.ndarray) -> float:
    """Seconds of a loop over ``mj_step`` for as many periods as there are actions."""
    task = Task(robot)
    task.begin(0, np.random.default_rng(0))
    simulations = task.simulations
    machine, batch = simulations.machine, simulations.batch
    model, data = batch.get_model(0), batch.get_data(0)
    steps = round(task.period / model.opt.timestep)
    shortest, longest = machine.reach
    written = longest * (1 + model.actuator_ctrlrange[:, 0])
    rest = simulations.rest_lengths[0].copy()
    sensors = [model.sensor(name) for name in ("position", "orientation")]
    position, orientation = (slice(one.adr[0], one.adr[0] + one.dim[0]) for one in sensors)
    tensions = np.array([model.sensor(f"tension_{i + 1}").adr[0] for i in range(len(rest))])
    plan, platform = task._plan[0], machine.platform
    planar, near = len(data.qvel) < 6, NEAR * rest.mean()
    vector, twist = np.zeros(3), np.zeros(6)
    began = time.process_time()
    for tick, action in enumerate(actions[:PERIODS]):
        ahead = np.clip(rest + 0.01 * action, shortest, longest)
        for step in range(steps):
            data.ctrl[:] = written / (rest + (step + 0.5) / steps * (ahead - rest)) - 1
            mujoco.mj_step(model, data)
        rest = ahead
        data.ctrl[:] = written / rest - 1
        mujoco.mj_forward(model, data)
        wanted, seen = plan[tick + 1], data.sensordata
        at, turned = seen[position], seen[orientation]
        error = np.linalg.norm(at - wanted[:3])
        angle = 2 * np.arccos(min(abs(turned @ wanted[3:7]), 1))
        reward = 1 / (1 + error / near) + 0.5 / (1 + angle / LEVEL) - 0.1 * (action**2).mean()
        fallen = not error <= FALLEN * rest.mean() or data.xmat[platform, 8] < 0 or data.warning.number.any()
        mujoco.mju_quat2Vel(vector, turned, 1)
        if planar:
            twist[[0, 2, 4]] = data.qvel[:3]
        else:
            twist[:3], twist[3:] = data.qvel[:3], data.xmat[platform].reshape(3, 3) @ data.qvel[3:6]
        returned = np.concatenate([at, vector, twist, seen[tensions], rest, wanted[7:]])
        del returned, reward, fallen
    return time.process_time() - began


def in_environment(robot: str, actions: np.ndarray) -> float:
    """Seconds of the same periods in the environment, without its reset."""
    environment = gymnasium.make("cdpr_sim/Track-v0", robot=robot, disable_env_checker=True)
    environment.reset(seed=0)
    began = time.process_time()
    for action in actions[:PERIODS]:
        environment.step(action)
    return time.process_time() - began


def vectorised(robot: str, actions: np.ndarray, threads: int) -> float:
    """Seconds for one step of one simulation, of many at once: of the processor for one thread, else wall clock."""
    clock = time.process_time if threads == 1 else time.perf_counter
    environments = gymnasium.make_vec("cdpr_sim/Track-v0", num_envs=SIMULATIONS, robot=robot, threads=threads)
    environments.reset(seed=0)
    several = np.repeat(actions[:, None], SIMULATIONS, axis=1)
    began = clock()
    for action in several[:50]:
        environments.step(action)
    return (clock() - began) / 50 / SIMULATIONS


def main() -> None:
    print(f"{'steps per second':18}{'by hand':>10}{'environment':>13}{'ratio':>8}{'64, 1 thread':>14}{'2 threads':>11}")
    for robot in ROBOTS:
        cables = Task(robot).robot.cables
        actions = (ACTION * np.random.default_rng(1).uniform(-1, 1, (PERIODS, cables))).astype(np.float32)
        turns = np.array([[way(robot, actions) for way in (by_hand, in_environment)] for _ in range(TURNS)])
        ratio = np.median(turns[:, 0] / turns[:, 1])
        one, two = (min(vectorised(robot, actions, threads) for _ in range(REPEATS)) for threads in (1, 2))
        rates = [*PERIODS / turns.min(axis=0), 1 / one, 1 / two]
        print(f"{robot:18}{rates[0]:10.0f}{rates[1]:13.0f}{ratio:8.2f}{rates[2]:14.0f}{rates[3]:11.0f}", flush=True)


if __name__ == "__main__":
    main()
