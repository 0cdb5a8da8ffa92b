"""Settling: damped steps of platforms in MuJoCo that grow until they are Newton's to equilibrium.

Only the equilibrium matters and not the time to reach it. A platform with its true mass and inertia sinks in a viscous
medium: each step is one of this motion, implicit in MuJoCo's own stiffness (``derivatives``),

    (stiffness + drag/duration) step = forces,

and its duration grows with success, so that short steps choose the equilibrium that the motion would choose, and the
last ones are Newton's (pseudo-transient continuation: Kelley and Keyes 1998, doi 10.1137/S0036142996304796). A step is
shortened to where the forces' work along it changes its sign (Matthies and Strang 1979, doi 10.1002/nme.1620141104):
it then has lowered the energy, also where cables become taut within it. Chains are laid out again after each step.
Where stiffness is negative, the step has the direction of the forces, which leads away from a saddle.

Rows for which this fails, with chains that are folded, move in damped time steps (``motion``) for a while.

Where no cable has mass, MuJoCo steps many platforms at less cost than Python takes for one step of this kind. So they
sink in time steps (``dynamic_relaxation``), and only the last steps, close to equilibrium, are Newton's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.status import ACCEPTABLE, NEUTRAL, Status
from cdpr_sim.physics.derivatives import Derivatives
from cdpr_sim.physics.dynamic_relaxation import SPEED, Frames, Relaxation
from cdpr_sim.physics.motion import CALM, Motion
from cdpr_sim.physics.simulations import TURNING, Observation, Rows, Simulations

RESIDUAL = 1e-9
"""Largest unbalanced force of an equilibrium, as a fraction of the load (the weight, or the external wrench if
larger)."""

ROUNDING = 2 * np.finfo(float).eps
"""Relative accuracy of a cable's force, in EA: the rounding of a length, times EA/l0."""

NUDGES = 3
"""Number of pushes of a platform that is balanced on a saddle. One that returns each time counts as stable after
all: under an external torque, which is not conservative, the symmetric part of the stiffness does not decide."""

STEPS = 100
"""Steps in turn after which a platform moves in damped time steps, or counts as not converging: ten are usual, and 41
the most of 140 random robots that these steps alone bring to rest."""

NUDGE = 1e-4
"""Push of a platform that is balanced on a saddle, as a fraction of the longest cable."""

FIRMEST, FIRMER, LOOSER = 30.0, 2.0, 0.2
"""Stiffness of the drag in the first step, in that of the slowest oscillation; its factor after a step that was
shortened, and after one that was not. ``FIRMEST`` is that of an overdamped motion in steps of a tenth of 1/omega."""

LOOSEST = 1e-3
"""Least of it after a shortened step."""

OVERDAMPED, SLOWEST = 30.0, 0.1
"""The same for a platform that has been below a wheel, as a multiple; and the least of it: it does not swing past an
equilibrium beside the wheel."""

TURN, FAR = 0.3, 0.3
"""Largest rotation in a step [rad], and the largest translation, in mean cable lengths."""

OVERSHOOT = 0.5
"""A step is shortened while the work at its end is below minus this fraction of that at its beginning."""

SHORTER, VAIN = 10, 4
"""Largest number of times that a step is shortened; and of failed steps in turn after which a row is given up."""

DAMPING, LONGEST, MOST_TIME = 1.5, 0.1, 1e3
"""Of damped time steps: damping ratio of the slowest oscillation; their length and that of the longest motion, in
1/omega."""

TRIES, SHAKEN, LONGER, MOST_STEPS = 3, 5.0, 4.0, 3000
"""Number of times that a row which was given up moves in damped time steps; for how long, in 1/omega, the first time,
and the factor of that from time to time; and the largest number of these steps."""

CLOSER, QUICK = 0.5, 0.1
"""A step that leaves less than these fractions of the residual is a good one; and the next one takes the same
derivatives again, which cost as much as many steps."""

NEAR, MOST_NEAR = 1e-3, 20
"""Where a motion chooses the equilibrium: longest first step of Newton's method, as a fraction of the mean cable
length, since another equilibrium may be as near; and its largest number of steps, of which one to three are usual."""

