"""Motion of one platform in MuJoCo on cables of any kind: true inertia, dampers, winches, memories.

Forces are computed at the ends of steps, from positions, lengths let out and memories of the same instant. Where the
steps are short against every oscillation, as on massless cables, they are those of velocity Verlet: of second order,
and without damping of their own,

    v' = v + h/2 a,    x' = x + h v',    v'' = v' + h/2 a'        with  (M + τ D) a' = f(x') - D v'

by MuJoCo's implicit integrator: dampers D act at the velocity of τ = h/2 later, that at the end of the step; or after
more, where something is damped within less than half a step, so that it decays and does not alternate.

Where they are not, a step is that of the theta method: D then contains τ times the slope of each spring, whose force is
so the one after τ = θ h, and the transverse stiffness of taut chains (``chains.plucked``). What the step does not
resolve decays; an oscillation of the angular frequency ω is damped by the ratio (θ - 1/2) ω h.

    (M + τ D) a = f(x) - D v,    v' = v + h a,    x' = x + h (v + τ a)

Springs are MuJoCo's own wherever it has the law. Dampers resist strains and not lengths: a winch that winds a cable is
not damped. No cable pushes. What differs from the motion of real cables with mass:

- The masses of a chain slide along its material while a winch winds it. That neglects the momentum of the cable that is
  wound, a force of density times speed times winding speed at each end.
- Wheels face their cables at once.
- Exits that give way are where the forces of springs balance, as the frame has no mass. Of an anchor's motion, a cable
  of the slope k whose exit gives way by s along it then gets the part 1/(1 + k s): its damper resists that part alone.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator
from math import ceil

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.memory import Memory
from cdpr_sim.physics.cable import Law, Springs
from cdpr_sim.physics.chains import ChainDivision, cut, plucked
from cdpr_sim.physics.exits import STEPS, MovingExits
from cdpr_sim.physics.rope_motion import RopeMotion, RopeState
from cdpr_sim.physics.simulations import UNUSED, Observation, Simulations, matrices
from cdpr_sim.physics.tendons import Jacobian

CHAINS = 0.6
"""θ of motions on chains: above a half, so that oscillations of their masses that the steps do not resolve decay to two
thirds in each."""

CALM = 1.0
"""θ of motions of which only the slow part is wanted."""

ROUNDING = 1e-9
"""Rounding of a number of steps."""

NEAREST = 1e-9
"""Least strain of a chain's segment that limits a step."""

SHORTEST_FREE = 0.1
"""Least free length of a first segment that damping assumes, in radii of its wheel."""

SWITCHED_OFF = UNUSED | mujoco.mjtDisableBit.mjDSBL_AUTORESET.value
"""Stages of MuJoCo that our models do not need, and its reset of a simulation that became unstable."""

Winches = Callable[[float, float], Float[np.ndarray, " cables"]]
"""Rest lengths (cables,) [m] after so many seconds, at the end of a step of this duration [s]."""


