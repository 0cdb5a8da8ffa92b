"""A user's mistake at the command line gets one sentence and exit status 2, and leaves everything as it was."""

import os
import re
import time

import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app

PATH = "--waypoint 0.3 0.2 0.1 --waypoint 0.4 0.2 0.1"
LINE = "--line 0.17 0.25 0.1 0.63 0.25 0.1"
DESIGN = f"design cogiro {LINE} --points 4 --generations 1"

BEFORE_WORK = [
    ("settle paralel", "unknown robot 'paralel': did you mean parallel?"),
    ("settle nowhere.toml", "nowhere.toml: no such file"),
    ("settle parallel --material nylon", "unknown material 'nylon'"),
    ("settle parallel --pose nan 0 0", "pose: found [nan, 0.0, 0.0], expected finite"),
    ("settle parallel --pose 0.1 0.2", "--pose: found '0.1,0.2', expected three numbers X Y Z [m], or"),
    ("settle parallel --pose here", "--pose: found 'here', expected three numbers X Y Z [m], or six"),
    ("settle parallel --pose 0.4 0.25 2", "falls since cables cannot push"),
    ("settle parallel --mass -1", "mass: found -1"),
    ("settle parallel --wrench 1,2", "--wrench: found '1,2', expected six numbers"),
    ("settle parallel --waypoint 0.3,0.2,0.1", "--waypoint: found a single one, expected at least two"),
    ("settle parallel --waypoint=0,0 --waypoint=1,1", "--waypoint: found '0,0', expected three numbers"),
    (f"settle parallel {PATH} --pose 0.3,0.2,0.1", "--waypoint: found waypoints and --pose, --certify or --all"),
    (f"settle parallel {PATH} --path-points 0", "--path-points: found 0, expected from 1 to 100000"),
    ("settle two-cable --pose 0.4 0.1 0.2", "'two-cable' is planar"),
    ("solve parallel --method newtn", "did you mean newton"),
    ("solve parallel --pose 1e300 0 0", "pose: found 1e+300 m, expected at most 1e+06 m"),
    ("compensate paralel", "did you mean parallel"),
    ("compensate cogiro --tension-limits 2 1", "found a smallest tension of 2 N above the largest, 1 N"),
    ("compensate cogiro --tension-limits nan 1", "found a smallest tension of nan N"),
    ("compensate cogiro --prefer stif", "unknown preference 'stif'"),
    ("sensitivity two-cable --pose 0.4 0.1 0.2", "'two-cable' is planar"),
    ("equilibria parallel --starts 0", "starts: found 0, expected at least 1"),
    ("equilibria parallel --starts 2000000000", "2000000000 would take about … expected fewer"),
    ("identify cogiro nowhere.csv", "nowhere.csv: no such file"),
    ("identify parallel /dev/zero", "/dev/zero: found a device, expected a file"),
    ("identify parallel endless.csv", "endless.csv: found more than 50 MB, expected a file of text"),
    ("check two-cable --orientation 0.1 0 0", "'two-cable' is planar"),
    ("check two-cable --wrench 0,1,0,0,0,0", "external_wrench: found"),
    (f"check parallel {PATH} --grid 1 1 1", "poses: found them besides a grid or an orientation"),
    (f"check parallel {PATH} -o none.png", "--output: found one for a path, expected a grid"),
    ("check parallel --grid 0 1 1", "grid: found (0, 1, 1)"),
    ("check parallel parallel", "found 2 called 'parallel'"),
    ("check parallel --grid 100000 1000 50", "of 5,000,000,000 poses would take about … TB"),
    ("sweep parallel --material nylon", "unknown material 'nylon'"),
    ("sweep parallel -o mine.png", "ends in .zarr or .nc"),
    ("sweep parallel --grid 2000 2000 2000", "of 8,000,000,000 poses would take about … TB"),
    ("sweep parallel --grid 2000 2000 2000 -o x.nc", "expected … or a .zarr store"),
    ("sweep parallel --grid 9000000000 1 1", "coordinates x would take about 900 GB … fewer"),
    ("sweep parallel --grid 999999999 999999999 999999999", "found 1.0e+27 positions, expected 1e+10 at most"),
    ("map paralel -o new.png", "did you mean parallel"),
    ("map parallel --plane xq -o new.png", "plane: found 'xq'"),
    ("map parallel --points 1 -o new.png", "points: found 1"),
    ("map parallel --points 60000", "points: found 60000, expected at most 2000"),
    ("map parallel -o mine.png", "exists; expected a new name, or --force"),
    ("map parallel -o new.jpg", "ends in .png"),
    ("map parallel two-cable -o new.png", "different workspaces"),
    ("map parallel --tension-limits 3 1 -o new.png", "tau_min <= tau_max"),
    ("map parallel --waypoint 0.3,0.25,0.2 -o new.png", "--waypoint: found a single one"),
    (f"map cogiro {PATH} --at 0.2 -o new.png", "--waypoint: found waypoints and --plane or --at"),
    (f"map cogiro {PATH} --orientation 0 0 0.1 -o new.png", "poses: found them besides"),
    ("map parallel --force -o pipe.png", "pipe.png: found a pipe or a device, expected a file"),
    ("video parallel --waypoint 0.3 0.2 0.1", "--waypoint: found a single one, expected at least"),
    (f"video parallel {PATH} --y 1", "--waypoint: found way"),
    ("video cogiro cogiro cogiro cogiro cogiro cogiro cogiro", "trajectories: found 7, expected 1 to 6 side by side"),
    ("video cogiro cogiro cogiro cogiro --compensate", "trajectories: found 8, expected 1 to 6 side by side"),
    ("video parallel --force -o pipe.mp4", "pipe.mp4: found a pipe or a device, expected a file"),
    ("models paralel", "unknown robot 'paralel'"),
    ("models parallel --damping much -o none", "damping: found 'much', expected 'settle', 'none'"),
    ("figures paperline", "unknown figure 'paperline': did you mean paper-line"),
    ("figures agreement -o /dev/null/in", "cannot be written"),
    (f"{DESIGN} --move exits=far", "move: found 'exits=far', expected a name, = and a number"),
    (f"{DESIGN} --move exits=", "move: found 'exits=', expected a name, = and a number"),
    (f"{DESIGN} --within 0,0,0,1", "within: found '0,0,0,1', expected a number, or 2, 3 or 6 with commas"),
    (f"{DESIGN} --within 0,0,0.5,0.8,0.5,0", "within: found bounds crossed for exits"),
    (f"{DESIGN} --limit points", "limit: found 'points', expected a name, = and a number"),
    (f"{DESIGN} --limit displacement=1", "unknown constraint 'displacement': did you mean points moved?"),
    (f"{DESIGN} --objective displacement", "unknown objective 'displacement': did you mean points moved?"),
    (f"{DESIGN} --symmetry mirror-x", "symmetry: found 'mirror-x', which 'cogiro' does not have"),
    (f"{DESIGN} --grid 2 2 2", "line: found a line and a grid"),
    (f"{DESIGN} -o better.txt", "output: found 'better.txt', expected a name that ends in .toml"),
    ("design parallel --grid 100000 1000 50", "5,000,000,000 poses would take about 1 TB"),
    (f"design parallel {LINE} --points 50000000000", "50,000,000,000 poses would take about 10 TB"),
    ("design parallel --move exits=1e300", "within: found 1e+300 m, expected at most 1e+06 m"),
    ("front parallel -o out/deeper --objectives a b", "unknown objective 'a'"),
    ("front nosuch -o out", "unknown robot 'nosuch'"),
    ("clearances parallel --grid 100000 1000 50", "5,000,000,000 poses would take about … TB"),
    (f"clearances parallel {LINE} --points 2000000000", "2,000,000,000 poses would take about … TB"),
    ("clearances parallel --line nan 0.25 0.1 0.6 0.25 0.1", "line: found nan, expected finite numbers"),
]
"""A command, and what its sentence contains, in this order; with the estimate and what to do where there is one."""

