"""Writers: files are whole, replaced only with ``--force``, and as they were where anything fails."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
from inputs import FILES, run

import cdpr_sim as cdpr
from cdpr_sim.cli import terminal
from cdpr_sim.core import compiling
from cdpr_sim.drawing import still
from cdpr_sim.report import layout_pictures, robot_summary

ALONG = "--line 0.2 0.25 0.1 0.6 0.25 0.1 --points 2 --generations 1"
FILM = "--drive-seconds 1 --seconds 0.5 --fps 10 --size 320 240 --renderer raycast"

WRITERS = {  # a command, and what it writes
    "new a": "a.toml",
    f"import {FILES / 'crane.wcrfx'} -o a.toml": "a.toml",
    "show two-cable -o a.png": "a.png",
    "models two-cable -o there": "there/two-cable/robot.xml there/two-cable/scene.xml",
    "map two-cable --points 5 -o a.png": "a.png",
    "map two-cable --waypoint 0.3,0,0.2 --waypoint 0.4,0,0.2 --path-points 2 -o a.svg": "a.svg",
    "clearances cogiro --grid 1 1 1 -o a.png": "a.png",
    "check two-cable --grid 2 1 2 -o a.png": "a.png",
    f"video two-cable {FILM} -o a.gif": "a.gif",
    "report two-cable --no-video --grid 2 1 1 -o a.html": "a.html",
    f"design parallel {ALONG} --move exits=0.08 -o a.toml --picture b.png": "a.toml b.png",
    f"front parallel {ALONG} --within 0.05 --max-files 5 -o there": "there/front.png there/robot-1.toml",
}

BEGINNINGS = {".png": b"\x89PNG", ".gif": b"GIF8", ".html": b"<!DOCTYPE html>", ".svg": b"<?xml", ".xml": b"<mujoco"}

WITHOUT_WORK = ("new", "import", "models")
"""Their files are quickly made, or compared with what is there."""


def contents() -> dict[str, bytes]:
    """Of all files below the current folder."""
    return {str(path): path.read_bytes() for path in sorted(Path().rglob("*")) if path.is_file()}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch) -> None:
    """Tests work in a folder of their own; reports have small maps, and clearances an empty one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(robot_summary, "POINTS", 5)
    monkeypatch.setattr(layout_pictures, "clearance_map", lambda *asked: still.Still())


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # mediapy leaves a pipe to be collected
@pytest.mark.parametrize("command", WRITERS, ids=lambda command: command.split()[0])
def test_files_are_replaced_only_with_force_and_by_whole_ones(command, monkeypatch):
    """Without it nothing is computed. On a full disk all is as it was, with status 3; then the files are written."""
    files = WRITERS[command].split()
    for file in files:
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        Path(file).write_bytes(b"mine")
    before, replace = contents(), os.replace
    with monkeypatch.context() as patch:
        if command.split()[0] not in WITHOUT_WORK:
            patch.setattr(compiling.Compiled, "compiled", property(lambda kernel: pytest.fail("it computes")))
            patch.setattr(mujoco.MjModel, "from_xml_string", lambda *given: pytest.fail("it settles"))
        refused = run(*command.split())
    assert (refused.exit_code, refused.stdout) == (2, ""), refused.output
    assert "exists" in refused.stderr
    assert "--force" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1
    assert contents() == before

    def full(source, place):
        if Path(place).absolute().is_relative_to(Path.cwd()):  # compiled code is kept elsewhere
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return replace(source, place)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        failed = run(*command.split(), "--force")
    assert failed.exit_code == terminal.OUTSIDE, failed.output
    assert "cannot be written: No space left on device" in failed.stderr
    assert contents() == before
    assert run(*command.split(), "--force").exit_code == 0
    after = contents()
    assert after.keys() >= before.keys()
    assert command.startswith(("models", "front")) or after.keys() == before.keys()
    for name, content in after.items():
        assert content.startswith(BEGINNINGS.get(Path(name).suffix, b"")), name
        assert content != b"mine"
    for file in (file for file in files if file.endswith("toml")):
        assert cdpr.load_robot(file).cables > 0


