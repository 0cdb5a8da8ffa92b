"""Physics over the whole workspace: every pose of a grid settled in MuJoCo and compared with the solver.

The rules are those of ``compare``, applied to thousands of rows at once; wherever they find anything but
plain agreement, ``compare`` itself says what it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from cdpr_sim.analysis.workspace import grids
from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.analysis.workspace.sweep import as_robots, axial_stiffnesses
from cdpr_sim.core import available_memory, extras
from cdpr_sim.core.checks import FLAG, MOST_THREADS, one_of, refuse_unless, whole
from cdpr_sim.core.describe import cables_name
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import angle_between, poses_of
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.progress import bar
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck import compare
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.physics.settle import residuals_of, settle_many
from cdpr_sim.statics import forces
from cdpr_sim.statics.newton import solve_many

if TYPE_CHECKING:
    import xarray as xr

ROWS = 2500
"""Poses that settle side by side: enough for all cores, few enough for a progress bar that moves."""

BYTES_PER_POSITION, BYTES_PER_POSE = 150, 150
"""Of memory: for the grid, and for what is found at each of its poses by each robot with each material."""

OUTCOMES = ("refused", *(verdict.name.lower() for verdict in Verdict), "unsettled", "unsolved")
"""The outcome at a pose, the worse the later: both methods refuse it, since every exit lies below the platform; a
verdict; MuJoCo's platform did not come to rest; the solver found no equilibrium."""

AGREEING = {OUTCOMES.index(verdict.name.lower()) for verdict in (Verdict.AGREE, Verdict.AGREE_BUT_FREE)}
REFUSED = OUTCOMES.index("refused")


@dataclass(frozen=True)
class Disagreement:
    """A pose at which the two methods do not agree.

    Attributes:
        robot: its name.
        material: the name of its cables.
        position: commanded, (x, y, z) [m].
        outcome: one of ``OUTCOMES``.
        reasons: a sentence each.
    """

    robot: str
    material: str
    position: tuple[float, float, float]
    outcome: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Check(HtmlRepr):
    """The two methods over a whole workspace.

    Attributes:
        dataset: over (robot, material, x, y, z), or (robot, x, y, z) with each robot's own cables: the ``outcome`` as
            a CF flag, the errors and the cross residuals of ``Agreement``.
        disagreements: every pose at which they do not agree.
    """

    dataset: xr.Dataset
    disagreements: tuple[Disagreement, ...]

    @property
    def agrees(self) -> bool:
        """Whether the two methods agree at every pose that was settled, and all poses were."""
        return not self.disagreements

    def across(self, axis: str = "y") -> xr.Dataset:
        """The worst outcome and the largest error of agreeing poses along ``axis``: a plane, to be drawn as a map.

        Returns:
            The dataset without ``axis``.
        """
        one_of("axis", axis, grids.AXES)
        agree = self.dataset["outcome"] == OUTCOMES.index("agree")
        errors = [name for name in _MEANINGS if name != "outcome"]
        worst = self.dataset[errors].where(agree).assign(outcome=self.dataset["outcome"]).max(axis, keep_attrs=True)
        middle = self.dataset[axis].mean(keep_attrs=True)
        worst = worst.expand_dims({axis: [float(middle)]}).assign_coords(frame=self.dataset["frame"])
        worst[axis].attrs = {"units": "m", "section": f"the worst along {axis}"}
        return worst

    def __repr__(self) -> str:
        poses = self.dataset["outcome"].size
        robots = ", ".join(repr(str(name)) for name in np.atleast_1d(self.dataset["robot"].values))
        said = "no disagreement" if self.agrees else f"{len(self.disagreements):,} poses do not agree"
        return f"<Check of {robots}: {poses:,} poses, {said}>"


