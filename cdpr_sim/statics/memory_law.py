"""The law of cables with a memory: from one equilibrium of a path to the next, linear between knots.

All parts of line are one cable here (``Cabling.behind``): EA and EA1 are those of n ropes, g is the length behind the
exit, l0 the rope from exit to anchor, L = l0 + g. With the stretch e = l − l0 − L zc beyond the creep zc:

*Hysteresis* is Maxwell-slip elements: springs in parallel, each of which slips where its stretch would exceed a bound,

    B(e) = (1 − Σ share) e + Σ share clip(e − z, ±min(y L, w e)).

The bound w e closes where the cable gets slack: so no element pushes, and a slack cable forgets. *Friction* at the exit
keeps the tensions T before and T' behind it within T'/T = 1/rho to rho, rho = (1 + c/2)/(1 − c/2). Where the rope
slips, T = EA e/(l0 + x g) with x = T'/T; where it holds, the unstretched length lo beyond the exit stays, and
T = (EA/l0)(l − lo).
This is one more element: with a = EA/(l0 + g/rho), b = EA/(l0 + g rho), m = (a + b)/2, h = (a − b)/2, k = EA/l0 − m,

    T = m B(e) + clip(k (e − z), ±h e),   z = EA/(l0 k) (lo − l0).

Before the first equilibrium there is no friction force: x = 1, T = EA/L B(e). With hysteresis besides, the band of
friction is that of the first loading. *Creep* is Kelvin-Voigt terms in series: zc' = (T/EA1 − zc)/tau1, exact for a
tension that changes linearly in time; with x = t/tau1, A = exp(−x), p = (1 − A)/x, from the tension T0 to T,

    zc = Σ A zc0 + (p − A) T0/EA1 + (1 − p) T/EA1.

While the memory of the last equilibrium stays, T is a function of l, linear between knots, and increasing, since
Σ share (1 + w) + c/(1 + c²/4) < 1. So the cable has an energy ∫T dl, and the next equilibrium is a minimum of energy,
of which ``newton_kernel`` knows only the knots.

Sources: Al-Bender, Lampaert and Swevers (2005, doi:10.1109/TAC.2005.858676) for Maxwell-slip elements; Simo and Hughes
(1998, "Computational Inelasticity", chapter 1) for steps of a path as minima.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law
from cdpr_sim.core.cable import COLUMNS, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.memory_kernel import (
    CREEP,
    CREPT,
    ELASTIC,
    HELD,
    KIND,
    KNOTS,
    LINEAR,
    MEMORY_COLUMNS,
    NONLINEAR,
    RHO,
)

Array = np.ndarray


class MemoryLaw:
    """The cables of a robot in one step of a path, or of many paths side by side; of all parts of line together.

    The last of the elements is friction.

    Args:
        robot: the robot.
        axial_stiffness: EA of the ropes, (..., cables) [N].
        rest_lengths: from exit to anchor, (..., cables) [m].
        memory: that of the last equilibrium.
        duration: time since then [s].

    Attributes:
        curved: which cables have a nonlinear law, (cables,).
        whole: L, (..., cables) [m].
        mean: slope of B in the tension, (..., cables) [N/m].
        base: slope without elements, (..., cables) [N/m].
        springs: spring constants of elements, (..., cables, elements) [N/m].
        free: z, (..., cables, elements) [m].
        most: largest bound of each element, (..., cables, elements) [m].
        widths: slope of its bound, (..., cables, elements).
        holding: k of friction, (..., cables) [N/m]; 0 without rope behind the exit.
        middle: m, (..., cables) [N/m].
        shares: of the elements of hysteresis, without friction, (cables, slipping).
        rho: largest ratio of the tensions before and behind the exit, (cables,).
        held: stretch of the rope behind the exit while it holds there, (..., cables) [m]; nan where no friction acts.
        left: creep at the end of the step without the tension there, (..., cables, terms).
        softness: what each newton adds to it, (..., cables, terms) [1/N].
        crept: creep at the end of the step without the tension there, (..., cables) [m].
        compliance: what a newton of tension makes the cables creep during the step, (..., cables) [m/N].
    """

    def __init__(
        self,
        robot: Robot,
        axial_stiffness: Float[Array, "*#batch cables"],
        rest_lengths: Float[Array, "*batch cables"],
        memory: Memory,
        duration: float,
    ) -> None:
        cabling, rest, rope = robot.cabling, rest_lengths, robot.cabling.ropes(rest_lengths)
        n, g = cabling.reeving, cabling.behind
        EA, L = n * axial_stiffness, rope + g
        rho = (1 + cabling.pulley_friction / 2) / (1 - cabling.pulley_friction / 2)
        a, b = EA / (rope + g / rho), EA / (rope + g * rho)
        middle = (a + b) / 2
        k = np.where((g > 0) & (cabling.pulley_friction > 0), EA / rope - middle, 0.0)
        rubbed, curved = ~np.isnan(memory.beyond), cabling.nonlinear
        mean = np.where(rubbed, middle, EA / L)
        shares, yields, widths = np.moveaxis(cabling.hysteresis, -1, 0)
        holds = rubbed & (k > 0) & ~curved  # the friction of nonlinear ropes is no spring
        moved = np.where(holds, memory.beyond - rest, 0.0)
        (EA1, tau1), T0 = np.moveaxis(cabling.creep, -1, 0), memory.tensions[..., None]
        x = duration / tau1
        decay, average = np.exp(-x), np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0)
        self.robot, self.axial_stiffness, self.rest_lengths, self.curved = robot, axial_stiffness, rest, curved
        self.whole, self.mean, self.base = L, mean, mean * (1 - shares.sum(-1))
        self.springs = _joined(mean[..., None] * shares, np.where(holds, k, 0.0))
        self.free = _joined(memory.strains * L[..., None], _over(EA / rope * moved, k))
        self.most = _joined(yields * L[..., None], np.full(rest.shape, np.inf))
        self.widths = _joined(np.broadcast_to(widths, memory.strains.shape), _over((a - b) / 2, k))
        self.holding, self.middle, self.shares, self.rho = k, middle, shares, rho
        self.held = np.where(rubbed & (k > 0), memory.beyond - rest, np.nan)
        self.left = decay * memory.creep + (average - decay) / EA1 * T0
        self.softness = (1 - average) / (n[:, None] * EA1)
        self.crept, self.compliance = L * self.left.sum(-1), L * self.softness.sum(-1)

    def table(self) -> Float[Array, "*batch cables columns"]:
        """Rows for compiled code: columns of ``core.cable``, and those of ``memory_kernel``."""
        robot, cabling = self.robot, self.robot.cabling
        stretches, tensions, slopes = self._knots()
        table = np.empty((*tensions.shape[:-1], MEMORY_COLUMNS + 3 * tensions.shape[-1]))
        table[..., :COLUMNS] = cabling.packed
        table[..., STIFFNESS] = cabling.pulls(self.axial_stiffness)
        table[..., WEIGHT], table[..., WRAPPED] = robot.cable_weights, robot.wrapped_lengths
        memory = table[..., COLUMNS:]
        memory[..., KIND] = np.where(cabling.has_memory, np.where(self.curved, NONLINEAR, LINEAR), ELASTIC)
        memory[..., CREEP], memory[..., CREPT] = self.compliance, self.crept
        memory[..., HELD], memory[..., RHO] = self.held, self.rho
        memory[..., KNOTS:] = np.concatenate([stretches, tensions, slopes], axis=-1)
        return table

    def _knots(self) -> tuple[Array, Array, Array]:
        """Stretches from 0, at which the slope may change, tensions there, and the slopes that follow.

        Of a nonlinear cable these are the forces by which its elements have given way, and stretches without creep.
        Knots that a cable does not have are at infinity. An element changes where its bound does, at y/w, and where it
        reaches one of its bounds: at z ± y, or z/(1 ± w).
        """
        z, y, w = self.free, self.most, self.widths
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.concatenate([y / w, z + y, z - y, z / (1 + w), z / (1 - w)], axis=-1)
        found = np.where(np.isfinite(found) & (found > 0) & np.tile(self.springs > 0, 5), found, np.inf)
        knots = np.concatenate([np.zeros((*found.shape[:-1], 1)), np.sort(found, axis=-1)], axis=-1)
        some = np.isfinite(knots)
        at = np.where(some, knots, 0.0)
        following = np.concatenate([knots[..., 1:], np.full((*knots.shape[:-1], 1), np.inf)], axis=-1)
        middle = np.where(np.isfinite(following), (at + following) / 2, at + self.whole[..., None])
        tensions, _ = self._tension(at)
        _, slopes = self._tension(middle)
        curved = self.curved[:, None]
        tensions = np.where(curved, self.mean[..., None] * at - tensions, tensions)
        slopes = np.where(curved, self.mean[..., None] - slopes, slopes)
        creep = np.where(curved, 0.0, self.compliance[..., None])
        return np.where(some, at + creep * tensions, np.inf), tensions, slopes / (1 + creep * slopes)

    def _tension(self, stretches: Float[Array, "*batch cables some"]) -> tuple[Array, Array]:
        """Tension and slope at some stretches e of each cable, beyond its creep."""
        e = stretches[..., None]
        pull, slope = self._elements(e, *(one[..., None, :] for one in (self.free, self.most, self.widths)))
        springs = self.springs[..., None, :]
        base = self.base[..., None]
        return base * stretches + (springs * pull).sum(-1), base + (springs * slope).sum(-1)

    @staticmethod
    def _elements(e: Array, free: Array, most: Array, widths: Array) -> tuple[Array, Array]:
        """Stretches of elements, and their slopes."""
        bound = np.minimum(most, widths * e)
        closing = np.where(widths * e < most, widths, 0.0)
        stretch = e - free
        slope = np.where(stretch > bound, closing, np.where(stretch < -bound, -closing, 1.0))
        return np.clip(stretch, -bound, bound), slope

    def after(
        self, lengths: Float[Array, "*batch cables"], tensions: Float[Array, "*batch cables"], time: float
    ) -> Memory:
        """The memory at the end of the step, from lengths and tensions of the ropes there; nan where they are.

        Of cables with mass, the tensions are those at their exits, on which all depends.
        """
        robot, rest = self.robot, self.rest_lengths
        pulls, EA = robot.cabling.pulls(tensions), robot.cabling.pulls(self.axial_stiffness)
        x = np.where(robot.cable_weights > 0, self._stretch_under(pulls), lengths - rest - self.crept)
        e = np.where(pulls > 0, x - self.compliance * pulls, 0.0)
        stretched, _ = self._elements(e[..., None], self.free, self.most, self.widths)
        gave_way = (self.shares * (e[..., None] - stretched[..., :-1])).sum(-1)
        free = robot.cabling.ropes(rest) * self._strains((pulls + self.middle * gave_way) / EA)
        ended = np.isnan(tensions)
        return Memory(
            strains=np.where(ended[..., None], np.nan, (e[..., None] - stretched[..., :-1]) / self.whole[..., None]),
            beyond=np.where(ended, np.nan, np.where(self.holding > 0, rest + e - free, rest)),
            creep=self.left + self.softness * pulls[..., None],
            tensions=np.array(tensions),
            time=time,
        )

    def _strains(self, forces: Float[Array, "*batch cables"]) -> Float[Array, "*batch cables"]:
        """Strains of the elastic law under forces over EA."""
        if not self.curved.any():
            return forces
        return cable_law.strain_at(forces, self.robot.cabling.law_of(np.ones(self.robot.cables)))

    def _stretch_under(self, pulls: Float[Array, "*batch cables"]) -> Float[Array, "*batch cables"]:
        """x of cables under these tensions [m]; of nonlinear ones without elements."""
        stretches, tensions, slopes = self._knots()
        last = np.maximum((np.isfinite(stretches) & (tensions <= pulls[..., None])).sum(-1, keepdims=True) - 1, 0)
        x, T, k = (np.take_along_axis(one, last, axis=-1)[..., 0] for one in (stretches, tensions, slopes))
        linear = x + (pulls - T) / np.where(self.curved, 1.0, k)
        if not self.curved.any():
            return linear
        g, forces = self.robot.cabling.behind, pulls / self.robot.cabling.pulls(self.axial_stiffness)
        behind = g * self._strains(forces)
        out, back = g * self._strains(forces / self.rho), g * self._strains(forces * self.rho)
        behind = np.where(np.isnan(self.held), behind, np.clip(self.held, out, back))
        curved = self.robot.cabling.ropes(self.rest_lengths) * self._strains(forces) + behind + self.compliance * pulls
        return np.where(self.curved, curved, linear)


def _joined(elements: Float[Array, "*batch cables elements"], friction: Float[Array, "*batch cables"]) -> Array:
    """Elements of hysteresis, and that of friction as the last."""
    return np.concatenate([elements, friction[..., None]], axis=-1)


def _over(force: Float[Array, "*batch cables"], spring: Float[Array, "*batch cables"]) -> Array:
    """A force as a stretch; 0 where there is no spring."""
    return np.divide(force, spring, out=np.zeros(np.broadcast_shapes(force.shape, spring.shape)), where=spring > 0)
