"""Benchmark of driven robots. On a shared machine compare processor times.

Run: python scripts/benchmark_control.py
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import statistics
import time

import mujoco

import cdpr_sim as cdpr

ROBOTS = ("cogiro", "parallel", "planar-vertical", "two-cable")
STEPS = 20_000  # per repeat
REPEATS = 5

LINE = [(0.17, 0.25, 0.1), (0.63, 0.25, 0.1)]  # m, the paper's
SPEED = 0.05  # m/s, largest speed; the mean is smaller by a factor of 1.875
SECONDS = 1.875 * 0.46 / SPEED


def main() -> None:
    for name in ROBOTS:
        print(winch_model(cdpr.load_robot(name)))
    for name in ("cogiro", "parallel"):
        print(tracking(cdpr.load_robot(name)))


def winch_model(robot: cdpr.Robot) -> str:
    """Steps per second of the winch model with its own integrator, compared with real time, on one core."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    data = mujoco.MjData(model)
    costs = []
    for _ in range(REPEATS):
        start = time.process_time()
        mujoco.mj_step(model, data, STEPS)
        costs.append((time.process_time() - start) / STEPS)
    cost, step = statistics.median(costs), model.opt.timestep
    return (
        f"winch model of {robot.name}: {1 / cost:,.0f} steps per second, {step / cost:.0f} times real time at "
        f"{1e3 * step:g} ms; median of {REPEATS}, one core"
    )


def tracking(robot: cdpr.Robot) -> str:
    """The paper's line with pose feedback at 100 Hz."""
    controller = cdpr.PoseFeedback(cdpr.RigidLengths(robot))
    costs, walls = [], []
    for _ in range(REPEATS + 1):
        start, begun = time.process_time(), time.perf_counter()
        cdpr.track(robot, LINE, controller, seconds=SECONDS, sensors=cdpr.Sensors(delay=0.01))
        costs.append(time.process_time() - start)
        walls.append(time.perf_counter() - begun)
    cost, wall = statistics.median(costs[1:]), statistics.median(walls[1:])  # without the first run, which compiles
    return (
        f"track of {robot.name} along the paper's line, {SECONDS:.1f} s at up to {SPEED:g} m/s, pose feedback "
        f"at 100 Hz: {cost:.2f} s of one core, {wall:.2f} s on the clock; median of {REPEATS}"
    )


if __name__ == "__main__":
    main()
