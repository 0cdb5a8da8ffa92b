"""The generated folders in models/ are what the generator writes today."""

import ast
import inspect
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_cli import run

import cdpr_sim as cdpr
from cdpr_sim.core.pose import distance
from cdpr_sim.physics.model_files import model_files, stale_models

MODELS = Path(__file__).parents[1] / "models"
PACKAGE = Path(cdpr.__path__[0])

IN_BLAS = {"dot", "vdot", "inner", "matmul", "vecdot", "matvec", "vecmat", "tensordot", "einsum"}
"""NumPy's sums of products, whose order, and so whose last digit, is that of a kernel for the processor; ``@`` too."""


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_models_folder_is_fresh(name):
    """As `cdpr-sim models --winches --check`: nothing stale, nothing missing."""
    robot = cdpr.load_robot(name)
    assert stale_models(MODELS / name, model_files(robot, winches=robot.cabling.massless)) == []


def blas_in(work: Callable[[], object]) -> set[str]:
    """What calls BLAS among the package's functions that ``work`` runs, as ``function: what it calls``.

    Of ``numpy.linalg``, ``norm`` along an ``axis`` is a plain sum, and without one a call to BLAS.
    """
    ran = set()
    sys.setprofile(lambda frame, event, _: ran.add(frame.f_code) if event == "call" else None)
    try:
        work()
    finally:
        sys.setprofile(None)
    found = set()
    for code in ran:
        if Path(code.co_filename).is_relative_to(PACKAGE) and not code.co_name.startswith("<"):
            tree = ast.parse(textwrap.dedent(inspect.getsource(code)))
            plain = {
                node.func
                for node in ast.walk(tree)
                if isinstance(node, ast.Call) and "axis" in {word.arg for word in node.keywords}
            }
            for node in ast.walk(tree):
                if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
                    found.add(f"{code.co_name}: @")
                if isinstance(node, ast.Attribute) and (
                    node.attr in IN_BLAS
                    or (ast.unparse(node.value) == "np.linalg" and not (node.attr == "norm" and node in plain))
                ):
                    found.add(f"{code.co_name}: {node.attr}")
    return found


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_models_are_written_without_blas(name):
    """So that every processor writes them alike."""
    robot = cdpr.load_robot(name)
    assert blas_in(lambda: model_files(robot, winches=robot.cabling.massless)) == set()


def test_a_call_of_blas_is_noticed():
    """Negative control: of rest lengths for given tensions, and of the distance between two poses."""
    robot = cdpr.load_robot("ipanema-1")
    home = robot.pose(robot.home)
    assert {"_balancing: @", "_balancing: pinv"} <= blas_in(lambda: robot.rest_lengths(home, tensions=100.0))
    assert blas_in(lambda: distance(home, home, 1.0)) == {"distance: norm"}


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