def check(
    robots: str | Robot | Sequence[str | Robot],
    grid: GridLike | None = None,
    materials: Sequence[str] | Mapping[str, float] | None = None,
    *,
    threads: int = 0,
    progress: bool = False,
) -> Check:
    """Settle every pose of a grid in MuJoCo and compare each with the solver.

    Args:
        robots: one robot or several, as objects, catalogue names or .toml files.
        grid: counts (nx, ny, nz) over the workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m]; default: 10⁴.
        materials: names of the catalogue, or {name: EA [N]}; default: each robot's own.
        threads: for MuJoCo; 0 for one per processor.
        progress: show a progress bar on standard error.

    Returns:
        Outcome and errors at every pose, and each pose at which the two methods do not agree.

    Raises:
        InvalidInput: a grid or names that cannot be right.
        UnknownName: no such robot or material.
    """
    extras.require("sweep", "check")
    import xarray as xr

    refuse_unless(FLAG, progress=progress)
    whole("threads", threads, 0, MOST_THREADS)
    group = as_robots(robots)
    axes = grids.as_grid(grid, group)
    stiffnesses = axial_stiffnesses(group, materials)
    labels = [None] if materials is None else list(materials)
    poses = float(np.prod([len(values) for values in axes.values()]))
    available_memory.refuse_beyond(
        f"grid: a check of {len(group) * len(labels) * poses:,.0f} poses",
        poses * (BYTES_PER_POSITION + BYTES_PER_POSE * len(group) * len(labels)),
        "fewer poses",
    )
    positions = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1)
    shape = positions.shape[:-1]
    rows = positions.reshape(-1, 3)
    columns: list[dict[str, np.ndarray]] = []
    disagreements: list[Disagreement] = []
    with bar("check", len(group) * len(labels) * len(rows), show=progress) as advance:
        for robot in group:
            for label, stiffness in zip(labels, np.atleast_2d(stiffnesses[robot.name]), strict=True):
                variant = robot.replace(axial_stiffness=stiffness)
                parts = []
                for first in range(0, len(rows), ROWS):
                    part, found = _check_rows(variant, rows[first : first + ROWS], label or cables_name(robot), threads)
                    parts.append(part)
                    disagreements += found
                    advance(len(rows[first : first + ROWS]))
                columns.append({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    if materials is None:
        sizes, names = {"robot": len(group)}, ("robot", [cables_name(robot) for robot in group])
    else:
        sizes, names = {"robot": len(group), "material": len(labels)}, ("material", labels)
    dataset = xr.Dataset(
        {
            name: ((*sizes, *axes), np.array([c[name] for c in columns]).reshape(*sizes.values(), *shape))
            for name in columns[0]
        },
        coords={
            "robot": [robot.name for robot in group],
            "material": names,
            **{name: (name, values, {"units": "m", "long_name": f"commanded {name}"}) for name, values in axes.items()},
            "frame": (("robot", "corner", "axis"), [robot.frame for robot in group], {"units": "m"}),
            "axis": list(axes),
        },
        attrs={"title": "MuJoCo and statics over the workspace of cable-driven parallel robots"},
    )
    for name, (units, meaning) in _MEANINGS.items():
        dataset[name].attrs = {"units": units, "long_name": meaning}
    dataset["outcome"].attrs |= {"flag_values": list(range(len(OUTCOMES))), "flag_meanings": " ".join(OUTCOMES)}
    return Check(dataset, tuple(disagreements))


_MEANINGS = {
    "outcome": ("1", "what comparing MuJoCo with statics came to"),
    "position_error": ("m", "distance between the platform's origins"),
    "rotation_error": ("rad", "angle between the platforms"),
    "tension_error": ("N", "largest difference in a cable"),
    "static_in_mujoco": ("N", "unbalanced force that MuJoCo finds at the static pose"),
    "settled_in_statics": ("N", "unbalanced force that statics finds at the settled pose"),
}


def _check_rows(
    robot: Robot, positions: np.ndarray, material: str, threads: int
) -> tuple[dict[str, np.ndarray], list[Disagreement]]:
    """The columns of ``_MEANINGS`` at each of the positions, and what is to be reported."""
    problems = Problems.of(robot, positions)
    solved, settled = solve_many(problems), settle_many(problems, threads=threads)  # what refuses, refuses at once
    values, agree = compare_many(solved, settled, threads=threads)
    refused = problems.refusals != Status.PENDING
    outcome = np.where(refused, REFUSED, OUTCOMES.index(Verdict.AGREE.name.lower())).astype(np.int8)
    disagreements: list[Disagreement] = []
    for row in np.flatnonzero(~agree & ~refused):
        name, reasons = _outcome(solved, settled, int(row))
        outcome[row] = OUTCOMES.index(name)
        if outcome[row] not in AGREEING:
            x, y, z = (float(value) for value in positions[row])
            disagreements.append(Disagreement(robot.name, material, (x, y, z), name, reasons))
    return {"outcome": outcome, **values}, disagreements


def compare_many(
    solved: EquilibriumBatch, settled: EquilibriumBatch, *, threads: int = 0
) -> tuple[dict[str, np.ndarray], Bool[np.ndarray, " rows"]]:
    """The errors and cross residuals of ``Agreement``, (rows,) each, and in which rows all is within tolerance.

    Args:
        solved: static equilibria, (rows,).
        settled: the same problems by MuJoCo.
        threads: for MuJoCo; 0 for one per processor.
    """
    columns = {name: np.full(len(solved), np.nan) for name in _MEANINGS if name != "outcome"}
    within = np.zeros(len(solved), dtype=bool)
    rows = np.flatnonzero(solved.converged & settled.converged)
    if not rows.size:
        return columns, within
    problems = solved.problems.take(rows)
    static, rested = ((equilibria.positions[rows], equilibria.rotations[rows]) for equilibria in (solved, settled))
    errors = {
        "position_error": np.linalg.norm(static[0] - rested[0], axis=-1),
        "rotation_error": angle_between(static[1], rested[1]),
        "tension_error": np.abs(solved.tensions[rows] - settled.tensions[rows]).max(-1),
        "static_in_mujoco": residuals_of(problems, poses_of(*static), threads=threads),
        "settled_in_statics": np.asarray(forces.at(problems, *rested).residual),
    }
    near = [np.abs(one.lengths - one.rest_lengths)[rows] <= compare.REST_LENGTH_TOLERANCE for one in (solved, settled)]
    same_slack = ~((solved.slack != settled.slack)[rows] & ~near[0] & ~near[1]).any(-1)
    cross = compare.CROSS_TOLERANCE * problems.force_scale
    tolerances = {
        "position_error": compare.POSITION_TOLERANCE,
        "rotation_error": compare.ROTATION_TOLERANCE,
        "tension_error": compare.TENSION_TOLERANCE,
        "static_in_mujoco": cross,
        "settled_in_statics": cross,
    }
    within[rows] = np.all([errors[name] <= tolerance for name, tolerance in tolerances.items()], axis=0) & same_slack
    for name, column in errors.items():
        columns[name][rows] = column
    return columns, within


def _outcome(solved: EquilibriumBatch, settled: EquilibriumBatch, row: int) -> tuple[str, tuple[str, ...]]:
    """In words, what is not plain agreement."""
    for name, equilibria in (("unsolved", solved), ("unsettled", settled)):
        if not equilibria.converged[row]:
            return name, (Status(int(equilibria.status[row])).sentence,)
    result = compare.compare(solved[row], settled[row])
    return result.verdict.name.lower(), result.reasons
