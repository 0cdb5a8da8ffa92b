"""Cables with a memory in motion: their pull and their memory from one time step to the next.

A time step is a step of a path: the cables go straight from the lengths at its beginning to those at its end, by the
law of ``rope_memory``, and their memory follows. Nothing is held as on the way to an equilibrium: in a motion, an
overshoot is real, and an element that slides in it does not return.

Friction at the exit acts differently on the two kinds of winches. A winch that controls a length has the rope behind
the exit as a spring. One that controls a tension T has this tension behind the exit, and the platform is pulled with
T/rho to rho T: within these limits the rope sticks at the exit, and its part from there to the platform is a spring
whose rest length stays; at a limit it slides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.memory import Memory
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.cable import Law, from_exit_on
from cdpr_sim.physics.rope_memory import RopeStep, largest_ratio


@dataclass(frozen=True)
class RopeState:
    """Cables at the end of a time step.

    Attributes:
        pulls: on the platform, (cables,) [N].
        slopes: of the pulls by the lengths, (cables,) [N/m].
        rest_lengths: that winches have let out, (cables,) [m].
        sticks: which ropes stick at their exits, (cables,); of winches that control tensions.
        memory: the memory, (1, cables).
    """

    pulls: Float[np.ndarray, " cables"]
    slopes: Float[np.ndarray, " cables"]
    rest_lengths: Float[np.ndarray, " cables"]
    sticks: Bool[np.ndarray, " cables"]
    memory: Memory

    def where(self, cables: Bool[np.ndarray, " cables"], other: RopeState) -> RopeState:
        """This state, with that of the ``other`` in some ``cables``."""

        def mixed(mine: np.ndarray, others: np.ndarray) -> np.ndarray:
            mask = cables if mine.ndim < 3 else cables[:, None]  # (1, cables, elements)
            return np.where(mask, others, mine)

        arrays = {name: mixed(mine, other.memory.arrays[name]) for name, mine in self.memory.arrays.items()}
        return RopeState(
            mixed(self.pulls, other.pulls),
            mixed(self.slopes, other.slopes),
            mixed(self.rest_lengths, other.rest_lengths),
            mixed(self.sticks, other.sticks),
            replace(self.memory, **arrays),
        )


class RopeMotion:
    """The cables of a robot in motion.

    Attributes:
        memory: their memory at the beginning of a time step, (1, cables).
    """

    def __init__(self, robot: Robot, memory: Memory) -> None:
        self.memory, self._cabling, self._bare = memory, robot.cabling, from_exit_on(robot)
        self._rho, self._law = largest_ratio(self._cabling), Law.of(self._cabling)

    def at(
        self,
        lengths: Float[np.ndarray, " cables"],
        rest_lengths: Float[np.ndarray, " cables"],
        seconds: float,
        within: Float[np.ndarray, " cables"],
        *,
        slopes: bool = False,
    ) -> RopeState:
        """Cables of these ``lengths`` [m] whose winches have let out ``rest_lengths`` [m], after ``seconds``.

        Of chains, ``within`` [m] is the rest length of all segments but the first, in which the memory acts. Without
        ``slopes``, these are 0.
        """
        step = RopeStep.of(self._cabling, self._law, rest_lengths[None], self.memory, seconds)
        if within.any():
            step = step.in_chain(rest_lengths[None] - within)
        pulls = step.pulls(step.stretches(lengths[None]))
        memory = step.memory_after(lengths[None], self._cabling.tensions(pulls))
        none = np.zeros(len(lengths))
        slope = np.where(pulls[0] > 0, step.tangent(lengths[None])[0][0], 0.0) if slopes else none
        return RopeState(pulls[0], slope, rest_lengths, none.astype(bool), memory)

    def under(
        self, lengths: Float[np.ndarray, " cables"], tensions: Float[np.ndarray, " cables"], seconds: float
    ) -> RopeState:
        """Cables of these ``lengths`` [m] whose winches hold ``tensions`` [N] and run as fast as that takes."""
        law, beyond = Law.of(self._bare), self.memory.beyond[0]
        step = RopeStep.of(self._bare, law, beyond[None], self.memory, seconds)
        unmoved, wanted = step.pulls(step.stretches(lengths[None]))[0], self._cabling.pulls(tensions)
        pulls = np.clip(unmoved, wanted / self._rho, wanted * self._rho)
        sticks = (pulls == unmoved) & (self._rho > 1)
        stretches = step.stretches_under(pulls[None])
        crept = (step.lasting + step.growing * pulls[:, None]).sum(-1)
        slid = law.rest_lengths((stretches / step.ropes + crept)[0], lengths)
        beyond = np.where(sticks, beyond, slid)
        moved = RopeStep.of(self._bare, law, beyond[None], self.memory, seconds)
        held = self._cabling.tensions(pulls)
        memory = moved.memory_after(lengths[None], held[None])
        # What is behind has the tension of the winch.
        behind = 1 + law.strains(lengths, beyond) + (tensions - held) / law.stiffness
        rest_lengths = beyond - self._law.behind * (behind - 1) / behind
        return RopeState(pulls, np.zeros_like(pulls), rest_lengths, sticks, replace(memory, beyond=beyond[None]))
