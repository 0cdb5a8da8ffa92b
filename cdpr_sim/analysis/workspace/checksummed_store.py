"""A Zarr store on disk whose chunks are checked when they are read: lost or corrupt ones are never read as zeros."""

from __future__ import annotations

import json
import re
from typing import Any

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
        if content is None:
            raise StoreError(f"{where} is lost; run the same sweep again, which computes it")
        try:
            description = json.loads((self.root / found["name"] / ".zarray").read_text(encoding="utf-8"))
            if description["compressor"]:  # which checks the chunk's checksum
                get_codec(description["compressor"]).decode(content.to_bytes())
        except Exception as error:  # each codec has its own
            raise StoreError(
                f"{where} is corrupt; remove {self.root / key} and run the same sweep again, which computes it"
            ) from error
        return content
