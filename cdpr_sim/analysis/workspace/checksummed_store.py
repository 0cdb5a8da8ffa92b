"""A Zarr store on disk whose chunks are checked when they are read: lost or corrupt ones are never read as zeros."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import get_codec
from zarr.storage import LocalStore

from cdpr_sim.core.errors import StoreError

CHUNK = re.compile(r"(?P<name>.+)/(?P<chunk>\d+(\.\d+)*)")
"""Pattern of a chunk's key."""


class ChecksummedStore(LocalStore):
    """Reads chunks, or raises an error that names the lost or corrupt one."""

    async def get(self, key: str, *args: Any, **kwargs: Any) -> Any:
        """The content of ``key``, or None if it does not exist and none is expected.

        Raises:
            StoreError: a chunk that is lost or corrupt.
        """
        content = await super().get(key, *args, **kwargs)
        found = CHUNK.fullmatch(key)
        if found is None:
            return content
        where = f"store: {self.root}: slab {found['chunk']} of {found['name']!r}"
        again = "run the same sweep again, which computes it"
        if content is None:
            raise StoreError(f"{where} is lost; {again}")
        if not is_intact(self.root / found["name"], content.to_bytes()):
            raise StoreError(f"{where} is corrupt; {again}")
        return content


def is_intact(folder: Path, chunk: bytes) -> bool:
    """Whether a chunk of the variable in ``folder`` has the right checksum and size."""
    try:
        description = json.loads((folder / ".zarray").read_text(encoding="utf-8"))
        if description["compressor"]:  # which checks the checksum
            chunk = bytes(get_codec(description["compressor"]).decode(chunk) or b"")
        size = math.prod(description["chunks"]) * np.dtype(description["dtype"]).itemsize
    except Exception:  # each codec has its own
        return False
    return len(chunk) == size
