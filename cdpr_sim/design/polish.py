"""Local refinement of a layout with exact derivatives.

The largest of many values is minimised in epigraph form, as one bound t above all of them, which avoids kinks:

    minimise t   such that   |r_c(v)|² ≤ t in every case c,   tensions, displacements and v within bounds,

with r the horizontal part of the platform's z axis (tilt), or its deviation from the commanded position.
"""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from cdpr_sim.design.layout_derivatives import layout_derivatives
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria, solve_layouts
from cdpr_sim.design.moves import Space
from cdpr_sim.design.objectives import Limits, Objective

POINTS = ("exits", "anchors", "center_of_mass")
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
    robot, sign = space.robot, -1.0 if objective.largest else 1.0
    free, weight = space.free, robot.weight or 1.0
    width = (space.upper - space.lower)[free]
    points = np.concatenate([space.by[name].reshape(len(space), -1, 3) for name in POINTS], axis=1)
    lower, upper = (np.broadcast_to(one, (len(cases), robot.cables)) for one in limits)

    def split(z: np.ndarray) -> np.ndarray:
        values = start.copy()
        values[free] = space.lower[free] + z[:-1] * width
        return values.clip(space.lower, space.upper)

    @functools.lru_cache(maxsize=1)  # SLSQP asks for the margins at a point, and then for their slopes there
    def solved(values: bytes) -> LayoutEquilibria:
        return solve_layouts(space.layouts(np.frombuffer(values)[None]), cases, 1)

    def to_minimise(values: np.ndarray) -> Float[np.ndarray, " numbers"]:
        """Squares of tilt or deviation, or signed tensions, of each case."""
        equilibria = solved(values.tobytes())
        if objective.smooth == "tensions":
            found = sign * equilibria.tensions[0].ravel()
        elif objective.smooth == "tilt":
            found = (equilibria.rotations[0][:, :2, 2] ** 2).sum(-1)
        else:
            found = (equilibria.deviation[0] ** 2).sum(-1)
        return np.nan_to_num(found, nan=UNSOLVED)

    def margins(z: np.ndarray) -> np.ndarray:
        """Of the bound t, of the tensions to their limits over the weight, and of the squared displacements."""
        values = split(z)
        tensions = solved(values.tobytes()).tensions[0]
        moved = np.tensordot(values, points, 1)
        far = [] if np.isinf(reach) else 1 - (moved**2).sum(-1) / reach**2
        low, high = (tensions - lower)[lower > 0] / weight, (upper - tensions)[np.isfinite(upper)] / weight
        return np.concatenate([z[-1] - to_minimise(values) / scale, low, high, far])

    def margin_slopes(z: np.ndarray) -> np.ndarray:
        values = split(z)
        equilibria = solved(values.tobytes())
        changes = {name: space.by[name].reshape(len(space), -1).T for name in POINTS}
        changes["axial_stiffness"] = (space.by["axial_stiffness"] * equilibria.layouts.axial_stiffness[0]).T
        pose, tensions = map(np.nan_to_num, layout_derivatives(equilibria, 0, changes, known=True))
        if objective.smooth == "tensions":
            by = sign * tensions.reshape(-1, len(space))
        elif objective.smooth == "tilt":
            axis = equilibria.rotations[0][:, :, 2, None]
            by = 2 * (np.cross(pose[:, 3:], axis, axis=1) * axis)[:, :2].sum(1)
        else:
            by = 2 * (pose[:, :3] * equilibria.deviation[0][..., None]).sum(1)
        far = -2 / reach**2 * np.einsum("pi,vpi->pv", np.tensordot(values, points, 1), points)
        room = [
            tensions[lower > 0] / weight,
            -tensions[np.isfinite(upper)] / weight,
            far[: 0 if np.isinf(reach) else None],
        ]
        slopes = np.concatenate([-by / scale, *room])[:, free] * width
        return np.hstack([slopes, (np.arange(len(slopes)) < len(by))[:, None]])

    here = to_minimise(start)
    scale = float(np.abs(here).max()) or 1.0
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
