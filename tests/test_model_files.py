"""The generated folders in models/ are what the generator writes today."""

import dis
import io
import itertools
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from inputs import run
from PIL import Image

import cdpr_sim as cdpr
from cdpr_sim.core.pose import distance
from cdpr_sim.drawing import still
from cdpr_sim.physics.model_files import model_files, stale_models
from cdpr_sim.physics.winches import hang

MODELS = Path(__file__).parents[1] / "models"
PACKAGE = f"{cdpr.__path__[0]}{os.sep}"

IN_BLAS = {"dot", "vdot", "inner", "matmul", "vecdot", "matvec", "vecmat", "tensordot", "einsum"}
"""NumPy's sums of products, whose order, and so whose last digit, is that of a kernel for the processor; ``@`` too."""

BY_PROCESSOR = ("arctan2", "arctan", "arcsin", "arccos", "sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsinh")
BY_PROCESSOR += ("arccosh", "arctanh", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt", "power")
"""NumPy's functions of real numbers that have other code, and another last digit, where there is AVX-512."""


def blas_in(work: Callable[[], object]) -> set[str]:
    """What calls BLAS among the package's functions that ``work`` runs, as ``function: what it calls``.

    Of ``numpy.linalg``, ``norm`` along an ``axis`` is a plain sum, and without one a call to BLAS.
    """
    ran, found = set(), set()
    sys.setprofile(lambda frame, event, _: ran.add(frame.f_code) if event == "call" else None)
    try:
        work()
    finally:
        sys.setprofile(None)
    for code in ran:
        if code.co_filename.startswith(PACKAGE):
            steps = [step for step in dis.get_instructions(code) if step.opname != "EXTENDED_ARG"]
            calls = {"@" for step in steps if step.argrepr in ("@", "@=")}
            for before, step in itertools.pairwise(steps):
                if step.opname in ("LOAD_ATTR", "LOAD_METHOD") and (
                    step.argval in IN_BLAS or before.argval == "linalg"
                ):
                    calls.add(step.argval)
            if any(isinstance(one, tuple) and "axis" in one for one in code.co_consts):  # names of keywords
                calls.discard("norm")
            found |= {f"{code.co_name}: {call}" for call in calls}
    return found


@pytest.fixture
def another_processor(monkeypatch):
    """Every function that depends on the processor returns the next larger number, except where it returns 0."""

    def rounded_otherwise(function: Callable) -> Callable:
        def other(*args, **options):
            result = function(*args, **options)
            return result if np.iscomplexobj(result) else np.where(result == 0, result, np.nextafter(result, np.inf))

        return other

    for name in BY_PROCESSOR:
        monkeypatch.setattr(np, name, rounded_otherwise(getattr(np, name)))


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_a_models_folder_is_fresh_and_the_same_on_every_processor(name, another_processor):
    """As `cdpr-sim models --winches --check`: nothing stale, nothing missing; without BLAS, and in spite of functions.

    No number depends on the last digit of a function that NumPy computes by the processor, nor on the order of a sum.
    """
    files, robot = [], cdpr.load_robot(name)
    assert blas_in(lambda: files.append(model_files(robot, winches=True))) == set()
    assert stale_models(MODELS / name, files[0]) == []


def test_a_call_of_blas_is_noticed():
    """Negative control: of rest lengths for given tensions, and of the distance between two poses."""
    robot = cdpr.load_robot("ipanema-1")
    home = robot.pose(robot.home)
    assert {"balance: @", "nearest: pinv"} <= blas_in(lambda: robot.rest_lengths(home, tensions=100.0))
    assert blas_in(lambda: distance(home, home, 1.0)) == {"distance: norm", "angle_between: @"}


def test_another_processor_is_noticed(another_processor):
    """Negative control: tilt is an arc tangent, and its last digit differs."""
    equilibrium = cdpr.solve(cdpr.load_robot("parallel"), (0.17, 0.25, 0.1))
    matrix = equilibrium.rotation_matrix
    assert 0 < equilibrium.tilt - math.atan2(math.hypot(*matrix[:2, 2]), matrix[2, 2]) < 1e-15


def cables_drawn(model: mujoco.MjModel, data: mujoco.MjData) -> set[str]:
    """The numbers of the cables that MuJoCo draws where one can see them, by all pieces of one of their tendons."""
    scene = mujoco.MjvScene(model, 1000)
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), everything, scene)
    pieces: dict[tuple[str, ...], list[bool]] = {}
    for geom in scene.geoms[: scene.ngeom]:
        if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON:
            kind, cable, *_ = model.tendon(geom.objid).name.split("_")
            pieces.setdefault((kind, cable), []).append(bool(np.isfinite([*geom.pos, *geom.size]).all()))
    return {cable for (_, cable), places in pieces.items() if all(places)}


