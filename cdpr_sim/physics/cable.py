"""The law of cables in MuJoCo's terms: one value, made from their properties, and the springs that follow from it.

MuJoCo's spring pulls with s (k + s (p + q s)) at the stretch s (``stiffness`` k, ``stiffnesspoly`` p and q). A rope
with n parts of line and a length g between winch and exit stretches by n (l - l0) over its length L = n l0 + g, and
each part pulls. As one tendon it has the coefficients n² EA/L, n³ EA a2/L² and n⁴ EA a3/L³; its force is n tau. What is
rigid at the anchor is part of the tendon's length, and none of L.

This is the law's second coding: the mathematics has its own in ``core.cable_law``, and neither reads the other's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.core.cable import MOST_STRAIN, Cabling
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot

STRETCHINGS, LEAST_SLOPE, EXACT = 30, 0.01, 1e-13
"""Largest number of Newton steps to the stretch under a pull, of which a handful suffice; the least slope of a spring
that they assume, as a fraction of its slope at rest; and the fraction of the stretch that ends them."""

STRENGTH = 0.015
"""Strength of a rope, as a fraction of EA, where neither its largest tension nor its breaking load is known. The fibre
and steel ropes of the catalogue break at 0.0156 to 0.0177 of their EA."""


class Springs(NamedTuple):
    """Springs with MuJoCo's polynomial: stiffness [N/m], and the coefficients of the stretch's square and cube."""

    stiffness: Float[np.ndarray, "*#batch"]
    square: Float[np.ndarray, "*#batch"]
    cube: Float[np.ndarray, "*#batch"]

    @property
    def polynomial(self) -> Float[np.ndarray, "*batch 2"]:
        """MuJoCo's ``stiffnesspoly`` [N/m², N/m³]."""
        return np.stack([self.square, self.cube], axis=-1)

    def some(self, which: Any) -> Springs:
        """Those of an index of the arrays."""
        return Springs(*(number[which] for number in self))

    def force(
        self, stretches: Float[np.ndarray, "*#batch"]
    ) -> tuple[Float[np.ndarray, "*#batch"], Float[np.ndarray, "*#batch"]]:
        """Their force at these stretches [m], and its slope by the stretch."""
        stiffness, square, cube = self
        force = stretches * (stiffness + stretches * (square + cube * stretches))
        return force, stiffness + stretches * (2 * square + 3 * cube * stretches)

    def energy(self, stretches: Float[np.ndarray, "*#batch"]) -> Float[np.ndarray, "*#batch"]:
        """Their energy at these stretches [J]."""
        stiffness, square, cube = self
        return stretches**2 * (stiffness / 2 + stretches * (square / 3 + cube / 4 * stretches))

    def stretched(
        self, pulls: Float[np.ndarray, "*#batch"]
    ) -> tuple[Float[np.ndarray, "*#batch"], Float[np.ndarray, "*#batch"]]:
        """Their stretches [m] under these pulls [N], and the slope of those [m/N], by Newton's method."""
        stretch, slope = pulls / self.stiffness, self.stiffness
        sought = np.ones(np.shape(stretch), dtype=bool)  # no spring has an effect on another one
        for _ in range(STRETCHINGS if self.square.any() or self.cube.any() else 0):
            force, slopes = self.force(stretch)
            slope = np.where(sought, np.maximum(slopes, LEAST_SLOPE * self.stiffness), slope)
            step = np.where(sought, (force - pulls) / slope, 0.0)
            stretch = np.maximum(stretch - step, 0)
            sought &= np.abs(step) > EXACT * stretch
            if not sought.any():
                break
        return stretch, 1 / slope


