"""Cables with a memory in MuJoCo: elasto-plastic springs beside each cable's own spring, and how they are held.

Each element of hysteresis, and friction at the exit, is a further tendon along its cable (``add_elements``). Its
spring has MuJoCo's ``springyield``: it slides where its force would exceed stiffness times ``springyield``, and its
free length, ``mjData.plastic``, then changes. The pull on the platform at the cable's stretch e > 0 is

    own e + Σ k_j s_j,   s_j = clip(e − z_j, ±min(Y_j, w_j e)),   and after the step   z_j := e − s_j;

a nonlinear law adds its square and cube to the own spring. The pull is 0 where e <= 0, and then all z_j = 0. The bound
w_j e is set here, since MuJoCo's ``springyield`` is a number: without it an element that has yielded would push on a
platform that comes near the exit.

On its way to rest a platform overshoots, and elements that have slid do not return: MuJoCo alone comes to rest with
another memory. So elements are *held*: every few time steps they are put where they are after a straight way from the
beginning of the step to the present lengths. At equilibrium, the forces are those of the law above, however
the platform came there. Between two such corrections, MuJoCo's own springs slide.

Creep lengthens a cable by a strain that depends on its tension. For a tension that is linear in time it is, for the
duration of a step, a longer rest length and a compliance in series with the springs.

This is the law's second coding: the mathematics has its own, and neither reads the other's.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import Batch

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.memory import Memory
from cdpr_sim.physics.cable import Law, Springs

PerCable: TypeAlias = Float[np.ndarray, "rows cables"]
PerElement: TypeAlias = Float[np.ndarray, "rows cables elements"]

MOST_STEPS, ENOUGH = 100, 1e-12
"""Most Newton steps to a point of a nonlinear law, of which a handful suffice; and the last one, as a fraction."""

LEAST_GRIP = 1e-6
"""Least stiffness of friction's element, as a fraction of the own spring's; where the rope slides, any will do."""

LEAST_YIELD = 1e-14
"""[m] ``springyield`` of an element that holds nothing: with 0, MuJoCo would slide it in every step."""


def elements_of(cabling: Cabling) -> int:
    """Number of elements of each cable: those of hysteresis, and one for friction."""
    return cabling.hysteresis.shape[1] + bool((_friction(cabling) > 0).any())


def _friction(cabling: Cabling) -> Float[np.ndarray, " cables"]:
    """c where it has an effect: without rope behind the exit, winches that hold lengths do not feel it."""
    return np.where(cabling.behind > 0, cabling.pulley_friction, 0.0)


def largest_ratio(cabling: Cabling) -> Float[np.ndarray, " cables"]:
    """Largest ratio rho of the tensions before and behind an exit; the least one is 1/rho."""
    friction = cabling.pulley_friction
    return (1 + friction / 2) / (1 - friction / 2)


def add_elements(spec: mujoco.MjSpec, cabling: Cabling) -> None:
    """The tendons ``memory_1_1``, ... along the tendons ``cable_1``, ... of a model, behind all its tendons."""
    for i in range(1, len(cabling) + 1):
        way = list(spec.tendon(f"cable_{i}").path)
        for j in range(1, elements_of(cabling) + 1):
            element = spec.add_tendon(name=f"memory_{i}_{j}", springlength=[1.0, 1.0], springyield=1.0)
            element.stiffness[0] = 1.0  # numbers of a step replace these; a yield of 0 would compile an elastic spring
            for part in way:
                if part.type == mujoco.mjtWrap.mjWRAP_SITE:
                    element.wrap_site(part.target.name)
                else:
                    element.wrap_geom(part.target.name, part.sidesite.name)


class Parts(NamedTuple):
    """Springs and elements of cables at their present stretches.

    Attributes:
        pull, slope: of the own spring [N, N/m].
        elements: stiffness of each element [N/m].
        bounds: its largest stretch [m].
        elastic: the stretch that it would have if it did not slide [m].
    """

    pull: PerCable
    slope: PerCable
    elements: PerElement
    bounds: PerElement
    elastic: PerElement

    @property
    def held(self) -> PerElement:
        """Stretches of the elements of cables that went straight there [m]."""
        return np.clip(self.elastic, -self.bounds, self.bounds)

    @property
    def forces(self) -> PerCable:
        """Their pull on the platform, (rows, cables) [N]."""
        return self.pull + (self.elements * self.held).sum(-1)


@dataclass(frozen=True)
class RopeStep:
    """The cables of rows side by side, for one step from a memory; of all parts of line together.

    Attributes:
        cabling: the cables.
        law: theirs without a memory.
        rest_lengths: from exit to anchor, (rows, cables) [m].
        beyond: the rope in these, (rows, cables) [m].
        ropes: with the part behind the exit, L, (rows, cables) [m].
        own: the cable's own spring, (rows, cables).
        elements: stiffness of each element, (rows, cables, elements) [N/m]; friction is the last.
        yields: its largest stretch, (rows, cables, elements) [m].
        widths: its largest stretch as a fraction of the cable's, (rows, cables, elements).
        free: stretch of the cable at which it is free, z, (rows, cables, elements) [m].
        middle: slope of the pull between those of a rope that slides out and in, (rows, cables) [N/m].
        rubbing: the cable's stiffness while the rope sticks at its exit, EA/l0, (rows, cables) [N/m].
        gripped: which nonlinear cables rub at their exits, (rows, cables): the numbers of their friction's element
            depend on the stretch.
        kept: stretch of the rope behind the exit while the rope sticks there, (rows, cables) [m].
        beside: length of rope whose stretch this law leaves out, (rows, cables) [m]: of a cable with mass, whose memory
            acts in the first segment of its chain, that of the other segments.
        lasting, growing: strain of each term of creep at the end of the step: what does not depend on the tension then,
            and its growth by each newton of the pull then, (rows, cables, terms) [1, 1/N].
    """

    cabling: Cabling
    law: Law
    rest_lengths: PerCable
    beyond: PerCable
    ropes: PerCable
    own: Springs
    elements: PerElement
    yields: PerElement
    widths: PerElement
    free: PerElement
    middle: PerCable
    rubbing: PerCable
    gripped: Bool[np.ndarray, "rows cables"]
    kept: PerCable
    beside: PerCable
    lasting: Float[np.ndarray, "rows cables terms"]
    growing: Float[np.ndarray, "rows cables terms"]

    @classmethod
    def of(
        cls,
        cabling: Cabling,
        law: Law,
        rest_lengths: PerCable,
        memory: Memory,
        duration: float = 0.0,
    ) -> RopeStep:
        """The step of ``duration`` [s] from ``memory``, of (rows,) paths, with this law and these rest lengths.

        Friction lets the rope's tension before the exit differ from that behind it by factors within [1/rho, rho]. The
        rope pulls by ``most`` per stretch where it slides out, and by ``least`` where it slides in.
        """
        parts, behind, beyond = law.strained.stiffness, law.behind, law.ropes(rest_lengths)
        ropes = beyond + behind
        c = _friction(cabling)
        rho = np.where(c > 0, largest_ratio(cabling), 1.0)
        most, least = parts / (beyond + behind / rho), parts / (beyond + behind * rho)
        rubbing, middle = parts / beyond, (most + least) / 2
        new = np.isnan(memory.beyond)
        friction = np.where(c > 0, rubbing - middle, 0.0)
        loading = np.where(new | (c == 0), parts / ropes, middle)
        shares, strains, widths = np.moveaxis(cabling.hysteresis, -1, 0)
        elements, yields = shares * loading[..., None], strains * ropes[..., None]
        widths, free = np.broadcast_to(widths, elements.shape), memory.strains * ropes[..., None]
        if (c > 0).any():
            divisor = np.where(friction > 0, friction, 1.0)
            held = np.where(new, 0.0, rubbing / divisor * (memory.beyond - rest_lengths))
            columns = np.where(new, 0.0, friction), np.full_like(friction, np.inf), (most - least) / 2 / divisor, held
            elements, yields, widths, free = (
                np.concatenate([array, column[..., None]], axis=-1)
                for array, column in zip((elements, yields, widths, free), columns, strict=True)
            )
        modulus, times = np.moveaxis(cabling.creep, -1, 0)
        elapsed = duration / times
        left = np.exp(-elapsed)
        mean = np.where(elapsed > 0, -np.expm1(-elapsed) / np.where(elapsed > 0, elapsed, 1), 1.0)
        return cls(
            cabling=cabling,
            law=law,
            rest_lengths=rest_lengths,
            beyond=beyond,
            ropes=ropes,
            own=law.springs(rest_lengths)._replace(stiffness=(1 - shares.sum(-1)) * loading),
            elements=elements,
            yields=yields,
            widths=widths,
            free=free,
            middle=middle,
            rubbing=rubbing,
            gripped=(c > 0) & cabling.nonlinear & ~new,
            kept=np.where(new, 0.0, memory.beyond - rest_lengths),
            beside=np.zeros_like(rest_lengths),
            lasting=left * memory.creep + (mean - left) / modulus * memory.tensions[..., None],
            growing=np.broadcast_to((1 - mean) / (modulus * law.parts[:, None]), memory.creep.shape),
        )

    def in_chain(self, rest_lengths: PerCable) -> RopeStep:
        """The same for springs between exit and first mass, with a memory for all of the cable.

        Args:
            rest_lengths: of these first segments [m]; of massless cables, from exit to anchor.
        """
        return replace(self, beside=np.maximum(self.beyond - rest_lengths, 0))

    @cached_property
    def taut(self) -> PerCable:
        """Length from which on a cable is stretched, (rows, cables) [m]."""
        return self.rest_lengths + self.ropes * self.lasting.sum(-1)

    @cached_property
    def compliance(self) -> PerCable:
        """Length by which creep lengthens a cable for each newton at the end of the step, (rows, cables) [m/N]."""
        return self.ropes * self.growing.sum(-1)

    @cached_property
    def rho(self) -> Float[np.ndarray, " cables"]:
        """Largest ratio of the tensions before and behind each exit, (cables,)."""
        return np.where(_friction(self.cabling) > 0, largest_ratio(self.cabling), 1.0)

    @cached_property
    def curved(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have a nonlinear law, (cables,)."""
        return self.cabling.nonlinear

    def softer(self, springs: Parts) -> PerCable:
        """Stiffness with creep over that without it, (rows, cables), where no element slides."""
        stiff = springs.slope + springs.elements.sum(-1)
        return 1 / (1 + self.compliance * stiff)

    def springs(self, stretches: PerCable) -> Parts:
        """The springs of the cables at these ``stretches`` [m]."""
        e = stretches
        found = Parts(*self.own.force(e), self.elements, self.bounds(e), e[..., None] - self.free)
        return self._gripping(e, found) if self.gripped.any() else found

    def bounds(self, stretches: PerCable) -> PerElement:
        """The largest stretches [m] of the elements at these ``stretches`` [m]; not of friction in nonlinear ropes."""
        return np.minimum(self.yields, self.widths * stretches[..., None])

    def pulls(self, stretches: PerCable) -> PerCable:
        """Pull on the platform, (rows, cables) [N], of cables that went straight to these ``stretches`` [m]."""
        return self.springs(stretches).forces

    def _gripping(self, stretches: PerCable, springs: Parts) -> Parts:
        """The same with the friction of nonlinear ropes: their own springs pull by the mean of what friction allows.

        A rope that slides with the ratio x of the tensions behind and beyond its exit has the stretch
        l0 eps(T) + g eps(x T), and one that sticks l0 eps(T) + ``kept``.
        """
        (out, out_slope), (back, back_slope) = (self._sliding(stretches, x) for x in (1 / self.rho, self.rho))
        stuck = stretches - self.kept
        sticking, _ = self._tension(stuck / self.beyond)
        # Where the rope slides, the spring is that of a rope that is about to: the law goes on to any stiffness.
        _, sticking_slope = self._tension(np.minimum(stuck / self.beyond, self._strain(out)))
        middle, middle_slope = (out + back) / 2, (out_slope + back_slope) / 2
        stiff = np.maximum(sticking_slope / self.beyond - middle_slope, LEAST_GRIP * middle_slope)
        lost = self.elements[..., :-1].sum(-1)
        gripped = self.gripped

        def last(column: np.ndarray, array: np.ndarray) -> np.ndarray:
            array = np.broadcast_to(array, (*gripped.shape, self.elements.shape[-1])).copy()
            array[..., -1] = np.where(gripped, column, array[..., -1])
            return array

        return Parts(
            pull=np.where(gripped, middle - lost * stretches, springs.pull),
            slope=np.where(gripped, middle_slope - lost, springs.slope),
            elements=last(stiff, springs.elements),
            bounds=last((out - back) / 2 / stiff, springs.bounds),
            elastic=last((sticking - middle) / stiff, springs.elastic),
        )

    def _tension(self, strains: PerCable) -> tuple[PerCable, PerCable]:
        """Pull [N] of a rope with this strain, and its slope by strain [N]."""
        strained = self.law.strained
        pull, slope = strained.force(np.maximum(strains, 0.0))
        return np.where(strains > 0, pull, strained.stiffness * strains), slope

    def _strain(self, pulls: PerCable) -> PerCable:
        """Strain of a rope under these pulls [N]."""
        return self.law.strained.stretched(pulls)[0]

    def _sliding(self, stretches: PerCable, ratio: Float[np.ndarray, " cables"]) -> tuple[PerCable, PerCable]:
        """Pull [N], and its slope [N/m], of ropes that slide at their exits with this ratio of tensions."""
        behind = self.law.behind
        strains = stretches / (self.beyond + ratio * behind)
        steps = 0
        while True:
            pull, slope = self._tension(strains)
            far = self._strain(ratio * pull)
            per_strain = self.beyond + behind * ratio * slope / self._tension(far)[1]
            step = (self.beyond * strains + behind * far - stretches) / per_strain
            steps += 1
            if steps == MOST_STEPS or (np.abs(step) <= ENOUGH * strains).all():
                return pull, slope / per_strain
            strains = np.maximum(strains - step, 0.0)

    def stretches(self, lengths: PerCable) -> PerCable:
        """e of cables of these ``lengths``, (rows, cables) [m]: what is not creep; 0 where not stretched."""
        beyond = np.maximum(lengths - self.taut, 0)
        if not (self.compliance.any() or self.beside.any()):
            return beyond
        return self._where(self._widened, beyond, beyond)

    def stretches_under(self, pulls: PerCable) -> PerCable:
        """e of cables that pull on the platform with ``pulls``, (rows, cables) [N]."""
        guess = pulls / self.own.stiffness
        return self._where(lambda e, springs: (springs.forces, self.slopes(e, springs)), pulls, guess)

    def _where(
        self,
        function: Callable[[np.ndarray, Parts], tuple[np.ndarray, np.ndarray]],
        wanted: PerCable,
        guess: PerCable,
    ) -> PerCable:
        """Stretches at which an increasing ``function`` is as ``wanted``: Newton's method between bounds that close.

        The function returns its values and its slopes.
        """
        low, high, e = np.zeros_like(guess), np.full_like(guess, np.inf), guess
        for _ in range(MOST_STEPS):
            found, slope = function(e, self.springs(e))
            missed = found - wanted
            low, high = np.where(missed <= 0, e, low), np.where(missed > 0, e, high)
            following = e - missed / slope
            outside = (following < low) | (following > high)
            following = np.where(outside, np.where(np.isinf(high), 2 * e + guess, (low + high) / 2), following)
            close = (np.abs(following - e) <= ENOUGH * e).all()
            e = following
            if close:
                break
        return e

    def _widened(self, stretches: PerCable, springs: Parts) -> tuple[PerCable, PerCable]:
        """By how much these stretches, with creep, lengthen the tendon [m], and the slope of that."""
        forces = springs.forces
        strains = self._strain(forces)
        beside = self.beside * strains
        softening = self.compliance - self.beside / self._tension(strains)[1]
        return stretches + self.compliance * forces - beside, 1 + softening * self.slopes(stretches, springs)

    def slopes(self, stretches: PerCable, springs: Parts) -> PerCable:
        """How much a stretch changes the forces, with what slides [N/m]."""
        wedge = np.where(self.widths * stretches[..., None] < self.yields, np.sign(springs.elastic) * self.widths, 0.0)
        slides = np.abs(springs.elastic) > springs.bounds
        slope = springs.slope + (springs.elements * np.where(slides, wedge, 1.0)).sum(-1)
        if self.gripped.any():
            (_, out), (_, back) = (self._sliding(stretches, x) for x in (1 / self.rho, self.rho))
            stuck = slope - (springs.elements * np.where(slides, wedge, 1.0))[..., -1]
            elastic = springs.elastic[..., -1]
            sliding = np.where(elastic > 0, out - back, back - out) / 2
            grip = np.where(slides[..., -1], sliding, springs.elements[..., -1])
            slope = np.where(self.gripped, stuck + grip, slope)
        return slope

    def tangent(self, lengths: PerCable) -> tuple[PerCable, PerCable]:
        """Stiffness [N/m], and free length [m], of a spring that pulls like each cable at and near ``lengths``."""
        stretches = self.stretches(lengths)
        springs = self.springs(stretches)
        slope = self.slopes(stretches, springs) / self._widened(stretches, springs)[1]
        return slope, np.where(stretches > 0, lengths - springs.forces / slope, self.taut)

    def memory_after(self, lengths: PerCable, tensions: PerCable) -> Memory:
        """The memory, without its time, of cables at rest at these ``lengths`` [m] with these ``tensions`` [N]."""
        stretches, pulls = self.stretches(lengths), self.cabling.pulls(tensions)
        hysteresis = self.cabling.hysteresis.shape[1]
        held, left = self.springs(stretches).held, stretches[..., None]
        gave_way = (self.cabling.hysteresis[..., 0] * (left - held[..., :hysteresis])).sum(-1)
        free = self.beyond * self._strain(pulls + self.middle * gave_way)
        beyond = np.where(_friction(self.cabling) > 0, self.rest_lengths + stretches - free, self.rest_lengths)
        unstretched = stretches <= 0
        return Memory(
            strains=np.where(unstretched[..., None], 0.0, (left - held[..., :hysteresis]) / self.ropes[..., None]),
            beyond=np.where(unstretched, self.rest_lengths, beyond),
            creep=self.lasting + self.growing * pulls[..., None],
            tensions=tensions,
            time=np.nan,
        )


