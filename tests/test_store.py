import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace import sweep as sweeping

ASKED = dict(robots=["parallel", "cogiro"], grid=(8, 10, 10), chunk=100, quantities=["tilt", "tensions", "feasible"])
"""16 chunks."""

TASKS = 4
"""Chunks per slab in these tests: four slabs."""

ROUNDING = 1e-14
"""Relative: with NumPy 2.0 a tilt differs in the last place between one chunk and another; with 2.4 all is equal to the
bit. Taken for how it rounds the ends of arrays."""


def assert_same(found: "xr.Dataset", expected: "xr.Dataset") -> None:
    """The same variables, dimensions and coordinates, and the same numbers but for rounding."""
    xr.testing.assert_allclose(found, expected, rtol=ROUNDING, atol=0)


@pytest.fixture(autouse=True)
def small_slabs(monkeypatch):
    """Four of them."""
    monkeypatch.setattr(stores, "TASKS", TASKS)


@pytest.fixture(scope="module")
def expected() -> xr.Dataset:
    """The same sweep in memory."""
    return cdpr.sweep(**ASKED)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished store."""
    path = tmp_path_factory.mktemp("finished") / "sweep.zarr"
    cdpr.sweep(**ASKED, store=path)
    return path


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_what_is_stored_is_what_was_swept(expected, tmp_path, suffix):
    """All numbers, types, coordinates and units, to the last bit, from NetCDF and from Zarr."""
    path = tmp_path / f"sweep{suffix}"
    stored = cdpr.sweep(**ASKED, store=path).compute()
    assert_same(stored, expected)
    for name in expected.variables:
        for attribute in ("units", "long_name"):
            assert stored[name].attrs.get(attribute) == expected[name].attrs.get(attribute)
    assert stored["status"].dtype == np.int8
    assert stored["feasible"].dtype == bool
    xr.testing.assert_identical(cdpr.open_sweep(path).compute(), stored)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_finished_store_is_read_and_not_computed_again(expected, finished, monkeypatch):
    """The same call a second time costs nothing."""
    monkeypatch.setattr(sweeping, "solve_many", None)
    assert_same(cdpr.sweep(**ASKED, store=finished).compute(), expected)


SETTLED = dict(robots=["cogiro"], grid=(8, 4, 4), chunk=16, quantities=["position", "settled"])
"""8 chunks, so two slabs in these tests."""


CHILD = f"""
import sys, time
import xarray as xr
import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store

write = xr.Dataset.to_zarr

def slowly(*args, **kwargs):
    write(*args, **kwargs)
    time.sleep(0.3)

store.TASKS, xr.Dataset.to_zarr = {TASKS}, slowly
cdpr.sweep(**{ASKED!r}, store=sys.argv[1])
"""
"""Sweeps slowly into the store that it is given."""


def test_killed_sweep_goes_on_where_it_stopped(expected, tmp_path):
    """Killed with SIGKILL while it writes: the store reads as unfinished, and the next run keeps what is there."""
    path = tmp_path / "sweep.zarr"
    process = subprocess.Popen([sys.executable, "-c", CHILD, str(path)], env=os.environ | {"PYTHONPATH": sys.path[0]})
    done = []
    while len(done) < TASKS * ASKED["chunk"]:
        assert process.poll() is None, "the sweep ended before it could be killed"
        time.sleep(0.1)  # each look costs as much as a chunk
        done = _solved_poses(path)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    with pytest.raises(cdpr.InvalidInput, match=r"is unfinished: .* are pending"):
        cdpr.open_sweep(path)
    plain = xr.open_zarr(path, consolidated=False).compute()  # by someone who knows nothing of us
    pending = plain["status"] == stores.PENDING
    assert 0 < int(pending.sum()) < pending.size
    assert_same(plain.where(~pending, drop=False)["tilt"], expected["tilt"].where(~pending))
    assert np.isfinite(plain["tensions"].where(~pending, 0.0)).all()

    kept = _modified(path, ~pending)
    assert kept
    assert_same(cdpr.sweep(**ASKED, store=path).compute(), expected)
    assert _modified(path, ~pending) == kept


@pytest.mark.parametrize(("asked", "slabs"), [(ASKED, 4), (SETTLED, 2)], ids=["solved", "settled"])
def test_interrupted_sweep_goes_on_after_every_slab(asked, slabs, tmp_path, monkeypatch):
    """Broken off after each slab in turn, between the numbers and their status, where it is most delicate."""
    path = tmp_path / "sweep.zarr"
    write = stores._write_slab
    for turn in range(1, 10):
        written = []

        def broken(piece, path, slab, written=written):
            if written:
                part = piece.drop_vars([*piece.coords, "status"]).persist()
                part.to_zarr(path, region=slab, consolidated=False, zarr_format=2)
                raise KeyboardInterrupt
            write(piece, path, slab)
            written.append(slab)

        monkeypatch.setattr(stores, "_write_slab", broken)
        try:
            stored = cdpr.sweep(**asked, store=path)
            break
        except KeyboardInterrupt:
            status = xr.open_zarr(path, consolidated=False)["status"]
            assert int((status != stores.PENDING).sum()) == turn * TASKS * asked["chunk"]
    assert turn == slabs
    assert_same(stored.compute(), cdpr.sweep(**asked))


# With Python 3.13 a buffer in which h5netcdf was writing cannot be cleared, and Python says so.
@pytest.mark.filterwarnings("ignore:Exception ignored in. <_io.BytesIO:pytest.PytestUnraisableExceptionWarning")
def test_full_disk_is_one_sentence_and_nothing_is_lost(expected, tmp_path):
    """Files may not grow beyond 4 kB: the tensions cannot be written. With room again the sweep goes on."""
    path = tmp_path / "sweep.zarr"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(cdpr.StoreError, match=r"sweep.zarr cannot be written: .*continues from there"):
            cdpr.sweep(**ASKED, store=path)
        with pytest.raises(cdpr.StoreError, match=r"sweep.nc cannot be written"):
            cdpr.sweep(**ASKED, store=tmp_path / "sweep.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["sweep.zarr"]
    with pytest.raises(cdpr.InvalidInput, match="unfinished"):
        cdpr.open_sweep(path)
    assert_same(cdpr.sweep(**ASKED, store=path).compute(), expected)


def test_store_of_another_sweep_is_left_alone(finished):
    """Any difference that changes a number or its place: refused, before anything is computed or written."""
    before = _modified(finished)
    assert len(before) == 16
    for other in (
        dict(grid=(8, 10, 9)),
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


def _solved_poses(path) -> list:
    """The statuses of the poses that are solved: the last thing that is written of a slab."""
    try:
        status = xr.open_zarr(path, consolidated=False)["status"].values
    except (OSError, KeyError, ValueError):
        return []
    return list(status[status != stores.PENDING])


def _modified(path, known=None) -> dict:
    """When each chunk of the tilt was written; only of slabs that are whole, if it is given which poses are ``known``.

    A slab that was being finished when the process was killed has to be written again.
    """
    times = {file.name: file.stat().st_mtime_ns for file in (path / "tilt").iterdir() if file.name[0].isdigit()}
    if known is None:
        return times
    chunks = known.values.all(axis=(2, 3))
    whole = chunks.reshape(len(chunks), -1, TASKS).all(axis=2)
    robots, columns = np.nonzero(np.repeat(whole, TASKS, axis=1))
    return {name: times[name] for name in {f"{r}.{x}.0.0" for r, x in zip(robots, columns, strict=True)}}
