import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.statics.forces import mass_matrix


def test_shapes_have_unit_kinetic_energy_and_diagonalise_the_stiffness(catalogue):
    """½ q̇ᵀ M q̇ = 1 for each shape at 1/s, and no two share energy; without the centre of mass they do."""
    robot = catalogue["cogiro"].replace(center_of_mass=(0.01, 0.005, -0.02))
    modes = cdpr.natural_modes(robot, (0.3, 0.2, 0.1))
    rotation = modes.equilibrium.rotation.as_matrix()
    mass = mass_matrix(modes.equilibrium.problem, rotation)
    assert 0.5 * modes.shapes @ mass @ modes.shapes.T == pytest.approx(np.eye(6), abs=1e-9)
    centred = mass_matrix(cdpr.Problem.of(robot.replace(center_of_mass=(0, 0, 0)), (0.3, 0.2, 0.1)), rotation)
    assert np.abs(0.5 * modes.shapes @ centred @ modes.shapes.T - np.eye(6)).max() > 1e-3
