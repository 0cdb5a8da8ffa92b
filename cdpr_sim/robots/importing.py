"""Robots of other projects, read from their own files."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from cdpr_sim.core.checks import checked_path, one_of, refuse_unless
from cdpr_sim.core.errors import CdprError, InvalidInput, RobotFileError
from cdpr_sim.core.robot import Robot
from cdpr_sim.robots.importers import bologna, caspr, cdpyr, gazebo, hangprinter, mujoco_model, uacdpr, wirex
from cdpr_sim.robots.importers.documents import SYNTAXES, read_document

FORMATS = {
    "caspr": caspr,
    "wirex": wirex,
    "cdpyr": cdpyr,
    "gazebo": gazebo,
    "bologna": bologna,  # after gazebo, whose files have a key "cable" as well
    "mjcf": mujoco_model,
    "hangprinter": hangprinter,
    "uacdpr": uacdpr,
}
"""Formats of other projects, by name: a module with a ``TITLE``, the ``MARKS`` at the top of such a file (root elements
or keys), and ``read``, which makes a ``Draft``."""

IMPORTED = tuple(SYNTAXES)
"""Suffixes of their files."""


def import_robot(path: str | Path, format: str | None = None, cables: str | None = None) -> Robot:
    """A robot from another project's file.

    Exits, anchors, pulleys, mass, inertia, elasticity and weight of the cables are read as far as the file has them.
    ``robot.notes`` has a sentence for each thing that has no counterpart and was left out, and for each assumption; a
    file is refused if the difference would change the robot's statics (several platforms, cables through several
    bodies).

    Args:
        path: ``.wcrfx`` (WireX), ``*_bodies.xml`` or ``*_cables.xml``, side by side (CASPR), ``.json`` (cdpyr,
            Bologna), ``.yaml`` or ``.yml`` (cdpyr, oKermorgant/cdpr), ``.xml`` (MuJoCo, tendons from site to site),
            ``.g`` (Hangprinter's ``config.g``), ``.mat`` (UACDPR).
        format: "caspr", "wirex", "cdpyr", "bologna", "gazebo", "mjcf", "hangprinter" or "uacdpr"; default: recognised
            by the file's content.
        cables: ``id`` of a set of cables in CASPR's file; default: the file's default.

    Returns:
        The robot, in SI units and z up, with ``notes``.

    Raises:
        RobotFileError: the file is missing, cannot be read, or does not describe a supported robot: the message gives
            the place in the file, what was found and what is expected.
        UnknownName: no such format.
    """
    path = checked_path("path", path)
    if format is not None:
        one_of("format", format, FORMATS)
    refuse_unless(str | None, cables=cables)
    try:
        document = read_document(path)
        if isinstance(document, Element) and document.tag == "cables":  # the lesser half of CASPR's pair
            path = caspr.beside(path, "cables", "bodies")
            document = read_document(path)
    except InvalidInput as error:
        raise RobotFileError(str(error)) from None
    try:
        format = _format_of(document, tuple(FORMATS) if format is None else (format,))
        if cables is not None and format != "caspr":
            raise InvalidInput(f"cables: found {cables!r}, but only CASPR's files have sets of cables to choose from")
        draft = FORMATS[format].read(document, path, **({"cables": cables} if cables else {}))
        draft.source = draft.source or f"{FORMATS[format].TITLE}, {path.name}"
        return draft.robot()
    except CdprError as error:
        raise RobotFileError(f"{path}: {error}") from None


def _format_of(document: Any, formats: tuple[str, ...]) -> str:
    """The first of these formats that a document has."""
    top = {document.tag} if isinstance(document, Element) else set(document) if isinstance(document, dict) else set()
    for name in formats:
        if FORMATS[name].MARKS & top:
            return name
    marks = ", ".join(sorted(set().union(*(FORMATS[name].MARKS for name in formats))))
    if len(formats) == 1:
        raise InvalidInput(f"found no {marks} at the top, expected {FORMATS[formats[0]].TITLE}")
    raise InvalidInput(f"found none of {marks} at the top, expected a robot's file")
