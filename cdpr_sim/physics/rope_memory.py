"""Cables with a memory in MuJoCo: elasto-plastic springs beside each cable's own spring, and how they are held.

Each element of hysteresis, and friction at the exit, is a further tendon along its cable (``add_elements``). Its
spring has MuJoCo's ``springyield``: it slides where its force would exceed stiffness times ``springyield``, and its
free length, ``mjData.plastic``, then changes. The pull on the platform at the cable's stretch e > 0 is

    own e + Σ k_j s_j,   s_j = clip(e − z_j, ±min(Y_j, w_j e)),   and after the step   z_j := e − s_j;

it is 0 where e <= 0, and then all z_j = 0. The bound w_j e is set here, since MuJoCo's ``springyield`` is a number:
without it an element that has yielded would push on a platform that comes near the exit.

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

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import Batch

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.memory import Memory

LEAST_YIELD = 1e-14
"""[m] ``springyield`` of an element that holds nothing: with 0, MuJoCo would slide it in every step."""


def elements_of(cabling: Cabling) -> int:
    """Number of elements of each cable: those of hysteresis, and one for friction."""
    return cabling.hysteresis.shape[1] + bool((_friction(cabling) > 0).any())


def _friction(cabling: Cabling) -> Float[np.ndarray, " cables"]:
    """c where it has an effect: without rope behind the exit, winches that hold lengths do not feel it."""
    return np.where(cabling.behind > 0, cabling.pulley_friction, 0.0)


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


@dataclass(frozen=True)
class RopeStep:
    """The cables of rows side by side, for one step from a memory; of all parts of line together.

    Attributes:
        cabling: the cables.
        rest_lengths: from exit to anchor, (rows, cables) [m].
        ropes: with the part behind the exit, L, (rows, cables) [m].
        own: stiffness of the cable's own spring, (rows, cables) [N/m].
        elements: stiffness of each element, (rows, cables, elements) [N/m]; friction is the last.
        yields: its largest stretch, (rows, cables, elements) [m].
        widths: its largest stretch as a fraction of the cable's, (rows, cables, elements).
        free: stretch of the cable at which it is free, z, (rows, cables, elements) [m].
        friction: [N/m] stiffness of friction's element once there is a friction force, (rows, cables).
        rubbing: the cable's stiffness while the rope sticks at its exit, EA/l0, (rows, cables) [N/m].
        lasting, growing: strain of each term of creep at the end of the step: what does not depend on the tension then,
            and its growth by each newton of the pull then, (rows, cables, terms) [1, 1/N].
    """

    cabling: Cabling
    rest_lengths: Float[np.ndarray, "rows cables"]
    ropes: Float[np.ndarray, "rows cables"]
    own: Float[np.ndarray, "rows cables"]
    elements: Float[np.ndarray, "rows cables elements"]
    yields: Float[np.ndarray, "rows cables elements"]
    widths: Float[np.ndarray, "rows cables elements"]
    free: Float[np.ndarray, "rows cables elements"]
    friction: Float[np.ndarray, "rows cables"]
    rubbing: Float[np.ndarray, "rows cables"]
    lasting: Float[np.ndarray, "rows cables terms"]
    growing: Float[np.ndarray, "rows cables terms"]

    @classmethod
    def of(
        cls,
        cabling: Cabling,
        axial_stiffness: Float[np.ndarray, "*#rows cables"],
        rest_lengths: Float[np.ndarray, "rows cables"],
        memory: Memory,
        duration: float = 0.0,
    ) -> RopeStep:
        """The step of ``duration`` [s] from ``memory``, of (rows,) paths, with these rest lengths.

        Friction lets the rope's tension before the exit differ from that behind it by factors within [1/rho, rho]. The
        rope pulls by ``most`` per stretch where it slides out, and by ``least`` where it slides in.
        """
        parts = cabling.reeving * axial_stiffness
        behind, ropes = cabling.behind, rest_lengths + cabling.behind
        c = _friction(cabling)
        rho = (1 + c / 2) / (1 - c / 2)
        most, least = parts / (rest_lengths + behind / rho), parts / (rest_lengths + behind * rho)
        rubbing, middle = parts / rest_lengths, (most + least) / 2
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
            rest_lengths=rest_lengths,
            ropes=ropes,
            own=(1 - shares.sum(-1)) * loading,
            elements=elements,
            yields=yields,
            widths=widths,
            free=free,
            friction=friction,
            rubbing=rubbing,
            lasting=left * memory.creep + (mean - left) / modulus * memory.tensions[..., None],
            growing=np.broadcast_to((1 - mean) / (modulus * cabling.reeving[:, None]), memory.creep.shape),
        )

    @cached_property
    def taut(self) -> Float[np.ndarray, "rows cables"]:
        """Length from which on a cable is stretched, (rows, cables) [m]."""
        return self.rest_lengths + self.ropes * self.lasting.sum(-1)

    @cached_property
    def compliance(self) -> Float[np.ndarray, "rows cables"]:
        """Length by which creep lengthens a cable for each newton at the end of the step, (rows, cables) [m/N]."""
        return self.ropes * self.growing.sum(-1)

    @cached_property
    def softer(self) -> Float[np.ndarray, "rows cables"]:
        """Stiffness with creep over that without it, (rows, cables), where no element slides."""
        return 1 / (1 + self.compliance * (self.own + self.elements.sum(-1)))

    def bounds(self, stretches: Float[np.ndarray, "rows cables"]) -> Float[np.ndarray, "rows cables elements"]:
        """The largest s_j [m] at these ``stretches`` [m]."""
        return np.minimum(self.yields, self.widths * stretches[..., None])

    def held(self, stretches: Float[np.ndarray, "rows cables"]) -> Float[np.ndarray, "rows cables elements"]:
        """s_j [m] of cables that went straight to these ``stretches`` [m]."""
        bounds = self.bounds(stretches)
        return np.clip(stretches[..., None] - self.free, -bounds, bounds)

    def pulls(self, stretches: Float[np.ndarray, "rows cables"]) -> Float[np.ndarray, "rows cables"]:
        """Their pull on the platform, (rows, cables) [N]."""
        return self.own * stretches + (self.elements * self.held(stretches)).sum(-1)

    def stretches(self, lengths: Float[np.ndarray, "rows cables"]) -> Float[np.ndarray, "rows cables"]:
        """e of cables of these ``lengths``, (rows, cables) [m]: what is not creep; 0 where slack."""
        beyond = np.maximum(lengths - self.taut, 0)
        if not self.compliance.any():
            return beyond
        # e + compliance pull(e) = beyond, increasing and piecewise linear in e: the piece between two kinks is found.
        with np.errstate(divide="ignore", invalid="ignore"):
            kinks = np.concatenate(
                [
                    self.free / (1 - self.widths),
                    self.free / (1 + self.widths),
                    self.free + self.yields,
                    self.free - self.yields,
                    self.yields / self.widths,
                ],
                axis=-1,
            )
        kinks = np.sort(np.where((kinks > 0) & np.isfinite(kinks), kinks, 0.0), axis=-1)
        last = kinks.max(-1, initial=0.0) + beyond
        ends = np.stack([np.zeros_like(beyond), *np.moveaxis(kinks, -1, 0), last])
        there = np.array([end + self.compliance * self.pulls(end) for end in ends])
        piece = np.clip((there <= beyond).sum(0) - 1, 0, len(ends) - 2)[None]
        (low, high), (start, end) = (
            [np.take_along_axis(values, piece + i, axis=0)[0] for i in (0, 1)] for values in (there, ends)
        )
        rising = high > low
        return start + np.where(rising, (beyond - low) / np.where(rising, high - low, 1.0), 0.0) * (end - start)

    def tangent(
        self, lengths: Float[np.ndarray, "rows cables"]
    ) -> tuple[Float[np.ndarray, "rows cables"], Float[np.ndarray, "rows cables"]]:
        """Stiffness [N/m], and free length [m], of a spring that pulls like each taut cable at and near ``lengths``."""
        stretches = self.stretches(lengths)
        apart, bounds = stretches[..., None] - self.free, self.bounds(stretches)
        wedge = np.where(self.widths * stretches[..., None] < self.yields, np.sign(apart) * self.widths, 0.0)
        slope = self.own + (self.elements * np.where(np.abs(apart) > bounds, wedge, 1.0)).sum(-1)
        pulls, slope = self.pulls(stretches), slope / (1 + self.compliance * slope)
        return slope, lengths - pulls / slope

    def memory_after(
        self, lengths: Float[np.ndarray, "rows cables"], tensions: Float[np.ndarray, "rows cables"]
    ) -> Memory:
        """The memory, without its time, of cables at rest at these ``lengths`` [m] with these ``tensions`` [N]."""
        stretches, pulls = self.stretches(lengths), self.cabling.reeving * tensions
        hysteresis = self.cabling.hysteresis.shape[1]
        held, left = self.held(stretches), stretches[..., None]
        strains = (left - held[..., :hysteresis]) / self.ropes[..., None]
        slides = self.friction > 0
        force = pulls - self._sticking(stretches)
        free = stretches - np.where(slides, force / np.where(slides, self.friction, 1.0), 0.0)
        beyond = self.rest_lengths + np.where(slides, self.friction / self.rubbing * free, 0.0)
        slack = stretches <= 0
        return Memory(
            strains=np.where(slack[..., None], 0.0, strains),
            beyond=np.where(slack, self.rest_lengths, beyond),
            creep=self.lasting + self.growing * pulls[..., None],
            tensions=tensions,
            time=np.nan,
        )

    def _sticking(self, stretches: Float[np.ndarray, "rows cables"]) -> Float[np.ndarray, "rows cables"]:
        """The part of the pull that is not friction's, (rows, cables) [N]."""
        shares, hysteresis = self.cabling.hysteresis[..., 0], self.cabling.hysteresis.shape[1]
        strength = (1 - shares.sum(-1)) * stretches + (shares * self.held(stretches)[..., :hysteresis]).sum(-1)
        return (self.rubbing - self.friction) * strength


