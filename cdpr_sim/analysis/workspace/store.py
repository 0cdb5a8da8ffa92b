"""Sweeps computed and kept: in memory, in NetCDF at one stroke, or in Zarr piece by piece, so that a sweep goes on.

A Zarr store is its own record of progress. It is made whole at once, with every ``status`` *pending*; then one slab
after the other is computed and written, its status last. So whatever is killed, and whenever: what reads as solved is
there in full, what is missing reads as pending, and the next run fills in the slabs that have a pending pose.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cdpr_sim.core.errors import InvalidInput, StoreError
from cdpr_sim.core.progress import bar
from cdpr_sim.core.status import Status

if TYPE_CHECKING:
    import xarray as xr

PENDING = Status.PENDING.value
"""The status of a pose that is not computed yet."""

TASKS = 16
"""Chunks that are computed between two entries in the store, or two looks at the progress bar."""

DIMENSIONS = ("robot", "x", "y", "z")
"""Along which slabs are cut."""


def checked_path(store: str | Path) -> Path:
    """``store`` as a path that can be written.

    Raises:
        InvalidInput: neither .zarr nor .nc, no such folder, or a NetCDF file that is there already.
    """
    path = Path(store)
    if path.suffix not in {".zarr", ".nc"}:
        raise InvalidInput(f"store: found {path.name!r}, expected a name that ends in .zarr or .nc")
    if not path.parent.is_dir():
        raise InvalidInput(f"store: found no folder {str(path.parent)!r} for {path.name!r}, expected one that exists")
    if path.suffix == ".nc" and path.exists():
        raise InvalidInput(f"store: {path} exists; expected a new name, since a finished file is never replaced")
    return path


def open_sweep(store: str | Path) -> xr.Dataset:
    """A finished sweep, read piece by piece as it is used.

    Raises:
        InvalidInput: no sweep is there, or it is unfinished.
    """
    import xarray as xr

    path = Path(store)
    try:
        dataset = xr.open_dataset(path, chunks={}) if path.suffix == ".nc" else _open_zarr(path)
        missing = int((dataset["status"] == PENDING).sum())
    except (OSError, ValueError, KeyError):
        raise InvalidInput(f"store: found no sweep in {path}") from None
    if missing:
        raise InvalidInput(
            f"store: {path} is unfinished: {missing} of {dataset['status'].size} poses are pending; "
            "expected the sweep to be run again, which goes on where it stopped"
        )
    return dataset


def computed(dataset: xr.Dataset, *, progress: bool) -> xr.Dataset:
    """``dataset`` in memory, by whatever scheduler Dask uses: threads, or the cluster that is connected."""
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
    """Compute ``dataset`` into ``path`` and read it from there; into a Zarr store that is begun, what is missing.

    Raises:
        InvalidInput: the store holds something else.
        StoreError: it cannot be written, as on a full disk; what is in it stays.
    """
    dataset.attrs["identity"] = _digest(identity)
    with _as_sentence(path):
        if path.suffix == ".nc":
            _write_netcdf(computed(dataset, progress=progress), path)
        else:
            if not path.exists():
                _create(dataset, path)
            elif _identity_of(path) != dataset.attrs["identity"]:
                raise InvalidInput(
                    f"store: {path} exists and holds something else; expected a new name, or the very sweep that was "
                    "begun there"
                )
            _fill(dataset, path, progress=progress)
    return open_sweep(path)


def _write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Under another name until it is whole; HDF5 writes into memory, since a full disk would crash it."""
    part = path.with_name(f".{path.name}.part")
    content = dataset.to_netcdf(engine="h5netcdf")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _create(dataset: xr.Dataset, path: Path) -> None:
    """The store with coordinates and every status pending, under another name until it is whole."""
    part = path.with_name(f".{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        dataset.to_zarr(part, compute=False, consolidated=False, zarr_format=2)
        status = dataset["status"]
        pending = status.drop_vars(list(status.coords)).to_dataset()
        pending["status"] = status.dims, np.full(status.shape, PENDING, status.dtype)
        everywhere = {str(name): slice(None) for name in status.dims}
        pending.to_zarr(part, region=everywhere, consolidated=False, zarr_format=2)
        os.rename(part, path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _fill(dataset: xr.Dataset, path: Path, *, progress: bool) -> None:
    on_disk = _open_zarr(path)["status"]
    slabs = list(_slabs(dataset))
    with bar(f"sweep into {path.name}", len(slabs), show=progress) as advance:
        for slab in slabs:
            if (on_disk.isel(slab) == PENDING).any():
                _write_slab(dataset.isel(slab), path, slab)
            advance(1)


def _write_slab(piece: xr.Dataset, path: Path, slab: dict[str, slice]) -> None:
    piece = piece.drop_vars(list(piece.coords)).persist()
    for names in ([name for name in piece.data_vars if name != "status"], ["status"]):
        piece[names].to_zarr(path, region=slab, consolidated=False, zarr_format=2)


def _slabs(dataset: xr.Dataset) -> Iterator[dict[str, slice]]:
    """Pieces of about ``TASKS`` chunks, cut along whole chunks of the grid."""
    dims = [name for name in DIMENSIONS if name in dataset["status"].dims]
    chunks = {name: dataset["status"].chunksizes[name] for name in dims}
    cuts, left = {}, TASKS
    for name in reversed(dims):
        per_slab = 1 if name == "robot" else min(len(chunks[name]), max(1, left))
        left //= per_slab
        edges = np.concatenate([[0], np.cumsum(chunks[name])])
        starts = edges[:-1:per_slab]
        cuts[name] = [slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], edges[-1]], strict=True)]
    for choice in np.ndindex(*(len(cuts[name]) for name in dims)):
        yield {name: cuts[name][i] for name, i in zip(dims, choice, strict=True)}


def _open_zarr(path: Path) -> xr.Dataset:
    import xarray as xr

    return xr.open_zarr(path, consolidated=False)


def _identity_of(path: Path) -> str | None:
    try:
        return _open_zarr(path).attrs.get("identity")
    except (OSError, ValueError, KeyError):
        return None


def _digest(identity: Sequence[Any]) -> str:
    """Of everything that decides the numbers: the same for the same sweep, on any machine."""
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


@contextmanager
def _as_sentence(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        kept = "; what is written stays, and the same sweep goes on from there" if path.suffix == ".zarr" else ""
        raise StoreError(f"store: {path} cannot be written: {error.strerror or error}{kept}") from error
