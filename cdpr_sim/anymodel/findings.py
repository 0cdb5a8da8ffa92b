"""``ModelFinding``: one thing that is wrong with a MuJoCo model, and what to do about it."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class FindingKind(enum.Enum):
    """What is wrong."""

    SPRING_PUSHES = "a tendon's spring pushes"
    DAMPER_PUSHES = "a tendon's damper acts while it is slack"
    LIMIT_PUSHES = "a tendon's range pushes"
    ACTUATOR_PUSHES = "an actuator pushes through a tendon"
    LIMIT_CARRIES = "a limit carries load at rest"
    TIME_STEP = "the time step is too long"
    REFSAFE = "the equilibrium depends on the time step"
    MASSES = "masses far apart"
    UNSUPPORTED = "gravity without support"
    NO_REST = "the model does not come to rest"


@dataclass(frozen=True)
class ModelFinding:
    """One thing that is wrong with a model.

    Attributes:
        kind: what is wrong.
        element: kind and name of the element, as in ``tendon 'rope'``.
        problem: what it does.
        remedy: what to change.
    """

    kind: FindingKind
    element: str
    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.element}: {self.problem}; {self.remedy}."
