"""Sweeps on disk: the same numbers, resumed after an interruption, never read where something is lost."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace import sweep as sweeping
from cdpr_sim.cli import app

ASKED = dict(robots=["parallel", "cogiro"], grid=(4, 5, 5), chunk=25, quantities=["tilt", "tensions", "feasible"])
"""8 chunks, four for each robot."""

TINY = dict(robots="cogiro", grid=(2, 1, 1), quantities=["tilt"])

TASKS = 4
"""Chunks per slab in these tests: a slab for each robot."""

ROUNDING = 1e-14
"""Relative: with NumPy 2.0 a tilt differs in the last place between one chunk and another; with 2.4 all is equal to the
bit. Taken for how it rounds the ends of arrays."""


def assert_same(found: xr.Dataset, expected: xr.Dataset) -> None:
    """The same variables, dimensions and coordinates, and the same numbers but for rounding."""
    xr.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=0)


@pytest.fixture(scope="module", autouse=True)
def small_slabs():
    """Two of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stores, "TASKS", TASKS)
        yield


@pytest.fixture(scope="module")
def expected() -> xr.Dataset:
    """The same sweep in memory."""
    return cdpr.sweep(**ASKED)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A finished store, to be read or copied."""
    path = tmp_path_factory.mktemp("finished") / "sweep.zarr"
    cdpr.sweep(**ASKED, store=path)
    return path


@pytest.fixture
def store(finished, tmp_path) -> Path:
    """A copy to be damaged."""
    path = tmp_path / "sweep.zarr"
    shutil.copytree(finished, path)
    return path


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_what_is_stored_is_what_was_swept(expected, finished, tmp_path, suffix):
    """All numbers, types, coordinates and units, to the last bit, from NetCDF and from Zarr."""
    path = finished if suffix == ".zarr" else tmp_path / "sweep.nc"
    stored = cdpr.sweep(**ASKED, store=path).compute()
    assert_same(stored, expected)
    for name in expected.variables:
        for attribute in ("units", "long_name"):
            assert stored[name].attrs.get(attribute) == expected[name].attrs.get(attribute)
    assert stored["status"].dtype == np.int8
    assert stored["feasible"].dtype == bool
    xr.testing.assert_identical(cdpr.open_sweep(path).compute(), stored)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_finished_store_is_read_and_not_computed_again(expected, finished, monkeypatch):
    """The same call a second time costs nothing."""
    monkeypatch.setattr(sweeping, "solve_many", None)
    assert_same(cdpr.sweep(**ASKED, store=finished).compute(), expected)


CHILD = f"""
import sys
import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store

write, done = store._write_region, []

def paused(*given):
    write(*given)
    done.append(given)
    if len(done) == 4:
        print("writes", flush=True)
        sys.stdin.read()

store.TASKS, store._write_region = {TASKS}, paused
cdpr.sweep(**{ASKED!r}, store=sys.argv[1])
"""
"""Sweeps into the store that it is given, and waits when only the last status is missing.

