"""The scripts that settle one configuration each: their tables, and agreement as their exit status."""

import dataclasses
import re
import runpy
from pathlib import Path

import pytest

import cdpr_sim as cdpr

SCRIPTS = Path(__file__).parents[1] / "scripts"
NAMES = (
    "cogiro", "parallel", "planar_vertical", "planar_horizontal", "two_cable", "fully_constrained", "real_cables",
)  # fmt: skip
TILT = 20.0
"""[°] Tilt of the parallel layout at the ends of its line in the paper, about (section IV)."""


def status(name: str, monkeypatch, *arguments: str) -> int | str:
    """Exit status of a script, or the sentence with which it ends."""
    monkeypatch.setattr("sys.argv", [f"settle_{name}.py", *arguments])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPTS / f"settle_{name}.py"), run_name="__main__")
    return ended.value.code


def test_every_script_is_tested():
    assert {one.stem.removeprefix("settle_") for one in SCRIPTS.glob("settle_*.py")} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_both_methods_agree_in_every_row(name, monkeypatch, capsys):
    """And a sentence says why the platform does what the table shows."""
    assert status(name, monkeypatch) == 0
    said = capsys.readouterr().out
    assert len(re.findall(r"  agree, \S+ mm apart", said)) >= 12
    assert "Why: " in said


@pytest.mark.parametrize("name", NAMES)
def test_methods_that_differ_are_the_exit_status(name, monkeypatch):
    """Negative control: MuJoCo's tensions are 1 % too large."""
    settle, many = cdpr.settle, cdpr.settle_many
    monkeypatch.setattr(cdpr, "settle", lambda *problem, **given: tighter(settle(*problem, **given)))
    monkeypatch.setattr(cdpr, "settle_many", lambda *problems: tighter(many(*problems)))
    assert status(name, monkeypatch) == 1


@pytest.mark.parametrize("name", NAMES)
def test_a_video_that_cannot_be_written_is_refused_before_anything_is_computed(name, monkeypatch, capsys):
    monkeypatch.setattr(cdpr, "load_robot", lambda name: pytest.fail("began to compute"))
    assert (
        status(name, monkeypatch, "--video", "drive.avi") == "drive.avi: found the suffix '.avi', expected .mp4 or .gif"
    )
    assert not capsys.readouterr().out


def tighter(found):
    return dataclasses.replace(found, tensions=1.01 * found.tensions)


def test_the_parallel_layout_tilts_and_the_crossed_one_stays_level(monkeypatch, capsys):
    """As the paper saw it: by 20° and more at the ends of the line, and by less than 0.1° anywhere."""
    tilts = {}
    for name in ("parallel", "cogiro"):
        status(name, monkeypatch)
        tilts[name] = [float(one) for one in re.findall(r"([\d.]+)°", capsys.readouterr().out)]
    assert min(tilts["parallel"][::9] + tilts["parallel"][8::9]) > TILT
    assert max(tilts["cogiro"]) < 0.1