DEFINITE = 1e-7
"""Smallest eigenvalue of a stiffness that counts as positive there, as a fraction of the largest: the error of
differences to one side. In a direction of less stiffness, the motion alone determines where the platform stops."""

Modes = tuple[Float[np.ndarray, "some chains slides"], Float[np.ndarray, "some chains slides slides"]]
"""Eigenvalues [N/m] and vectors of the chains' stiffness."""


@dataclass(frozen=True)
class Reading(Observation):
    """State of each row at zero velocity, from MuJoCo, with residual and stiffness."""

    residuals: Float[np.ndarray, " rows"]
    eigenvalues: Float[np.ndarray, "rows free"]
    softest: Float[np.ndarray, "rows free"]
    off_wheel: Bool[np.ndarray, " rows"]

    @classmethod
    def of(cls, simulations: Simulations) -> Reading:
        """At the present coordinates."""
        rows = simulations.all
        residuals = simulations.residuals(rows)
        off_wheel = simulations.off_wheel(rows)
        eigenvalues, softest = Derivatives.of(simulations, rows).stiffness()
        return cls(
            **vars(simulations.observe(rows)),
            residuals=residuals,
            eigenvalues=eigenvalues,
            softest=softest,
            off_wheel=off_wheel,
        )

    @property
    def unstable(self) -> Bool[np.ndarray, " rows"]:
        """Which rows are not stable: where they rest, they are at a saddle."""
        return self.eigenvalues[:, 0] < -NEUTRAL * np.abs(self.eigenvalues).max(1)


