"""Exceptions of the package: one base class; each message is one clear sentence."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 60
"""Largest number of characters of a name that a message quotes."""


class CdprError(Exception):
    """Base class of all errors that cdpr_sim raises deliberately."""


class InvalidInput(CdprError, ValueError):
    """An invalid value: the message names the field, the value found and the value expected."""


class UnknownName(CdprError, LookupError):
    """A name that is not in a catalogue: the message lists the nearest valid names."""

    def __init__(self, what: str, name: str, known: Iterable[str], note: str = "", meant: Iterable[str] = ()) -> None:
        """The arguments are stored unchanged: copies are made from them.

        Args:
            what: kind of the unknown name.
            name: the name as given.
            known: names that are valid.
            note: other valid input.
            meant: suggestions; default: the nearest of ``known``.
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
    """A file or folder that cannot be written; existing files are unchanged."""


class StoreRepaired(UserWarning):
    """A store in which something was lost or corrupt: what is written or computed again."""


class MissingExtra(CdprError, ImportError):
    """A library of an optional extra that is not installed: the message says how to install it."""


class ImplausibleRobot(UserWarning):
    """A robot that can be computed but is implausible: lengths in millimetres, cables that stretch by half.

    Issued once, when a robot is made or loaded, not for changed copies of it; and when it is commanded to a position
    beside or above its frame.
    """
