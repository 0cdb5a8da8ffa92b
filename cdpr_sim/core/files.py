"""Files that are written completely or not at all, replaced only on request, and read up to a maximum size."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from cdpr_sim.core.checks import checked_path
from cdpr_sim.core.errors import InvalidInput, StoreError

OUTSIDE = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.EPIPE}
"""Errors of a valid place: a full disk, a quota, a broken device, a killed encoder."""


def read_text(path: Path, most: int) -> str:
    """A text file of at most ``most`` bytes, in UTF-8 with or without a byte order mark.

    Raises:
        OSError: no such file, or one that cannot be read.
        UnicodeDecodeError: not UTF-8.
        InvalidInput: not a file, or one that is too large: a device, a picture, a mistake.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def read_bytes(path: Path, most: int) -> bytes:
    """A file of at most ``most`` bytes.

    Raises:
        OSError: no such file, or one that cannot be read.
        InvalidInput: not a file, or one that is too large: a device, a picture, a mistake; a pipe without a writer.
    """
    if path.exists() and not (path.is_file() or path.is_fifo()) and not path.is_dir():
        raise InvalidInput(f"{path}: found a device, expected a file")
    # Opening a pipe to which nothing writes would wait without end.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        os.set_blocking(file.fileno(), True)
        content = file.read(most + 1)
    if not content and path.is_fifo():
        raise InvalidInput(f"{path}: found a pipe to which nothing writes, expected a file")
    if len(content) > most:
        raise InvalidInput(f"{path}: found more than {most / 1e6:g} MB, expected a file of text")
    return content


@contextmanager
def readable(label: str | Path) -> Iterator[None]:
    """Report a file that is missing or cannot be read as text in one sentence, which begins with ``label``.

    Raises:
        InvalidInput: such a file.
    """
    try:
        yield
    except FileNotFoundError:
        raise InvalidInput(f"{label}: no such file") from None
    except UnicodeDecodeError:
        raise InvalidInput(f"{label}: found bytes that are not UTF-8, expected text") from None
    except OSError as error:
        raise InvalidInput(f"{label}: cannot be read: {error.strerror or error}") from None


def refuse_irregular(path: Path) -> None:
    """Refuse what exists and is no file, before it is opened: a pipe would be waited for.

    Raises:
        InvalidInput: a pipe, a device or a folder.
    """
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "a pipe or a device"
        raise InvalidInput(f"{path}: found {what}, expected a file or a new name")


def target(path: Path) -> Path:
    """The file that is written for ``path``: of a symbolic link, what it points to, so that the link stays.

    Raises:
        InvalidInput: links that point to one another.
    """
    if not path.is_symlink():
        return path
    real = Path(os.path.realpath(path))
    if real.is_symlink():
        raise InvalidInput(f"{path}: found symbolic links that point to one another, expected a file or a new name")
    return real


def check_place(path: str | Path, suffixes: Sequence[str], *, force: bool = False, field: str = "") -> Path:
    """``path``, if a file can be written there; to be called before work begins.

    Args:
        path: path of the file.
        suffixes: accepted suffixes.
        force: whether an existing file may be replaced.
        field: name of the path in messages; default: the path itself.

    Raises:
        InvalidInput: another suffix, an existing file without ``force``, or a folder that cannot be written.
    """
    path = checked_path("path", path)
    if path.suffix.lower() not in suffixes:
        expected = " or ".join(filter(None, [", ".join(suffixes[:-1]), suffixes[-1]]))
        if field:
            raise InvalidInput(f"{field}: found {path.name!r}, expected a name that ends in {expected}")
        found = f"found the suffix {path.suffix!r}" if path.suffix else "found no suffix"
        raise InvalidInput(f"{path}: {found}, expected {expected}")
    refuse_irregular(path)
    if field and path.exists() and not force:
        raise InvalidInput(f"{field}: {path} exists; expected a new name, or --force to replace it")
    refuse_existing([path], force=force)
    if not path.parent.is_dir():
        raise InvalidInput(f"{field or path}: found no folder {str(path.parent)!r}, expected one that exists")
    refuse_unwritable(path)
    return path


def refuse_unwritable(path: Path) -> None:
    """Check that a file can be written to ``path``; to be called before work begins.

    Raises:
        InvalidInput: it cannot.
    """
    written = target(path)
    if not written.parent.is_dir():
        raise InvalidInput(f"{path}: found no folder {str(written.parent)!r}, to which it links, expected one")
    if not os.access(written.parent, os.W_OK | os.X_OK):
        raise InvalidInput(f"{path}: cannot be written: the folder {str(written.parent)!r} is read-only")
    try:
        with tempfile.TemporaryFile(dir=written.parent):
            pass
        with suppress(FileNotFoundError):
            os.lstat(written)  # its name may be too long
    except OSError as error:
        raise _unwritable(path, error) from None


def refuse_existing(paths: Iterable[Path], *, force: bool = False) -> None:
    """Refuse to replace files, unless ``force`` is given.

    Raises:
        InvalidInput: one of ``paths`` exists, and ``force`` is off.
    """
    for path in paths:
        if path.exists() and not force:
            raise InvalidInput(f"{path}: exists, expected a new place or --force")


def make_folder(folder: Path) -> None:
    """Make ``folder`` if it does not exist, and check that it can be written to.

    Raises:
        InvalidInput: it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from None


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """``folder``, made and checked to be writable; it is removed again if it stays empty after an error.

    Raises:
        InvalidInput: it cannot be made or written to.
    """
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    make_folder(folder)
    try:
        yield folder
    except BaseException:
        with suppress(OSError):
            for place in made:
                place.rmdir()  # only if it is empty
        raise


@contextmanager
def appearing(*paths: Path) -> Iterator[list[Path]]:
    """Temporary files beside ``paths``, to write to; they replace ``paths`` after success, and are removed otherwise.

    Of a symbolic link, the file to which it points is replaced.

    Raises:
        InvalidInput: a place that cannot be written; existing files are unchanged.
        StoreError: a full disk or the like; existing files are unchanged.
    """
    temporaries: list[Path] = []
    path = Path()
    try:
        for path in paths:
            handle, name = tempfile.mkstemp(
                dir=target(path).parent, prefix=f".{path.stem}-", suffix=path.suffix.lower()
            )
            os.close(handle)
            temporaries.append(Path(name))
        yield temporaries
        for path, temporary in zip(paths, temporaries, strict=True):
            os.chmod(temporary, 0o644)
            os.replace(temporary, target(path))
    except StoreError:  # an OSError whose message is complete
        raise
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        for temporary in temporaries:
            temporary.unlink(missing_ok=True)


def write_whole(contents: Mapping[Path, bytes]) -> None:
    """Write all of these files or none.

    Raises:
        InvalidInput: a place that cannot be written; existing files are unchanged.
        StoreError: a full disk or the like; existing files are unchanged.
    """
    with appearing(*contents) as temporaries:
        for content, temporary in zip(contents.values(), temporaries, strict=True):
            temporary.write_bytes(content)


def _unwritable(path: Path, error: OSError) -> InvalidInput | StoreError:
    kind = StoreError if error.errno in OUTSIDE else InvalidInput
    return kind(f"{path}: cannot be written: {error.strerror or error}")