@pytest.mark.parametrize("command", [one for one in WRITERS if "-o a." in one], ids=lambda command: command.split()[0])
def test_a_place_that_cannot_be_written_is_found_before_the_work(command, monkeypatch):
    """A pipe, which would be waited for, with force as well; and /proc, where nobody can write."""
    assert run("sweep", "two-cable", "-o", "/proc/x.zarr").exit_code == 2
    suffix = Path(WRITERS[command].split()[0]).suffix
    os.mkfifo(f"pipe{suffix}")
    for name in ("check", "drive", "sweep"):
        monkeypatch.setattr(cdpr, name, None)
    for place, words in ((f"pipe{suffix}", "found a pipe or a device"), (f"/proc/a{suffix}", "cannot be written")):
        refused = run(*command.replace(f"-o a{suffix}", f"-o {place} --force").split())
        assert (refused.exit_code, refused.stdout) == (2, ""), refused.output
        assert words in refused.stderr
        assert len(refused.stderr.strip().splitlines()) == 1


def test_an_interrupt_leaves_the_old_file(monkeypatch):
    """And no temporary one."""

    def interrupted(*places):
        raise KeyboardInterrupt

    Path("a.toml").write_text("mine")
    monkeypatch.setattr(os, "replace", interrupted)
    assert run("new", "a", "--force").exit_code == 130
    assert contents() == {"a.toml": b"mine"}


def test_a_folder_that_is_a_file_is_left_alone_and_stale_models_are_noticed():
    """Fresh files pass --check; a changed one fails it."""
    Path("taken").write_text("mine")
    refused = run("models", "two-cable", "-o", "taken")
    assert (refused.exit_code, "cannot be written" in refused.stderr, contents()) == (2, True, {"taken": b"mine"})
    assert run("models", "two-cable", "-o", "there").exit_code == 0
    assert run("models", "two-cable", "-o", "there", "--check").exit_code == 0
    Path("there/two-cable/robot.xml").write_text("mine")
    assert run("models", "two-cable", "-o", "there", "--check").exit_code == 1


def test_a_mistake_replaces_nothing_even_with_force():
    """What was there stays there."""
    Path("a.toml").write_text("mine")
    assert run("import", "nowhere.csv", "-o", "a.toml", "--force").exit_code == 2
    assert contents() == {"a.toml": b"mine"}


def test_force_writes_to_where_a_link_points():
    """The link stays, and the file behind it is replaced, whichever folder it is in; links in a circle are refused."""
    Path("there").mkdir()
    Path("there/robot.toml").write_text("old")
    links = {"link": "there/robot", "dangling": "there/new", "lost": "nowhere/new", "circle": "circle"}
    for link, to in links.items():
        Path(f"{link}.toml").symlink_to(f"{to}.toml")
    assert run("new", "link", "--force").exit_code == 0
    assert run("new", "dangling").exit_code == 0
    assert Path("link.toml").is_symlink()
    for name in ("robot", "new"):
        cdpr.load_robot(f"there/{name}.toml")
    for name in ("lost", "circle"):
        refused = run("new", name, "--force")
        assert (refused.exit_code, "expected" in refused.stderr) == (2, True), refused.output


@pytest.mark.slow
def test_a_disk_that_a_video_fills_is_one_sentence_and_status_3(tmp_path):
    """A disk of one page, mounted for this process alone; the encoder's own words are not repeated."""
    mounted = f"mount -t tmpfs -o size=4k tmpfs '{tmp_path}'"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mounted], capture_output=True).returncode:
        pytest.skip("this machine lets nobody mount a disk")
    environment = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1]), "COLUMNS": "200"}
    for place in (f"{tmp_path}/v.mp4", f"{tmp_path}/v.gif"):
        video = f"'{sys.executable}' -m cdpr_sim video two-cable {FILM} -o {place}"
        words = ["unshare", "-rm", "sh", "-c", f"{mounted} && {video}; echo $?; ls -A '{tmp_path}'"]
        result = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=600)
        assert result.stdout.split() == [str(terminal.OUTSIDE)], result.stderr
        lines = [line for line in result.stderr.splitlines() if line and "compiles its" not in line]
        assert lines == [f"cdpr-sim: {place}: cannot be written: No space left on device"]