class Elements:
    """The elements of the first ``rows`` simulations side by side in MuJoCo.

    Attributes:
        of: the tendons of each cable's elements, (cables, elements).
        yields: ``springyield`` of all tendons of all simulations.
    """

    def __init__(self, batch: Batch, model: mujoco.MjModel, cabling: Cabling, unit: float, rows: int) -> None:
        cables, elements = len(cabling), elements_of(cabling)
        ids = slice(cables, cables + cables * elements)
        self._unit, self.of = unit, np.arange(ids.start, ids.stop).reshape(cables, elements)
        self.yields = batch.expand("tendon_springyield")
        self._stiffnesses, self._yields = batch.expand("tendon_stiffness")[:rows, ids], self.yields[:rows, ids]
        self._plastic, self._lower = batch.bind("plastic"), model.tendon_plasticadr[ids]

    def hold(
        self,
        step: RopeStep,
        rows: Bool[np.ndarray, " rows"],
        tendons: PerCable,
        entries: Float[np.ndarray, " cables"],
    ) -> tuple[PerCable, PerCable]:
        """Put the elements of ``rows`` where cables have them that went straight from the start of ``step``.

        Args:
            step: the step.
            rows: which.
            tendons: lengths of the cables' tendons [m].
            entries: by which they are longer than the cables, (cables,) [m].

        Returns:
            Stiffness of the cables' own springs, in MuJoCo's unit, and the length from which on they pull [m], of all
            rows, (rows, cables).
        """
        stretches = step.stretches(tendons - entries)
        springs, unstretched = step.springs(stretches), stretches <= 0
        softer = step.softer(springs)
        shape = (int(rows.sum()), self.of.size)
        yields = np.maximum(springs.bounds / softer[..., None], LEAST_YIELD)
        stiffnesses = np.where(unstretched[..., None], 0.0, springs.elements * softer[..., None] / self._unit)
        free = tendons[..., None] - springs.held / softer[..., None]
        self._yields[rows], self._stiffnesses[rows] = yields[rows].reshape(shape), stiffnesses[rows].reshape(shape)
        where = np.flatnonzero(rows)[:, None]
        self._plastic[where, self._lower] = self._plastic[where, self._lower + 1] = free[rows].reshape(shape)
        straight = ~(step.compliance.astype(bool) | step.curved)
        own = springs.slope * softer
        return own / self._unit, np.where(unstretched | straight, step.taut + entries, tendons - springs.pull / own)
