"""How fast are robots that are driven? On a machine that others use, too, processor time is what can be compared.

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


def main() -> None:
    for name in ROBOTS:
        print(winch_model(cdpr.load_robot(name)))


def winch_model(robot: cdpr.Robot) -> str:
    """Steps a second of the winch model as it is written, against real time; one core."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    data = mujoco.MjData(model)
    costs = []
    for _ in range(REPEATS):
        start = time.process_time()
        mujoco.mj_step(model, data, STEPS)
        costs.append((time.process_time() - start) / STEPS)
    cost, step = statistics.median(costs), model.opt.timestep
    return (
        f"winch model of {robot.name}: {1 / cost:,.0f} steps a second, {step / cost:.0f} times real time at "
        f"{1e3 * step:g} ms; median of {REPEATS}, one core"
    )


if __name__ == "__main__":
    main()
