"""Random controls over the whole range, on every robot of the catalogue, and on the crane as it is built.

Winches of kind "ratio" get new controls at every time step, those of kind "speed" every 0.2 s. Prints whether MuJoCo
warned, the largest force and the largest velocity; exit status 1 if it warned or a number is not finite.

Run: python scripts/research/random_controls.py [SECONDS]
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import sys

import mujoco
import numpy as np

import cdpr_sim as cdpr

SECONDS = 60.0
"""[s] Simulated time of each run."""

HELD = {"ratio": 0.0, "speed": 0.2}
"""[s] Time for which controls are constant; at least a time step."""


def run(robot: cdpr.Robot, winches: str, seconds: float) -> tuple[bool, float, float, float]:
    """Whether all is finite; the largest force [N], velocity [m/s, rad/s] and the least time step [s]."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=winches))  # type: ignore[arg-type]
    data, random, step = mujoco.MjData(model), np.random.default_rng(0), model.opt.timestep
    held, force, velocity = max(1, round(HELD[winches] / step)), 0.0, 0.0
    for number in range(round(seconds / step)):
        if number % held == 0:
            data.ctrl = random.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data)
        force, velocity = max(force, data.actuator_force.max()), max(velocity, np.abs(data.qvel).max())
        if data.warning.number.any():
            return False, force, velocity, step
    return bool(np.isfinite(data.qpos).all()), force, velocity, step


if __name__ == "__main__":
    seconds, all_finite = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS, True
    built = cdpr.load_robot("cogiro-crane").replace(linear_density=0.064, pulley_radius=0.1, winch_to_exit=6.0)
    for name in [*cdpr.list_robots(), "crane as built"]:
        robot = built if name == "crane as built" else cdpr.load_robot(name)
        for winches in HELD:
            finite, force, velocity, step = run(robot, winches, seconds)
            all_finite &= finite
            print(
                f"{name:22} {winches:6} {1e3 * step:g} ms  {'finite' if finite else 'NOT FINITE':10}  "
                f"{force:9.0f} N  {velocity:7.1f} m/s or rad/s"
            )
    raise SystemExit(0 if all_finite else 1)
