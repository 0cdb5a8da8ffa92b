"""Sweeps on disk: the same numbers, resumed after an interruption, never read where something is lost."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from inputs import run

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace import sweep as sweeping

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


def modified(path: Path, name: str = "tilt") -> dict[str, int]:
    """When each chunk of a variable was written."""
    return {file.name: file.stat().st_mtime_ns for file in (path / name).iterdir() if file.name[0].isdigit()}


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
    return Path(shutil.copytree(finished, tmp_path / "sweep.zarr"))


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_what_is_stored_is_what_was_swept(expected, finished, tmp_path, suffix, monkeypatch):
    """All numbers, types, coordinates and units; a finished store is read and not computed again; Zarr is plain."""
    path = finished if suffix == ".zarr" else tmp_path / "sweep.nc"
    if suffix == ".zarr":
        monkeypatch.setattr(sweeping, "solve_many", None)
    stored = cdpr.sweep(**ASKED, store=path).compute()
    assert_same(stored, expected)
    for name in expected.variables:
        for attribute in ("units", "long_name"):
            assert stored[name].attrs.get(attribute) == expected[name].attrs.get(attribute)
    assert (stored["status"].dtype, stored["feasible"].dtype) == (np.int8, bool)
    xr.testing.assert_identical(cdpr.open_sweep(path).compute(), stored)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    if suffix == ".zarr":  # every chunk is a file, also one that is zero, whose loss could not be told from it
        xr.testing.assert_identical(xr.open_zarr(path, consolidated=False).compute(), stored)
        assert [len(modified(path, name)) for name in (*ASKED["quantities"], "status")] == [8] * 4
        assert not expected["status"].any()


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


@pytest.mark.slow
def test_killed_sweep_goes_on_where_it_stopped(expected, tmp_path):
    """Killed with SIGKILL while it writes: the store reads as unfinished, and the next run keeps what is there.

    As long as it lives, nobody else writes to the store: who has it is said. Its lock then holds nobody up.
    """
    path = tmp_path / "sweep.zarr"
    environment = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])}
    words, pipe = [sys.executable, "-c", CHILD, str(path)], subprocess.PIPE
    process = subprocess.Popen(words, env=environment, stdin=pipe, stdout=pipe, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "writes\n"
        before = modified(path)
        with pytest.raises(cdpr.StoreError, match=rf"is being written to by process {process.pid} on \S+; try again"):
            cdpr.sweep(**ASKED, store=path)
        assert run("sweep", "cogiro", "--grid", "2", "1", "1", "-o", path).exit_code == 3
        assert modified(path) == before
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
    kept = {name: time for name, time in before.items() if name.startswith("0.")}
    assert len(kept) == TASKS
    assert_same(cdpr.sweep(**ASKED, store=path).compute(), expected)
    assert modified(path).items() & before.items() == kept.items()
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


OTHERS = [
    dict(grid=(4, 5, 4)), dict(robots=["cogiro", "parallel"]), dict(materials=["fishing-0.4mm"]),
    dict(robots=["parallel", cdpr.load_robot("cogiro").replace(mass=0.41)]), dict(tension_limits=(0, 5)),
    dict(external_wrench=[0, 0, 1.0, 0, 0, 0]), dict(orientation=(0, 0, 0.1)), dict(quantities=["tilt"]),
    dict(chunk=50),
]  # fmt: skip


def test_store_of_another_sweep_or_of_something_else_is_left_alone(finished, store, tmp_path):
    """Any difference that changes a number or its place: refused, before anything is computed or written."""
    before = modified(finished)
    for other in OTHERS:
        with pytest.raises(cdpr.InvalidInput, match="exists and holds something else"):
            cdpr.sweep(**(ASKED | other), store=finished)
    assert modified(finished) == before
    (tmp_path / "mine.zarr").mkdir()
    for file in ("mine.zarr/note", "mine.nc"):
        (tmp_path / file).write_text("mine")
    (store / ".zattrs").write_text("{")  # its description as a whole is lost: another sweep could be in it
    for name, kind, message in [
        ("mine.zarr", cdpr.InvalidInput, "holds something else"),
        ("mine.nc", cdpr.InvalidInput, "exists; expected a new name"),
        ("mine.csv", cdpr.InvalidInput, "expected a name that ends in .zarr or .nc"),
        ("nowhere/sweep.zarr", cdpr.InvalidInput, "found no folder"),
        ("sweep.zarr", cdpr.StoreError, r"has lost its \.zattrs.* expected a new name"),
    ]:
        with pytest.raises(kind, match=message):
            cdpr.sweep(**ASKED, store=tmp_path / name)
    assert (tmp_path / "mine.zarr" / "note").read_text() == (tmp_path / "mine.nc").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 3


def test_a_robot_is_known_by_its_numbers(tmp_path):
    """However they were given: in lists or arrays, one stiffness for all or one each."""
    robot = cdpr.load_robot("two-cable")
    ask = dict(grid=(2, 1, 1), quantities=["tilt"], store=tmp_path / "sweep.zarr")
    cdpr.sweep(robot.replace(axial_stiffness=1000.0, frame=robot.frame), **ask)
    cdpr.sweep(robot.replace(axial_stiffness=[1000.0, 1000.0], exits=robot.exits.tolist(), frame=robot.frame), **ask)
    with pytest.raises(cdpr.InvalidInput, match="holds something else"):
        cdpr.sweep(robot.replace(axial_stiffness=[1000.0, 1000.1]), **ask)


# ----------------------------------------------------------------------------------------- what is lost or corrupt


def flipped(file: Path) -> None:
    """One bit in the middle: each chunk carries a checksum."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:9])


