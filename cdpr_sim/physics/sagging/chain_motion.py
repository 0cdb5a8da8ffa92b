"""A platform on cables with mass in motion: true inertia, and winches that let out all segments of a chain alike.

Each time step is that of ``stepping``, with true springs. What differs from the motion of real cables:

- The masses of a chain slide along its material while a winch winds it. That neglects the momentum of the cable that is
  wound, a force of density times speed times winding speed at each end.
- Wheels face their cables at once.
- Springs act with their force a part ``ahead`` of the step later, which damps oscillations of the angular frequency
  omega by the ratio ahead omega step/2, and those of taut segments across the cable by as much or more.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.physics.batch import Observation
from cdpr_sim.physics.chains import strains
from cdpr_sim.physics.sagging.chain_simulations import ChainSimulations
from cdpr_sim.physics.sagging.stepping import Stepping

LEAST_AHEAD = 0.5
"""Least part of a step after which springs may act: with less, stiff ones become unstable."""

ROUNDING = 1e-9
"""Rounding of a number of steps."""

Winches = Callable[[float], Float[np.ndarray, " cables"]]
"""Rest lengths (cables,) [m] after so many seconds."""


class ChainMotion:
    """Motion of one platform on cables with mass, from the present state of its simulation.

    Args:
        simulation: the platform, at rest; one row.
        longest: longest time step [s].
        viscosity: of the air [Pa s].
        damping: of the platform's coordinates, (free,) [N s/m, N m s].
        ahead: part of a step after which a spring's force acts, 1/2 to 1.
        cable_damping: damping of springs, as a multiple of their stiffness, if that is more [s].

    Raises:
        InvalidInput: cables with a memory, which is held only on the way to an equilibrium.
    """

    def __init__(
        self,
        simulation: ChainSimulations,
        longest: float,
        *,
        viscosity: float = 0.0,
        damping: Float[np.ndarray, " free"] | float = 0.0,
        ahead: float = 1.0,
        cable_damping: float = 0.0,
    ) -> None:
        simulation.robot.cabling.refuse_memory()
        self.simulation, self.longest = simulation, longest
        self.row = simulation.all
        simulation.residuals(self.row)
        simulation.batch.expand("opt.viscosity")[:] = viscosity
        simulation.armature[:, : simulation.free] = 0
        simulation.damping[:, : simulation.free] = damping
        self.stepping = Stepping(simulation, np.array([longest]), ahead=ahead, cable_damping=cable_damping)
        self.stepping.stiffen(self.row)
        self.stepping.turning = bool(len(simulation.swivels))
        self.stepping.begin(self.row)
        self.let_out, self.time = simulation.rest_lengths[0], 0.0
        self.data: mujoco.MjData = mujoco.MjData(simulation.model)

    def advance(self, seconds: float, winches: Winches | None = None) -> None:
        """Move for ``seconds``, while winches let these lengths out, which are counted from now on."""
        for _ in self.steps(seconds, winches):
            pass

    def steps(self, seconds: float, winches: Winches | None = None) -> Iterator[float]:
        """``advance``, time step by time step: the time that has passed [s], after each."""
        passed = 0.0

        def wind(steps: Float[np.ndarray, "1"]) -> None:
            step = float(steps[0])
            wanted = self.let_out if winches is None else winches(passed + step)
            self._wind((wanted - self.let_out) / step, float(self.stepping.lag(steps)[0]))
            self.let_out = wanted

        while (left := seconds - passed) > ROUNDING * self.longest:
            longest = left / np.ceil(left / self.longest - ROUNDING)
            step = float(self.stepping.advance(self.row, np.array([longest]), wind)[0])
            passed, self.time = passed + step, self.time + step
            yield passed

    def look(self) -> Observation:
        """Bring the springs and ``data`` to the present instant; returns pose, lengths and tensions."""
        simulation = self.simulation
        self._wind(np.zeros_like(self.let_out), 0.0)
        seen = simulation.observe(self.row)
        simulation.batch.get_data(0, self.data)
        mujoco.mj_kinematics(simulation.model, self.data)
        self.data.warning.number[:] = simulation.batch.warning[0, :, 1]
        return seen

    def _wind(self, rates: Float[np.ndarray, " cables"], lag: float) -> None:
        """Set springs to the lengths of the instant at which they act: damping is of strains, not of lengths."""
        simulation = self.simulation
        self.stepping.rates = rates[None, simulation.chains.cables]
        rest_lengths = (self.let_out + lag * rates)[None]
        if (rest_lengths != simulation.rest_lengths).any():
            simulation.wind(rest_lengths)
            self.stepping.measure(self.row)

    def lengths_under(self, tensions: Float[np.ndarray, " cables"], step: float) -> Float[np.ndarray, " cables"]:
        """Rest lengths that give the ropes these tensions at their anchors after a step [m], once it is repeated.

        Of a chain, the last segment gets the strain with which its pull and the weight at the anchor have that size;
        all others follow it. As of MuJoCo's last call, with the lengths to which present velocities lead.
        """
        simulation, robot = self.simulation, self.simulation.robot
        chains, cabling, xpos = simulation.chains, simulation.robot.cabling, simulation.xpos[0]
        lengths = simulation.ten_length[0] + self.stepping.lag(np.array([step]))[0] * simulation.ten_velocity[0]
        pulls = robot.reeving * tensions
        wanted = np.empty(robot.cables)
        along = xpos[chains.nodes[:, 0]] - xpos[chains.ends]
        rise = along[:, 2] / np.linalg.norm(along, axis=1)
        hung = simulation.masses[0, chains.ends] * robot.gravity
        needed = pulls[chains.cables]
        needed = hung * rise + np.sqrt(np.maximum(needed**2 - hung**2 * (1 - rise**2), 0))
        wrapped, last = robot.wrapped_lengths[chains.cables], simulation.division.lengths[0, :, -1]
        ends = lengths[chains.segments[:, -1]]
        wanted[chains.cables] = wrapped + ends / (last * (1 + strains(cabling, chains.cables, needed)))
        alone = simulation.massless
        strain, shared = strains(cabling, alone, pulls[alone]), (robot.winch_to_exit / robot.reeving)[alone]
        spans = lengths[simulation.single] - simulation.entries[alone]
        wanted[alone] = (spans - strain * shared) / (1 + strain)
        return wanted