class Settling:
    """The way of platforms to equilibrium.

    Args:
        simulations: the platforms, where they begin.
        say: is called from time to time with a row and its progress as text.
        frames: collects the motion of the first row on massless cables, which is then not ended by Newton's method.
    """

    def __init__(
        self,
        simulations: Simulations,
        say: Callable[[int, str], None] | None = None,
        frames: Frames | None = None,
    ) -> None:
        self.simulations, self.say = simulations, say
        rows = len(simulations.all)
        self.target = np.zeros(rows)
        self._aim(simulations.all)
        self.steps, self.status = np.zeros(rows, dtype=int), np.full(rows, Status.ITERATION_LIMIT.value)
        self.firmness, self.least = np.full(rows, FIRMEST if simulations.heavy else 0.0), np.zeros(rows)
        self.relaxation = None
        if not simulations.heavy:
            self.relaxation = Relaxation(simulations, self.target, self.steps, self.status, self.finish, frames)

    def _aim(self, at: Rows) -> None:
        """The largest unbalanced force of an equilibrium, with these springs."""
        simulations, rest, load = self.simulations, self.simulations.rest_lengths[at], self.simulations.load[at]
        if simulations.heavy:  # coordinates are as long as a cable
            stiffest = simulations.stiffnesses[at][:, simulations.chains.segments].max((1, 2)) * rest.max(1)
        else:
            stiffest = (simulations.stiffnesses[at][:, simulations.single] * rest).max(1)
        rounding = ROUNDING * simulations.unit * stiffest
        self.target[at] = np.minimum(np.maximum(RESIDUAL * load, rounding), ACCEPTABLE * load)

    def settle(self) -> dict[str, np.ndarray]:
        """Bring all rows to rest; columns of an ``EquilibriumBatch`` there."""
        if self.relaxation is None:
            self._sag()
            reading = self._read()
        else:
            self.relaxation.run()
            reading = self._read()
            lost = reading.off_wheel
            if len(self.simulations.swivels):
                lost = lost | (self.status == Status.DIVERGED)
            if lost.any():  # below a wheel MuJoCo's tendon jumps off it, and the motion after that is not this robot's
                self.relaxation.again(lost)
                reading = self._read()
            unstable = self.relaxation.finished & (self.status == Status.CONVERGED) & reading.unstable
            if unstable.any():  # the motion chooses the equilibrium, and would not have stopped there
                self.relaxation.resume(unstable)
                reading = self._read()
        for _ in range(NUDGES):
            saddles = (self.status == Status.CONVERGED) & reading.unstable
            if not saddles.any():
                break
            self._nudge(saddles, reading.softest)
            reading = self._read()
        robot = self.simulations.robot
        beyond = robot.cabling.beyond_law(reading.lengths, self.simulations.rest_lengths).any(1)
        self.status[beyond] = Status.OVERSTRAINED
        # A cable off its wheel is no longer this robot's: an equilibrium that depends on it does not count.
        self.status[reading.off_wheel] = Status.OFF_WHEEL
        names = ("positions", "rotations", "lengths", "tensions", "residuals")
        read = {name: getattr(reading, name) for name in names}
        return read | {"stiffness": reading.eigenvalues, "iterations": self.steps, "status": self.status}

    def _read(self) -> Reading:
        if self.relaxation is not None:
            self.simulations.qpos[:] = self.relaxation.qpos
        return Reading.of(self.simulations)

    def settle_held(self) -> Bool[np.ndarray, " rows"]:
        """Bring the chains of platforms that are held to rest; returns where that succeeds."""
        self.simulations.hold()
        self._sag()
        self.simulations.held = False
        return self.status == Status.CONVERGED

    def _sag(self) -> None:
        """Bring platforms on chains to rest, then divide the chains where they bend."""
        simulations = self.simulations
        simulations.residuals(simulations.all)
        simulations.lay(simulations.all, simulations.expected_pulls(simulations.all))
        self.run(simulations.all)
        for attempt in range(0 if simulations.held else TRIES):
            left = np.flatnonzero(self.status != Status.CONVERGED)
            with np.errstate(over="ignore", invalid="ignore"):  # of a motion that becomes unstable
                for row in left.tolist():
                    for _ in self.damped(row, SHAKEN * LONGER**attempt):
                        pass
            self.firmness[left] = 1.0
            self.run(left)
        if not simulations.held:
            lost = np.flatnonzero(simulations.off_wheel(simulations.all))
            if len(lost):  # below a wheel MuJoCo's tendon jumps off it, and the motion after that is not this robot's
                self.firmness[lost], self.least[lost] = OVERDAMPED * FIRMEST, SLOWEST
                simulations.restart(lost)
                self.run(lost)
                self.status[lost[self.status[lost] != Status.CONVERGED]] = Status.OFF_WHEEL
        at = simulations.divide_at_bends(np.flatnonzero(self.status == Status.CONVERGED))
        if len(at):
            self._aim(at)
            self.firmness[at] = 0.0
            self.run(at)

    def run(self, at: Rows) -> None:
        """Move rows until each is in equilibrium, or given up."""
        simulations, rows, derivatives = self.simulations, len(at), None
        chains, slides = simulations.slides.shape
        modes = np.zeros((rows, chains, slides)), np.zeros((rows, chains, slides, slides))
        known = np.ones(rows, dtype=bool)
        earlier, vain = np.full(rows, -1.0), np.zeros(rows, dtype=int)
        limit = self.steps[at] + STEPS
        residual = simulations.residuals(at)
        while True:
            going = known & (self.steps[at] < limit) & (vain < VAIN) & ~(residual <= self.target[at])
            stale = np.flatnonzero(going & ~(residual <= QUICK * earlier))
            if len(stale):
                fresh = Derivatives.of(simulations, at[stale], quick=True)
                known[stale] = fresh.known
                if derivatives is None:
                    derivatives = Derivatives(*(np.zeros((rows, *part.shape[1:])) for part in fresh))
                for whole, part in zip(derivatives, fresh, strict=True):
                    whole[stale] = part
                finite = stale[fresh.known]
                within = derivatives.within[finite]
                modes[0][finite], modes[1][finite] = np.linalg.eigh((within + within.swapaxes(2, 3)) / 2)
            live = np.flatnonzero(going & known)
            if derivatives is None or not len(live):
                break
            earlier[live] = residual[live]
            some = Derivatives(*(part[live] for part in derivatives))
            with np.errstate(over="ignore", invalid="ignore"):  # at trials on the way
                good, residual[live] = self._step(at[live], some, (modes[0][live], modes[1][live]), residual[live])
            vain[live] = np.where(good, 0, vain[live] + 1)
            if self.say is not None:
                for row, left in zip(at[live], residual[live], strict=True):
                    load = simulations.load[row]
                    self.say(int(row), f"{self.steps[row]} steps, {left:.1e} N of {load:.3g} N unbalanced")
        self.status[at] = np.where(residual <= self.target[at], Status.CONVERGED, Status.ITERATION_LIMIT)
        self.status[at[~known]] = Status.DIVERGED

    def finish(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Move rows on massless cables to the equilibria beside them; returns which reach them.

        Newton's method: rows are put back if their stiffness is not positive definite, their first step is long, or a
        step does not halve the force: a cable has become slack or taut.
        """
        simulations, free, count = self.simulations, self.simulations.free, self.steps[at]
        qpos, qvel = simulations.qpos[at], simulations.qvel[at]
        residual, earlier = simulations.residuals(at), np.full(len(at), -1.0)
        compliance, definite = np.zeros((len(at), free, free)), np.zeros(len(at), dtype=bool)
        reached, going = np.zeros(len(at), dtype=bool), np.arange(len(at))
        for _ in range(MOST_NEAR):
            stale = going[~(residual[going] <= QUICK * earlier[going])]
            if len(stale):
                compliance[stale], definite[stale] = self._compliance(at[stale])
            rows, earlier[going] = at[going], residual[going]
            x = (compliance[going] @ simulations.forces(rows)[0][..., None])[..., 0]
            usable = definite[going] & (np.abs(x).max(1) <= NEAR * simulations.size[rows])
            x[~usable] = 0
            simulations.qpos[rows] = simulations.displaced(simulations.qpos[rows], simulations.in_dofs(rows, x))
            self.steps[rows] += 1
            left = residual[going] = simulations.residuals(rows)
            reached[going] = rests = usable & (left <= self.target[rows])
            going = going[usable & ~rests & (left <= CLOSER * earlier[going])]
            if not len(going):
                break
        back = at[~reached]
        simulations.qpos[back], simulations.qvel[back] = qpos[~reached], qvel[~reached]
        self.steps[back] = count[~reached]
        return reached

    def _compliance(self, at: Rows) -> tuple[Float[np.ndarray, "some free free"], Bool[np.ndarray, " some"]]:
        """Inverse of the stiffness [m/N] of rows on massless cables; and where that is positive definite."""
        derivatives = Derivatives.of(self.simulations, at, quick=True)
        stiffness = np.where(derivatives.known[:, None, None], derivatives.direct, 0.0)
        values = np.linalg.eigvalsh((stiffness + stiffness.swapaxes(1, 2)) / 2)
        definite = values[:, 0] > DEFINITE * values[:, -1]
        stiffness[~definite] = np.eye(self.simulations.free)
        return np.linalg.inv(stiffness), definite

    def _step(
        self, at: Rows, derivatives: Derivatives, modes: Modes, residual: Float[np.ndarray, " some"]
    ) -> tuple[Bool[np.ndarray, " some"], Float[np.ndarray, " some"]]:
        """One step; whether it lowers the energy, and the residual after it [N]."""
        simulations = self.simulations
        x, slid, work = self._direction(at, derivatives, modes, residual)
        move, pulls = simulations.in_dofs(at, x), simulations.anchor_pulls(at)
        move[:, simulations.slides] = slid
        springs = simulations.bands[at], simulations.stiffnesses[at], simulations.further[at]
        start, share, after = simulations.qpos[at].copy(), np.ones(len(at)), residual.copy()
        good = np.zeros(len(at), dtype=bool)
        low, high, work_low, work_high = np.zeros(len(at)), np.full(len(at), np.inf), work.copy(), np.zeros(len(at))
        for _ in range(SHORTER):
            left = np.flatnonzero(~good)
            some = at[left]
            simulations.qpos[some] = simulations.displaced(start[left], share[left, None] * move[left])
            after[left] = simulations.residuals(some)
            loosely = left[~(after[left] <= CLOSER * residual[left])]
            if len(loosely):
                if simulations.ropes is not None:  # tangents of the laws here, and not at what stretches chains
                    fields = simulations.bands, simulations.stiffnesses, simulations.further
                    for field, values in zip(fields, springs, strict=True):
                        field[at[loosely]] = values[loosely]
                ahead, there = after[loosely], simulations.qpos[at[loosely]]
                simulations.lay(at[loosely], pulls[loosely])
                after[loosely] = simulations.residuals(at[loosely])
                worse = after[loosely] > ahead  # at the limit of rounding, where chains are not laid out more precisely
                if worse.any():
                    simulations.qpos[at[loosely[worse]]] = there[worse]
                    after[loosely[worse]] = simulations.residuals(at[loosely[worse]])
            now = _work(simulations.forces(some), derivatives.carried[left], x[left], slid[left])
            band = OVERSHOOT * work[left]
            over, under = ~(now >= -band), (now > band) & np.isfinite(high[left])
            good[left] = ~(over | under) | (after[left] <= CLOSER * residual[left])
            if good.all():
                break
            # Regula falsi (Illinois): a bound that stays counts half.
            over, under = left[over], left[under]
            now = np.where(np.isfinite(now), now, -np.inf)
            work_low[over] *= 0.5 ** (np.isfinite(high[over]) & (low[over] > 0))
            high[over], work_high[over] = share[over], now[np.isin(left, over)]
            work_high[under] *= 0.5
            low[under], work_low[under] = share[under], now[np.isin(left, under)]
            left = left[~good[left]]
            fraction = work_low[left] / (work_low[left] - work_high[left])
            share[left] = low[left] + np.clip(fraction, 1e-3, 0.9) * (high[left] - low[left])
        self.steps[at] += 1
        whole = good & np.isinf(high)
        firmness = self.firmness[at]
        firmness = np.where(whole, LOOSER * firmness, np.maximum(firmness, LOOSEST) * FIRMER)
        self.firmness[at] = np.clip(firmness, self.least[at], FIRMEST)
        return good | (share > 0) & (low > 0), after

    def _direction(
        self, at: Rows, derivatives: Derivatives, modes: Modes, residual: Float[np.ndarray, " some"]
    ) -> tuple[Float[np.ndarray, "some free"], Float[np.ndarray, "some chains slides"], Float[np.ndarray, " some"]]:
        """The steps of platforms [m], of the slides of their chains [m], and the forces' work per step [J]."""
        simulations, (direct, across, _, carried, _) = self.simulations, derivatives
        platform, slides = forces = simulations.forces(at)
        firmness = self.firmness[at] * np.minimum(1, residual / simulations.load[at])
        # Slack masses are damped as well, in proportion to what a hanging chain resists; nothing is pushed uphill.
        values, vectors = modes
        rest = simulations.rest_lengths[at][:, simulations.chains.cables]
        floor = firmness[:, None] * simulations.weights[at] / rest
        sizes = np.maximum(np.abs(values), np.finfo(float).eps * np.abs(values).max(2, keepdims=True))
        sizes = np.maximum(sizes + floor[..., None], np.finfo(float).tiny)
        loose = (vectors / sizes[..., None, :]) @ vectors.swapaxes(2, 3)
        alone, follow, x = (loose @ slides[..., None])[..., 0], loose @ across, np.zeros_like(platform)
        if not simulations.held:
            direct = direct - (across.swapaxes(2, 3) @ follow).sum(1)
            pushed = platform + np.einsum("rcs,rcsf->rf", slides, carried)
            pushed = pushed - (across.swapaxes(2, 3) @ alone[..., None])[..., 0].sum(1)
            x = self._damped(at, direct, pushed, firmness * simulations.swing[at] ** 2)
            limit = np.abs(x[:, simulations.angular]).max(1) / (TURN * simulations.length)
            limit = np.maximum(limit, np.abs(x).max(1) / (FAR * simulations.size[at]))
            x /= np.maximum(limit, 1.0)[:, None]
        slid = alone - (follow @ x[:, None, :, None])[..., 0]
        return x, slid, _work(forces, carried, x, slid)

    def _damped(
        self,
        at: Rows,
        stiffness: Float[np.ndarray, "some free free"],
        pushed: Float[np.ndarray, "some free"],
        drag: Float[np.ndarray, " some"],
    ) -> Float[np.ndarray, "some free"]:
        """Steps against a stiffness and a ``drag`` in proportion to the inertia [1/s²]."""
        simulations = self.simulations
        units = np.zeros_like(stiffness)  # of a kilogram, along the axes of the platform
        free, root = np.arange(simulations.free), np.sqrt(simulations.inertia)
        units[:, free, free] = 1 / root
        if simulations.free == 6:
            units[:, 3:, 3:] = simulations.rotations[at] / root[3:]
        units[:, simulations.angular] *= simulations.length
        seen = units.swapaxes(1, 2) @ stiffness @ units
        force = (pushed[:, None] @ units)[:, 0]
        values, vectors = np.linalg.eigh((seen + seen.swapaxes(1, 2)) / 2)
        largest = np.maximum(np.abs(values).max(1), np.finfo(float).tiny)
        sizes = np.maximum(np.abs(values), NEUTRAL * largest[:, None]) + drag[:, None]
        step = (vectors @ ((force[:, None] @ vectors)[:, 0] / sizes)[..., None])[..., 0]
        definite = values[:, 0] > NEUTRAL * largest
        if definite.any():  # also the antisymmetric part
            whole = seen[definite] + drag[definite, None, None] * np.eye(len(free))
            step[definite] = np.linalg.solve(whole, force[definite, :, None])[..., 0]
        return (units @ step[..., None])[..., 0]

    def damped(self, row: int = 0, most: float = MOST_TIME) -> Iterator[Motion]:
        """The motion of one platform in an overdamping medium, at its beginning and after each step, until it rests.

        Its last state is then the simulation's.

        Args:
            row: which.
            most: its longest duration, in 1/omega.
        """
        simulations = self.simulations
        swing, reach = float(simulations.swing[row]), float(simulations.rest_lengths[row].max())
        turning = 1 + TURNING * (np.arange(simulations.free) >= simulations.angular.start)
        drag, steps = 2 * DAMPING * swing * simulations.inertia * turning, 0
        motion = Motion(
            simulations, LONGEST / swing, damping=drag, theta=CALM, memory=simulations.memory_of(row), row=row
        )
        yield motion
        while motion.time * swing < most and steps < MOST_STEPS:
            before = motion.time
            for _ in motion.steps(LONGEST / swing):
                steps += 1
                if steps >= MOST_STEPS:  # a step may be as short as rounding allows
                    break
            yield motion
            speed = np.abs(motion.data.qvel[: simulations.free])
            speed[simulations.angular] *= simulations.length
            if not speed.max() > SPEED * swing * reach or motion.time == before:
                break
        if np.isfinite(motion.data.qpos).all():
            simulations.qpos[row] = motion.data.qpos

    def _nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Displace ``rows`` along an unstable direction, as any disturbance would, and let them move on."""
        simulations, at = self.simulations, np.flatnonzero(rows)
        if self.relaxation is not None:
            self.relaxation.nudge(rows, directions)
            return
        ways = np.where(directions[at].sum(1) < 0, -1, 1) * NUDGE * simulations.rest_lengths[at].max(1)
        move = simulations.in_dofs(at, directions[at] * ways[:, None])
        simulations.qpos[at] = simulations.displaced(simulations.qpos[at], move)
        self.firmness[at] = FIRMEST
        self.run(at)


def _work(
    forces: tuple[Float[np.ndarray, "some free"], Float[np.ndarray, "some chains slides"]],
    carried: Float[np.ndarray, "some chains slides free"],
    x: Float[np.ndarray, "some free"],
    slid: Float[np.ndarray, "some chains slides"],
) -> Float[np.ndarray, " some"]:
    """Work of forces on platforms and slides, which are carried, per step [J]."""
    platform, slides = forces
    return np.vecdot(platform + np.einsum("rcs,rcsf->rf", slides, carried), x) + (slides * slid).sum((1, 2))
