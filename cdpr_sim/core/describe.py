"""Descriptions of a robot's cables as text: for tables, titles and captions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.materials import OF_MATERIAL
from cdpr_sim.core.robot import Robot

_SIZES = {"MN": 1e6, "kN": 1e3, "N": 1.0}


def newtons(force: float) -> str:
    """A force with a suitable unit: 10 kN."""
    unit = next((unit for unit, size in _SIZES.items() if force >= size), "N")
    return f"{force / _SIZES[unit]:g} {unit}"


def describe_stiffness(robot: Robot, unit: str = "") -> str:
    """EA = 10 kN, or EA = 1 kN to 10 kN where cables differ; with a given ``unit`` EA = 10000 N, or EA = 1 to 10 kN."""
    ends = sorted({float(robot.axial_stiffness.min()), float(robot.axial_stiffness.max())})
    if unit:
        return f"EA = {' to '.join(f'{end / _SIZES[unit]:g}' for end in ends)} {unit}"
    return f"EA = {' to '.join(map(newtons, ends))}"


def describe_cables(robot: Robot, unit: str = "") -> str:
    """Name of the cables, their stiffness as ``describe_stiffness`` writes it, and ``describe_properties``."""
    stiffness = describe_stiffness(robot, unit)
    cables = f"{robot.material} cables ({stiffness})" if robot.material else f"cables with {stiffness}"
    return "".join([cables, *(f", {one}" for one in describe_properties(robot))])


def cables_name(robot: Robot) -> str:
    """The name of the cables' material, or their stiffness if they have none: "dyneema-2mm", "EA = 1 kN"."""
    return robot.material or describe_stiffness(robot)


def describe_properties(robot: Robot) -> tuple[str, ...]:
    """Properties in which cables differ from massless linear ones from points: mass, law, pulleys, drive line, memory.

    "0.5 g/m", "nonlinear with a2 = 20, a3 = 0", "over pulleys of 20 mm radius", "6 m from winch to exit", "2 parts of
    line", "2 % friction at the exit", "10 % of EA with hysteresis", "25 % of the stretch as creep", "200 N of
    pretension"; with the number of cables if not all.
    """
    cabling, parts = robot.cabling, []
    for name, one in PROPERTIES.items():
        which = cabling.has(name)
        if one.said is not None and which.any():
            text, numbers = one.said
            columns = numbers(cabling)[which].reshape(which.sum(), -1).T
            parts.append(f"{text.format(*map(span, columns))}{some(which)}")
    if robot.pretension is not None:
        parts.append(f"{robot.pretension:g} N of pretension")
    return tuple(parts)


def describe_origins(robot: Robot) -> str:
    """Which numbers of the cables are those of a material, and which were given by hand.

    "EA, breaking load of steel-rope-4mm; by hand: mass per length"; the mass per length counts if it is not 0, and the
    breaking load if it is known.
    """
    of = _by_origin(robot)
    by_hand = of.pop(None, [])
    parts = [f"{', '.join(labels)} of {name}" for name, labels in of.items()]
    return "; ".join(parts + ([f"by hand: {', '.join(by_hand)}"] if by_hand else []))


def numbers_by_hand(robot: Robot) -> list[str]:
    """Numbers of the cables that were given by hand: "mass per length (3 of 8)"."""
    return _by_origin(robot).get(None, [])


def _by_origin(robot: Robot) -> dict[str | None, list[str]]:
    """Labels of numbers by the material from which they came."""
    found: dict[str | None, list[str]] = {}
    for field in OF_MATERIAL:
        label = PROPERTIES[field].title
        values, names = getattr(robot, field), robot.from_material.get(field, (None,) * robot.cables)
        known = np.isfinite(values) & (values > 0)
        for name in dict.fromkeys(names):
            which = known & np.array([one == name for one in names])
            if which.any():
                found.setdefault(name, []).append(f"{label}{some(which)}")
    return found


def describe_twist(twist: Float[np.ndarray, "6"], robot: Robot) -> str:
    """A small motion (translation [m], rotation vector [rad]), scaled to 1 in mm or degrees, as text.

    "+1 mm x, -0.57° about y"; a rotation alone about one axis is "rotation about y".
    """
    motion = twist * robot.units
    motion = 1e-3 * motion / max(np.abs(motion).max(), np.finfo(float).tiny)
    parts = [f"{1e3 * value:+.2g} mm {axis}" for value, axis in zip(motion[:3], "xyz", strict=True)]
    degrees = np.degrees(motion[3:] / robot.characteristic_length)
    parts += [f"{value:+.2g}° about {axis}" for value, axis in zip(degrees, "xyz", strict=True)]
    some = np.flatnonzero(np.abs(motion) >= 1e-5)
    if len(some) == 1:
        return f"{'translation along' if some[0] < 3 else 'rotation about'} {'xyzxyz'[some[0]]}"
    return ", ".join(parts[i] for i in some)


def span(values: Float[np.ndarray, " some"]) -> str:
    """The value 20, or the range 10 to 20."""
    return " to ".join(f"{end:g}" for end in sorted({float(values.min()), float(values.max())}))


def some(which: Bool[np.ndarray, " cables"]) -> str:
    """Of how many cables, in brackets; nothing if of all."""
    return "" if which.all() else f" ({which.sum()} of {len(which)})"
