"""A robot as the text of a robot file, which loads to the very same numbers (axes of pulleys to their last bit)."""

from __future__ import annotations

import json
from contextlib import suppress

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import DOWN
from cdpr_sim.core.errors import CdprError
from cdpr_sim.core.materials import load_material
from cdpr_sim.core.robot import Robot


def robot_toml(robot: Robot) -> str:
    """The robot as TOML: lengths in metres, each number in as many digits as it takes."""
    cabling = robot.cabling
    same = {
        name: bool((values == values[0]).all())
        for name, values in (
            ("axial_stiffness", cabling.axial_stiffness),
            ("linear_density", cabling.linear_density),
            ("stiffening", cabling.stiffening),
            ("pulley", np.column_stack([cabling.pulley_radius, cabling.pulley_axis])),
        )
    }
    named = _is_of(robot.material, cabling.axial_stiffness)

    def stiffness(cable: int) -> str:
        return (
            f"material = {_text(str(robot.material))}"
            if named
            else f"axial_stiffness = {_value(cabling.axial_stiffness[cable])}"
        )

    def own(cable: int) -> dict[str, str]:
        radius, axis = cabling.pulley_radius[cable], cabling.pulley_axis[cable]
        return {
            "axial_stiffness": stiffness(cable),
            "linear_density": f"linear_density = {_value(cabling.linear_density[cable])}",
            "stiffening": f"stiffening = {_value(cabling.stiffening[cable])}",
            "pulley": f"pulley = {{ radius = {_value(radius)}, axis = {_value(axis)} }}",
        }

    usual = {
        "linear_density": not cabling.linear_density.any(), "stiffening": cabling.linear,
        "pulley": not cabling.pulleys.any() and np.array_equal(cabling.pulley_axis[0], DOWN),
    }  # fmt: skip
    lines = [
        f"{name} = {_text(getattr(robot, name))}" for name in ("name", "description", "source") if getattr(robot, name)
    ]
    lines += [f"mobility = {_text(robot.mobility)}", f"gravity = {_value(robot.gravity)}  # m/s²"]
    lines += [line for name, line in own(0).items() if same[name] and not usual.get(name)]
    lines += ["", "[platform]", f"mass = {_value(robot.mass)}  # kg", f"size = {_value(robot.platform_size)}  # m"]
    lines += [f"center_of_mass = {_value(robot.center_of_mass)}", f"inertia = {_value(robot.inertia)}  # kg m²"]
    for name, (lower, upper) in (("frame", robot.frame), ("workspace", robot.workspace)):
        lines += ["", f"[{name}]  # m", f"lower = {_value(lower)}", f"upper = {_value(upper)}"]
    for cable in range(robot.cables):
        lines += ["", "[[cables]]", f"exit = {_value(robot.exits[cable])}", f"anchor = {_value(robot.anchors[cable])}"]
        lines += [line for name, line in own(cable).items() if not same[name]]
    return "\n".join(lines) + "\n"


def _is_of(material: str | None, axial_stiffness: Float[np.ndarray, " cables"]) -> bool:
    """Whether loading a material by this name gives every cable this stiffness."""
    with suppress(CdprError):
        return material is not None and bool((axial_stiffness == load_material(material).axial_stiffness).all())
    return False


def _text(words: str) -> str:
    return json.dumps(words, ensure_ascii=False)


def _value(number: object) -> str:
    """A number, or nested lists of them; each parses back to the same bits."""
    return repr(np.asarray(number, dtype=float).tolist())
