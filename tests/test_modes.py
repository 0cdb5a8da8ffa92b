import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.pose import moved
from cdpr_sim.physics.mjcf import coordinates
from cdpr_sim.statics.forces import mass_matrix

FREQUENCY = 5e-6
"""Relative error of a measured frequency, 200 steps of RK4 to a period, 12 periods, zero crossings interpolated:
5e-7 measured at worst."""

AMPLITUDE = 1e-6
"""[m] Far less than the stretch of any taut cable, so that all stay taut."""


def measured_frequency(equilibrium: cdpr.Equilibrium, shape: np.ndarray, frequency: float, periods: int = 12) -> float:
    """Let MuJoCo's undamped platform go, displaced along ``shape``, and read the frequency off its zero crossings."""
    problem = equilibrium.problem
    robot = problem.robot
    step = shape * AMPLITUDE / np.linalg.norm(shape * robot.units)
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, equilibrium.pose, equilibrium.rest_lengths))
    model.opt.viscosity = 0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = 1 / (200 * frequency)
    data = mujoco.MjData(model)
    data.qpos[:] = coordinates(robot, moved(equilibrium.pose, step))
    platform, states = data.body("platform"), np.empty((200 * periods, 7))
    for state in states:
        mujoco.mj_step(model, data)
        state[:3], state[3:] = platform.xpos, platform.xquat
    turns = Rotation.from_quat(states[:, 3:], scalar_first=True) * equilibrium.rotation.inv()
    moves = np.hstack([states[:, :3] - equilibrium.position, turns.as_rotvec()])
    values = moves @ mass_matrix(equilibrium.problem, equilibrium.rotation.as_matrix()) @ shape
    before = np.flatnonzero(np.diff(np.sign(values)))
    crossings = (before + values[before] / (values[before] - values[before + 1])) * model.opt.timestep
    return 0.5 * (len(crossings) - 1) / (crossings[-1] - crossings[0])


@pytest.mark.parametrize(
    ("name", "pose"), [("cogiro", (0.3, 0.25, 0.1)), ("two-cable", (0.3, 0, 0.2)), ("planar-vertical", (0.2, 0, 0.1))]
)
def test_mujoco_swings_at_the_natural_frequencies(catalogue, name, pose):
    """Every mode of a robot whose centre of mass is off its origin, in undamped MuJoCo."""
    robot = catalogue[name].replace(material="fishing-0.4mm", center_of_mass=(0.01, 0, -0.02))
    modes = cdpr.natural_modes(robot, pose)
    assert len(modes.frequencies) == len(robot.free)
    for frequency, shape in zip(modes.frequencies, modes.shapes, strict=True):
        assert measured_frequency(modes.equilibrium, shape, frequency) == pytest.approx(frequency, rel=FREQUENCY)


def test_shapes_have_unit_kinetic_energy_and_diagonalise_the_stiffness(catalogue):
    """½ q̇ᵀ M q̇ = 1 for each shape at 1/s, and no two share energy; without the centre of mass they do."""
    robot = catalogue["cogiro"].replace(center_of_mass=(0.01, 0.005, -0.02))
    modes = cdpr.natural_modes(robot, (0.3, 0.2, 0.1))
    rotation = modes.equilibrium.rotation.as_matrix()
    mass = mass_matrix(modes.equilibrium.problem, rotation)
    assert 0.5 * modes.shapes @ mass @ modes.shapes.T == pytest.approx(np.eye(6), abs=1e-9)
    centred = mass_matrix(cdpr.Problem.of(robot.replace(center_of_mass=(0, 0, 0)), (0.3, 0.2, 0.1)), rotation)
    assert np.abs(0.5 * modes.shapes @ centred @ modes.shapes.T - np.eye(6)).max() > 1e-3
