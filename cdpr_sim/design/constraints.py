"""Constraints: tension limits, taut cables, stability, clearances, and limits on any objective."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.analysis import clearance
from cdpr_sim.core.checks import checked_array, one_of, refuse_unless, shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.limits import checked_limits
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.design.layout_equilibria import LayoutEquilibria
from cdpr_sim.design.objectives import NO_LIMITS, OBJECTIVES, Limits, renamed

KNOWN = ("tensions", "all taut", "stable", "clearance")


@dataclass(frozen=True)
class Constraint:
    """A constraint in every case.

    Attributes:
        name: name of the constraint, with its limit.
        violation: (layouts,) as a fraction of the limit; 0 where the constraint holds.
    """

    name: str
    violation: Callable[[LayoutEquilibria], Float[np.ndarray, " layouts"]]


ALL_TAUT = Constraint("all cables taut", lambda equilibria: equilibria.slack.mean((-1, -2)))
STABLE = Constraint(
    "stable equilibria",
    lambda equilibria: 1 - (equilibria.eigenvalues[..., 0] > NEUTRAL * np.abs(equilibria.eigenvalues).max(-1)).mean(-1),
)


def constraints_of(robot: Robot, subject_to: Mapping[str, Any] | None) -> tuple[list[Constraint], Limits, float]:
    """Constraints as users give them, with the tension limits [N] and the limit of how far points move [m] among them.

    Raises:
        UnknownName: no such constraint.
        InvalidInput: an invalid limit.
    """
    refuse_unless(Mapping | None, subject_to=subject_to)
    constraints, limits, reach = [], NO_LIMITS, np.inf
    given = {} if subject_to is None else subject_to
    for name, value in sorted(given.items(), key=lambda item: item[0] != "tensions"):
        one_of("constraint", name, (*KNOWN, *OBJECTIVES), renamed)
        if name == "tensions":
            limits = checked_limits(robot, value)
            constraints.append(_tensions(robot, *limits))
        elif name in ("all taut", "stable"):
            if value is not True:
                raise InvalidInput(f"subject_to[{name!r}]: found {shown(value)}, expected True")
            constraints.append(STABLE if name == "stable" else ALL_TAUT)
        else:
            limit = float(checked_array(f"subject_to[{name!r}]", value, ()))
            reach = limit if name == "points moved" else reach
            constraints.append(_clearance(limit) if name == "clearance" else _limit(name, limit, limits))
    return constraints, limits, reach


def _tensions(robot: Robot, lower: np.ndarray, upper: np.ndarray) -> Constraint:
    scale = robot.weight or 1.0
    name = f"tensions from {lower.min():g} to {upper.max():g} N"
    return Constraint(
        name,
        lambda equilibria: (
            np.maximum(np.maximum(lower - equilibria.tensions, equilibria.tensions - upper), 0).max((-1, -2)) / scale
        ),
    )


def _clearance(least: float) -> Constraint:
    if not least > 0:
        raise InvalidInput(f"subject_to['clearance']: found {least:g} m, expected more than 0")

    return Constraint(
        f"clearance of {1e3 * least:g} mm",
        lambda equilibria: np.maximum(least - clearance.least_clearance(equilibria).min(-1), 0) / least,
    )


def _limit(name: str, limit: float, tensions: Limits) -> Constraint:
    objective = OBJECTIVES[name]
    side, scale = (-1.0, abs(limit) or 1.0) if objective.largest else (1.0, abs(limit) or 1.0)
    bound = "at least" if objective.largest else "at most"
    return Constraint(
        f"{name} {bound} {objective.shown(limit)}",
        lambda equilibria: np.maximum(side * (objective.score(equilibria, tensions) - limit), 0) / scale,
    )
