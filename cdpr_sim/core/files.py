"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cdpr_sim.core.errors import InvalidInput


@contextmanager
def appearing(*paths: Path) -> Iterator[list[Path]]:
    """Temporary files beside ``paths``, to write to; they take their places when all went well, and else are gone.

    Raises:
        InvalidInput: a place that cannot be written; what was there is still there.
    """
    temporaries: list[Path] = []
    path = Path()
    try:
        for path in paths:
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix.lower())
            os.close(handle)
            temporaries.append(Path(name))
        yield temporaries
        for path, temporary in zip(paths, temporaries, strict=True):
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        for temporary in temporaries:
            temporary.unlink(missing_ok=True)
