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

    def __init__(self, what: str, name: str, known: Iterable[str], note: str = "") -> None:
        known, name = sorted(known), name if len(name) <= LONGEST else f"{name[:LONGEST]}..."
        near = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        super().__init__(f"unknown {what} {name!r}: {hint}known: {', '.join(known)}{note}")


class RobotFileError(InvalidInput):
    """A robot file that is missing, is not TOML, or does not describe a robot."""


class StoreError(CdprError, OSError):
    """A file or folder that cannot be written; what was there is still there."""


class ImplausibleRobot(UserWarning):
    """A robot that can be computed and is hardly meant: lengths in millimetres, cables that stretch by half.

    Said once, where a robot is made or loaded; changed copies of it are silent. And where it is commanded to a position
    beside or above its frame.
    """