DURING_WORK = [
    ("solve parallel --pose 0.285 0.25 0.1 --method least_squares", "stopped with"),
    (f"{DESIGN} --tension-limits 100 200", "subject_to: found no feasible layout"),
]


@pytest.fixture
def folder(tmp_path, monkeypatch) -> dict[str, int]:
    """To work in: a picture, pipes, and a file that is too large; the sizes of all that is there."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.png").write_text("mine")
    for name in ("pipe.png", "pipe.mp4"):
        os.mkfifo(name)
    with open("endless.csv", "wb") as file:
        file.truncate(60_000_000)
    return contents()


def contents() -> dict[str, int]:
    """Names and sizes of what is in the current folder."""
    return {one.name: one.stat().st_size for one in os.scandir()}


def refused(command: str, message: str) -> None:
    """One line on standard error, nothing on standard output, no traceback."""
    result = CliRunner().invoke(app, command.split(), env={"COLUMNS": "100"})
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    (sentence,) = result.stderr.strip().splitlines()
    assert re.match("cdpr-sim: .*" + ".*".join(map(re.escape, message.split("…"))), sentence), sentence


@pytest.mark.parametrize(("command", "message"), BEFORE_WORK, ids=[command for command, _ in BEFORE_WORK])
def test_what_cannot_be_is_refused_in_one_sentence_before_any_work(command, message, folder, monkeypatch):
    """In less time than the work takes to begin; nothing is written or lost."""
    for name in ("solve_many", "settle_many", "drive", "find_equilibria"):
        monkeypatch.setattr(cdpr, name, None)
    began = time.process_time()
    refused(command, message)
    assert time.process_time() - began < 2.0
    assert contents() == folder


@pytest.mark.parametrize(("command", "message"), DURING_WORK)
def test_what_turns_out_to_be_impossible_is_said_in_one_sentence(command, message, folder):
    """A solver that stalls, a design that nothing satisfies."""
    refused(command, message)
    assert contents() == folder
