"""Local refinement of a layout with exact derivatives.

The largest of many values is minimised in epigraph form, as one bound t above all of them, which avoids kinks:

    minimise t   such that   |r_c(v)|² ≤ t in every case c,   tensions, displacements and v within bounds,

with r the horizontal part of the platform's z axis (tilt), or its deviation from the commanded position.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from cdpr_sim.design.layout_derivatives import Steps, layout_derivatives
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Space
from cdpr_sim.design.objectives import Limits, Objective

STEPS = 100
UNSOLVED = 1e6
"""Value assigned to a trial layout without an equilibrium: far worse than any other."""

SHORTER = (1.0, 0.5, 0.25, 0.1, 0.03)
"""Fractions of the step that are tried, since not every constraint has a gradient."""


def polished(
    start: Float[np.ndarray, " variables"],
    space: Space,
    cases: Cases,
    objective: Objective,
    limits: Limits,
    reach: float,
) -> Float[np.ndarray, "candidates variables"]:
    """Candidate layouts between ``start`` and the local optimum, the optimum first; the caller evaluates them."""
    path = _Path(space, cases, objective, limits, reach)
    free = space.free
    width = (space.upper - space.lower)[free]
    here = path.values(start)
    scale = float(np.abs(here).max()) or 1.0

    def split(z: np.ndarray) -> np.ndarray:
        values = start.copy()
        values[free] = space.lower[free] + z[:-1] * width
        return values.clip(space.lower, space.upper)

    def margins(z: np.ndarray) -> np.ndarray:
        return np.concatenate([z[-1] - path.values(split(z)) / scale, path.room(split(z))])

    def margin_slopes(z: np.ndarray) -> np.ndarray:
        by, room = path.layout_derivatives(split(z))
        rows = np.vstack([-by[:, free] / scale, room[:, free]]) * width
        return np.hstack([rows, np.concatenate([np.ones(len(by)), np.zeros(len(room))])[:, None]])

    first = np.append((start[free] - space.lower[free]) / width, float((here / scale).max()))
    pick = np.zeros(len(first))
    pick[-1] = 1.0
    found = minimize(
        lambda z: z[-1], first, jac=lambda z: pick, method="SLSQP", bounds=[(0, 1)] * int(free.sum()) + [(None, None)],
        constraints={"type": "ineq", "fun": margins, "jac": margin_slopes}, options={"maxiter": STEPS, "ftol": 1e-12},
    )  # fmt: skip
    end = split(found.x)
    if not np.isfinite(end).all():
        return start[None]
    return np.array([start + part * (end - start) for part in SHORTER])


class _Path:
    """Values and derivatives of a layout; the last equilibria are cached."""

    def __init__(self, space: Space, cases: Cases, objective: Objective, limits: Limits, reach: float) -> None:
        self.space, self.cases, self.objective, self.limits, self.reach = space, cases, objective, limits, reach
        self.at: np.ndarray | None = None

    def _solve(self, values: np.ndarray) -> None:
        if self.at is None or not np.array_equal(values, self.at):
            self.at = values.copy()
            self.equilibria = solve_layouts(self.space.layouts(values[None]), self.cases, 1)

    def values(self, values: np.ndarray) -> Float[np.ndarray, " numbers"]:
        """Values to be minimised, for each case: squares of tilt or deviation, or signed tensions."""
        self._solve(values)
        if self.objective.smooth == "tensions":
            found = self._sign * self.equilibria.tensions[0].ravel()
        else:
            found = (self._residual() ** 2).sum(-1)
        return np.nan_to_num(found, nan=UNSOLVED)

    @property
    def _sign(self) -> float:
        return -1.0 if self.objective.largest else 1.0

    def _residual(self) -> np.ndarray:
        if self.objective.smooth == "tilt":
            return self.equilibria.rotations[0][:, :2, 2]
        return self.equilibria.deviation[0]

    def room(self, values: np.ndarray) -> Float[np.ndarray, " limits"]:
        """Margins to the limits: of tensions over the weight, and of squared displacements over their limit."""
        self._solve(values)
        tau, scale = self.equilibria.tensions[0], self.space.robot.weight or 1.0
        lower, upper = (np.broadcast_to(one, tau.shape) for one in self.limits)
        low, high = lower > 0, np.isfinite(upper)
        moved = (self._moved(values) ** 2).sum(-1)
        far = [] if np.isinf(self.reach) else 1 - moved / self.reach**2
        return np.concatenate([(tau - lower)[low] / scale, (upper - tau)[high] / scale, far])

    @property
    def _directions(self) -> Float[np.ndarray, "variables points 3"]:
        space = self.space
        return np.concatenate([space.exits, space.anchors, space.center[:, None]], axis=1)

    def _moved(self, values: np.ndarray) -> Float[np.ndarray, "points 3"]:
        return np.tensordot(values, self._directions, 1)

    def layout_derivatives(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of ``values`` and of ``room`` by the variables, a row each."""
        self._solve(values)
        space, equilibria = self.space, self.equilibria
        layouts = equilibria.layouts
        steps = Steps(
            space.exits, space.anchors, space.log_stiffness * layouts.axial_stiffness[0], space.center
        )  # fmt: skip
        by_pose, by_tensions = layout_derivatives(
            layouts.robot_at(0),
            self.cases,
            equilibria.positions[0],
            equilibria.rotations[0],
            equilibria.problems.rest_lengths[0],
            steps,
        )
        pose, tensions = np.nan_to_num(by_pose), np.nan_to_num(by_tensions)
        if self.objective.smooth == "tensions":
            rows = self._sign * tensions.swapaxes(1, 2).reshape(-1, len(space))
        elif self.objective.smooth == "tilt":
            axis = equilibria.rotations[0][:, :, 2]
            turned = np.cross(pose[..., 3:], axis[:, None])[..., :2]
            rows = 2 * (turned * axis[:, None, :2]).sum(-1)
        else:
            rows = 2 * (pose[..., :3] * equilibria.deviation[0][:, None]).sum(-1)
        tau, scale = equilibria.tensions[0], space.robot.weight or 1.0
        lower, upper = (np.broadcast_to(one, tau.shape) for one in self.limits)
        each = tensions.swapaxes(1, 2) / scale
        far = -2 / self.reach**2 * np.einsum("pi,vpi->pv", self._moved(values), self._directions)
        far = far[: 0 if np.isinf(self.reach) else None]
        return rows, np.concatenate([each[lower > 0], -each[np.isfinite(upper)], far])
