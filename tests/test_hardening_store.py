"""Stores that lost something, that two processes want, and neighbours that are not ours."""

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace import sweep as sweeping
from cdpr_sim.cli import app

ASKED = dict(robots=["parallel", "cogiro"], grid=(8, 10, 10), chunk=100, quantities=["tilt", "tensions", "feasible"])
"""16 chunks: four slabs, of four in this process."""

ROUNDING = 1e-14
"""Relative, as in the other tests of stores."""


@pytest.fixture(scope="module", autouse=True)
def small_slabs():
    """Of four chunks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stores, "TASKS", 4)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A finished store, to be copied."""
    path = tmp_path_factory.mktemp("whole") / "sweep.zarr"
    cdpr.sweep(**ASKED, store=path)
    return path


@pytest.fixture(scope="module")
def expected(whole) -> xr.Dataset:
    return cdpr.open_sweep(whole).compute()


@pytest.fixture
def store(whole, tmp_path) -> Path:
    """A copy to be damaged."""
    path = tmp_path / "sweep.zarr"
    shutil.copytree(whole, path)
    return path


def test_every_chunk_is_a_file_also_one_that_is_zero(store, expected):
    """A status that is all zero means converged, and was not written: its loss could not be told from it."""
    chunks = {
        name: len([f for f in os.listdir(store / name) if f[0].isdigit()]) for name in ("status", "tilt", "feasible")
    }
    assert set(chunks.values()) == {16}
    assert not expected["status"].any()


@pytest.mark.parametrize("name", ["status", "tensions", "exits", "x"])
def test_a_lost_chunk_is_noticed_and_computed_again(store, expected, name):
    """One sentence that names the store and the slab; the same sweep then mends it, and nothing else."""
    chunk = sorted(f for f in os.listdir(store / name) if f[0].isdigit())[-1]
    (store / name / chunk).unlink()
    lost = rf"sweep\.zarr(: slab {chunk} of '{name}' is lost| has lost slab {chunk} of '{name}'); run the same sweep"
    with pytest.raises(cdpr.StoreError, match=lost):
        cdpr.open_sweep(store)
    before = {file: file.stat().st_mtime_ns for file in (store / "tilt").iterdir()}
    xr.testing.assert_allclose(cdpr.sweep(**ASKED, store=store).compute(), expected, rtol=ROUNDING, atol=0)
    kept = [file for file, time in before.items() if file.exists() and file.stat().st_mtime_ns == time]
    assert len(kept) >= 12  # three slabs of four, and the description


def test_half_of_all_chunks_lost_is_no_silent_nan(store, expected):
    """Ten of twenty deleted ``tilt`` chunks read as nan, and the sweep as finished."""
    for chunk in sorted(f for f in os.listdir(store / "tilt") if f[0].isdigit())[::2]:
        (store / "tilt" / chunk).unlink()
    with pytest.raises(cdpr.StoreError, match=r"has lost slab 0.0.0.0 of 'tilt', and 7 more"):
        cdpr.open_sweep(store)
    xr.testing.assert_allclose(cdpr.sweep(**ASKED, store=store).compute(), expected, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize(
    ("name", "damage"), [("status", "flipped"), ("tensions", "cut"), ("status", "empty"), ("tensions", "noise")]
)
def test_a_corrupt_chunk_is_one_sentence_that_names_it(store, expected, name, damage):
    """One bit is enough: each chunk carries a checksum. Removed, it is computed again."""
    file = store / name / "1.5.0.0" if name == "status" else store / name / "1.5.0.0.0"
    content = bytearray(file.read_bytes())
    if damage == "flipped":
        content[-9] ^= 1
    file.write_bytes({"flipped": content, "cut": content[:-5], "empty": b"", "noise": os.urandom(999)}[damage])
    with pytest.raises(cdpr.StoreError, match=rf"sweep\.zarr: slab {file.name} of '{name}' is corrupt; remove") as told:
        cdpr.open_sweep(store).compute()
    assert "\n" not in str(told.value)
    if name == "tensions":
        file.unlink()
    xr.testing.assert_allclose(cdpr.sweep(**ASKED, store=store).compute(), expected, rtol=ROUNDING, atol=0)


def test_a_store_is_plain_zarr(store, expected):
    """Readable by whoever knows nothing of us."""
    plain = xr.open_zarr(store, consolidated=False).compute()
    xr.testing.assert_identical(plain, expected)


ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])}

LONG = ASKED | dict(grid=(32, 10, 10))
"""64 chunks: four slabs of 16."""

CHILD = f"""
import sys
import cdpr_sim as cdpr
try:
    cdpr.sweep(**{LONG!r}, store=sys.argv[1])
except cdpr.CdprError as error:
    print(error)
    sys.exit(7)
"""


def start(path: Path) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])}
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)], env=environment, stdout=subprocess.PIPE, text=True
    )


def test_of_two_processes_at_one_store_one_goes_on_and_the_other_says_who(tmp_path):
    """Both failed, with an error of xarray's."""
    path = tmp_path / "sweep.zarr"
    running = [start(path), start(path)]
    try:
        said = [process.communicate(timeout=300)[0] for process in running]
    finally:
        for process in running:
            process.kill()
            process.communicate()
    codes = sorted(process.returncode for process in running)
    assert codes in ([0, 7], [0, 0]), said  # or one came when the other had finished
    if codes == [0, 7]:
        assert "sweep.zarr is being written to by" in "".join(said)
    assert [entry.name for entry in tmp_path.iterdir()] == ["sweep.zarr"]
    assert int((cdpr.open_sweep(path)["status"] == stores.PENDING).sum()) == 0


