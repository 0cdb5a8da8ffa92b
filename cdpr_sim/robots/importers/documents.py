"""Files of other projects as plain data: XML, JSON and YAML, with one sentence for whatever is wrong with them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import yaml
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring
from numpy.typing import ArrayLike
from pydantic import AllowInfNan, BaseModel, BeforeValidator, ConfigDict, ValidationError

from cdpr_sim.core.checks import checked_array, shown
from cdpr_sim.core.errors import LONGEST, InvalidInput
from cdpr_sim.core.files import read_bytes

LARGEST_FILE = 1_000_000
"""Bytes; a thousand cables take half of it in the most talkative of these formats."""

IRREGULAR = re.compile(r'("(?:[^"\\]|\\.)*")|,(?=\s*[\]}])|(?<=\d)(\.)(?!\d)')
"""Text, which is kept; and what is common and not JSON: commas before closing brackets, numbers that end in a point."""


class Part(BaseModel):
    """A part of a JSON or YAML file, of which only what is declared here is read."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=Part)


def _number(value: Any) -> Any:
    """``1e-5`` is text in YAML 1.1, and is meant as a number; true is not 1."""
    if isinstance(value, bool):
        raise ValueError("expected a number")
    return value


def _row(value: Any) -> Any:
    """A column of one-element lists is a vector as well."""
    if isinstance(value, list) and all(isinstance(one, list) and len(one) == 1 for one in value):
        return [one[0] for one in value]
    return value


Number = Annotated[float, BeforeValidator(_number)]
Unbounded = Annotated[float, AllowInfNan(True), BeforeValidator(_number)]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_row)]
Matrix = tuple[Vector, Vector, Vector]


def read_document(path: Path) -> Any:
    """The file as an XML element, or as what JSON and YAML are made of.

    Raises:
        InvalidInput: no such file, none of these formats, or one that cannot be read; the message says which file.
    """
    syntax = SYNTAXES.get(path.suffix.lower())
    if syntax is None:
        raise InvalidInput(f"{path}: found the suffix {path.suffix!r}, expected one of {', '.join(SYNTAXES)}")
    try:
        content = read_bytes(path, LARGEST_FILE)
    except FileNotFoundError:
        raise InvalidInput(f"{path}: no such file") from None
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        return syntax(content)
    except UnicodeDecodeError:
        raise InvalidInput(f"{path}: found bytes that are not UTF-8, expected text") from None
    except RecursionError:
        raise InvalidInput(f"{path}: found brackets nested too deeply, expected a robot") from None
    except DefusedXmlException:
        raise InvalidInput(f"{path}: found entities of its own, expected XML without them") from None
    except yaml.MarkedYAMLError as error:
        where = f" in line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InvalidInput(f"{path}: is not YAML: {error.problem or error.context}{where}") from None
    except (ParseError, yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError) as error:
        # the last four: what the parsers let through of encodings, tags and dates that do not exist
        kind = "YAML" if syntax is _yaml else "JSON" if syntax is _json else "XML"
        raise InvalidInput(f"{path}: is not {kind}: {shown(str(error))}") from None


def _xml(content: bytes) -> Element:
    return fromstring(content, forbid_entities=True, forbid_external=True)


def _json(content: bytes) -> Any:
    return json.loads(IRREGULAR.sub(lambda match: match[1] or (match[2] and ".0") or "", content.decode("utf-8-sig")))


class _Loader(yaml.SafeLoader):
    """Plain data alone, and no merge keys, of which a few lines can make gigabytes."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        pass  # what is left of a merge key has no constructor, and is refused


def _yaml(content: bytes) -> Any:
    return yaml.load(content.decode("utf-8-sig"), _Loader)


SYNTAXES: dict[str, Callable[[bytes], Any]] = {
    ".xml": _xml,
    ".wcrfx": _xml,
    ".json": _json,
    ".yaml": _yaml,
    ".yml": _yaml,
}
"""Per suffix, what reads it."""


def as_model(model: type[Model], document: Any) -> Model:
    """What the file says, checked.

    Raises:
        InvalidInput: something is missing or cannot be right; the message says where in the file.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(key)[:LONGEST] for key in first["loc"]) or "the file"
        if first["type"] == "missing":
            raise InvalidInput(f"{where}: missing") from None
        expected = "expected keys with values" if first["type"] == "model_type" else first["msg"]
        raise InvalidInput(
            f"{where}: found {shown(first['input'])}: {expected.removeprefix('Value error, ')}"
        ) from None


def child(element: Element, tag: str) -> Element:
    """The first element of that name inside.

    Raises:
        InvalidInput: there is none.
    """
    found = element.find(tag)
    if found is None:
        raise InvalidInput(f"<{_short(element.tag)}>: missing <{tag}>")
    return found


def numbers(element: Element, tag: str, count: int) -> list[float]:
    """The ``count`` numbers that stand in the element of that name inside.

    Raises:
        InvalidInput: others.
    """
    found = child(element, tag)
    return spelled(f"<{tag}>", (found.text or "").split(), (count,)).tolist()


def attribute(element: Element, name: str, default: float | None = None) -> float:
    """A number among the attributes.

    Raises:
        InvalidInput: no number, or none at all where there is no ``default``.
    """
    text = element.get(name, default)
    if text is None:
        raise InvalidInput(f"<{_short(element.tag)}>: missing {name}")
    return float(spelled(f"<{_short(element.tag)}> {name}", text, ()))


def spelled(field: str, text: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers that stand in a document as text.

    Raises:
        InvalidInput: no numbers, or not of that shape.
    """
    try:
        values = np.array(text, dtype=float)
    except ValueError:
        raise InvalidInput(f"{field}: found {shown(text)}, expected numbers") from None
    return checked_array(field, values, shape)


def _short(tag: str) -> str:
    return tag[:LONGEST]