DAMAGES: list[tuple[str, Callable[[Path], object], str]] = [  # a part of a store, what happens to it, and the sentence
    ("tensions/0.2.0.0.0", cut, "slab 0.2.0.0.0 of 'tensions' is corrupt"),
    ("status/1.3.0.0", Path.unlink, "slab 1.3.0.0 of 'status'"),
    ("feasible/1.3.0.0", Path.unlink, "has lost slab 1.3.0.0 of 'feasible'"),
    ("tilt/1.3.0.0", flipped, "slab 1.3.0.0 of 'tilt' is corrupt"),
    ("x/0", flipped, "'x'"), ("x/.zattrs", flipped, ""), ("robot_file/0", Path.unlink, "'robot_file'"),
    (".zgroup", Path.unlink, "has lost a description"), ("tilt/.zarray", cut, "has lost a description"),
    ("tilt", shutil.rmtree, "has lost 'tilt'"),
]  # fmt: skip


@pytest.mark.parametrize(("place", "damage", "words"), DAMAGES)
def test_what_is_lost_or_corrupt_is_one_sentence_and_the_same_sweep_computes_it_again(
    store, expected, place, damage, words
):
    """Whether it is read or not; also coordinates, status and descriptions. It is never read as nan or as less."""
    damage(store / place)
    before = modified(store) if (store / "tilt").exists() else {}
    if words:  # a unit that is another word is noticed by whom knows which it should be
        with pytest.raises(cdpr.CdprError) as told:
            cdpr.open_sweep(store).compute()
        assert all(part in str(told.value) for part in (words, str(store)))
        assert "\n" not in str(told.value)
    with pytest.warns(cdpr.StoreRepaired, match=r"found .* lost or corrupt; computing again"):
        assert_same(cdpr.sweep(**ASKED, store=store).compute(), expected)
    xr.testing.assert_identical(cdpr.open_sweep(store).compute(), cdpr.sweep(**ASKED, store=store).compute())
    if place.startswith(("status/1", "tilt/1", "feasible/1")):  # nothing of the other slab
        assert {name[0] for name, _ in modified(store).items() & before.items()} == {"0"}


def test_the_command_says_what_it_repairs(tmp_path):
    """In a line on standard error, once."""
    words = ["sweep", "cogiro", "--grid", "3", "1", "1", "-o", tmp_path / "s.zarr"]
    assert run(*words).exit_code == 0
    flipped(tmp_path / "s.zarr" / "tilt" / "0.0.0.0")
    results = [run(*words) for _ in range(2)]
    assert [result.exit_code for result in results] == [0, 0]
    assert [result.stderr.count("lost or corrupt; computing again") for result in results] == [1, 0]
    assert f"cdpr-sim: warning: store: {tmp_path / 's.zarr'}: found " in results[0].stderr


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