SCENES = sorted(MODELS.glob("*/*scene.xml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_scene_shows_every_cable_as_loaded_and_after(path):
    """Also where it is just as long as its rest length, for which MuJoCo draws nothing; and one step or many later."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    cables = {str(i + 1) for i in range(cdpr.load_robot(path.parent.name).cables)}
    assert model.nu == (len(cables) if path.stem == "winch_scene" else 0)
    for steps in (0, 1, 100):
        mujoco.mj_step(model, data, steps)
        mujoco.mj_forward(model, data)
        assert cables_drawn(model, data) == cables
        if model.nu:
            hang(model, data)  # as ``cdpr-sim view`` does
            assert cables_drawn(model, data) == cables
    assert not data.warning.number.any()


def test_without_what_a_scene_adds_mujoco_draws_no_cable_at_its_rest_length():
    """Negative control, and the day on which MuJoCo draws it the scene needs nothing of its own."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "cogiro" / "robot.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert cables_drawn(model, data) == set()


def test_a_small_picture_keeps_its_colours():
    """No pixel differs by more than 24 of 255, measured 23 over the catalogue; with 64 colours it would be 32."""
    picture = still.encoded(still.draw(cdpr.load_robot("falcon-7")))
    small = still.small(picture, "stamp")
    pixels = [np.asarray(Image.open(io.BytesIO(one)).convert("RGB")).astype(int) for one in (picture, small)]
    assert len(small) < 0.4 * len(picture)
    assert np.abs(pixels[1] - pixels[0]).max() <= 24


def test_check_notices_a_stale_file(tmp_path):
    """Negative control: one character more in one file, a picture that is none."""
    words = ["models", "two-cable", "-o", str(tmp_path)]
    assert run(*words).exit_code == 0
    for file in ("scene.xml", "robot.png"):
        fresh = (tmp_path / "two-cable" / file).read_bytes()
        (tmp_path / "two-cable" / file).write_bytes((fresh + b" ") if file == "scene.xml" else b"")
        assert run(*words, "--check").exit_code == 1
        (tmp_path / "two-cable" / file).write_bytes(fresh)
    assert run(*words, "--check").exit_code == 0


def test_models_are_written_as_asked(tmp_path):
    """With pretension they rest where they were commanded; the README says what damps them."""
    words = "models ipanema-1 --pretension 200 --mass 20 --damping 0.02 --winches --contact"
    assert run(*words.split(), "-o", str(tmp_path)).exit_code == 0
    folder, robot = tmp_path / "ipanema-1", cdpr.load_robot("ipanema-1").replace(mass=20)
    for file in ("scene.xml", "winch_scene.xml"):  # whose floor touches, too
        assert mujoco.MjModel.from_xml_path(str(folder / file)).geom("floor").contype == 1
    for file in ("robot.xml", "winch.xml", "winch_speed.xml"):
        model = mujoco.MjModel.from_xml_path(str(folder / file))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        np.testing.assert_allclose(data.body("platform").xpos, robot.home, rtol=0, atol=1e-9)
        assert model.body("platform").mass == 20
        assert data.actuator_force.min() > 100
        assert model.actuator_biasprm[:, 2].max() < 0
        assert model.geom("platform").contype == 1
        assert model.opt.viscosity == model.dof_damping[:6].max() == 0
    assert "Damping: each cable has a loss factor of 0.02" in (folder / "README.md").read_text()
    assert run("models", "two-cable", "--damping", "none", "-o", str(tmp_path)).exit_code == 0
    assert "Damping: none." in (tmp_path / "two-cable" / "README.md").read_text()