@dataclass(frozen=True, eq=False)
class Law:
    """The law of cables, apart from their memory.

    Attributes:
        stiffness: EA of the ropes [N].
        square, cube: coefficients of tau = EA (eps + square eps² + cube eps³).
        parts: of line.
        far: length of rope between winch and exit [m].
        rigid: part of the rest length that is rigid, at the anchor [m].
        held: whether friction holds the rope at the exit.
        linear: whether ``square`` and ``cube`` are 0 in all cables.
    """

    stiffness: Float[np.ndarray, "*#batch cables"]
    square: Float[np.ndarray, " cables"]
    cube: Float[np.ndarray, " cables"]
    parts: Int[np.ndarray, " cables"]
    far: Float[np.ndarray, " cables"]
    rigid: Float[np.ndarray, " cables"]
    held: Bool[np.ndarray, " cables"]
    linear: bool

    @classmethod
    def of(cls, cabling: Cabling) -> Law:
        """The law of a robot's cables."""
        square, cube = cabling.stiffening.T
        lengths = cabling.winch_to_exit, cabling.rigid_length
        held = cabling.has("pulley_friction")
        return cls(cabling.axial_stiffness, square, cube, cabling.reeving, *lengths, held, cabling.linear)

    @classmethod
    def of_rows(cls, problems: Problems) -> Law:
        """The law of the cables of (rows,) problems, which may have an EA of their own."""
        whole, shape = cls.of(problems.robot.cabling), (len(problems), problems.robot.cables)
        return replace(whole, stiffness=np.broadcast_to(problems.axial_stiffness, shape))

    def at(self, rows: Any) -> Law:
        """The law of some rows."""
        return replace(self, stiffness=self.stiffness[rows])

    def some(self, which: Any) -> Law:
        """The law of some cables, by an index of the last dimension."""
        numbers = {name: getattr(self, name)[..., which] for name in self.__dict__ if name != "linear"}
        return replace(self, **numbers)

    @property
    def behind(self) -> Float[np.ndarray, " cables"]:
        """Length of rope between winch and exit for each part of line [m]: it stretches with the cable."""
        return self.far / self.parts

    def ropes(self, rest_lengths: Float[np.ndarray, "*#batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """Length of rope between exit and anchor, for each part of line [m]: it stretches and weighs."""
        return rest_lengths - self.rigid

    @property
    def added(self) -> Float[np.ndarray, " cables"]:
        """Length that stretches besides the rest length, for each part of line [m]; negative where less does."""
        return self.behind - self.rigid

    def springs(self, rest_lengths: Float[np.ndarray, "*#batch cables"]) -> Springs:
        """The springs of tendons from exit to anchor."""
        return self._over(self.parts * self.ropes(rest_lengths) + self.far)

    def sticking(self, rest_lengths: Float[np.ndarray, "*#batch cables"]) -> Springs:
        """The same where friction holds the ropes at their exits."""
        return self._over(self.parts * self.ropes(rest_lengths))

    def segments(self, lengths: Float[np.ndarray, "*batch cables segments"]) -> Springs:
        """The springs of all segments of chains, the first with the rope behind it, the last with what is rigid."""
        each = self.some(None)
        ropes = each.parts * lengths
        ropes[..., 0] += self.far
        ropes[..., -1] -= self.parts * self.rigid
        return each._over(ropes)

    def steepest(self, rest_lengths: Float[np.ndarray, "*#batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """A stiffness of the tendons that none exceeds up to ``MOST_STRAIN`` [N/m]."""
        steeper = 2 * MOST_STRAIN * np.abs(self.square) + 3 * MOST_STRAIN**2 * np.abs(self.cube)
        return self.springs(rest_lengths).stiffness * (1 + steeper)

    @property
    def strained(self) -> Springs:
        """Springs whose stretch is the strain: the pulls of all parts of line together [N]."""
        pulled = self.parts * self.stiffness
        return Springs(pulled, pulled * self.square, pulled * self.cube)

    def strains(
        self, lengths: Float[np.ndarray, "*#batch cables"], rest_lengths: Float[np.ndarray, "*#batch cables"]
    ) -> Float[np.ndarray, "*batch cables"]:
        """Strains of cables that are ``lengths`` long and of which winches have let out ``rest_lengths`` [m]."""
        return (lengths - rest_lengths) / (rest_lengths + self.added)

    def rest_lengths(
        self, strains: Float[np.ndarray, "*#batch cables"], lengths: Float[np.ndarray, "*#batch cables"]
    ) -> Float[np.ndarray, "*batch cables"]:
        """Rest lengths of cables with these strains that are ``lengths`` long [m]."""
        return (lengths - strains * self.added) / (1 + strains)

    def _over(self, ropes: Float[np.ndarray, "*#batch"]) -> Springs:
        """Springs of tendons for ropes of these unstretched lengths [m]."""
        parts = self.parts
        stiffness = parts * parts * self.stiffness / ropes
        if self.linear:
            none = np.zeros(stiffness.shape)
            return Springs(stiffness, none, none)
        squares = ropes * ropes
        square = parts**3 * (self.stiffness * self.square) / squares
        return Springs(stiffness, square, parts**4 * (self.stiffness * self.cube) / (squares * ropes))


def strengths(cabling: Cabling) -> tuple[Float[np.ndarray, " cables"], Bool[np.ndarray, " cables"]]:
    """Tensions that ropes and winches bear [N]; and of which cables they are known, and not ``STRENGTH`` EA."""
    limits = np.minimum(cabling.force_max, cabling.breaking_load)
    known = np.isfinite(limits)
    return np.where(known, limits, STRENGTH * cabling.axial_stiffness), known


def from_exit_on(robot: Robot) -> Cabling:
    """The cables of a robot from their exits on: without friction there, and without rope behind."""
    ropes = dict(winch_to_exit=0.0, hysteresis=robot.hysteresis, creep=robot.creep)
    return without_memory(robot).replace(**ropes).cabling


def in_words(cabling: Cabling) -> tuple[str, str]:
    """The formula of the tension in a model's description; and what its winches add to lengths, "" for nothing."""
    parts, whole, said, added = "", "l0", [], ""
    rigid = bool(cabling.has("rigid_length").any())
    if (cabling.has("winch_to_exit") | cabling.has("reeving")).any():
        parts, whole, said = "n ", "l0 + g/n", ["n parts of line and g from winch to exit"]
        added = "With a rope g from winch to exit and n parts of line, g/n is added to L and l0."
    if rigid:
        whole, said = f"{whole} - d", [*said, "d rigid at the anchor"]
        added = f"{added} What is rigid at the anchor, d, is subtracted from L and l0.".strip()
    whole = f"({whole})" if said else whole
    law = f"{parts}EA (l - l0)/{whole}"
    if not cabling.linear:
        law = f"{parts}EA (eps + a2 eps² + a3 eps³), eps = (l - l0)/{whole},"
    return law + (f" with {', '.join(said)}" if said else ""), added
