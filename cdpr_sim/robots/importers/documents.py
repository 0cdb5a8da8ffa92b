"""Files of other projects as plain data: XML, JSON, YAML, G-code and MATLAB's, with one sentence for every error."""

from __future__ import annotations

import io
import json
import re
import warnings
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
from cdpr_sim.core.files import read_bytes, readable
from cdpr_sim.robots.expectations import sentence_of

LARGEST_FILE = 1_000_000
"""Largest size of a file [bytes]; a thousand cables take half of it in the most verbose of these formats."""

IRREGULAR = re.compile(r'("(?:[^"\\]|\\.)*")|,(?=\s*[\]}])|(?<=\d)(\.)(?!\d)')
"""Pattern of JSON strings, which are kept, and of common deviations from JSON: commas before closing brackets, numbers
that end in a point."""


class Part(BaseModel):
    """Base of parts of a JSON or YAML file, of which only the declared fields are read."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=Part)


def _number(value: Any) -> Any:
    """Convert text to a number, since ``1e-5`` is text in YAML 1.1; refuse booleans."""
    if isinstance(value, bool):
        raise ValueError("expected a number")
    return value


def _row(value: Any) -> Any:
    """Accept a column of one-element lists as a vector."""
    if isinstance(value, list) and all(isinstance(one, list) and len(one) == 1 for one in value):
        return [one[0] for one in value]
    return value


Number = Annotated[float, BeforeValidator(_number)]
Unbounded = Annotated[float, AllowInfNan(True), BeforeValidator(_number)]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_row)]
Matrix = tuple[Vector, Vector, Vector]


def read_document(path: Path) -> Any:
    """The file as an XML element, or as the data types of JSON and YAML.

    Raises:
        InvalidInput: no such file, none of these formats, or one that cannot be read; the message says which file.
    """
    syntax = SYNTAXES.get(path.suffix.lower())
    if syntax is None:
        raise InvalidInput(f"{path}: found the suffix {path.suffix!r}, expected one of {', '.join(SYNTAXES)}")
    with readable(path):
        content = read_bytes(path, LARGEST_FILE)
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
        # the last four: errors that the parsers raise for encodings, tags and dates that do not exist
        kind = {_yaml: "YAML", _json: "JSON", _xml: "XML", _gcode: "G-code"}.get(syntax, "a MATLAB file")
        raise InvalidInput(f"{path}: is not {kind}: {shown(str(error))}") from None


def _xml(content: bytes) -> Element:
    return fromstring(content, forbid_entities=True, forbid_external=True)


def _json(content: bytes) -> Any:
    return json.loads(IRREGULAR.sub(lambda match: match[1] or (match[2] and ".0") or "", content.decode("utf-8-sig")))


class _Loader(yaml.SafeLoader):
    """Plain data only, and no merge keys, of which a few lines can produce gigabytes."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        pass  # a merge key then has no constructor, and is refused


def _yaml(content: bytes) -> Any:
    return yaml.load(content.decode("utf-8-sig"), _Loader)


class GCode(dict[str, dict[str, str]]):
    """Parameters of each command, ``M669``, by their letters; later ones replace earlier ones, as in a machine."""


def _gcode(content: bytes) -> GCode:
    found = GCode()
    for line in content.decode("utf-8-sig").splitlines():
        words = re.split(r"\(.*?\)|;.*", line)[0].split()
        if words:
            given = found.setdefault(words[0].upper(), {})
            given.update({word[0].upper(): word[1:] for word in words[1:]})
    return found


def _matlab(content: bytes) -> dict[str, Any]:
    """The structure ``s``, as plain data.

    Raises:
        ValueError: not such a file.
    """
    from scipy.io import loadmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = loadmat(io.BytesIO(content), variable_names=["s"], simplify_cells=True)
        except (
            Exception
        ) as error:  # its reader raises what it meets: zlib.error, NotImplementedError, struct.error, ...
            raise ValueError(str(error) or type(error).__name__) from None
    return {name: _plain(value) for name, value in found.items() if not name.startswith("__")}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list) else value


SYNTAXES: dict[str, Callable[[bytes], Any]] = {
    ".xml": _xml,
    ".wcrfx": _xml,
    ".json": _json,
    ".yaml": _yaml,
    ".yml": _yaml,
    ".g": _gcode,
    ".mat": _matlab,
}
"""Parser of each suffix."""


def as_model(model: type[Model], document: Any) -> Model:
    """The data of the file, checked.

    Raises:
        InvalidInput: something is missing or invalid; the message gives the place in the file.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        sentence = sentence_of(error, lambda path: ".".join(str(key)[:LONGEST] for key in path) or "the file")
        raise InvalidInput(sentence) from None


def child(element: Element, tag: str) -> Element:
    """The first child element with that tag.

    Raises:
        InvalidInput: there is none.
    """
    found = element.find(tag)
    if found is None:
        raise InvalidInput(f"<{_short(element.tag)}>: missing <{tag}>")
    return found


def numbers(element: Element, tag: str, count: int) -> list[float]:
    """The ``count`` numbers in the child element with that tag.

    Raises:
        InvalidInput: anything else.
    """
    found = child(element, tag)
    return spelled(f"<{tag}>", (found.text or "").split(), (count,)).tolist()


def attribute(element: Element, name: str, default: float | None = None) -> float:
    """A numeric attribute.

    Raises:
        InvalidInput: not a number, or missing without a ``default``.
    """
    text = element.get(name, default)
    if text is None:
        raise InvalidInput(f"<{_short(element.tag)}>: missing {name}")
    return float(spelled(f"<{_short(element.tag)}> {name}", text, ()))


def spelled(field: str, text: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers from text in a document.

    Raises:
        InvalidInput: not numbers, or not of that shape.
    """
    try:
        values = np.array(text, dtype=float)
    except ValueError:
        raise InvalidInput(f"{field}: found {shown(text)}, expected numbers") from None
    return checked_array(field, values, shape)


def _short(tag: str) -> str:
    return tag[:LONGEST]
