"""Physics over the whole workspace: every pose of a grid settled in MuJoCo and compared with the solver.

The rules are those of ``agreement.compare``, applied to thousands of rows at once; wherever they find anything but
plain agreement, ``compare`` itself says what it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.crosscheck import compare as agreement
from cdpr_sim.analysis.workspace import grids
from cdpr_sim.physics import settle as settling
from cdpr_sim.statics import forces as statics
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.statics.newton_kernel import Status
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.statics.newton import Solutions, solve_many
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.progress import bar
from cdpr_sim.core.robot import Robot
from cdpr_sim.analysis.workspace.sweep import as_robots, axial_stiffnesses

if TYPE_CHECKING:
    import xarray as xr

ROWS = 2500
"""Poses that settle side by side: enough for all cores, few enough for a progress bar that moves."""

OUTCOMES = ("refused", *(verdict.name.lower() for verdict in Verdict), "unsettled", "unsolved")
"""What checking a pose comes to, the worse the later: both roads refuse it, since every exit lies below the platform; a
verdict; MuJoCo's platform did not come to rest; the solver found no equilibrium."""

AGREEING = {OUTCOMES.index(verdict.name.lower()) for verdict in (Verdict.AGREE, Verdict.AGREE_BUT_FREE)}
REFUSED = OUTCOMES.index("refused")


@dataclass(frozen=True)
class Finding:
    """A pose at which the two roads do not agree.

    Attributes:
        robot: its name.
        material: its cables, or None for the robot's own.
        position: commanded, (x, y, z) [m].
        outcome: one of ``OUTCOMES``.
        reasons: a sentence each.
    """

    robot: str
    material: str | None
    position: tuple[float, float, float]
    outcome: str
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Check:
    """The two roads over a whole workspace.

    Attributes:
        dataset: over (robot, material, x, y, z): the ``outcome`` as a CF flag, the errors and the cross residuals of
            ``Agreement``, and the tilt.
        findings: every pose at which they do not agree.
    """

    dataset: xr.Dataset
    findings: tuple[Finding, ...]

    @property
    def agrees(self) -> bool:
        """Whether the two roads agree at every pose that was settled, and all poses were."""
        return not self.findings

    def across(self, axis: str = "y") -> xr.Dataset:
        """The worst outcome and the largest error of agreeing poses along ``axis``: a plane, to be drawn as a map."""
        agree = self.dataset["outcome"] == OUTCOMES.index("agree")
        errors = [name for name in _MEANINGS if name != "outcome"]
        worst = self.dataset[errors].where(agree).assign(outcome=self.dataset["outcome"]).max(axis, keep_attrs=True)
        middle = self.dataset[axis].mean(keep_attrs=True)
        worst = worst.expand_dims({axis: [float(middle)]}).assign_coords(frame=self.dataset["frame"])
        worst[axis].attrs = {"units": "m", "section": f"the worst along {axis}"}
        return worst


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

    Raises:
        InvalidInput: a grid or names that cannot be right.
        UnknownName: no such robot or material.
    """
    import xarray as xr

    group = as_robots(robots)
    axes = grids.as_grid(grid, group)
    stiffnesses = axial_stiffnesses(group, materials)
    labels = [None] if materials is None else list(materials)
    positions = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1)
    shape = positions.shape[:-1]
    rows = positions.reshape(-1, 3)
    columns: list[dict[str, np.ndarray]] = []
    findings: list[Finding] = []
    with bar("check", len(group) * len(labels) * len(rows), show=progress) as advance:
        for robot in group:
            for label, stiffness in zip(labels, np.atleast_2d(stiffnesses[robot.name]), strict=True):
                variant = robot.replace(axial_stiffness=stiffness)
                parts = []
                for first in range(0, len(rows), ROWS):
                    part, found = _check_rows(variant, rows[first : first + ROWS], label, threads)
                    parts.append(part)
                    findings += found
                    advance(len(rows[first : first + ROWS]))
                columns.append({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    dims = ("robot", "material", *axes)
    dataset = xr.Dataset(
        {
            name: (dims, np.array([c[name] for c in columns]).reshape(len(group), len(labels), *shape))
            for name in columns[0]
        },
        coords={
            "robot": [robot.name for robot in group],
            "material": ["own" if label is None else label for label in labels],
            **{name: (name, values, {"units": "m", "long_name": f"commanded {name}"}) for name, values in axes.items()},
            "frame": (("robot", "corner", "axis"), [robot.frame for robot in group], {"units": "m"}),
            "axis": list(axes),
        },
        attrs={"title": "MuJoCo and statics over the workspace of cable-driven parallel robots"},
    )
    for name, (units, meaning) in _MEANINGS.items():
        dataset[name].attrs = {"units": units, "long_name": meaning}
    dataset["outcome"].attrs |= {"flag_values": list(range(len(OUTCOMES))), "flag_meanings": " ".join(OUTCOMES)}
    return Check(dataset, tuple(findings))


_MEANINGS = {
    "outcome": ("1", "what comparing MuJoCo with statics came to"),
    "position_error": ("m", "distance between the platform's origins"),
    "rotation_error": ("rad", "angle between the platforms"),
    "tension_error": ("N", "largest difference in a cable"),
    "static_in_mujoco": ("N", "unbalanced force that MuJoCo finds at the static pose"),
    "settled_in_statics": ("N", "unbalanced force that statics finds at the settled pose"),
}


def _check_rows(
    robot: Robot, positions: np.ndarray, label: str | None, threads: int
) -> tuple[dict[str, np.ndarray], list[Finding]]:
    """The columns of ``_MEANINGS`` at each of the positions, and what is to be reported."""
    values = {name: np.full(len(positions), np.nan) for name in _MEANINGS if name != "outcome"}
    outcome = np.full(len(positions), REFUSED, dtype=np.int8)
    problems, asked = [], []
    for row, position in enumerate(positions):
        try:
            problems.append(Problem.of(robot, position))
            asked.append(row)
        except InvalidInput:
            continue
    findings: list[Finding] = []
    if problems:
        settled = settling.settle_problems(problems, threads=threads)
        solved = solve_many(robot, positions[asked], rest_lengths=[problem.rest_lengths for problem in problems])
        columns, agree = compare_many(problems, solved, settled, threads=threads)
        for name, column in columns.items():
            values[name][asked] = column
        outcome[asked] = OUTCOMES.index(Verdict.AGREE.name.lower())
        for i in np.flatnonzero(~agree):
            name, reasons = _outcome(problems[i], solved, settled, int(i))
            outcome[asked[i]] = OUTCOMES.index(name)
            if outcome[asked[i]] not in AGREEING:
                x, y, z = (float(value) for value in positions[asked[i]])
                findings.append(Finding(robot.name, label, (x, y, z), name, reasons))
    return {"outcome": outcome, **values}, findings


def compare_many(
    problems: Sequence[Problem], solved: Solutions, settled: settling.Settlings, *, threads: int = 0
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The errors and cross residuals of ``Agreement``, (rows,) each, and in which rows all is within tolerance.

    Args:
        problems: of one and the same robot object.
        solved: their static equilibria, row by row.
        settled: the same from MuJoCo.
        threads: for MuJoCo; 0 for one per processor.
    """
    load = np.array([problem.load for problem in problems])
    rest_lengths = np.array([problem.rest_lengths for problem in problems])
    # One problem with a stack of rest lengths: statics broadcasts.
    stack = dataclasses.replace(problems[0], rest_lengths=rest_lengths)
    at_rest = solved.converged & settled.settled
    poses = _poses(solved, at_rest, problems)
    columns = {
        "position_error": np.linalg.norm(poses.translation - settled.poses.translation, axis=-1),
        "rotation_error": (poses.rotation * settled.poses.rotation.inv()).magnitude(),
        "tension_error": np.abs(solved.tensions - settled.tensions).max(-1),
        "static_in_mujoco": settling.residuals_of(problems, poses, threads=threads),
        "settled_in_statics": np.asarray(
            statics.residual(stack, settled.poses.translation, settled.poses.rotation.as_matrix())
        ),
    }
    near = [
        np.abs(lengths - rest_lengths) <= agreement.REST_LENGTH_TOLERANCE
        for lengths in (solved.lengths, settled.lengths)
    ]
    same_slack = ~(((solved.tensions <= 0) != (settled.tensions <= 0)) & ~near[0] & ~near[1]).any(-1)
    tolerances = {
        "position_error": agreement.POSITION_TOLERANCE,
        "rotation_error": agreement.ROTATION_TOLERANCE,
        "tension_error": agreement.TENSION_TOLERANCE,
        "static_in_mujoco": agreement.CROSS_TOLERANCE * load,
        "settled_in_statics": agreement.CROSS_TOLERANCE * load,
    }
    within = np.all([columns[name] <= tolerance for name, tolerance in tolerances.items()], axis=0)
    for column in columns.values():
        column[~at_rest] = np.nan
    return columns, within & same_slack & at_rest


