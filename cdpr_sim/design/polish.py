"""Local refinement of a layout by slopes that are differences of equilibria solved anew.

The largest of many values is minimised in epigraph form, as one bound t above all of them, which avoids kinks:

    minimise t   such that   |r_c(v)|² ≤ t in every case c,   tensions, displacements and v within bounds,

with r the horizontal part of the platform's z axis (tilt), or its deviation from the commanded position. The winches
know each layout that is tried: rest lengths at the commanded poses change with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Space
from cdpr_sim.design.objectives import Limits, Objective

POINTS = ("exits", "anchors", "center_of_mass")
ITERATIONS = 100
UNSOLVED = 1e6
"""Value assigned to a trial layout without an equilibrium: far worse than any other."""

STEP, SMALLER = 1e-4, (1.0, 0.1, 0.01)
"""Step of central differences, as a share of a variable's range: they miss less than 1e-6 of a slope, by curvature and
by rounding of equilibria (``test_design.py``). And the fractions of it that are tried in turn: a slope jumps where
a cable becomes slack, and a search may end early there."""

SHORTER = (1.0, 0.5, 0.25, 0.1, 0.03)
"""Fractions of the step that are tried, since a slope jumps where a cable becomes slack."""


def polished(
    start: Float[np.ndarray, " variables"],
    space: Space,
    cases: Cases,
    objective: Objective,
    limits: Limits,
    reach: float,
    smaller: float = 1.0,
) -> Float[np.ndarray, "candidates variables"]:
    """Candidate layouts between ``start`` and the local optimum, the optimum first; the caller evaluates them.

    Slopes are differences at the fraction ``smaller`` of ``STEP``.
    """
    free, width = space.free, (space.upper - space.lower)[space.free]

    def values(shares: Float[np.ndarray, "layouts free"]) -> Float[np.ndarray, "layouts variables"]:
        found = np.tile(start, (len(shares), 1))
        found[:, free] = space.lower[free] + shares.clip(0, 1) * width
        return found

    def numbers(shares: Float[np.ndarray, "layouts free"]) -> tuple[np.ndarray, np.ndarray]:
        return margins(values(shares), space, cases, objective, limits, reach)

    first = (start[free] - space.lower[free]) / width
    here = numbers(first[None])[0][0]
    scale = float(np.abs(here).max()) or 1.0

    def below(z: np.ndarray) -> np.ndarray:
        """Of the bound t, and of all limits; none without an equilibrium."""
        worst, room = numbers(z[None, :-1])
        return np.nan_to_num(np.append(z[-1] - worst / scale, room), nan=-UNSOLVED)

    def slopes(z: np.ndarray) -> np.ndarray:
        worst, room = slopes_of_margins(numbers, z[:-1], smaller * STEP)
        by_bound = np.arange(len(worst) + len(room)) < len(worst)
        return np.column_stack([np.concatenate([-worst / scale, room]), by_bound])

    bound = np.append(np.zeros(len(width)), 1.0)
    found = minimize(
        lambda z: z[-1], np.append(first, (here / scale).max()), jac=lambda z: bound,
        method="SLSQP", bounds=[(0, 1)] * len(width) + [(None, None)],
        constraints={"type": "ineq", "fun": below, "jac": slopes}, options={"maxiter": ITERATIONS, "ftol": 1e-12},
    )  # fmt: skip
    end = values(found.x[None, :-1])[0]
    if not np.isfinite(end).all():
        return start[None]
    return np.array([start + part * (end - start) for part in SHORTER])


def margins(
    values: Float[np.ndarray, "layouts variables"],
    space: Space,
    cases: Cases,
    objective: Objective,
    limits: Limits,
    reach: float,
) -> tuple[Float[np.ndarray, "layouts numbers"], Float[np.ndarray, "layouts margins"]]:
    """Of layouts, what is minimised, and margins that must not be below 0; nan without an equilibrium.

    What is minimised are squares of tilt or deviation, or signed tensions, of each case. Margins are those of the
    tensions to their limits, over the weight; and of the squared displacement of each point over that of ``reach``.
    """
    equilibria = solve_layouts(space.layouts(values), cases, 1)
    tensions, weight = equilibria.tensions, space.robot.weight or 1.0
    if objective.smooth == "tensions":
        found = (-1.0 if objective.largest else 1.0) * tensions.reshape(len(values), -1)
    elif objective.smooth == "tilt":
        found = (equilibria.rotations[..., :2, 2] ** 2).sum(-1)
    else:
        found = (equilibria.deviation**2).sum(-1)
    lower, upper = (np.broadcast_to(one, tensions.shape[1:]) for one in limits)
    room = [(tensions - lower)[:, lower > 0] / weight, (upper - tensions)[:, np.isfinite(upper)] / weight]
    if np.isfinite(reach):
        points = np.concatenate([space.by[name].reshape(len(space), -1, 3) for name in POINTS], axis=1)
        room.append(1 - (np.tensordot(values, points, 1) ** 2).sum(-1) / reach**2)
    return found, np.concatenate(room, axis=1)


def slopes_of_margins(
    numbers: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], at: Float[np.ndarray, " free"], step: float = STEP
) -> tuple[Float[np.ndarray, "numbers free"], Float[np.ndarray, "margins free"]]:
    """Central differences of ``margins`` by shares of the variables' ranges, one-sided at their ends.

    All of them are solved at once; 0 where a layout has no equilibrium.
    """
    steps = step * np.eye(len(at))
    up, down = (at + steps).clip(0, 1), (at - steps).clip(0, 1)
    apart = (up - down).sum(1)[:, None]
    both = numbers(np.concatenate([up, down]))
    return tuple(np.nan_to_num((each[: len(at)] - each[len(at) :]) / apart).T for each in both)
