"""Stored sweeps: in memory, in NetCDF at once, or in Zarr slab by slab, so that an interrupted sweep can be resumed.

A Zarr store is its own record of progress. It is created complete, with every ``status`` *pending*; then slabs
are computed and written one after the other, their status last. So whenever the process is killed, rows that are marked
as solved are complete, missing ones are pending, and the next run fills in the slabs that have a pending pose.

Every chunk is a file, also one of zeros, and has a checksum: a chunk that is lost or corrupt later is
detected, and never read as zeros. One process at a time writes to a store, by a lock beside it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cdpr_sim.core import extras
from cdpr_sim.core.checks import checked_path as given_path
from cdpr_sim.core.errors import InvalidInput, StoreError
from cdpr_sim.core.files import refuse_unwritable, target
from cdpr_sim.core.progress import bar
from cdpr_sim.core.status import Status

if TYPE_CHECKING:
    import xarray as xr

PENDING = Status.PENDING.value
"""The status of a pose that is not computed yet."""

TASKS = 16
"""Chunks that are computed between two writes to the store, or two updates of the progress bar."""

DIMENSIONS = ("robot", "x", "y", "z")
"""Dimensions along which slabs are divided."""


def checked_path(store: str | Path) -> Path:
    """``store`` as a path that can be written.

    Raises:
        InvalidInput: neither .zarr nor .nc, no such folder, one that cannot be written to, or an existing NetCDF file.
    """
    path = given_path("store", store)
    if path.suffix not in {".zarr", ".nc"}:
        raise InvalidInput(f"store: found {path.name!r}, expected a name that ends in .zarr or .nc")
    if not path.parent.is_dir():
        raise InvalidInput(f"store: found no folder {str(path.parent)!r} for {path.name!r}, expected one that exists")
    if path.suffix == ".nc" and path.exists():
        raise InvalidInput(f"store: {path} exists; expected a new name, since a finished file is never replaced")
    refuse_unwritable(path)
    return path


def open_sweep(store: str | Path) -> xr.Dataset:
    """A finished sweep, read slab by slab as it is used.

    Args:
        store: the .nc file or the .zarr folder that ``sweep`` wrote.

    Returns:
        What ``sweep`` returned, backed by the file.

    Raises:
        InvalidInput: there is no sweep, or it is unfinished.
        StoreError: a chunk of it is lost or corrupt: raised here, or when it is read.
    """
    extras.require("sweep", "open_sweep")
    import xarray as xr

    path = given_path("store", store)
    try:
        dataset = xr.open_dataset(path, chunks={}) if path.suffix == ".nc" else _open_zarr(path)
        missing = int((dataset["status"] == PENDING).sum())
    except StoreError:
        raise
    except (OSError, ValueError, KeyError):
        raise InvalidInput(f"store: found no sweep in {path}") from None
    if missing:
        raise InvalidInput(
            f"store: {path} is unfinished: {missing} of {dataset['status'].size} poses are pending; "
            "run the same sweep again, which resumes it"
        )
    lost = _losses(dataset, path) if path.suffix != ".nc" else []
    if lost:
        name, chunk = lost[0]
        more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
        raise StoreError(
            f"store: {path} has lost slab {'.'.join(map(str, chunk))} of {name!r}{more}; run the same sweep "
            "again, which computes what is lost"
        )
    return dataset


def computed(dataset: xr.Dataset, *, progress: bool) -> xr.Dataset:
    """``dataset`` in memory, by the current scheduler of Dask: threads, or the cluster that is connected."""
    if not progress:
        return dataset.compute()
    from dask.base import compute
    from dask.callbacks import Callback

    with bar("sweep", 1) as advance:

        def finished(key, result, graph, state, worker):
            advance(1 / sum(len(state[kind]) for kind in ("waiting", "ready", "running", "finished")))

        with Callback(posttask=finished):
            return compute(dataset)[0]


def written(dataset: xr.Dataset, path: Path, identity: Sequence[Any], *, progress: bool) -> xr.Dataset:
    """Compute ``dataset`` into ``path`` and read it from there; in an unfinished Zarr store, only what is missing.

    Raises:
        InvalidInput: the store holds something else.
        StoreError: it cannot be written, as on a full disk, or another process writes to it; its content is kept.
    """
    dataset.attrs["identity"] = _digest(identity)
    try:
        with _held(path):
            if path.suffix == ".nc":
                _write_netcdf(computed(dataset, progress=progress), path)
            else:
                if not path.exists():
                    _create(dataset, path)
                elif _identity_of(path) != dataset.attrs["identity"]:
                    raise InvalidInput(
                        f"store: {path} exists and holds something else; expected a new name, or the very sweep that "
                        "was begun there"
                    )
                _mend_coordinates(dataset, path)
                _fill(dataset, path, progress=progress)
    except StoreError:
        raise
    except OSError as error:
        kept = "; what is written stays, and the same sweep continues from there" if path.suffix == ".zarr" else ""
        raise StoreError(f"store: {path} cannot be written: {error.strerror or error}{kept}") from error
    return open_sweep(path)


def _write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write under another name until it is complete; HDF5 writes into memory, since a full disk would crash it."""
    # No view of xarray's buffer may remain in a traceback: garbage collection would crash Python 3.12.
    with memoryview(dataset.to_netcdf(engine="h5netcdf")) as content:
        path = target(path)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
        part = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            part.chmod(0o644)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


