"""What can go wrong, as exceptions: one family, each message one clear sentence."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 60
"""Characters of a name that a message quotes."""


class CdprError(Exception):
    """The base of every error that cdpr_sim raises on purpose."""


class InvalidInput(CdprError, ValueError):
    """A value that cannot be right: the message names the field, what was found, what is expected."""


class UnknownName(CdprError, LookupError):
    """A name that is not in a catalogue: the message lists the nearest valid names."""

    def __init__(self, what: str, name: str, known: Iterable[str], note: str = "", meant: Iterable[str] = ()) -> None:
        """Its arguments are kept as they are: copies are made from them.

        Args:
            what: is unknown, in words.
            name: as it was given.
            known: names that are valid.
            note: what else may be given.
            meant: what was surely meant; default: the nearest of ``known``.
        """
        super().__init__(what, name, tuple(sorted(known)), note, tuple(meant))

    def __str__(self) -> str:
        what, name, known, note, near = self.args
        name = name if len(name) <= LONGEST else f"{name[:LONGEST]}..."
        if not near:
            spelled = {one.casefold(): one for one in known}
            near = [spelled[one] for one in difflib.get_close_matches(name.casefold(), spelled, n=2, cutoff=0.5)]
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        return f"unknown {what} {name!r}: {hint}known: {', '.join(known)}{note}"


class RobotFileError(InvalidInput):
    """A robot file that is missing, is not TOML, or does not describe a robot."""


class StoreError(CdprError, OSError):
    """A file or folder that cannot be written; what was there is still there."""


class MissingExtra(CdprError, ImportError):
    """A library of an optional extra that is not installed: the message says how to install it."""


class ImplausibleRobot(UserWarning):
    """A robot that can be computed and is hardly meant: lengths in millimetres, cables that stretch by half.

    Said once, where a robot is made or loaded; changed copies of it are silent. And where it is commanded to a position
    beside or above its frame.
    """