def test_who_holds_a_store_is_said(tmp_path):
    """Its process and machine, as long as it lives; afterwards the sweep goes on."""
    path = tmp_path / "sweep.zarr"
    with stores._held(path):
        holding = subprocess.run(
            [sys.executable, "-c", CHILD, str(path)],
            env=ENVIRONMENT,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert holding.returncode == 7, holding.stderr
        assert f"is being written to by process {os.getpid()} on " in holding.stdout
        result = CliRunner().invoke(app, ["sweep", "cogiro", "--grid", "2", "1", "1", "-o", str(path)])
        assert result.exit_code == 3
    cdpr.sweep("cogiro", (2, 1, 1), store=path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["sweep.zarr"]


def test_a_lock_of_a_killed_process_holds_nobody_up(tmp_path):
    """The file is there; nobody holds it."""
    path = tmp_path / "sweep.zarr"
    child = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys, time; from pathlib import Path; from cdpr_sim.analysis.workspace import store\n"
            "with store._held(Path(sys.argv[1])):\n    print('held', flush=True); time.sleep(60)",
            str(path),
        ],
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout.readline() == "held\n"
    finally:
        with suppress(ProcessLookupError):
            child.send_signal(signal.SIGKILL)
        child.communicate()
    assert (tmp_path / ".sweep.zarr.lock").exists()
    cdpr.sweep("cogiro", (2, 1, 1), store=path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["sweep.zarr"]


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_a_users_folder_beside_the_store_is_left_alone(tmp_path, suffix):
    """``.sweep.zarr.part`` is no name of ours to delete, whoever made it."""
    names = [f".sweep{suffix}.part", f".sweep{suffix}-mine.part"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").write_text("mine")
        (tmp_path / name / ".zattrs").write_text(json.dumps({"title": "mine"}))
    cdpr.sweep("cogiro", (2, 1, 1), store=tmp_path / f"sweep{suffix}")
    assert all((tmp_path / name / "thesis.tex").read_text() == "mine" for name in names)
    assert len(list(tmp_path.iterdir())) == 3


def test_what_a_process_that_was_killed_began_is_cleared(tmp_path, monkeypatch):
    """Ours is known by its description."""
    monkeypatch.setattr(stores.os, "rename", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    monkeypatch.setattr(stores.shutil, "rmtree", lambda *_, **__: None)
    with pytest.raises(KeyboardInterrupt):
        cdpr.sweep("cogiro", (2, 1, 1), store=tmp_path / "sweep.zarr")
    monkeypatch.undo()
    assert len(list(tmp_path.glob(".sweep.zarr-*.part"))) == 1
    cdpr.sweep("cogiro", (2, 1, 1), store=tmp_path / "sweep.zarr")
    assert [entry.name for entry in tmp_path.iterdir()] == ["sweep.zarr"]


def test_a_sweep_that_cannot_fit_is_refused_and_one_into_a_store_is_not(tmp_path, monkeypatch):
    """By the memory there is; by the disk where it goes there; never where nothing is computed."""
    monkeypatch.setattr(sweeping.free_ram, "available", lambda: 1e6)
    with pytest.raises(cdpr.InvalidInput, match=r"10,000 poses would take about .* MB of memory, and 1 MB are"):
        cdpr.sweep("cogiro")
    with pytest.raises(cdpr.InvalidInput, match="expected fewer poses"):
        cdpr.check("cogiro")
    cdpr.sweep("cogiro", compute=False)
    cdpr.sweep("cogiro", (2, 2, 2))
    assert cdpr.sweep("cogiro", (10, 10, 10), store=tmp_path / "sweep.zarr").sizes["x"] == 10
    monkeypatch.setattr(sweeping.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 10**5))
    with pytest.raises(cdpr.InvalidInput, match="are free in"):
        cdpr.sweep("cogiro", store=tmp_path / "other.zarr")


def test_the_estimate_of_memory_is_right_within_a_factor_of_three():
    """The result alone, as it lies in memory, against what is said of it."""
    dataset = cdpr.sweep("cogiro", (20, 10, 10))
    said = []
    sweeping.free_ram.refuse_beyond, kept = (
        (lambda what, need, instead: said.append(need)),
        sweeping.free_ram.refuse_beyond,
    )
    try:
        cdpr.sweep("cogiro", (20, 10, 10))
    finally:
        sweeping.free_ram.refuse_beyond = kept
    assert 1 < said[-1] / dataset.nbytes < 3  # the first is of the grid's coordinates alone


def test_more_cables_than_bits_are_not_told_apart_wrongly():
    """``slack_set`` of 64 cables would overflow."""
    angles = np.linspace(0, 2 * np.pi, 70, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.full(70, 2.0)])
    robot = cdpr.Robot(ring, 0.1 * ring - [0, 0, 0.2], 1e4, 1.0)
    with pytest.raises(cdpr.InvalidInput, match="slack_set has bits for 63 cables at most, and 'robot' has 70"):
        cdpr.sweep(robot, (2, 1, 1))
    assert cdpr.sweep(robot, (2, 1, 1), quantities=["tilt"]).sizes["x"] == 2
