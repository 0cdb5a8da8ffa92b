"""Compare winch models with ``solve``: DemoBot's layouts, three stiffnesses, several integrators and time steps.

Each model is written for the middle of its workspace and driven to random poses. It is "there" when its position
differs from that of ``solve`` by at most 1e-9 m. It is "elsewhere" if it settles at another position, and ``solve``
started there finds an equilibrium there. Poses with a nearly neutral direction are left out, because settling there
takes long.

Run: python scripts/research/check_winches.py [poses of each robot, default 20]
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
"""Time steps [ms] of the integrators that treat springs explicitly, per axial stiffness [N]."""

SOFT = 0.2
"""[N/m] Smallest stiffness of the poses that are used."""

THERE = 1e-9
"""[m] Largest distance from the position of ``solve``."""

WINDING, PATIENCE = 3.0, 60.0
"""[s] Time to drive from the middle to the pose, and longest time to settle."""


def seconds_to_rest(model: mujoco.MjModel, data: mujoco.MjData, controls: np.ndarray, position: np.ndarray) -> float:
    """Time from the beginning until the platform settles where it should [s]; inf if it does not."""
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
    """Whether ``solve`` finds an equilibrium with these rest lengths at the platform's present pose."""
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
    table = new_table("Winch models compared with solve", "EA [N]", "integrator", "step [ms]", "there", "elsewhere")
    for name in ("median [s]", "most [s]"):
        table.add_column(name, justify="right")
    table.add_column("not settled")
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
            seconds, unsettled, elsewhere = [], [], 0
            for model, data, controls, static in cases:
                model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
                model.opt.timestep = step / 1000
                taken = seconds_to_rest(model, data, controls, static.position)
                if np.isfinite(taken):
                    seconds.append(taken)
                elif is_equilibrium(data, static):
                    elsewhere += 1
                else:
                    unsettled.append(static.problem.robot.name)
            table.add_row(
                f"{stiffness:g}", integrator, f"{step:g}", f"{len(seconds)} of {len(cases)}", f"{elsewhere}",
                f"{np.median(seconds):.1f}", f"{np.max(seconds):.0f}",
                ", ".join(f"{unsettled.count(name)} {name}" for name in sorted(set(unsettled))),
            )  # fmt: skip
    console.print(table)


if __name__ == "__main__":
    main()
