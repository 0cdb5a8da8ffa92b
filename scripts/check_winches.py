"""Where winch models come to rest, against ``solve``: DemoBot's layouts, three stiffnesses, integrators and time steps.

Each model is written in the middle of its workspace and wound to random poses. It is "there" once it is where ``solve``
says to 1e-9 m; "elsewhere" if ``solve``, asked again from where the model came to rest, finds a rest there, too. Poses
with a direction that is nearly free are left out: nothing comes to rest there soon.

Run it: python scripts/check_winches.py [poses of each robot, default 20]
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import sys

import mujoco
import numpy as np
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.report.table_style import new_table

ROBOTS = ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
"""DemoBot's layouts."""

STEPS = {1e3: [5], 1e4: [2, 1], 1e5: [0.5]}
"""Time steps [ms] of the integrators that do not know springs, per axial stiffness [N]."""

SOFT = 0.2
"""[N/m] Smallest stiffness of a pose that is looked at."""

THERE = 1e-9
"""[m] From where ``solve`` says."""

WINDING, PATIENCE = 3.0, 60.0
"""[s] To wind from the middle to the pose, and to wait for rest at most."""


def seconds_to_rest(model: mujoco.MjModel, data: mujoco.MjData, controls: np.ndarray, position: np.ndarray) -> float:
    """Until the platform is where it should rest, from the beginning [s]; inf if it never is."""
    mujoco.mj_resetDataKeyframe(model, data, 0)
    chunk = max(1, round(0.01 / model.opt.timestep))
    while data.time < WINDING:
        data.ctrl = controls * min(1, data.time / WINDING)
        mujoco.mj_step(model, data, chunk)
    data.ctrl = controls
    while data.time < PATIENCE:
        mujoco.mj_step(model, data, 25 * chunk)
        if data.warning.number.any():
            return np.inf
        if np.linalg.norm(data.sensor("position").data - position) < THERE:
            return data.time
    return np.inf


def is_equilibrium(data: mujoco.MjData, static: cdpr.Equilibrium) -> bool:
    """Whether ``solve`` as well finds a rest on these lengths where the platform is now."""
    position = data.sensor("position").data
    turned = Rotation.from_quat(data.sensor("orientation").data, scalar_first=True)
    pose = RigidTransform.from_components(position, turned)
    try:
        again = cdpr.solve(static.problem.robot, pose, static.rest_lengths)
    except cdpr.CdprError:
        return False
    return bool(np.linalg.norm(again.position - position) < THERE)


def main() -> None:
    poses = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    random, console = np.random.default_rng(1), Console()
    table = new_table("Rest of winch models against solve", "EA [N]", "integrator", "step [ms]", "there", "elsewhere")
    for name in ("median [s]", "most [s]"):
        table.add_column(name, justify="right")
    table.add_column("not at rest")
    for stiffness, steps in STEPS.items():
        cases = []
        for name in ROBOTS:
            robot = cdpr.load_robot(name).replace(axial_stiffness=stiffness)
            model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
            lower, upper = robot.workspace
            for pose in random.uniform(lower, upper, (poses, 3)):
                static = cdpr.solve(robot, pose)
                if static.eigenvalues.min() > SOFT:
                    controls = cdpr.winch_controls(robot, robot.home, static.rest_lengths)
                    cases.append((model, mujoco.MjData(model), controls, static))
        for integrator, step in [
            *(("discrete", step) for step in (10, 5, 2)),
            *((one, step) for one in ("Euler", "implicitfast") for step in steps),
        ]:
            seconds, restless, elsewhere = [], [], 0
            for model, data, controls, static in cases:
                model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
                model.opt.timestep = step / 1000
                taken = seconds_to_rest(model, data, controls, static.position)
                if np.isfinite(taken):
                    seconds.append(taken)
                elif is_equilibrium(data, static):
                    elsewhere += 1
                else:
                    restless.append(static.problem.robot.name)
            table.add_row(
                f"{stiffness:g}", integrator, f"{step:g}", f"{len(seconds)} of {len(cases)}", f"{elsewhere}",
                f"{np.median(seconds):.1f}", f"{np.max(seconds):.0f}",
                ", ".join(f"{restless.count(name)} {name}" for name in sorted(set(restless))),
            )  # fmt: skip
    console.print(table)


if __name__ == "__main__":
    main()
