"""Steps per second of winch models in MuJoCo Warp, for many worlds, beside ``mujoco.batch`` on the processor.

    python scripts/benchmarks/measure_warp.py [ROBOT ...]

And the deviation of the worlds' equilibria from those of MuJoCo, for integrators and time steps.
"""

# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
import sys
import time
from functools import partial

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco.batch import Batch

import cdpr_sim as cdpr

ROBOTS = ("parallel", "cogiro")
WORLDS_GPU, WORLDS_CPU = (1, 64, 1024, 8192, 65536), (1, 16)
SECONDS = 1.5  # of settling, from a millimetre below the rest
LAST = 10  # steps, in which forces must not change
DISCRETE, FAST = mujoco.mjtIntegrator.mjINT_DISCRETE, mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def stepping(worlds, data):
    """A function that makes a step: on a GPU, a recorded graph."""
    mjw.step(worlds, data)
    wp.synchronize()
    if not wp.get_device().is_cuda:
        return lambda: mjw.step(worlds, data)
    with wp.ScopedCapture() as capture:
        mjw.step(worlds, data)
    assert capture.graph is not None
    return partial(wp.capture_launch, capture.graph)


def rates(model: mujoco.MjModel) -> None:
    """Print steps per second, of all worlds together."""
    cuda = wp.get_device().is_cuda
    worlds = mjw.put_model(model)
    for count in WORLDS_GPU if cuda else WORLDS_CPU:
        step = stepping(worlds, mjw.put_data(model, mujoco.MjData(model), nworld=count))
        times = 200 if cuda else 20
        began = time.perf_counter()
        for _ in range(times):
            step()
        wp.synchronize()
        print(f"  Warp, {count:6} worlds: {times * count / (time.perf_counter() - began):12.0f} steps per second")
    batch = Batch(model, 1024)
    began = time.perf_counter()
    batch.step(nstep=100)
    print(f"  mujoco.batch, 1024 simulations: {1024 * 100 / (time.perf_counter() - began):.0f} steps per second")


def deviations(robot: cdpr.Robot, model: mujoco.MjModel) -> None:
    """Print the distance of equilibria from those of MuJoCo, and how much forces change there."""
    rest = mujoco.MjData(model)
    while rest.time < 1 or np.abs(rest.qvel).max() > 1e-9:
        mujoco.mj_step(model, rest)
    mujoco.mj_forward(model, rest)
    platform, written = model.body("platform").id, model.opt.timestep
    for integrator, step in ((DISCRETE, written), (FAST, written), (FAST, 1e-3), (FAST, 2.5e-4)):
        model.opt.integrator, model.opt.timestep = integrator, step
        worlds, data = mjw.put_model(model), mjw.put_data(model, rest, nworld=1)
        start = rest.qpos.copy()
        start[2] -= 1e-3
        wp.copy(data.qpos, wp.array(start[None].astype(np.float32), dtype=data.qpos.dtype))
        forces = []
        for number in range(steps := round(SECONDS / step)):
            mjw.step(worlds, data)
            if number >= steps - LAST:
                forces.append(data.actuator_force.numpy()[0])
        away = np.abs(data.xpos.numpy()[0, platform] - rest.xpos[platform]).max()
        wrong = np.abs(np.array(forces) - rest.actuator_force).max() / robot.weight
        swing = np.ptp(forces, axis=0).max() / robot.weight
        name = mujoco.mjtIntegrator(integrator).name.removeprefix("mjINT_").lower()
        print(
            f"  {name:13}{1e3 * step:5.2f} ms: {away:8.1e} m, forces {wrong:.1e} of the weight, changing by {swing:.1e}"
        )


def main() -> None:
    wp.config.quiet = True
    print(f"on {wp.get_device()}")
    for name in sys.argv[1:] or ROBOTS:
        robot = cdpr.load_robot(name)
        print(name)
        for measure in (lambda robot, model: rates(model), deviations):
            measure(robot, mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True)))


if __name__ == "__main__":
    main()