class Motion:
    """Motion of one platform, from the present state of its simulation.

    Args:
        simulation: the platform, at rest.
        longest: longest time step [s].
        viscosity: of the air [Pa s].
        damping: of the platform's coordinates, (free,) [N s/m, N m s].
        cable_damping: resistance of cables to strain, as a multiple of their stiffness [s].
        damping_time: of the oscillation that is damped most [s].
        theta: θ of the theta method; default: Verlet's, on chains ``CHAINS``.
        memory: of cables with one, (1,); default: that of new ropes.
        row: of the simulation.

    Attributes:
        model, data: MuJoCo's.
        platform: number of the platform's body.
        time: time that has passed [s].
        let_out: rest lengths that winches have let out, (cables,) [m].
        motors: winches that hold ``tensions`` and run as fast as that takes, (cables,); of massless cables.
        tensions: (cables,) [N].
    """

    def __init__(
        self,
        simulation: Simulations,
        longest: float,
        *,
        viscosity: float = 0.0,
        damping: Float[np.ndarray, " free"] | float = 0.0,
        cable_damping: float = 0.0,
        damping_time: float = np.inf,
        theta: float | None = None,
        memory: Memory | None = None,
        row: int = 0,
    ) -> None:
        self.simulation, self.robot, self.row, self.longest = simulation, simulation.robot, row, float(longest)
        self._cable_damping, self._damping_time = cable_damping, damping_time
        simulation.residuals(np.array([row]))
        self.model = model = simulation.batch.get_model(row)
        model.opt.viscosity, model.opt.disableflags = viscosity, model.opt.disableflags | SWITCHED_OFF
        free, self._chains = simulation.free, simulation.chains
        model.dof_damping[:free], model.dof_armature[:free] = damping, 0
        self._heavy = bool(len(self._chains.cables))
        self._theta = CHAINS if self._heavy and theta is None else theta
        # A cable that is slack at the beginning of a step may carry its share of the load at the end.
        self._least = float(simulation.load[row]) / self.robot.cables
        if self._theta is None:  # gyroscopic torques are implicit as well
            model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
        self.data = data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = simulation.qpos[row], simulation.qvel[row]
        if simulation.wrenches.any():
            data.xfrc_applied[simulation.origin] = simulation.wrenches[row]
        self.platform, self.time = simulation.platform, 0.0
        self.let_out = simulation.rest_lengths[row].copy()
        self.hold(np.zeros(self.robot.cables, dtype=bool), np.zeros(self.robot.cables))
        self._ropes, self._sticks = None, np.zeros(self.robot.cables, dtype=bool)
        if len(simulation.with_memory):
            self._ropes = RopeMotion(self.robot, Memory.fresh(self.robot, (1,)) if memory is None else memory)
        self._name_fields()
        self._locate()
        self._wind(self.let_out)
        self._remember(0.0)
        self._acceleration = self._accelerated(self.longest)

    def _name_fields(self) -> None:
        """Views of MuJoCo's arrays, and the tendons' own numbers."""
        model, data, simulation, row = self.model, self.data, self.simulation, self.row
        self._options = model.opt
        self._qpos, self._qvel, self._lengths = data.qpos, data.qvel, data.ten_length
        self._applied, self._dampers, self._sparse = data.qfrc_applied, model.tendon_damping, data.ten_J
        self._rates_of, self._dense = Jacobian(model), None
        # Of the law without memory; MuJoCo's springs of cables with one are switched off.
        self._stiffness, self._further = simulation.stiffnesses[row].copy(), simulation.further[row].copy()
        self._bands, self._wound = simulation.bands[row, :, 1].copy(), self.let_out if simulation.given else None
        others = np.ones(model.ntendon, dtype=bool)
        others[simulation.tendons] = False
        self._stiffness[others] = self._further[others] = model.tendon_damping[others] = 0.0
        self._springs = model.tendon_lengthspring[:, 1], model.tendon_stiffness
        self._law, self._linear = Law.of(self.robot.cabling), self.robot.cabling.linear
        self._own = Springs(self._stiffness, *self._further.T)
        self._resilient = not (self._heavy or self._cable_damping or len(simulation.with_memory))  # springs alone
        self._plain = not self._heavy and model.ntendon == self.robot.cables  # each tendon is a cable, in their order
        self._foreign = simulation.first[simulation.with_memory]
        self._pulls, self._slopes = np.zeros((2, model.ntendon))  # of those
        swivels = simulation.swivels
        frames = matrices(model.body_quat[swivels.bodies])
        self._sites, self._places = data.site_xpos, data.xpos
        self._axes, self._straight = np.moveaxis(frames, -1, 0)[:2].copy(), model.qpos0[swivels.coordinates]
        if self._heavy and not simulation.given:
            self._division = ChainDivision(*(part[row : row + 1] for part in simulation.division))
        self._rates = self._still = np.zeros(self.robot.cables)
        self._exits = MovingExits.of(simulation.frames, self.robot, simulation.first)
        self._gives_way = len(self._exits) > 0
        self._gives = np.zeros(model.ntendon)  # by how much exits give way along their tendons [m/N]

    def hold(self, motors: Bool[np.ndarray, " cables"], tensions: Float[np.ndarray, " cables"]) -> None:
        """From now on, let these ``motors`` hold ``tensions`` [N]."""
        self.motors, self.tensions, self._some_motors = motors, tensions, bool(motors.any())

    def advance(self, seconds: float, winches: Winches | None = None) -> None:
        """Move for ``seconds``, while winches let these lengths out, which are counted from now on."""
        for _ in self.steps(seconds, winches):
            pass

    def steps(self, seconds: float, winches: Winches | None = None) -> Iterator[float]:
        """``advance``, time step by time step: the time that has passed [s], after each."""
        passed = 0.0

        def wanted(after: float, step: float) -> Float[np.ndarray, " cables"]:
            return self.let_out if winches is None else winches(after, step)

        if self._theta is None:
            count = max(1, ceil(seconds / self.longest - ROUNDING))
            step = seconds / count
            self._begin(step, wanted)
            for number in range(1, count + 1):
                self._verlet(step, wanted, number * step)
                self.time += step
                yield number * step
            return
        while (left := seconds - passed) > ROUNDING * self.longest:
            step = left / ceil(left / self.longest - ROUNDING)
            if self._heavy:
                step = min(step, self._shortest())
                if not step > 0:  # it became unstable
                    return
            self._theta_step(step, wanted(passed + step, step))
            passed, self.time = passed + step, self.time + step
            yield passed

    def _begin(self, step: float, wanted: Winches) -> None:
        """The acceleration now, at the beginning of steps in which winches run otherwise than before."""
        rates, (velocity, earlier, held) = self._rates, self._evaluated
        self._rates = (wanted(step, step) - self.let_out) / step
        switched = held or self._some_motors
        if switched:
            self._remember(0.0)
        if switched or (self._cable_damping and (rates != self._rates).any()):
            qvel = self._qvel.copy()
            self._qvel[:] = velocity
            self._acceleration = self._accelerated(earlier)
            self._qvel[:] = qvel

    def _verlet(self, step: float, wanted: Winches, passed: float) -> None:
        """One step, after which so many seconds will have ``passed``."""
        qvel, half = self._qvel, step / 2
        qvel += half * self._acceleration
        mujoco.mj_integratePos(self.model, self._qpos, qvel, step)
        self._locate()
        lengths = wanted(passed, step)
        self._rates = (lengths - self.let_out) / step
        self._let_out(lengths, step)
        self._acceleration = self._accelerated(step)
        qvel += half * self._acceleration

    def _theta_step(self, step: float, wanted: Float[np.ndarray, " cables"]) -> None:
        """One step, at whose end winches have let out the ``wanted`` lengths [m]."""
        qvel = self._qvel
        self._rates = self._still if wanted is self.let_out else (wanted - self.let_out) / step
        if self._later(step) == step:
            self._set_out(step)
            mujoco.mj_step2(self.model, self.data)  # at θ = 1 a step of MuJoCo's is just this
        else:
            acceleration = self._accelerated(step)
            later = qvel + self._later(step) * acceleration
            qvel += step * acceleration
            mujoco.mj_integratePos(self.model, self._qpos, later, step)
        self._locate()
        self._let_out(wanted, step)

    def _later(self, step: float) -> float:
        """τ [s]."""
        return max((0.5 if self._theta is None else self._theta) * step, step - self._damping_time)

    def _locate(self) -> None:
        """Bring MuJoCo's positions up to date, with wheels that face their cables."""
        model, data, swivels = self.model, self.data, self.simulation.swivels
        if len(swivels.coordinates):
            mujoco.mj_kinematics(model, data)
            away = self._sites.take(swivels.faced, 0) - self._places.take(swivels.bodies, 0)
            x, y = np.vecdot(self._axes, away)
            self._qpos[swivels.coordinates] = self._straight + np.arctan2(y, x)
            self._qvel[swivels.dofs] = 0
        elif len(swivels):
            swivels.face(model, data)
        mujoco.mj_fwdPosition(model, data)
        self._dense = None

    @property
    def _jacobian(self) -> Float[np.ndarray, "tendons dofs"]:
        """Rates of the tendons' lengths by velocities, at the present positions."""
        if self._dense is None:
            self._dense = self._rates_of.of(self._sparse)
        return self._dense

    def _let_out(self, lengths: Float[np.ndarray, " cables"], step: float) -> None:
        """Winches have let out ``lengths`` [m] at the present instant, a ``step`` [s] after the last one."""
        self.let_out = lengths
        if self._theta is None:
            self._wind(lengths)
        self._remember(step)

    def _wind(self, rest: Float[np.ndarray, " cables"]) -> None:
        """Springs and masses for these rest lengths: all segments of a chain change alike."""
        if rest is self._wound:
            return
        model, simulation, robot = self.model, self.simulation, self.robot
        self._wound, single, some = rest, simulation.single, simulation.massless
        bands, springs = rest + simulation.entries, self._law.springs(rest)
        stiffness = springs.stiffness
        if self._plain:
            self._bands[:], self._stiffness[:] = bands, stiffness
        else:
            self._bands[single], self._stiffness[single] = bands[some], stiffness[some]
        if not self._linear:
            self._further[single] = springs.polynomial[some]
        if self._heavy:
            chains = self._chains
            lengths, masses = cut(robot, rest[None], self._division)
            segments = self._law.some(chains.cables).segments(lengths[0])
            self._stiffness[chains.segments], self._further[chains.segments] = segments.stiffness, segments.polynomial
            lengths[..., 0] += chains.entries
            self._bands[chains.segments] = lengths[0]
            model.body_mass[chains.nodes], model.body_mass[chains.ends] = masses[0, :, -2::-1], masses[0, :, -1]
        self._springs[0][:], self._springs[1][:] = self._bands, self._stiffness
        if not self._linear:
            model.tendon_stiffnesspoly[:] = self._further
        if self._ropes is not None:
            model.tendon_stiffness[self._foreign] = model.tendon_stiffnesspoly[self._foreign] = 0.0

    def _remember(self, seconds: float) -> None:
        """Pulls of cables with a memory, which have come straight here from where they were ``seconds`` before.

        Exits that give way are then where forces balance.
        """
        if self._ropes is None:
            return
        state, steps = self._recalled(seconds), 0
        while self._move_exits() and steps < STEPS:
            state, steps = self._recalled(seconds), steps + 1
        self._ropes.memory, self._sticks = state.memory, state.sticks

    def _recalled(self, seconds: float) -> RopeState:
        """Cables with a memory where they are now; their pulls and slopes."""
        ropes, simulation = self._ropes, self.simulation
        assert ropes is not None
        within = np.zeros(self.robot.cables)
        if self._heavy:
            within[self._chains.cables] = self._bands[self._chains.segments[:, 1:]].sum(1)
        lengths = self._lengths[simulation.first] - simulation.entries + within
        slopes = self._theta is not None or self._gives_way
        state = ropes.at(lengths, self.let_out, seconds, within, slopes=slopes)
        if self._some_motors and not self._heavy:
            state = state.where(self.motors, ropes.under(lengths, self.tensions, seconds))
        which = simulation.with_memory
        self._pulls[self._foreign], self._slopes[self._foreign] = state.pulls[which], state.slopes[which]
        return state

    def _balance_exits(self) -> None:
        """Put exits that give way where the forces of springs balance."""
        for _ in range(STEPS if self._gives_way else 0):
            if not self._move_exits():
                break

    def _move_exits(self) -> bool:
        """One step of exits that give way towards where the forces of springs balance; whether they moved."""
        exits, led = self._exits, self._exits.tendons
        if not self._gives_way:
            return False
        lengths = self._lengths[led]
        stretch = np.maximum(lengths - self._bands[led], 0.0)
        pulls, slopes = Springs(self._stiffness[led], *self._further[led].T).force(stretch)
        slopes = np.where(stretch > 0, slopes, 0.0)
        if self._ropes is not None:
            own = np.isin(led, self._foreign)
            pulls, slopes = np.where(own, self._pulls[led], pulls), np.where(own, self._slopes[led], slopes)
        elif self._some_motors:
            held = self.motors[exits.cables] & np.isin(led, self.simulation.single)
            pulls = np.where(held, self.robot.cabling.pulls(self.tensions)[exits.cables], pulls)
            slopes = np.where(held, 0.0, slopes)
        self._gives[led], moved = exits.move(self._qpos, self._jacobian, lengths, pulls, slopes)
        if moved:
            self._locate()
        return moved

    def _accelerated(self, step: float) -> Float[np.ndarray, " dofs"]:
        """The acceleration for a step, by MuJoCo's implicit integrator; the state does not change."""
        qvel, later = self._qvel, self._set_out(step)
        self._evaluated = before, *_ = qvel.copy(), step, self._some_motors
        qpos = self._qpos.copy()
        mujoco.mj_step2(self.model, self.data)
        acceleration = (qvel - before) / later
        self._qpos[:], qvel[:] = qpos, before
        return acceleration

    def _set_out(self, step: float) -> float:
        """Forces and dampers for a step, and τ as the time step of MuJoCo's integrator; returns τ [s]."""
        later = self._later(step)
        if self._theta is not None:  # springs of the instant at which they act
            self._wind(self.let_out if self._rates is self._still else self.let_out + later * self._rates)
        self._balance_exits()
        self._pull_by(later)
        self._options.timestep = later
        mujoco.mj_fwdVelocity(self.model, self.data)
        return later

    def _pull_by(self, later: float) -> Float[np.ndarray, " tendons"]:
        """Dampers, and forces that MuJoCo's springs do not have, for a step of τ = ``later`` [s].

        Returns:
            Pulls at the present velocities [N], without what dampers of springs add.
        """
        simulation = self.simulation
        stretch = self._lengths - self._bands
        taut = stretch > 0
        if self._linear:
            slope = taut * self._stiffness
            pull = slope * stretch
        else:
            pull, slope = self._own.force(taut * stretch)
            slope *= taut
        resisting, extra = None, None
        if self._theta is not None:
            resisting = later * slope * self._stretching(slope)
            if not taut.all():
                nearly = (stretch + later * (self._jacobian @ self._qvel) > 0) & ~taut  # it gets taut within the step
                if nearly.any():
                    slopes = nearly * self._stiffness * self._stretching(self._stiffness)
                    extra = slopes * stretch
                    resisting += later * slopes
        if self._resilient and not self._some_motors:
            self._applied[:] = 0.0 if extra is None else -extra @ self._jacobian
            self._dampers[:] = 0.0 if resisting is None else resisting
            return pull
        velocity, winding = self._jacobian @ self._qvel, self._winding()
        drag = self._cable_damping * slope * self._stretching(slope) ** 2
        if self._ropes is not None:
            own, slides = self._foreign, (self.motors & ~self._sticks)[simulation.with_memory]
            extra = np.zeros_like(pull) if extra is None else extra
            pull[own] = extra[own] = self._pulls[own]
            part = self._stretching(self._slopes)
            drag[own] = np.where(slides | (pull[own] <= 0), 0.0, (self._cable_damping * self._stiffness * part**2)[own])
            if resisting is not None:
                resisting[own] = (later * self._slopes * part)[own]
                extra[own] -= (resisting * winding)[own]
        elif self._some_motors:
            extra = np.zeros_like(pull) if extra is None else extra
            which = self.motors[simulation.massless]
            held, wanted = simulation.single[which], self.robot.cabling.pulls(self.tensions)[simulation.massless][which]
            extra[held] = wanted - pull[held]
            pull[held], drag[held] = wanted, 0.0
            if resisting is not None:
                resisting[held] = 0.0
        total = pull + drag * (velocity - winding)
        if total.min() < 0:  # no cable does
            pushes = total < 0
            total[pushes] = 0.0
            if resisting is None:
                extra = np.zeros_like(pull) if extra is None else extra
                drag[pushes], extra[pushes] = 0.0, -pull[pushes]
            else:  # as much as takes the pull now, since at the end of the step it may pull
                drag[pushes] = (pull / np.where(pushes, winding - velocity, 1.0))[pushes]
        forces = drag * winding
        self._applied[:] = (forces if extra is None else forces - extra) @ self._jacobian
        self._dampers[:] = drag if resisting is None else resisting + drag
        if self._heavy:
            chains = self._chains
            across = plucked(later, np.maximum(total[chains.segments], self._least), self._free())
            self.model.dof_damping[chains.dofs] = across[:, :0:-1, None]
            self._dampers[chains.brakes] = across[:, :1]
        return total

    def _stretching(self, slopes: Float[np.ndarray, " tendons"]) -> Float[np.ndarray, " tendons"] | float:
        """Parts of motions along tendons of these slopes [N/m] that stretch them; exits take the rest."""
        return 1 / (1 + slopes * self._gives) if self._gives_way else 1.0

    def _winding(self) -> Float[np.ndarray, " tendons"]:
        """Rates at which the rest lengths of tendons change [m/s]."""
        if self._plain:
            return self._rates
        winding, simulation = np.zeros(self.model.ntendon), self.simulation
        if not self._rates.any():
            return winding
        winding[simulation.single] = self._rates[simulation.massless]
        if self._heavy:
            winding[self._chains.segments] = self._rates[self._chains.cables, None] * self._division.lengths[0]
        return winding

    def _free(self) -> Float[np.ndarray, "chains segments"]:
        """Lengths of the segments that are free to turn [m]: at rest; of the first over a wheel, what is beyond it."""
        chains, data = self._chains, self.data
        lengths = self._bands[chains.segments]
        lengths[:, 0] -= chains.entries
        if chains.over.any():
            away = data.xpos[chains.first] - data.geom_xpos[chains.grooves]
            squares = chains.radii[chains.over] ** 2
            free = np.maximum((away * away).sum(1) - squares, SHORTEST_FREE**2 * squares)
            lengths[chains.over, 0] = np.sqrt(free)
        return lengths

    def _shortest(self) -> float:
        """[s] A segment that turns in a step is stretched by half the angle's square: at most as much as it is now."""
        chains, bands = self._chains, self._bands
        weights = self.simulation.weights[self.row]
        stretch = np.maximum(self._lengths - bands, 0)[chains.segments] / bands[chains.segments]
        least = weights / (self._stiffness * bands)[chains.segments[:, -1]]
        strain = np.maximum(np.maximum(stretch, least[:, None]), NEAREST)
        velocity = self._jacobian @ self._qvel
        slides = self._qvel[chains.dofs][:, ::-1]
        extending = np.concatenate([velocity[chains.brakes][:, None], slides], axis=1)
        turning = np.sqrt(np.maximum((extending**2).sum(2) - velocity[chains.segments] ** 2, 0))
        with np.errstate(divide="ignore"):
            return float(np.min(np.sqrt(2 * strain) * self._free() / turning, initial=np.inf))

    def look(self) -> Observation:
        """Pose, lengths and tensions now; tensions include what dampers of cables add."""
        simulation, data, robot = self.simulation, self.data, self.robot
        self._wind(self.let_out)
        self._balance_exits()
        pulls = self._pull_by(0.0)
        tensions, lengths = np.empty(robot.cables), np.empty(robot.cables)
        tensions[simulation.massless] = pulls[simulation.single]
        lengths[simulation.massless] = self._lengths[simulation.single] - simulation.entries[simulation.massless]
        if self._heavy:
            chains = self._chains
            along = data.xpos[chains.nodes[:, 0]] - data.xpos[chains.ends]
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            weight = self.model.body_mass[chains.ends, None] * self.model.opt.gravity
            tensions[chains.cables] = np.linalg.norm(pulls[chains.segments[:, -1], None] * along + weight, axis=1)
            lengths[chains.cables] = self._chords()
        at, turned = data.xpos[self.platform].copy(), data.xmat[self.platform].reshape(3, 3).copy()
        return Observation(at[None], turned[None], lengths[None], robot.cabling.tensions(tensions)[None])

    def _chords(self) -> Float[np.ndarray, " chains"]:
        """Lengths of cables with mass, over wheels that face the anchors [m]."""
        chains, simulation = self._chains, self.simulation
        if not chains.over.any():
            return self._lengths[chains.chords] - chains.entries
        simulation.qpos[self.row] = self._qpos
        return simulation.lengths(np.array([self.row]))[0, chains.cables]

    @property
    def pose(self) -> RigidTransform:
        """The platform's pose now."""
        at, turned = self.data.xpos[self.platform], self.data.xquat[self.platform]
        return RigidTransform.from_components(at, Rotation.from_quat(turned, scalar_first=True))

    def lengths_under(self, tensions: Float[np.ndarray, " cables"], step: float) -> Float[np.ndarray, " cables"]:
        """Rest lengths [m] that give the ropes these tensions at their anchors at the end of a ``step`` [s].

        Of a chain, the last segment gets the strain with which its pull and the weight at the anchor have that size;
        all others follow it. With the present lengths of massless cables, and those of chains to which present
        velocities lead.
        """
        simulation, robot, data = self.simulation, self.robot, self.data
        lengths = self._lengths if self._theta is None else self._lengths + step * (self._jacobian @ self._qvel)
        spans, pulls = lengths[simulation.first] - simulation.entries, robot.cabling.pulls(tensions)
        if self._ropes is not None:
            return self._ropes.under(spans, tensions, step).rest_lengths
        wanted = self._law.rest_lengths(self._law.strained.stretched(pulls)[0], spans)
        if self._heavy:
            chains = self._chains
            along = data.xpos[chains.nodes[:, 0]] - data.xpos[chains.ends]
            rise = along[:, 2] / np.linalg.norm(along, axis=1)
            hung = self.model.body_mass[chains.ends] * robot.gravity
            needed = pulls[chains.cables]
            needed = hung * rise + np.sqrt(np.maximum(needed**2 - hung**2 * (1 - rise**2), 0))
            wrapped, last = robot.wrapped_lengths[chains.cables], self._division.lengths[0, :, -1]
            ends = lengths[chains.segments[:, -1]]
            law, rigid = self._law.some(chains.cables), robot.cabling.least_lengths[chains.cables]
            strains, _ = law.strained.stretched(needed)
            wanted[chains.cables] = rigid + wrapped + law.ropes(ends) / (last * (1 + strains))
        return wanted
