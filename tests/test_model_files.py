"""The generated folders in models/ are what the generator writes today."""

from pathlib import Path

import mujoco
import pytest
from test_cli import run

import cdpr_sim as cdpr
from cdpr_sim.physics.model_files import model_files, stale_models

MODELS = Path(__file__).parents[1] / "models"


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_models_folder_is_fresh(name):
    """As `cdpr-sim models --winches --check`: nothing stale, nothing missing."""
    assert stale_models(MODELS / name, model_files(cdpr.load_robot(name), winches=True)) == []


def test_models_folder_holds_nothing_else():
    """No folder is left of a robot that is gone."""
    assert {path.name for path in MODELS.iterdir()} == set(cdpr.list_robots())


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_scene_compiles_steps_and_warns_of_nothing(name):
    """From the folder, as a user would load it; the scene adds no mass to the robot."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("commanded").id)
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    assert model.body_mass.sum() == cdpr.load_robot(name).mass


def test_check_notices_a_stale_file(tmp_path):
    """Negative control: one character more in one file."""
    assert run("models", "-o", str(tmp_path)).exit_code == 0
    file = tmp_path / "cogiro" / "scene.xml"
    file.write_text(file.read_text() + " ")
    assert run("models", "-o", str(tmp_path), "--check").exit_code == 1
