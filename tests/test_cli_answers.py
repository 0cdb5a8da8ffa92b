import json

import numpy as np
import pytest
from sample_problems import garage_crane
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.robots.robot_file_text import as_toml

runner = CliRunner()


def run(*words: str):
    return runner.invoke(app, list(words), env={"COLUMNS": "140"})


def row(text: str, label: str) -> list[str]:
    """The cells of the table's row that begins with ``label``."""
    return next(line for line in text.splitlines() if line.strip().startswith(label)).split()


def test_compensate_shows_the_error_before_and_after_by_both_methods():
    """Half a millimetre before, nothing after, exit status 0."""
    result = run("compensate", "cogiro", "--material", "fishing-0.4mm", "--pose", "0.3", "0.25", "0.1")
    assert result.exit_code == 0
    before_mujoco, before_newton, after_mujoco, after_newton = map(float, row(result.stdout, "position error")[-4:])
    assert before_mujoco == pytest.approx(before_newton, abs=1e-4)
    assert before_mujoco > 0.4
    assert max(after_mujoco, after_newton) < 1e-6
    assert "The commanded pose is held exactly" in result.stdout


def test_compensate_says_where_no_lengths_help_and_exits_1():
    """With the reason, and the nearest pose in a stated metric."""
    result = run("compensate", "parallel", "--pose", "0.17", "0.25", "0.1")
    assert result.exit_code == 1
    assert "No lengths hold the commanded pose" in result.stdout
    assert "would have to push" in result.stdout
    values = json.loads(run("compensate", "parallel", "--pose", "0.17", "0.25", "0.1", "--arm", "0", "--json").stdout)
    assert values["exact"] is False
    assert values["distance"] < 1e-6
    assert np.linalg.norm(np.subtract(values["after"]["mujoco"]["position"], [0.17, 0.25, 0.1])) < 1e-6


def test_sensitivity_prints_what_matters_most_and_the_frequencies():
    """A table of effects, largest first, and one of natural frequencies."""
    result = run("sensitivity", "parallel", "--pose", "0.25", "0.25", "0.1", "--rows", "5")
    assert result.exit_code == 0
    listed = result.stdout.partition("They hold while")[0]
    assert sum(f" 1 {per} " in line for line in listed.splitlines() for per in ("mm", "%", "N")) == 5
    assert "rest length 1" in result.stdout
    assert "natural frequencies" in result.stdout
    values = json.loads(run("sensitivity", "parallel", "--pose", "0.25", "0.25", "0.1", "--json").stdout)
    assert len(values["frequencies"]) == 6
    moved = [
        np.hypot(
            effect["position"], 1e3 * cdpr.load_robot("parallel").characteristic_length * np.radians(effect["rotation"])
        )
        for effect in values["effects"]
    ]
    assert (np.diff(moved) <= 1e-12).all()


def test_equilibria_marks_the_one_that_is_reached(monkeypatch):
    """Seven places to rest, MuJoCo stays at each, and the upright one is reached on both methods."""
    release, durations = cdpr.release, set()

    def sooner(one, seconds):
        durations.add((one.stable, seconds))
        return release(one, seconds=seconds / 10 if one.stable else seconds)

    monkeypatch.setattr(cdpr, "release", sooner)
    result = run("equilibria", "cogiro", "--material", "fishing-0.4mm", "--starts", "150")
    assert result.exit_code == 0
    assert result.stdout.count("stays") == 7
    assert "the platform reaches equilibrium 1;" in result.stdout
    assert "MuJoCo reaches the same one" in result.stdout
    values = json.loads(run("equilibria", "two-cable", "--saddles", "--starts", "20", "--json").stdout)
    assert values["imbalance"] == 0
    assert [one["stays_in_mujoco"] for one in values["equilibria"]] == [True, False]
    assert durations == {(True, 2.0), (False, 20.0)}


def test_equilibria_of_cables_with_mass_are_not_released(tmp_path):
    """They are listed, and both methods say which is reached; undamped cables would oscillate themselves."""
    robot = cdpr.load_robot("parallel").replace(linear_density=0.002)
    file = tmp_path / "rope.toml"
    file.write_text(as_toml(robot))
    ask = ("equilibria", str(file), "--pose", "0.2", "0.25", "0.1", "--starts", "50")
    result, values = run(*ask), json.loads(run(*ask, "--json").stdout)
    assert result.exit_code == 0
    assert "released" not in result.stdout
    assert "MuJoCo reaches the same one" in " ".join(result.stdout.split())
    assert values["equilibria"][0]["stays_in_mujoco"] is None
    assert values["equilibria"][0]["position"] == pytest.approx(
        cdpr.solve(robot, (0.2, 0.25, 0.1)).position.tolist(), abs=1e-9
    )


def test_tensions_of_sagging_cables_are_shown_and_none_is_called_slack(tmp_path):
    """A crane on steel rope in a garage: settle, compensate, sweep and sensitivity, as a designer would use them."""
    file = tmp_path / "garage.toml"
    file.write_text(as_toml(garage_crane()))
    assert (cdpr.solve(garage_crane(), (1.5, 1.5, 0.3)).lengths <= garage_crane().rest_lengths((1.5, 1.5, 0.3))).any()
    ask = (str(file), "--pose", "1.5", "1.5", "0.3")
    settle = ("settle", *ask, "--no-certify")
    for command in (settle, ("compensate", *ask, "--tension-limits", "15", "300")):
        result = run(*command)
        assert result.exit_code == 0
        for cable in range(1, 9):
            assert all(float(cell) > 10 for cell in row(result.stdout, f"tension {cable} [N]")[3:])
    assert row(run(*settle).stdout, "slack cables")[2:5] == ["0", "of", "8"]
    assert row(run("sweep", str(file), "--grid", "2", "2", "2").stdout, "garage")[-2] == "0"  # % with slack cables
    assert "set of taut cables" not in run("sensitivity", *ask).stdout


def test_identify_reads_a_file_and_finds_the_stiffness(tmp_path):
    """Data by MuJoCo at EA = 800 N, in millimetres and degrees."""
    robot = cdpr.load_robot("cogiro").replace(axial_stiffness=800.0)
    lines = ["commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_x [mm],measured_z [mm],measured_beta [deg]"]
    for x in (200.0, 300.0, 450.0, 600.0):
        found = cdpr.settle(robot, (x / 1e3, 0.2, 0.1))
        position, beta = 1e3 * found.position, np.degrees(found.euler[1])
        lines.append(
            f"{x!r},200,100,{position[0]!r},{position[2]!r},{beta!r}".replace("np.float64(", "").replace(")", "")
        )
    path = tmp_path / "line.csv"
    path.write_text("\n".join(lines))
    result = run("identify", "cogiro", str(path), "--json", "--position-error", "0.01", "--rotation-error", "0.01")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["unknowns"]["axial_stiffness"]["value"] == pytest.approx(800, rel=1e-4)
    result = run("identify", "cogiro", str(path), "--unknown", "axial_stiffness", "--unknown", "mass")
    assert result.exit_code == 1
    assert result.stdout.count("undetermined") == 2
    assert "cannot distinguish axial_stiffness and mass" in result.stdout