class Elements:
    """The elements of rows side by side in MuJoCo."""

    def __init__(self, batch: Batch, model: mujoco.MjModel, cabling: Cabling, unit: float) -> None:
        cables, elements = len(cabling), elements_of(cabling)
        ids = slice(cables, cables + cables * elements)
        self._unit, self.owners = unit, np.repeat(np.arange(cables), elements)
        self.stiffnesses = batch.expand("tendon_stiffness")[:, ids]
        self._yields, self._plastic = batch.expand("tendon_springyield")[:, ids], batch.bind("plastic")
        self._lower = model.tendon_plasticadr[ids]

    def hold(
        self,
        step: RopeStep,
        rows: Bool[np.ndarray, " rows"],
        tendons: Float[np.ndarray, "rows cables"],
        entries: Float[np.ndarray, " cables"],
    ) -> Float[np.ndarray, "rows cables"]:
        """Put the elements of ``rows`` where cables have them that went straight from the start of ``step``.

        Args:
            step: the step.
            rows: which.
            tendons: lengths of the cables' tendons [m].
            entries: by which they are longer than the cables, (cables,) [m].

        Returns:
            Length from which on the cables' own springs pull, of all rows, (rows, cables) [m].
        """
        stretches = step.stretches(tendons - entries)
        slack, softer = stretches <= 0, step.softer[..., None]
        shape = (int(rows.sum()), len(self.owners))
        yields = np.maximum(step.bounds(stretches) / softer, LEAST_YIELD)
        stiffnesses = np.where(slack[..., None], 0.0, step.elements * softer / self._unit)
        free = tendons[..., None] - step.held(stretches) / softer
        self._yields[rows], self.stiffnesses[rows] = yields[rows].reshape(shape), stiffnesses[rows].reshape(shape)
        where = np.flatnonzero(rows)[:, None]
        self._plastic[where, self._lower] = self._plastic[where, self._lower + 1] = free[rows].reshape(shape)
        return np.where(slack | ~step.compliance.astype(bool), step.taut + entries, tendons - stretches / step.softer)
