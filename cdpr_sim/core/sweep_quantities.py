"""What a sweep computes at every pose: the form of its variables, and those that need MuJoCo.

A sweep belongs to statics, which must not import the simulation; the package's ``__init__`` sets the function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar


@dataclass(frozen=True)
class Quantity:
    """A variable of the Dataset: its dimensions beside the grid's, its type, unit and meaning.

    Attributes:
        dims: names of these dimensions.
        dtype: type of its numbers.
        units: their unit.
        long_name: its meaning.
        flags: meaning of each number, of a variable that has few.
    """

    dims: tuple[str, ...]
    dtype: type
    units: str
    long_name: str
    flags: Mapping[int, str] = field(default_factory=dict)

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the variable, by the CF conventions."""
        attrs: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.flags:
            attrs |= {"flag_values": list(self.flags), "flag_meanings": " ".join(self.flags.values())}
        return attrs


class BySimulation:
    """Returns the module ``crosscheck.settled_quantities``, which this folder must not import."""

    settled: ClassVar[Callable[..., Any]]