def _poses(solved: Solutions, known: np.ndarray, problems: Sequence[Problem]) -> RigidTransform:
    """The solved poses; the commanded ones where there is none, so that the rest can be compared in one go."""
    positions = np.array([problem.pose.translation for problem in problems])
    matrices = np.array([problem.pose.rotation.as_matrix() for problem in problems])
    positions[known], matrices[known] = solved.positions[known], solved.rotations[known]
    return RigidTransform.from_components(positions, Rotation.from_matrix(matrices))


def _outcome(problem: Problem, solved: Solutions, settled: settling.Settlings, row: int) -> tuple[str, tuple[str, ...]]:
    """In words, what is not plain agreement."""
    if not solved.converged[row]:
        return "unsolved", (Status(int(solved.status[row])).sentence,)
    if not settled.settled[row]:
        return "unsettled", (settled.outcomes[row].value,)
    result = agreement.compare(_static_equilibrium(problem, solved, row), settled.equilibrium(row))
    return result.verdict.name.lower(), result.reasons


def _static_equilibrium(problem: Problem, solved: Solutions, row: int) -> Equilibrium:
    pose = RigidTransform.from_components(solved.positions[row], Rotation.from_matrix(solved.rotations[row]))
    return statics.equilibrium_at(problem, pose, iterations=int(solved.iterations[row]), source="newton")
