"""Winch models in MJX, MuJoCo's rewriting in JAX: they step there, on a processor too, and come to the same rest."""

import warnings

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what MJX itself imports
    jax = pytest.importorskip("jax")
    mjx = pytest.importorskip("mujoco.mjx")

SAME = 1e-6
"""[m] Measured 1e-13 in double precision."""

AWAY = np.array([-0.1, 0, -0.05])
"""[m] From the middle of the workspace, where the model is written, to where it is wound."""

STEP, WINDING, SECONDS = 1e-3, 1.0, 8.0
"""[s]"""


def rest(model: mujoco.MjModel, controls: np.ndarray):
    """MJX's state after ``SECONDS``; wound evenly at first."""
    on_jax = mjx.put_model(model)

    def step(i, data):
        return mjx.step(on_jax, data.replace(ctrl=controls * jax.numpy.minimum(1, i * STEP / WINDING)))

    first = jax.jit(step)(0, mjx.make_data(on_jax))  # in double precision it changes the types of some whole numbers
    return jax.jit(lambda data: jax.lax.fori_loop(1, round(SECONDS / STEP), step, data))(first)


def test_it_comes_to_the_same_rest():
    """As ``solve`` says, position, tensions and slack cables; with a gain that is 1 % off it does not."""
    jax.config.update("jax_enable_x64", True)
    robot = cdpr.load_robot("parallel")
    static = cdpr.solve(robot, robot.home + AWAY)
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_EULER, STEP
    controls = cdpr.winch_controls(robot, robot.home, static.rest_lengths)
    platform = model.body("platform").id
    found = rest(model, controls)
    assert np.linalg.norm(found.xpos[platform] - static.position) < SAME
    np.testing.assert_allclose(found.actuator_force, static.tensions, rtol=0, atol=1e-3)
    np.testing.assert_array_equal(np.asarray(found.actuator_force) == 0, static.slack)
    model.actuator_gainprm[0] *= 1.01
    assert np.linalg.norm(rest(model, controls).xpos[platform] - static.position) > SAME
