import dataclasses

import numpy as np
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.crosscheck import check as checking
from cdpr_sim.drawing import maps

runner = CliRunner()


def run(*words: str):
    return runner.invoke(app, list(words), env={"COLUMNS": "80"})


def test_map_writes_a_picture_and_says_the_worst(tmp_path):
    """One command: the elastic map of both layouts and both materials, and a table of what it shows."""
    path = tmp_path / "map.png"
    materials = ["--material", "vectran-0.7mm", "--material", "fishing-0.4mm"]
    result = run("map", "parallel", "cogiro", *materials, "--points", "5", "-o", str(path))
    assert result.exit_code == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    rows = [line.split() for line in result.stdout.splitlines() if line.strip().startswith(("parallel", "cogiro"))]
    assert [row[:2] for row in rows if row[1] != "with"] == [
        [robot, material] for robot in ("parallel", "cogiro") for material in materials[1::2]
    ]
    assert sum(row[1:4] == ["with", "rigid", "cables:"] for row in rows) == 2
    assert all("…" not in cell for row in rows for cell in row)


def test_map_along_waypoints_draws_each_quantity_of_each_robot(tmp_path):
    """A picture, and the table of the poses along the path."""
    path = tmp_path / "path.svg"
    stops = ["--waypoint", "0.3,0.25,0.2", "--waypoint", "0.5,0.25,0.2,0,0.05,0", "--waypoint", "0.4,0.25,0.3"]
    result = run("map", "parallel", "cogiro", *stops, "--path-points", "9", "-o", str(path))
    assert result.exit_code == 0
    assert "9 commanded poses" in result.stdout
    drawn = path.read_text()
    for name in ("tilt", "distance", "slack_count", "feasible"):
        assert drawn.count(f'<g id="{name}">') == 2


def test_check_prints_zero_disagreements_and_exits_0(tmp_path, monkeypatch):
    """And draws where they agree, seen along y."""
    path, drawn, draw = tmp_path / "agreement.png", [], maps.draw_agreement_map
    monkeypatch.setattr(maps, "draw_agreement_map", lambda flat: drawn.append(dict(flat.sizes)) or draw(flat))
    result = run("check", "parallel", "cogiro", "--grid", "3", "2", "2", "-o", str(path))
    assert result.exit_code == 0
    assert "No disagreement at 24 poses; MuJoCo settled at all of them." in result.stdout
    assert path.exists()
    assert (drawn[0]["x"], drawn[0]["y"], drawn[0]["z"]) == (3, 1, 2)


def test_check_lists_every_disagreement_and_exits_1(monkeypatch):
    """With its pose and its reason."""
    solve = checking.solve_many

    def wrong(asked):
        stiffer = dataclasses.replace(asked, axial_stiffness=1.01 * asked.axial_stiffness)
        return dataclasses.replace(solve(stiffer), problems=asked)

    monkeypatch.setattr(checking, "solve_many", wrong)
    result = run("check", "cogiro", "--grid", "2", "1", "1")
    assert result.exit_code == 1
    text = " ".join(result.stdout.split())
    assert "2 of 2 poses do not agree" in text
    assert (
        "cogiro, vectran-0.7mm at (0.1, 0.25, 0.225) m: disagree: MuJoCo at the static pose has a residual of" in text
    )


def test_sweep_keeps_its_result(tmp_path):
    """A table, and a store that can be opened."""
    path = tmp_path / "sweep.zarr"
    result = run("sweep", "cogiro", "--grid", "3", "2", "2", "--tension-limits", "0", "5", "-o", str(path))
    assert result.exit_code == 0
    assert "12 commanded poses" in result.stdout
    assert cdpr.open_sweep(path).sizes["x"] == 3


def test_sweep_settles_what_it_keeps(tmp_path):
    """Beside the other quantities, what MuJoCo says; and the status of the command is that of check."""
    path = tmp_path / "settled.zarr"
    result = run("sweep", "cogiro", "--grid", "2", "1", "1", "--settle", "-o", str(path))
    assert result.exit_code == 0
    with cdpr.open_sweep(path) as swept:
        robot = cdpr.load_robot("cogiro")
        poses = [(x, swept.y.item(), swept.z.item()) for x in swept.x.values]
        settled = cdpr.settle_many(robot, poses).positions
        np.testing.assert_array_equal(swept["settled_position"].values.reshape(2, 3), settled)
        assert not np.array_equal(swept["position"].values.reshape(2, 3), settled)
