"""Hangprinter, from the ``config.g`` of RepRapFirmware: M669 has the exits, M666 lines, springs and the mover's mass.

The firmware counts the mover as a point. Its spring constant is S over the length of all line, n d + g, with U parts of
line n and Y the length g to the spool, so that EA is S. Lengths are in millimetres.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import GCode, spelled
from cdpr_sim.robots.importers.draft import Draft

TITLE = "Hangprinter's config.g"
MARKS = {"M669"}

HANGPRINTER = "6"
"""Number of the kinematics, K."""

LETTERS = "ABCDIJKLO"
"""Letters of the anchors in M669, in their order."""

ANCHORS = 4
"""Without N in M669."""

SPRING = 20e3
"""[N] The firmware's S where the file has none."""

GRAVITY = 9.81
"""[m/s²] The firmware's."""


def read(document: GCode, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid.
    """
    geometry, lines = document.get("M669", {}), document.get("M666", {})
    if geometry.get("K", HANGPRINTER) != HANGPRINTER:
        raise InvalidInput(f"M669 K: found {shown(geometry['K'])}, expected {HANGPRINTER}, a Hangprinter")
    count = int(_numbers("M669 N", geometry.get("N", str(ANCHORS)), 1, whole=True)[0])
    if not 1 <= count <= len(LETTERS):
        raise InvalidInput(f"M669 N: found {count}, expected 1 to {len(LETTERS)} anchors")
    exits = []
    for letter in LETTERS[:count]:
        if letter not in geometry:
            raise InvalidInput(f"M669: missing the anchor {letter}, as {letter}0:-2000:-100 in millimetres")
        single = letter == "D" and ":" not in geometry[letter]  # older firmware: the height of the one on top
        found = _numbers(f"M669 {letter}", geometry[letter], 1 if single else 3)
        exits.append([0.0, 0.0, found[0]] if single else found)
    notes = ["Spools, gears and motors were left out.", "Its mover counts as a point, as in the firmware."]
    if "W" not in lines:
        raise InvalidInput("M666: missing W, the mover's mass in kilograms")

    def given(letter: str, count: int, default: ArrayLike, whole: bool = False) -> np.ndarray:
        return _numbers(f"M666 {letter}", lines[letter], count, whole) if letter in lines else np.asarray(default)

    if "S" not in lines:
        notes.append(f"The spring constant of its lines is not given: the firmware's default, {SPRING:g} N, was taken.")
    if "U" not in lines:
        notes.append("Its parts of line are not given: one was assumed.")
    behind, points = given("Y", count, np.full(count, -1.0)), np.array(exits)
    if (behind < 0).any():
        behind = np.linalg.norm(points - points[-1], axis=1)
        notes.append("The lengths to its spools are not given: as in the firmware, all are at the last anchor.")
    return Draft(
        name=path.stem if path.stem != "config" else "hangprinter",
        exits=points / 1e3,
        anchors=np.zeros((count, 3)),
        mass=float(_numbers("M666 W", lines["W"], 1)[0]),
        axial_stiffness=[float(given("S", 1, [SPRING])[0])] * count,
        reeving=given("U", count, np.ones(count), whole=True),
        winch_to_exit=behind / 1e3,
        gravity=GRAVITY,
        force_min=given("I", count, 0.0),
        force_max=given("X", count, np.inf),
        home=np.zeros(3),
        notes=notes,
    )


def _numbers(field: str, text: str, count: int, whole: bool = False) -> np.ndarray:
    """Numbers between colons; whole ones, where they have to be."""
    words = text.split(":")
    if len(words) != count:
        raise InvalidInput(f"{field}: found {len(words)} numbers, expected {count}")
    if whole and not all(re.fullmatch(r"\d{1,6}", word) for word in words):
        raise InvalidInput(f"{field}: found {shown(text)}, expected whole numbers")
    return spelled(field, words, (count,))