def _create(dataset: xr.Dataset, path: Path) -> None:
    """Create the store with coordinates and every status pending, under another name until it is complete."""
    from numcodecs import Zstd

    for left in path.parent.glob(f".{path.name}-*.part"):
        if _identity_of(left) is not None:  # ours, of a process that was killed
            shutil.rmtree(left, ignore_errors=True)
    part = Path(tempfile.mkdtemp(prefix=f".{path.name}-", suffix=".part", dir=path.parent))
    compressor = Zstd(level=1, checksum=True)  # a checksum of each chunk
    try:
        dataset.to_zarr(
            part, mode="w", compute=False, consolidated=False, zarr_format=2, write_empty_chunks=True,
            encoding={str(name): {"compressors": compressor} for name in dataset.variables},
        )  # fmt: skip
        status = dataset["status"]
        pending = status.drop_vars(list(status.coords)).to_dataset()
        pending["status"] = status.dims, np.full(status.shape, PENDING, status.dtype)
        everywhere = {str(name): slice(None) for name in status.dims}
        _write_region(pending, part, everywhere)
        os.chmod(part, 0o755)
        os.rename(part, path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _mend_coordinates(dataset: xr.Dataset, path: Path) -> None:
    """Rewrite lost or corrupt coordinates, which are written with the store, and not slab by slab."""
    try:
        _open_zarr(path).coords.to_dataset().load()
    except StoreError:
        dataset[list(dataset.coords)].to_zarr(
            path, mode="a", consolidated=False, zarr_format=2, write_empty_chunks=True
        )


def _fill(dataset: xr.Dataset, path: Path, *, progress: bool) -> None:
    on_disk = _open_zarr(path)
    lost = _losses(on_disk, path)
    slabs = list(_slabs(dataset))
    with bar(f"sweep into {path.name}", len(slabs), show=progress) as advance:
        for slab in slabs:
            if _is_pending(on_disk, slab, lost):
                _write_slab(dataset.isel(slab), path, slab)
            advance(1)


def _is_pending(on_disk: xr.Dataset, slab: dict[str, slice], lost: list[tuple[str, tuple[int, ...]]]) -> bool:
    """Whether a part of the slab has to be computed, or computed again."""
    for name, chunk in lost:
        sizes = dict(zip(map(str, on_disk[name].dims), on_disk[name].encoding["chunks"], strict=True))
        first = {dim: number * sizes[dim] for dim, number in zip(sizes, chunk, strict=True)}
        if all(part.start <= first[dim] < part.stop for dim, part in slab.items() if dim in first):
            return True
    try:
        return bool((on_disk["status"].isel(slab) == PENDING).any())
    except StoreError:  # a corrupt status
        return True


def _write_slab(piece: xr.Dataset, path: Path, slab: dict[str, slice]) -> None:
    piece = piece.drop_vars(list(piece.coords)).persist()
    for names in ([name for name in piece.data_vars if name != "status"], ["status"]):
        _write_region(piece[names], path, slab)


def _write_region(piece: xr.Dataset, path: Path, slab: dict[str, slice]) -> None:
    piece.to_zarr(path, region=slab, consolidated=False, zarr_format=2, write_empty_chunks=True)


@contextmanager
def _held(path: Path) -> Iterator[None]:
    """Lock the store for this process.

    Raises:
        StoreError: another process has it.
    """
    from filelock import FileLock, Timeout

    file = path.with_name(f".{path.name}.lock")
    holder = "another process"
    with suppress(OSError, UnicodeDecodeError):
        holder = file.read_text(encoding="utf-8") or holder
    lock = FileLock(file, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise StoreError(f"store: {path} is being written to by {holder}; try again later") from None
    except NotImplementedError:  # a file system without locks: treated as locked
        yield
        return
    try:
        file.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
        yield
    finally:
        with suppress(OSError):
            file.unlink()
        lock.release()


def _losses(dataset: xr.Dataset, path: Path) -> list[tuple[str, tuple[int, ...]]]:
    """Variables and chunks whose files are missing: all of them are written, also those of zeros."""
    lost = []
    for name, variable in dataset.variables.items():
        there = set(os.listdir(path / str(name)))
        chunks = variable.encoding["chunks"]
        counts = [-(-size // chunk) for size, chunk in zip(variable.shape, chunks, strict=True)]
        for chunk in np.ndindex(*counts):
            if (".".join(map(str, chunk)) or "0") not in there:
                lost.append((str(name), chunk))
    return lost


def _slabs(dataset: xr.Dataset) -> Iterator[dict[str, slice]]:
    """Pieces of about ``TASKS`` chunks, cut along whole chunks of the grid."""
    from dask.array.core import slices_from_chunks

    dims = [name for name in DIMENSIONS if name in dataset["status"].dims]
    sizes, left = {}, TASKS
    for name in reversed(dims):
        chunks = dataset["status"].chunksizes[name]
        per_slab = 1 if name == "robot" else min(len(chunks), max(1, left))
        left //= per_slab
        sizes[name] = [sum(chunks[first : first + per_slab]) for first in range(0, len(chunks), per_slab)]
    for slices in slices_from_chunks([sizes[name] for name in dims]):
        yield dict(zip(dims, slices, strict=True))


def _open_zarr(path: Path) -> xr.Dataset:
    import xarray as xr

    from cdpr_sim.analysis.workspace.checksummed_store import ChecksummedStore

    return xr.open_zarr(ChecksummedStore(path, read_only=True), consolidated=False)


def _identity_of(path: Path) -> str | None:
    try:
        found = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
        return found.get("identity") if isinstance(found, dict) else None
    except (OSError, ValueError):
        return None


def _digest(identity: Sequence[Any]) -> str:
    """Hash of everything that determines the numbers: the same for the same sweep, on any machine."""
    state = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, np.ndarray):
            add((str(value.dtype), value.shape))
            state.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, dict):
            add(list(value.items()))
        elif isinstance(value, (list, tuple)):
            state.update(f"[{len(value)}".encode())
            for item in value:
                add(item)
        elif hasattr(value, "__dataclass_fields__"):
            add({name: getattr(value, name) for name in value.__dataclass_fields__ if not name.startswith("_")})
        else:
            state.update(repr(value).encode())

    add(list(identity))
    return state.hexdigest()
