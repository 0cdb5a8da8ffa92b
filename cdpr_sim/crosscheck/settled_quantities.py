"""The quantity "settled" of a sweep: every pose settled in MuJoCo, and compared with statics.

It is computed block by block on the graph of ``sweep``, so that it can be stored, resumed and computed on a cluster.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cdpr_sim.analysis.workspace.sweep import as_stored, rotation_vectors
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.core.sweep_quantities import Quantity
from cdpr_sim.crosscheck import check
from cdpr_sim.crosscheck.check import ROWS, both, outcomes_of
from cdpr_sim.crosscheck.compare import compare_many

QUANTITIES = {
    "settled_position": Quantity(("axis",), float, "m", "position of the platform's origin in MuJoCo"),
    "settled_rotation_vector": Quantity(("axis",), float, "rad", "rotation in MuJoCo, as axis times angle, base frame"),
    "settled_tensions": Quantity(("cable",), float, "N", "cable tensions in MuJoCo, at the platform"),
    "settled_eigenvalues": Quantity(("mode",), float, "N m-1", "eigenvalues of the stiffness in MuJoCo, ascending"),
    "settled_residual": Quantity((), float, "N", "largest unbalanced force in MuJoCo"),
    "settled_steps": Quantity((), np.int32, "1", "steps in MuJoCo, of time and of Newton"),
    "settled_status": Quantity(
        (), np.int8, "1", "how the settling ended", {int(one): one.name.lower() for one in Status}
    ),
    **{name: kind for name, kind in check.QUANTITIES.items() if name != "proved"},
}
"""Each number is nan (with the reason in a status) where MuJoCo's platform did not settle; of a comparison also where
statics found no equilibrium."""


def compute(robot: Robot, commanded: np.ndarray, **given: Any) -> dict[str, np.ndarray]:
    """The quantities at positions of any shape, on one thread: others compute other blocks."""
    del given["names"]  # all of them are computed
    problems = Problems.of(robot, commanded, **given)
    rows = problems.take(np.ones(problems.shape, dtype=bool))
    parts = [_of_rows(rows.take(np.arange(first, min(first + ROWS, len(rows))))) for first in range(0, len(rows), ROWS)]
    return {
        name: np.concatenate([part[name] for part in parts]).reshape(problems.shape + parts[0][name].shape[1:])
        for name in QUANTITIES
    }


def _of_rows(problems: Problems) -> dict[str, np.ndarray]:
    solved, settled = both(problems, threads=1)
    found = settled.converged
    read = {
        "settled_position": settled.positions,
        "settled_rotation_vector": rotation_vectors(settled.rotations, found),
        "settled_tensions": settled.tensions,
        "settled_eigenvalues": settled.eigenvalues,
        "settled_residual": settled.residuals,
        "settled_steps": settled.iterations,
        "settled_status": settled.status,
    }
    columns = {name: as_stored(QUANTITIES[name], values, found) for name, values in read.items()}
    comparison = compare_many(solved, settled, threads=1)
    return columns | comparison.errors | {"outcome": outcomes_of(comparison)}
