"""The memory of ropes: what, besides rest lengths and load, determines the equilibria along a path. Data only.

A cable has the rest length l0 from exit to anchor and g = ``Cabling.behind`` behind its exit; L = l0 + g. The memory
consists of one number for each element of ``hysteresis``, one for ``pulley_friction`` and one for each term of
``creep``. They are chosen so that a winch that turns changes none of them: an element keeps a strain, friction keeps
the point of the rope that lies at the exit.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import MEMORIES, PROPERTIES
from cdpr_sim.core.checks import Frozen, listed, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot


@dataclass(frozen=True, eq=False)
class Memory(Frozen):
    """State of the cables of one robot at one moment of a path, or of many paths side by side; arrays are read-only.

    Attributes:
        strains: zeta of each element of hysteresis, (..., cables, elements): its spring is free at the stretch zeta L.
        beyond: unstretched length lo between the exit and the anchor, (..., cables) [m]; nan where no equilibrium has
            been reached yet, so that there is no friction force.
        creep: strain of each term, (..., cables, terms).
        tensions: tensions of the ropes at that moment, from which creep continues, (..., cables) [N]; where a rope with
            a memory has mass, at its exit; nan where a path ended earlier because no equilibrium was found.
        time: the moment [s]; nan before the first equilibrium.
    """

    strains: Float[np.ndarray, "*batch cables elements"]
    beyond: Float[np.ndarray, "*batch cables"]
    creep: Float[np.ndarray, "*batch cables terms"]
    tensions: Float[np.ndarray, "*batch cables"]
    time: float

    @classmethod
    def fresh(cls, robot: Robot, shape: tuple[int, ...] = ()) -> Memory:
        """The memory of new ropes: no element has yielded, no friction acts, nothing has crept.

        Args:
            robot: the robot.
            shape: (...), of many paths side by side.

        Returns:
            The memory before the first equilibrium of a path.

        Raises:
            InvalidInput: not a robot, or not a shape.
        """
        refuse_unless(Robot, robot=robot)
        cables = (*(whole("shape", size, 1) for size in listed("shape", shape)), robot.cables)
        return cls(
            strains=np.zeros((*cables, robot.hysteresis.shape[1])),
            beyond=np.full(cables, np.nan),
            creep=np.zeros((*cables, robot.creep.shape[1])),
            tensions=np.zeros(cables),
            time=np.nan,
        )

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """The numbers of all cables, by name: all but the time."""
        return {name: getattr(self, name) for name in ("strains", "beyond", "creep", "tensions")}

    @property
    def shape(self) -> tuple[int, ...]:
        """(...), the paths side by side."""
        return self.tensions.shape[:-1]

    def __getitem__(self, row: SupportsIndex | tuple[SupportsIndex, ...] | None) -> Memory:
        """The memory of one of the paths, or with another dimension for ``None``."""
        return dataclasses.replace(self, **{name: array[row].copy() for name, array in self.arrays.items()})

    def broadcast(self, robot: Robot, shape: tuple[int, ...]) -> Memory:
        """This memory for paths of ``robot`` side by side.

        Returns:
            A copy of ``shape``.

        Raises:
            InvalidInput: a memory of other cables or another number of paths, or of a path that ended before.
        """
        fresh = Memory.fresh(robot, shape)
        parts = {}
        for name, mine in self.arrays.items():
            wanted = getattr(fresh, name)
            try:
                parts[name] = np.broadcast_to(mine, wanted.shape).copy()
            except ValueError:
                raise InvalidInput(
                    f"memory: found {name} of shape {mine.shape}, expected {wanted.shape}, those of {robot.name!r}"
                ) from None
        if np.isnan(parts["tensions"]).any():
            raise InvalidInput("memory: found that of a path without an equilibrium at its end, expected one with")
        return Memory(**parts, time=self.time)

    def __repr__(self) -> str:
        moment = "before the first equilibrium" if np.isnan(self.time) else f"at {self.time:g} s"
        return f"<Memory of {self.tensions.shape[-1]} cables, {self.shape or 'one path'}, {moment}>"


def without_memory(robot: Robot) -> Robot:
    """The same robot with elastic cables."""
    if not robot.cabling.has_memory.any():
        return robot
    return robot.replace(**{name: PROPERTIES[name].default for name in MEMORIES})
