"""A robot's cables in words: for tables, titles and captions."""

from __future__ import annotations

from cdpr_sim.core.robot import Robot

_SIZES = {"MN": 1e6, "kN": 1e3, "N": 1.0}


def newtons(force: float) -> str:
    """A force with the unit that suits its size: 10 kN."""
    unit = next((unit for unit, size in _SIZES.items() if force >= size), "N")
    return f"{force / _SIZES[unit]:g} {unit}"


def stiffness_in_words(robot: Robot, unit: str = "") -> str:
    """EA = 10 kN, or EA = 1 kN to 10 kN where cables differ; in a given ``unit`` EA = 10000 N, or EA = 1 to 10 kN."""
    ends = sorted({float(robot.axial_stiffness.min()), float(robot.axial_stiffness.max())})
    if unit:
        return f"EA = {' to '.join(f'{end / _SIZES[unit]:g}' for end in ends)} {unit}"
    return f"EA = {' to '.join(map(newtons, ends))}"


def cables_in_words(robot: Robot, unit: str = "") -> str:
    """What the cables are called, and their stiffness as ``stiffness_in_words`` has it."""
    stiffness = stiffness_in_words(robot, unit)
    return f"{robot.material} cables ({stiffness})" if robot.material else f"cables with {stiffness}"
