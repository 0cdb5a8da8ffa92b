"""The generated folders in models/ are what the generator writes today."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_cli import run

import cdpr_sim as cdpr
from cdpr_sim.physics.model_files import model_files, stale_models

MODELS = Path(__file__).parents[1] / "models"


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_models_folder_is_fresh(name):
    """As `cdpr-sim models --winches --check`: nothing stale, nothing missing."""
    robot = cdpr.load_robot(name)
    assert stale_models(MODELS / name, model_files(robot, winches=robot.cabling.massless)) == []


def test_models_folder_holds_nothing_else():
    """No folder is left of a robot that is gone."""
    assert {path.name for path in MODELS.iterdir()} == {*cdpr.list_robots(), "README.md", "robots.png"}


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_scene_compiles_steps_and_warns_of_nothing(name):
    """From the folder, as a user would load it; the scene adds no mass to the robot."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("commanded").id)
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    alone = mujoco.MjModel.from_xml_path(str(MODELS / name / "robot.xml"))
    np.testing.assert_array_equal(model.body_mass, alone.body_mass)
    assert model.body("platform").mass == cdpr.load_robot(name).mass


def test_check_notices_a_stale_file(tmp_path):
    """Negative control: one character more in one file, a picture that is none."""
    assert run("models", "cogiro", "-o", str(tmp_path)).exit_code == 0
    for file in ("scene.xml", "robot.png"):
        fresh = (tmp_path / "cogiro" / file).read_bytes()
        (tmp_path / "cogiro" / file).write_bytes((fresh + b" ") if file == "scene.xml" else b"")
        assert run("models", "cogiro", "-o", str(tmp_path), "--check").exit_code == 1
        (tmp_path / "cogiro" / file).write_bytes(fresh)
        assert run("models", "cogiro", "-o", str(tmp_path), "--check").exit_code == 0
