"""Stored sweeps: in memory, in NetCDF at once, or in Zarr slab by slab, so that an interrupted sweep can be resumed.

A Zarr store is its own record of progress. It is created complete, with every ``status`` *pending*; then slabs
are computed and written one after the other, their status last. So whenever the process is killed, rows that are marked
as solved are complete, missing ones are pending, and the next run fills in the slabs that have a pending pose.

Every chunk is a file, also one of zeros, and has a checksum: a chunk that is lost or corrupt later is
detected, and never read as zeros. The same sweep reads all chunks again before it continues, and computes those.
One process at a time writes to a store, by a lock beside it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import tempfile
import warnings
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cdpr_sim.core import extras
from cdpr_sim.core.checks import checked_path as given_path
from cdpr_sim.core.errors import InvalidInput, StoreError, StoreRepaired
from cdpr_sim.core.files import refuse_unwritable, target
from cdpr_sim.core.progress import bar
from cdpr_sim.core.status import Status

if TYPE_CHECKING:
    import xarray as xr

PENDING = Status.PENDING.value
"""The status of a pose that is not computed yet."""

TASKS = 16
"""Chunks that are computed between two writes to the store, or two updates of the progress bar."""

FILES = (".zarray", ".zattrs")
"""What describes a variable in a Zarr store."""

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
    except (OSError, ValueError, KeyError, TypeError):
        if path.suffix == ".zarr" and _identity_of(path) is not None:
            raise StoreError(
                f"store: {path} has lost a description of its variables, or it is corrupt; run the same sweep again, "
                "which writes it"
            ) from None
        raise InvalidInput(f"store: found no sweep in {path}") from None
    if missing:
        raise InvalidInput(
            f"store: {path} is unfinished: {missing} of {dataset['status'].size} poses are pending; "
            "run the same sweep again, which resumes it"
        )
    lost = [] if path.suffix == ".nc" else [one for one in _chunks(dataset) if not (path / one[0] / one[1]).exists()]
    if lost:
        name, chunk = lost[0]
        more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
        raise StoreError(
            f"store: {path} has lost slab {chunk} of {name!r}{more}; run the same sweep again, "
            "which computes what is lost"
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
    """Compute ``dataset`` into ``path`` and read it from there; in a Zarr store, only what is missing or corrupt.

    Warns:
        StoreRepaired: something was lost or corrupt, and is computed again.

    Raises:
        InvalidInput: the store holds something else.
        StoreError: it cannot be written, as on a full disk, or another process writes to it; its content is kept.
    """
    dataset.attrs["identity"] = _digest(identity)
    if path.suffix == ".zarr":
        dataset.attrs["variables"] = sorted(map(str, dataset.variables))
    try:
        with _held(path):
            if path.suffix == ".nc":
                _write_netcdf(computed(dataset, progress=progress), path)
            else:
                if not path.exists():
                    _create(dataset, path)
                    slabs = list(_slabs(dataset))
                else:
                    _refuse_another(dataset, path)
                    slabs = _repair(dataset, path, progress=progress)
                _fill(dataset, path, slabs, progress=progress)
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


@contextmanager
def _described(dataset: xr.Dataset, path: Path) -> Iterator[Path]:
    """A folder beside the store with its descriptions and coordinates, and no other chunk; removed at the end."""
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
        root = part / ".zattrs"
        attributes = json.loads(root.read_text(encoding="utf-8")) | {"descriptions": _descriptions(part)}
        root.write_text(json.dumps(attributes, indent=2), encoding="utf-8")
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _create(dataset: xr.Dataset, path: Path) -> None:
    """Create the store with coordinates and every status pending, under another name until it is complete."""
    with _described(dataset, path) as part:
        status = dataset["status"]
        pending = status.drop_vars(list(status.coords)).to_dataset()
        pending["status"] = status.dims, np.full(status.shape, PENDING, status.dtype)
        everywhere = {str(name): slice(None) for name in status.dims}
        _write_region(pending, part, everywhere)
        os.chmod(part, 0o755)
        os.rename(part, path)


def _refuse_another(dataset: xr.Dataset, path: Path) -> None:
    """Refuse a store that does not hold this sweep, or does not say which."""
    identity = _identity_of(path)
    if identity is None and (path / "status").is_dir():
        raise StoreError(
            f"store: {path} has lost its .zattrs, or it is corrupt, so it does not say which sweep it holds; expected "
            "a new name"
        )
    if identity != dataset.attrs["identity"]:
        raise InvalidInput(
            f"store: {path} exists and holds something else; expected a new name, or the very sweep that was "
            "begun there"
        )


def _repair(dataset: xr.Dataset, path: Path, *, progress: bool) -> list[dict[str, slice]]:
    """Write lost and corrupt descriptions and coordinates again, and remove corrupt chunks of the other variables.

    Warns:
        StoreRepaired: there are any, or lost chunks of slabs that are marked as computed.

    Returns:
        The slabs that have to be computed, or computed again.
    """
    from cdpr_sim.analysis.workspace.checksummed_store import is_intact

    def intact(file: Path) -> bool:
        with suppress(OSError):
            return is_intact(file.parent, file.read_bytes())
        return False

    with _described(dataset, path) as part:
        files = [file.relative_to(part) for file in part.rglob("*") if file.is_file()]
        wrong = [str(file) for file in files if not (file.name.startswith(".") or intact(path / file))]
        if _attributes(path).get("descriptions") != _descriptions(path):
            wrong.append("the description of its variables")
        if wrong:
            for file in sorted(files, key=lambda file: len(file.parts), reverse=True):  # those of the whole store last
                (path / file).parent.mkdir(exist_ok=True)
                os.replace(part / file, path / file)
    on_disk, slabs = _open_zarr(path), list(_slabs(dataset))
    chunks = [(name, chunk) for name, chunk in _chunks(on_disk) if name in on_disk.data_vars]
    bad: dict[tuple[int, ...], list[Path]] = {}  # by where their slab begins
    starts = {dim: sorted({slab[dim].start for slab in slabs}) for dim in slabs[0]}
    with bar(f"check of {path.name}", len(chunks), show=progress) as advance, ThreadPoolExecutor() as pool:
        good = pool.map(intact, [path / name / chunk for name, chunk in chunks])
        for (name, chunk), is_good in zip(chunks, good, strict=True):
            if not is_good:
                bad.setdefault(_slab_of(chunk, on_disk[name], starts), []).append(path / name / chunk)
            advance(1)
    todo = []
    for slab in slabs:
        files = bad.get(tuple(part.start for part in slab.values()), [])
        lost = [file for file in files if not file.exists()]
        for file in files:
            file.unlink(missing_ok=True)
        readable = all(file.parent.name != "status" for file in files)
        pending = readable and bool((on_disk["status"].isel(slab) == PENDING).any())
        # Chunks of a slab that is pending may not be there yet.
        wrong += [str(file.relative_to(path)) for file in files if not (pending and file in lost)]
        if files or pending:
            todo.append(slab)
    if wrong:
        more = f" and {len(wrong) - 1} more files" if len(wrong) > 1 else ""
        warnings.warn(
            f"store: {path}: found {wrong[0]}{more} lost or corrupt; computing again what was there",
            StoreRepaired,
            stacklevel=4,
        )
    return todo


def _slab_of(chunk: str, variable: xr.DataArray, starts: dict[str, list[int]]) -> tuple[int, ...]:
    """Where the slab of a chunk begins, of those that begin at ``starts``."""
    sizes = zip(map(str, variable.dims), variable.encoding["chunks"], chunk.split("."), strict=True)
    first = {dim: int(number) * size for dim, size, number in sizes}
    return tuple(each[bisect_right(each, first[dim]) - 1] for dim, each in starts.items())


def _fill(dataset: xr.Dataset, path: Path, slabs: Sequence[dict[str, slice]], *, progress: bool) -> None:
    with bar(f"sweep into {path.name}", len(slabs), show=progress) as advance:
        for slab in slabs:
            _write_slab(dataset.isel(slab), path, slab)
            advance(1)


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


def _chunks(dataset: xr.Dataset) -> Iterator[tuple[str, str]]:
    """Variable and file name of each chunk of a store: all of them are written, also those of zeros."""
    for name, variable in dataset.variables.items():
        sizes = zip(variable.shape, variable.encoding["chunks"], strict=True)
        for chunk in np.ndindex(*(-(-size // chunk) for size, chunk in sizes)):
            yield str(name), ".".join(map(str, chunk)) or "0"


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
    """The sweep in a Zarr store.

    Raises:
        StoreError: a variable is lost.
    """
    import xarray as xr

    from cdpr_sim.analysis.workspace.checksummed_store import ChecksummedStore

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Object at", UserWarning)  # a variable without its description
        dataset = xr.open_zarr(ChecksummedStore(path, read_only=True), consolidated=False)
    lost = sorted(set(dataset.attrs.get("variables", ())) - set(dataset.variables))
    if lost:
        raise StoreError(f"store: {path} has lost {lost[0]!r}; run the same sweep again, which computes it")
    return dataset


def _attributes(path: Path) -> dict[str, Any]:
    """The attributes of the store as a whole; none if they are lost or corrupt."""
    try:
        found = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _identity_of(path: Path) -> str | None:
    return _attributes(path).get("identity")


def _descriptions(path: Path) -> str | None:
    """Hash of all that describes the store and its variables; None if something of it is lost or corrupt."""
    attributes = _attributes(path)
    files = [path / ".zgroup", *(path / name / file for name in attributes.get("variables", ()) for file in FILES)]
    try:
        found = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    except (OSError, ValueError):
        return None
    attributes.pop("descriptions", None)
    return hashlib.sha256(json.dumps([attributes, found], sort_keys=True).encode()).hexdigest()


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
