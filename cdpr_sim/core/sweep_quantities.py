"""What a sweep computes at every pose: the form of its variables, and those that need MuJoCo.

A sweep belongs to statics, which must not import the simulation; the package's ``__init__`` sets the function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

if TYPE_CHECKING:
    import numpy as np


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


class Settled(NamedTuple):
    """Equilibria by MuJoCo, compared with those of statics.

    Attributes:
        quantities: the variables, by name.
        compute: their values for ``Problems`` of any shape, by name; a function that other processes can import.
        most: largest number of poses that should be computed at once.
    """

    quantities: Mapping[str, Quantity]
    compute: Callable[[Any], dict[str, np.ndarray]]
    most: int


class BySimulation:
    """The answer of ``crosscheck.settled_quantities``, which this folder must not import."""

    settled: ClassVar[Callable[..., Settled]]
