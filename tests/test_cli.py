import dataclasses
import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.report import crosscheck_tables as report
from cdpr_sim.studies import gallery

runner = CliRunner()


def run(*words: str):
    return runner.invoke(app, list(words), env={"COLUMNS": "100"})


def test_settle_shows_the_tilt_the_slack_cables_and_agreement():
    """The main job: 26° of tilt and four slack cables at the left end of the paper's line, and exit status 0."""
    result = run("settle", "parallel", "--pose", "0.17", "0.25", "0.1", "--all")
    assert result.exit_code == 0
    tilt = next(line for line in result.stdout.splitlines() if line.strip().startswith("tilt [°]"))
    assert tilt.split()[-4:-2] == ["26.420", "26.420"]
    assert "4 of 8" in result.stdout
    assert "the two methods agree" in result.stdout
    assert "seecr/fsolve: stopped" in result.stdout  # SEECR's own outcome, honestly
    values = json.loads(run("settle", "parallel", "--pose", "0.17", "0.25", "0.1", "--json").stdout)
    assert values["agrees"] is True
    assert values["results"]["fsolve"]["equilibrium"] is False


def test_settle_exits_1_where_the_methods_disagree(monkeypatch):
    """Only agreement is success."""
    robot = cdpr.load_robot("parallel")
    stiffer = cdpr.solve(robot.replace(axial_stiffness=10.1e3), (0.38, 0.25, 0.1))
    solve = cdpr.solve

    def wrong(problem, method="newton"):
        found = solve(problem, method=method)
        return found if method != "newton" else type(found)(**(vars(found) | {"pose": stiffer.pose}))

    monkeypatch.setattr(cdpr, "solve", wrong)
    result = run("settle", "parallel", "--pose", "0.38", "0.25", "0.1")
    assert result.exit_code == 1
    assert "the two methods disagree" in result.stdout


def test_robots_lists_robots_and_materials():
    """Everything that can be named."""
    result = run("robots")
    for name in (*cdpr.list_robots(), *cdpr.MATERIALS):
        assert name in result.stdout
    wide = runner.invoke(app, ["robots"], env={"COLUMNS": "200"}).stdout
    ropes = re.findall(r"^ (\S+) +(\S+) GPa +(\S+) +(\S+) kg/m³", wide, re.MULTILINE)
    assert {name for name, *_ in ropes} == set(cdpr.ROPES)
    section = np.pi / 4 * 0.002**2  # of the circle that a rope of 2 mm fills in part
    for name, modulus, fill, density in ropes:
        robot = cdpr.load_robot("cogiro").replace(material=f"{name}-2mm")
        expected = 1e9 * float(modulus) * float(fill) * section
        assert robot.axial_stiffness == pytest.approx(expected, rel=1e-2), name
        assert 900 < float(density) < 9000  # from polyethylene to steel


def test_models_writes_checks_and_protects_what_is_there(tmp_path):
    """Fresh files pass --check; a changed one fails it, is not overwritten without --force, and then is."""
    out = ["-o", str(tmp_path)]
    assert run("models", "two-cable", *out).exit_code == 0
    assert run("models", "two-cable", *out, "--check").exit_code == 0
    file = tmp_path / "two-cable" / "robot.xml"
    fresh = file.read_text()
    file.write_text("mine")
    assert run("models", "two-cable", *out, "--check").exit_code == 1
    refused = run("models", "two-cable", *out)
    assert refused.exit_code == 2
    assert "exists and differs" in refused.stderr
    assert file.read_text() == "mine"
    assert run("models", "two-cable", *out, "--force").exit_code == 0
    assert file.read_text() == fresh


def test_models_into_a_place_that_is_a_file_leaves_nothing(tmp_path):
    """One sentence, and the file is still there."""
    file = tmp_path / "taken"
    file.write_text("mine")
    result = run("models", "two-cable", "-o", str(file))
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr
    assert file.read_text() == "mine"


def test_figures_draws_lists_and_protects_what_is_there(tmp_path, monkeypatch):
    """Both files, named as printed; a second time only with --force; --list draws none."""
    words = ["figures", "tilt-condition", "-o", str(tmp_path)]
    drawn = run(*words)
    assert drawn.exit_code == 0
    files = [tmp_path / f"tilt-condition.{kind}" for kind in ("svg", "png")]
    assert drawn.stdout.splitlines() == list(map(str, files))
    assert set(tmp_path.iterdir()) == set(files)
    before = [file.read_bytes() for file in files]
    other = dataclasses.replace(gallery.PICTURES["tilt-condition"], draw=lambda _: Figure(figsize=(1, 1)))
    monkeypatch.setitem(gallery.PICTURES, "tilt-condition", other)
    refused = run(*words)
    assert refused.exit_code == 2
    assert "exists, expected a new place or --force" in refused.stderr
    assert [file.read_bytes() for file in files] == before
    assert run("figures", "tilt-condition", "-o", str(tmp_path), "--force").exit_code == 0
    assert all(file.read_bytes() != old for file, old in zip(files, before, strict=True))
    listed = run("figures", "--list")
    for name in cdpr.list_figures():
        assert name in listed.stdout


