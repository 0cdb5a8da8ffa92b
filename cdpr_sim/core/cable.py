"""What cables are: where they begin and end, and how stiff they are. Data; what a cable does is each road's own matter.

The mathematics says it in ``statics.cable_law`` and ``core.cable_path``, MuJoCo's side in ``physics.cables``.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array, frozen, in_range
from cdpr_sim.core.errors import InvalidInput

EXIT, ANCHOR, STIFFNESS, COLUMNS = 0, 3, 6, 7
"""Of ``Cabling.packed``: where the exit's and the anchor's coordinates begin, the axial stiffness, and their number."""


MOST_CABLES = 1000
"""Of one robot; real ones have up to some dozens."""

MOST_LENGTH = 1e6
"""[m] The largest coordinate that is taken: beyond, double precision does not resolve what stretches."""

STIFFNESS_RANGE = (1e-6, 1e15)
"""[N] Axial stiffnesses that are taken: from spider silk to steel ropes of a metre, and far beyond."""


@dataclass(frozen=True, eq=False, init=False)
class Cabling:
    """The cables of one robot; arrays are read-only.

    Args:
        exits: exit points A_i in the base frame, (cables, 3) [m].
        anchors: anchor points B_i in the platform frame, (cables, 3) [m].
        axial_stiffness: EA [N], one number or one per cable.

    Raises:
        InvalidInput: a field that cannot be right; the message names it.
    """

    exits: Float[np.ndarray, "cables 3"]
    anchors: Float[np.ndarray, "cables 3"]
    axial_stiffness: Float[np.ndarray, " cables"]

    def __init__(self, exits: ArrayLike, anchors: ArrayLike, axial_stiffness: ArrayLike) -> None:
        exits = checked_array("exits", exits, (None, 3))
        cables = len(exits)
        if cables < 1:
            raise InvalidInput("exits: found no cable, expected at least one row (x, y, z)")
        if cables > MOST_CABLES:
            raise InvalidInput(f"exits: found {cables} cables, expected at most {MOST_CABLES}")
        anchors = checked_array("anchors", anchors, (cables, 3))
        in_range("exits", exits, -MOST_LENGTH, MOST_LENGTH, "m")
        in_range("anchors", anchors, -MOST_LENGTH, MOST_LENGTH, "m")
        stiffness = checked_array("axial_stiffness", axial_stiffness, None)
        if stiffness.ndim:
            stiffness = checked_array("axial_stiffness", stiffness, (cables,))
        if not (stiffness > 0).all():
            raise InvalidInput(f"axial_stiffness: found {stiffness.min():g} N, expected more than 0")
        in_range("axial_stiffness", stiffness, *STIFFNESS_RANGE, "N")
        object.__setattr__(self, "exits", frozen(exits))
        object.__setattr__(self, "anchors", frozen(anchors))
        object.__setattr__(self, "axial_stiffness", frozen(np.broadcast_to(stiffness, (cables,)).copy()))

    def __len__(self) -> int:
        return len(self.exits)

    @cached_property
    def packed(self) -> Float[np.ndarray, "cables columns"]:
        """All of it as one table, a row per cable, for compiled code."""
        return frozen(np.column_stack([self.exits, self.anchors, self.axial_stiffness]))

    def packed_with(
        self, axial_stiffness: Float[np.ndarray, "*batch cables"]
    ) -> Float[np.ndarray, "*batch cables columns"]:
        """``packed`` with another stiffness, or many."""
        table = np.empty((*axial_stiffness.shape, COLUMNS))
        table[...] = self.packed
        table[..., STIFFNESS] = axial_stiffness
        return table

    def same_as(self, other: Cabling) -> bool:
        """Whether both are the very same numbers."""
        return all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in dataclasses.fields(self)
        )
