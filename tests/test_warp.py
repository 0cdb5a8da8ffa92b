"""Winch models in MuJoCo Warp, unchanged, on the processor: they come to the rests of MuJoCo."""

import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what Warp itself imports
    wp = pytest.importorskip("warp")
    mjw = pytest.importorskip("mujoco_warp")

MODELS = sorted((Path(__file__).parents[1] / "models").glob("*/winch.xml"))

SAME = 1e-5
"""[m] Warp computes in single precision: measured 4e-8 (``parallel``)."""

FORCE = 1e-3
"""As a fraction of the platform's weight: measured 3e-4 (``parallel``), where rounding of a length times the stiffness
is felt."""

STEPS = 400
"""From a millimetre above the rest, back to it."""

SETTLED, STILL = 2000, 1e-6
"""Steps of MuJoCo's own settling, and the speed that is left [m/s, rad/s]: measured 3e-8, by rounding."""

AWAY = np.array([-0.05, 0.03, -0.05])
"""[m] From where the model is written to where the platform of the second world is wound."""


@pytest.fixture(autouse=True)
def _quiet():
    wp.config.quiet = True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations within Warp
        yield


def resting(model: mujoco.MjModel, controls: np.ndarray) -> mujoco.MjData:
    """MuJoCo's rest on these controls."""
    data = mujoco.MjData(model)
    data.ctrl = controls
    mujoco.mj_step(model, data, SETTLED)
    mujoco.mj_forward(model, data)
    assert np.abs(data.qvel).max() < STILL
    return data


def several(values, like):
    """An array of Warp with a row for each world, of the kind of another one."""
    return wp.array(np.asarray(values, dtype=np.float32), dtype=like.dtype, device=like.device)


def test_every_winch_model_is_accepted_unchanged():
    """Warp refuses what it does not support."""
    assert len(MODELS) > 10
    for path in MODELS:
        mjw.put_model(mujoco.MjModel.from_xml_path(str(path)))


@pytest.mark.parametrize("name", ["parallel", "cogiro"])
def test_it_comes_to_rest_where_mujoco_does(name, catalogue):
    """In two worlds, pose and forces; a third one, with controls 0.1 % off, does not."""
    robot = catalogue[name]
    model = mujoco.MjModel.from_xml_path(str(MODELS[0].parents[1] / name / "winch.xml"))
    platform = model.body("platform").id
    controls = [cdpr.winch_controls(robot, robot.home, robot.rest_lengths(robot.home + by * AWAY)) for by in (0, 1)]
    rests = [resting(model, one) for one in controls]
    worlds = mjw.put_model(model)
    data = mjw.put_data(model, rests[0], nworld=3)
    start = np.array([rests[0].qpos, rests[1].qpos, rests[1].qpos])
    start[:, 2] += 1e-3
    wp.copy(data.qpos, several(start, data.qpos))
    wp.copy(data.ctrl, several([*controls, controls[1] + 1e-3], data.ctrl))
    for _ in range(STEPS):
        mjw.step(worlds, data)
    positions, forces = data.xpos.numpy()[:, platform], data.actuator_force.numpy()
    for row, rest in enumerate(rests):
        np.testing.assert_allclose(positions[row], rest.xpos[platform], rtol=0, atol=SAME)
        np.testing.assert_allclose(forces[row], rest.actuator_force, rtol=0, atol=FORCE * robot.weight)
    assert np.abs(positions[2] - rests[1].xpos[platform]).max() > SAME