def test_the_result_comes_first_and_the_papers_solver_only_with_all():
    """Of `settle` and `solve` the first five lines are the result; SEECR and residuals are details."""
    place = ["--pose", "0.2", "0.25", "0.1"]
    for command, verdict in (
        ("settle", "The two methods agree. Stable equilibrium."),
        ("solve", "Stable equilibrium, "),
    ):
        lines = run(command, "parallel", *place, "--material", "dyneema-2mm").stdout.splitlines()
        assert lines[0].startswith(verdict)
        assert [line[:17].strip() for line in lines[1:5]] == ["deviation", "tilt", "slack cables", "highest tension"]
        assert "% of its breaking load of" in lines[4]
        brief = run(command, "parallel", *place).stdout
        assert "its breaking load is unknown" in brief
        assert not {"SEECR", "iterations", "unbalanced [N]"} & set(brief.split("\n\n", 1)[1].split("  "))
    assert "fsolve" not in run("settle", "parallel", *place).stdout
    full = run("settle", "parallel", *place, "--all").stdout
    assert "fsolve" in full
    assert "iterations" in full
    assert "iterations" in run("solve", "parallel", *place, "--all").stdout


def test_every_command_says_its_verdict_before_its_tables():
    """A designer reads the first line."""
    for words, verdict in (
        ("compensate parallel --pose 0.3 0.25 0.1", "No lengths hold the commanded pose"),
        ("certify two-cable", "Proved: "),
        ("sensitivity two-cable", "Largest effects: "),
        ("equilibria two-cable --starts 20", "1 equilibrium found, 1 stable."),
        ("check two-cable --grid 2 1 1", "No disagreement at 2 poses"),
        ("clearances cogiro --grid 1 1 1", "Interference-free"),
        ("settle two-cable --waypoint 0.35,0,0.2 --waypoint 0.4,0,0.2 --path-points 2", "The methods agree at 2 of 2"),
    ):
        assert run(*words.split()).stdout.startswith(verdict), words


def test_table_marks_a_point_that_is_no_equilibrium():
    """A stalled solver's stability is not claimed."""
    robot = cdpr.load_robot("parallel")
    problem = cdpr.Problem.of(robot, (0.285, 0.25, 0.1))
    with pytest.raises(cdpr.NotConverged) as stalled:
        cdpr.solve(robot, problem.pose, method="least_squares")
    table = report.settle_table(problem, [stalled.value])
    assert list(table.columns[-1].cells)[-1] == "[red]none[/]"


def test_settle_agrees_where_a_pose_of_a_path_is_neutral():
    """As it does for that pose alone, and as `check` does."""
    path = ["--waypoint", "0.1,0.1,0.05", "--waypoint", "0.4,0.25,0.2"]
    assert run("settle", "parallel", "--pose", "0.1", "0.1", "0.05").exit_code == 0
    result = run("settle", "parallel", *path, "--path-points", "2")
    assert result.exit_code == 0, result.output
    assert "The methods agree at 2 of 2 poses." in result.stdout


def test_settle_and_check_follow_a_path():
    """A row for each pose, also turned ones and by JSON; and a check of them, which a wrong solver fails."""
    path = ["--waypoint", "0.35,0.25,0.1", "--waypoint", "0.35,0.25,0.15,0,0,0.1", "--waypoint", "0.45,0.25,0.15"]
    result = run("settle", "cogiro", *path, "--path-points", "4", "--wrench", "0,0,-1,0,0,0")
    assert result.exit_code == 0, result.output
    assert "The methods agree at 4 of 4 poses." in result.stdout
    found = json.loads(run("settle", "cogiro", *path, "--path-points", "4", "--json").stdout)
    assert found["agrees"] == [True] * 4
    assert np.shape(found["mujoco"]["tensions"]) == (4, 8)
    np.testing.assert_allclose(found["mujoco"]["positions"], found["newton"]["positions"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found["positions"][0], [0.35, 0.25, 0.1])
    single = cdpr.solve(cdpr.load_robot("cogiro"), (0.35, 0.25, 0.1))
    np.testing.assert_allclose(found["newton"]["positions"][0], single.position, rtol=0, atol=1e-12)
    result = run("check", "cogiro", *path, "--path-points", "5")
    assert result.exit_code == 0, result.output
    assert "No disagreement at 5 poses" in result.stdout