It has written where all is pending, the numbers and the status of a slab, and the numbers of another.
"""


def test_killed_sweep_goes_on_where_it_stopped(expected, tmp_path):
    """Killed with SIGKILL while it writes: the store reads as unfinished, and the next run keeps what is there.

    As long as it lives, nobody else writes to the store: who has it is said. Its lock then holds nobody up.
    """
    path = tmp_path / "sweep.zarr"
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)],
        env=os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "writes\n"
        before = _modified(path)
        with pytest.raises(cdpr.StoreError, match=rf"is being written to by process {process.pid} on \S+; try again"):
            cdpr.sweep(**ASKED, store=path)
        result = CliRunner().invoke(app, ["sweep", "cogiro", "--grid", "2", "1", "1", "-o", str(path)])
        assert result.exit_code == 3
        assert _modified(path) == before
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert path.with_name(".sweep.zarr.lock").exists()
    with pytest.raises(cdpr.InvalidInput, match=r"is unfinished: 100 of 200 poses are pending"):
        cdpr.open_sweep(path)
    plain = xr.open_zarr(path, consolidated=False).compute()  # by someone who knows nothing of us
    pending = plain["status"] == stores.PENDING
    assert_same(plain["tilt"].where(~pending), expected["tilt"].where(~pending))
    assert np.isfinite(plain["tensions"].where(~pending, 0.0)).all()
    kept = {name: time for name, time in before.items() if name.startswith("0.")}
    assert len(kept) == TASKS
    assert_same(cdpr.sweep(**ASKED, store=path).compute(), expected)
    assert _modified(path).items() & before.items() == kept.items()
    assert [entry.name for entry in tmp_path.iterdir()] == ["sweep.zarr"]


def test_a_store_is_held_before_it_is_looked_at(tmp_path):
    """Of two processes that begin one store at once, both failed with an error of xarray's."""
    path = tmp_path / "sweep.zarr"
    with stores._held(path), pytest.raises(cdpr.StoreError, match=f"is being written to by process {os.getpid()} on "):
        cdpr.sweep(**TINY, store=path)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_sweep_goes_on_after_every_slab(tmp_path, monkeypatch):
    """Broken off after each slab in turn, where it is most delicate: of the next one, half of the status is missing."""
    asked = dict(robots=["cogiro"], grid=(3 * TASKS, 1, 1), chunk=1, quantities=["position", "settled"])
    path = tmp_path / "sweep.zarr"
    write = stores._write_slab
    for turn in range(1, 10):
        written = []

        def broken(piece, path, slab, written=written):
            if written:
                part = piece.drop_vars([*piece.coords, "status"]).persist()
                stores._write_region(part, path, slab)
                half = slice(slab["x"].start, slab["x"].start + TASKS // 2)
                status = piece.drop_vars(list(piece.coords))[["status"]].isel(x=slice(TASKS // 2))
                stores._write_region(status, path, slab | {"x": half})
                raise KeyboardInterrupt
            write(piece, path, slab)
            written.append(slab)

        monkeypatch.setattr(stores, "_write_slab", broken)
        try:
            stored = cdpr.sweep(**asked, store=path)
            break
        except KeyboardInterrupt:
            status = xr.open_zarr(path, consolidated=False)["status"]
            assert int((status != stores.PENDING).sum()) == turn * TASKS + TASKS // 2
    assert turn == 3
    assert_same(stored.compute(), cdpr.sweep(**asked))


# With Python 3.13 a buffer in which h5netcdf was writing cannot be cleared, and Python says so.
@pytest.mark.filterwarnings("ignore:Exception ignored in. <_io.BytesIO:pytest.PytestUnraisableExceptionWarning")
def test_full_disk_is_one_sentence_and_nothing_is_lost(expected, tmp_path):
    """Files may not grow beyond 1.2 kB: cogiro's tensions cannot be written. With room again the sweep goes on."""
    path = tmp_path / "sweep.zarr"
    resource = pytest.importorskip("resource", reason="Windows has no limits of the size of files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1200, hard))
    try:
        with pytest.raises(cdpr.StoreError, match=r"sweep.zarr cannot be written: .*continues from there"):
            cdpr.sweep(**ASKED, store=path)
        with pytest.raises(cdpr.StoreError, match=r"sweep.nc cannot be written"):
            cdpr.sweep(**ASKED, store=tmp_path / "sweep.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["sweep.zarr"]
    with pytest.raises(cdpr.InvalidInput, match="unfinished: 100 of 200"):
        cdpr.open_sweep(path)
    assert_same(cdpr.sweep(**ASKED, store=path).compute(), expected)


def test_store_of_another_sweep_is_left_alone(finished):
    """Any difference that changes a number or its place: refused, before anything is computed or written."""
    before = _modified(finished)
    assert len(before) == 8
    for other in (
        dict(grid=(4, 5, 4)),
        dict(robots=["cogiro", "parallel"]),
        dict(robots=["parallel", cdpr.load_robot("cogiro").replace(mass=0.41)]),
        dict(materials=["fishing-0.4mm"]),
        dict(tension_limits=(0, 5)),
        dict(external_wrench=[0, 0, 1.0, 0, 0, 0]),
        dict(orientation=(0, 0, 0.1)),
        dict(quantities=["tilt"]),
        dict(chunk=50),
    ):
        with pytest.raises(cdpr.InvalidInput, match="exists and holds something else"):
            cdpr.sweep(**(ASKED | other), store=finished)
    assert _modified(finished) == before


def test_a_robot_is_known_by_its_numbers(tmp_path):
    """However they were given: in lists or arrays, one stiffness for all or one each."""
    robot = cdpr.load_robot("two-cable")
    ask = dict(grid=(2, 1, 1), quantities=["tilt"], store=tmp_path / "sweep.zarr")
    cdpr.sweep(robot.replace(axial_stiffness=1000.0, frame=robot.frame), **ask)
    cdpr.sweep(robot.replace(axial_stiffness=[1000.0, 1000.0], exits=robot.exits.tolist(), frame=robot.frame), **ask)
    with pytest.raises(cdpr.InvalidInput, match="holds something else"):
        cdpr.sweep(robot.replace(axial_stiffness=[1000.0, 1000.1]), **ask)


def test_what_is_no_store_is_left_alone(tmp_path):
    """A folder of something else, a finished NetCDF file, another suffix, a folder that is not there."""
    (tmp_path / "mine.zarr").mkdir()
    (tmp_path / "mine.zarr" / "note").write_text("mine")
    (tmp_path / "mine.nc").write_text("mine")
    for name, message in [
        ("mine.zarr", "holds something else"),
        ("mine.nc", "exists; expected a new name"),
        ("mine.csv", "expected a name that ends in .zarr or .nc"),
        ("nowhere/sweep.zarr", "found no folder"),
    ]:
        with pytest.raises(cdpr.InvalidInput, match=message):
            cdpr.sweep(**ASKED, store=tmp_path / name)
    assert (tmp_path / "mine.zarr" / "note").read_text() == (tmp_path / "mine.nc").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


def test_open_sweep_says_where_there_is_none(tmp_path):
    """One sentence, not a traceback of a library."""
    (tmp_path / "mine.nc").write_text("mine")
    for name in ("nothing.zarr", "nothing.nc", "mine.nc"):
        with pytest.raises(cdpr.InvalidInput, match="found no sweep"):
            cdpr.open_sweep(tmp_path / name)


def test_every_chunk_is_a_file_also_one_that_is_zero(finished, expected):
    """A status that is all zero means converged, and was not written: its loss could not be told from it."""
    assert {name: len(_modified(finished, name)) for name in ASKED["quantities"]} == dict.fromkeys(
        ASKED["quantities"], 8
    )
    assert len(_modified(finished, "status")) == 8
    assert not expected["status"].any()


def test_a_lost_chunk_is_noticed_and_computed_again(store, expected):
    """One sentence that names the store and the slab; the same sweep then mends it, and nothing else."""
    last = {name: sorted(_modified(store, name))[-1] for name in ("status", "tensions", "exits", "x")}
    for name, chunk in last.items():
        (store / name / chunk).rename(store.parent / "lost")
        lost = (
            rf"sweep\.zarr(: slab {chunk} of '{name}' is lost| has lost slab {chunk} of '{name}'); run the same sweep"
        )
        with pytest.raises(cdpr.StoreError, match=lost):
            cdpr.open_sweep(store)
        (store.parent / "lost").rename(store / name / chunk)
    cdpr.open_sweep(store)
    for name, chunk in last.items():
        (store / name / chunk).unlink()
    before = _modified(store)
    with pytest.warns(cdpr.StoreRepaired, match=r"sweep\.zarr: found .* and 3 more files lost or corrupt; computing"):
        mended = cdpr.sweep(**ASKED, store=store)
    assert_same(mended.compute(), expected)
    kept = _modified(store).items() & before.items()
    assert {name[0] for name, _ in kept} == {"0"}
    assert len(kept) == TASKS


def test_half_of_all_chunks_lost_is_no_silent_nan(store):
    """Ten of twenty deleted ``tilt`` chunks read as nan, and the sweep as finished."""
    for chunk in sorted(_modified(store))[::2]:
        (store / "tilt" / chunk).unlink()
    with pytest.raises(cdpr.StoreError, match=r"has lost slab 0.0.0.0 of 'tilt', and 3 more"):
        cdpr.open_sweep(store)


def test_a_corrupt_chunk_is_one_sentence_that_names_it(store, expected):
    """One bit is enough: each chunk carries a checksum. The same sweep computes it again."""
    for name, damage in [("tensions", "cut"), ("tensions", "noise"), ("status", "empty"), ("status", "flipped")]:
        file = store / name / "1.3.0.0" if name == "status" else store / name / "0.2.0.0.0"
        intact = file.read_bytes()
        flipped = bytearray(intact)
        flipped[-1] ^= 1
        file.write_bytes({"flipped": flipped, "cut": intact[:-5], "empty": b"", "noise": os.urandom(999)}[damage])
        corrupt = rf"sweep\.zarr: slab {file.name} of '{name}' is corrupt; run the same sweep again"
        with pytest.raises(cdpr.StoreError, match=corrupt) as told:
            cdpr.open_sweep(store).compute()
        assert "\n" not in str(told.value)
        if damage not in ("noise", "flipped"):
            file.write_bytes(intact)
    statuses = stores._open_zarr(store)["status"]
    for place in range(len(intact)):  # some of them are numbers
        flipped = bytearray(intact)
        flipped[place] ^= 1
        file.write_bytes(flipped)
        try:
            read = statuses.compute()
        except cdpr.StoreError as told:
            assert re.search(corrupt, str(told))
        else:  # a reserved bit, which older versions of the decoder ignore; OpenGL's may come first in a process
            np.testing.assert_array_equal(read, expected["status"])
    file.write_bytes(intact[:-5])
    with pytest.warns(cdpr.StoreRepaired, match=r"found .*0 and 1 more files lost or corrupt"):
        assert_same(cdpr.sweep(**ASKED, store=store).compute(), expected)


def _flipped(file: Path) -> None:
    """One bit in the middle."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


ASKED_ON_THE_COMMAND_LINE = ["sweep", "cogiro", "--grid", "3", "1", "1"]


@pytest.fixture(scope="module")
def printed(tmp_path_factory) -> Path:
    """A finished store of the command."""
    path = tmp_path_factory.mktemp("printed") / "s.zarr"
    assert CliRunner().invoke(app, [*ASKED_ON_THE_COMMAND_LINE, "-o", str(path)]).exit_code == 0
    return path


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:9])


@pytest.mark.parametrize(
    ("place", "damage"),
    [
        ("iterations/0.0.0.0", _flipped), ("iterations/0.0.0.0", Path.unlink), ("tilt/0.0.0.0", _flipped),
        ("status/0.0.0.0", _flipped), ("x/0", _flipped), ("robot_file/0", Path.unlink), ("tilt/.zarray", _cut),
        ("x/.zattrs", _flipped), (".zgroup", Path.unlink),
    ],
)  # fmt: skip
def test_the_same_command_computes_again_what_is_lost_or_corrupt(printed, tmp_path, place, damage):
    """Whether its table reads it (tilt) or not (iterations); also coordinates, status and descriptions. It says so."""
    path = tmp_path / "s.zarr"
    shutil.copytree(printed, path)
    damage(path / place)
    results = [CliRunner().invoke(app, [*ASKED_ON_THE_COMMAND_LINE, "-o", str(path)]) for _ in range(2)]
    assert [result.exit_code for result in results] == [0, 0]
    assert [result.stderr.count("lost or corrupt; computing again") for result in results] == [1, 0]
    assert f"cdpr-sim: warning: store: {path}: found " in results[0].stderr
    xr.testing.assert_identical(cdpr.open_sweep(path).compute(), cdpr.open_sweep(printed).compute())


def test_a_lost_variable_is_no_smaller_sweep(printed, tmp_path):
    """A folder that is gone, or the description without which Zarr does not see it: refused, and computed again."""
    path = tmp_path / "s.zarr"
    for damage in (lambda: shutil.rmtree(path / "tilt"), (path / "tilt" / ".zarray").unlink):
        shutil.copytree(printed, path, dirs_exist_ok=True)
        damage()
        with pytest.raises(cdpr.StoreError, match="has lost 'tilt'; run the same sweep again"):
            cdpr.open_sweep(path)
        result = CliRunner().invoke(app, [*ASKED_ON_THE_COMMAND_LINE, "-o", str(path)])
        assert "lost or corrupt" in result.stderr
        xr.testing.assert_identical(cdpr.open_sweep(path).compute(), cdpr.open_sweep(printed).compute())


def test_a_store_that_does_not_say_what_it_holds_is_left_alone(store):
    """Its description as a whole is lost: another sweep could be in it."""
    (store / ".zattrs").write_text("{")
    with pytest.raises(cdpr.StoreError, match=r"has lost its \.zattrs.* expected a new name"):
        cdpr.sweep(**ASKED, store=store)


def test_a_store_is_plain_zarr(finished):
    """Readable by whoever knows nothing of us."""
    plain = xr.open_zarr(finished, consolidated=False).compute()
    xr.testing.assert_identical(plain, cdpr.open_sweep(finished).compute())


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_what_is_beside_the_store_is_left_alone_but_what_a_killed_process_began(tmp_path, monkeypatch, suffix):
    """``.sweep.zarr.part`` is no name of ours to delete, whoever made it. Ours is known by its description."""
    names = [f".sweep{suffix}.part", f".sweep{suffix}-mine.part"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").write_text("mine")
        (tmp_path / name / ".zattrs").write_text(json.dumps({"title": "mine"}))
    if suffix == ".zarr":
        monkeypatch.setattr(stores.os, "rename", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        monkeypatch.setattr(stores.shutil, "rmtree", lambda *_, **__: None)
        with pytest.raises(KeyboardInterrupt):
            cdpr.sweep(**TINY, store=tmp_path / "sweep.zarr")
        monkeypatch.undo()
        assert len(list(tmp_path.glob(".sweep.zarr-*.part"))) == 2
    cdpr.sweep(**TINY, store=tmp_path / f"sweep{suffix}")
    assert all((tmp_path / name / "thesis.tex").read_text() == "mine" for name in names)
    assert len(list(tmp_path.iterdir())) == 3


def _modified(path: Path, name: str = "tilt") -> dict[str, int]:
    """When each chunk of a variable was written."""
    return {file.name: file.stat().st_mtime_ns for file in (path / name).iterdir() if file.name[0].isdigit()}
