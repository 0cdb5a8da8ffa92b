"""MuJoCo models in files: read with errors of one sentence; written with a keyframe in which the model is at rest."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cdpr_sim.anymodel.model_equilibrium import ModelEquilibrium
from cdpr_sim.core.checks import checked_path
from cdpr_sim.core.errors import InvalidInput, UnknownName
from cdpr_sim.core.files import appearing, readable, refuse_irregular

KEYFRAME = "rest"
"""Name of the keyframe that is written."""

SAME = 1e-12
"""Largest difference of a number that MuJoCo reads back: it normalises quaternions."""


def read_model(path: str | Path) -> Any:
    """The compiled model of an MJCF or URDF file, or of a binary ``.mjb``.

    Raises:
        InvalidInput: no such file, or one that MuJoCo does not compile.
    """
    path = checked_path("model", path)
    refuse_irregular(path)
    with readable(path), open(path, "rb"):
        pass
    return _compiled(path)


def _compiled(path: Path) -> Any:
    read = mujoco.MjModel.from_binary_path if path.suffix == ".mjb" else mujoco.MjModel.from_xml_path
    try:
        return read(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise InvalidInput(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None


def start_of(model: Any, keyframe: str | None) -> Any:
    """Data at a keyframe, by its name or its number from 0; without one, at the initial pose ``qpos0``.

    Raises:
        UnknownName: no such keyframe.
    """
    data = mujoco.MjData(model)
    if keyframe is None:
        return data
    names = [model.key(number).name or str(number) for number in range(model.nkey)]
    if keyframe in names:
        number = names.index(keyframe)
    elif keyframe.isascii() and keyframe.isdecimal() and int(keyframe) < model.nkey:
        number = int(keyframe)
    else:
        raise UnknownName("keyframe", keyframe, names or ["none in this model"])
    mujoco.mj_resetDataKeyframe(model, data, number)
    return data


def with_keyframe(text: str, equilibrium: ModelEquilibrium, data: Any) -> str:
    """MJCF with the keyframe ``rest``, which replaces one of that name; all else stays as it is written.

    Args:
        text: MJCF of the model.
        equilibrium: of the model.
        data: the start of the search, which has the poses of mocap bodies.

    Raises:
        InvalidInput: not MJCF.
    """
    name = re.escape(KEYFRAME)
    text = re.sub(rf"""[ \t]*<key\s[^>]*?\bname\s*=\s*["']{name}["'][^>]*?(/>|>\s*</key\s*>)[ \t]*\n?""", "", text)
    place = text.rfind("</mujoco")
    if place < 0:
        raise InvalidInput("model: found no closing tag of mujoco, expected MJCF")
    numbers = {
        "qpos": equilibrium.qpos, "act": equilibrium.act, "ctrl": equilibrium.ctrl,
        "mpos": data.mocap_pos, "mquat": data.mocap_quat,
    }  # fmt: skip
    written = [f'{field}="{_exact(values)}"' for field, values in numbers.items() if np.size(values)]
    key = f'  <keyframe>\n    <key name="{KEYFRAME}" {" ".join(written)}/>\n  </keyframe>\n'
    before = text[:place]
    return f"{before}{'' if before.endswith(chr(10)) else chr(10)}{key}{text[place:]}"


def _exact(values: Any) -> str:
    """Numbers that read back exactly."""
    return " ".join(repr(float(one)) for one in np.ravel(values))


def check_copy(source: Path, target: Path) -> None:
    """Check that a copy of a model's file can be read at another place; to be called before work begins.

    Raises:
        InvalidInput: no MJCF, or a place from which the model's other files are not found.
    """
    if source.suffix == ".mjb":
        raise InvalidInput(f"{source}: found a compiled model, expected MJCF, which can have a keyframe added")
    with tempfile.NamedTemporaryFile(dir=target.parent, prefix=".", suffix=".xml") as copy:
        copy.write(source.read_bytes())
        copy.flush()
        _read_copy(source, target, Path(copy.name))


def save_at_rest(source: Path, target: Path, equilibrium: ModelEquilibrium, data: Any) -> None:
    """Write a copy of a model's file with the keyframe ``rest``, and check that MuJoCo reads it back.

    Raises:
        InvalidInput: as ``check_copy``; or a pose that is not read back.
        StoreError: a full disk or the like.
    """
    text = with_keyframe(source.read_text(encoding="utf-8-sig"), equilibrium, data)
    with appearing(target) as (temporary,):
        temporary.write_text(text, encoding="utf-8")
        model = _read_copy(source, target, temporary)
        read = start_of(model, KEYFRAME).qpos
        if len(read) != len(equilibrium.qpos) or np.abs(read - equilibrium.qpos).max(initial=0.0) > SAME:
            raise InvalidInput(
                f"{target}: MuJoCo reads another pose back from keyframe {KEYFRAME!r}, expected the same"
            )


def _read_copy(source: Path, target: Path, temporary: Path) -> Any:
    try:
        return _compiled(temporary)
    except InvalidInput as error:
        reason = str(error).partition("MuJoCo cannot read it: ")[2]
        raise InvalidInput(
            f"{target}: the copy would not be read there, expected a place in {str(source.parent)!r}, where the model "
            f"finds its files: {reason}"
        ) from None
