"""Comparison over a whole workspace: every pose of a grid settled in MuJoCo and compared with the static solver.

The criteria are those of ``compare``, applied to thousands of rows at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int8
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.analysis.workspace import grids
from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.analysis.workspace.sweep import as_robots, on_materials
from cdpr_sim.core import extras, free_ram
from cdpr_sim.core.checks import FLAG, MOST_THREADS, checked_array, one_of, refuse_unless, whole
from cdpr_sim.core.describe import cables_name
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problems, refuse_wrench_out_of_plane
from cdpr_sim.core.progress import bar
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.core.sweep_quantities import Quantity
from cdpr_sim.crosscheck.compare import Comparison, Verdict, compare_many, has_memory
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.physics.settle_path import settle_path
from cdpr_sim.proof import certificate as proof
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.statics.solve_path import solve_path

if TYPE_CHECKING:
    import xarray as xr

ROWS = 2500
"""Poses settled in one batch: enough for all cores, few enough for a progress bar that advances."""

BYTES_PER_POSITION, BYTES_PER_POSE = 150, 150
"""Memory per grid position, and per pose of each robot with each material."""

OUTCOMES = ("refused", *(verdict.name.lower() for verdict in Verdict), "unsettled", "unsolved")
"""Outcomes at a pose, from best to worst: refused by both methods, since every exit is below the platform; a verdict of
``compare``; MuJoCo's platform did not settle; the static solver found no equilibrium."""

AGREEING = {OUTCOMES.index(verdict.name.lower()) for verdict in (Verdict.AGREE, Verdict.AGREE_EXCEPT_NEUTRAL)}
REFUSED = OUTCOMES.index("refused")


@dataclass(frozen=True)
class Disagreement:
    """A pose at which the two methods do not agree.

    Attributes:
        robot: name of the robot.
        material: name of its cables.
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
    """Comparison of the two methods over a whole workspace.

    Attributes:
        dataset: over (robot, material, x, y, z), or (robot, x, y, z) with each robot's own cables; of single poses,
            ``pose`` instead of x, y and z: the ``outcome`` as
            a CF flag, the errors and the cross residuals of ``Agreement``; with ``certify``, whether both equilibria
            are ``proved``.
        disagreements: every pose at which the methods do not agree.
    """

    dataset: xr.Dataset
    disagreements: tuple[Disagreement, ...]

    @property
    def agrees(self) -> bool:
        """Whether MuJoCo settled at every pose and the two methods agree there."""
        return not self.disagreements

    def across(self, axis: str = "y") -> xr.Dataset:
        """Worst outcome, and largest error of agreeing poses, along ``axis``: a plane that can be drawn as a map.

        Returns:
            The dataset without ``axis``.
        """
        one_of("axis", axis, grids.AXES)
        if "pose" in self.dataset.dims:
            raise InvalidInput("axis: found a check of single poses, expected one of a grid")
        agree = self.dataset["outcome"] == OUTCOMES.index("agree")
        worst = self.dataset[COMPARED].where(agree).assign(outcome=self.dataset["outcome"]).max(axis, keep_attrs=True)
        middle = self.dataset[axis].mean(keep_attrs=True)
        worst = worst.expand_dims({axis: [float(middle)]}).assign_coords(frame=self.dataset["frame"])
        worst[axis].attrs = {"units": "m", "section": f"the worst along {axis}"}
        return worst

    def __repr__(self) -> str:
        poses = self.dataset["outcome"].size
        robots = ", ".join(repr(str(name)) for name in np.atleast_1d(self.dataset["robot"].values))
        result = "no disagreement" if self.agrees else f"{len(self.disagreements):,} poses do not agree"
        return f"<Check of {robots}: {poses:,} poses, {result}>"


def check(
    robots: str | Robot | Sequence[str | Robot],
    grid: GridLike | None = None,
    materials: Sequence[str] | Mapping[str, float] | None = None,
    *,
    poses: RigidTransform | Sequence[PoseLike] | np.ndarray | None = None,
    orientation: ArrayLike | Sequence[float] = (0.0, 0.0, 0.0),
    external_wrench: ArrayLike | Sequence[float] | None = None,
    threads: int = 0,
    certify: bool = False,
    progress: bool = False,
) -> Check:
    """Settle every pose of a grid in MuJoCo and compare each with the solver.

    Args:
        robots: one robot or several, as objects, catalogue names or .toml files.
        grid: counts (nx, ny, nz) over the workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m]; default: 10⁴.
        materials: names of the catalogue, or {name: EA [N]}; default: each robot's own.
        poses: commanded poses, instead of a grid: (rows, 3), (rows, 6), a stack of transforms or a list of poses. For
            cables with a memory they are a path, which both methods follow in this order.
        orientation: on a grid, commanded, (alpha, beta, gamma) [rad]; default: level.
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity, (6,).
        threads: for MuJoCo; 0 for one per processor.
        certify: prove both methods' equilibria (extra ``proof``), in about 0.03 s a pose.
        progress: show a progress bar on standard error.

    Returns:
        Outcome and errors at every pose, and each pose at which the two methods do not agree.

    Raises:
        InvalidInput: an invalid grid, pose or wrench, or invalid names.
        UnknownName: no such robot or material.
        MissingExtra: a library of the extra ``sweep``, or of ``proof`` if ``certify``, is not installed.
    """
    extras.require("sweep", "check")
    refuse_unless(FLAG, certify=certify, progress=progress)
    if certify:
        extras.require("proof", "check with certify")
    import xarray as xr

    whole("threads", threads, 0, MOST_THREADS)
    group = as_robots(robots)
    turn = checked_array("orientation", orientation, (3,))
    wrench = np.zeros(6) if external_wrench is None else checked_array("external_wrench", external_wrench, (6,))
    for robot in group:
        if certify:
            robot.cabling.refuse_memory()
        refuse_wrench_out_of_plane(robot, wrench)
        robot.pose(np.r_[robot.home, turn])
    stack = None if poses is None else grids.as_poses(poses, group[0], grid, turn)
    axes = grids.as_grid(grid, group) if stack is None else {"pose": np.arange(len(stack))}
    shape = tuple(len(values) for values in axes.values())
    size = math.prod(shape)
    variants = on_materials(group, materials)
    labels = [None] if materials is None else list(materials)
    free_ram.refuse_beyond(
        f"grid: a check of {len(group) * len(labels) * size:,.0f} poses",
        size * (BYTES_PER_POSITION + BYTES_PER_POSE * len(group) * len(labels)),
        "fewer poses",
    )
    if stack is None:
        rows = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1).reshape(-1, 3)
        matrices = np.broadcast_to(Rotation.from_euler("xyz", turn).as_matrix(), (len(rows), 3, 3))
        places = {name: (name, values) for name, values in axes.items()}
    else:
        rows, matrices = stack.translation, stack.rotation.as_matrix()
        places = {name: ("pose", column) for name, column in zip(grids.AXES, rows.T, strict=True)}
    parts: list[dict[str, np.ndarray]] = []
    disagreements: list[Disagreement] = []
    with bar("check", len(group) * len(labels) * len(rows), show=progress) as advance:
        for robot in group:
            for label, variant in zip(labels, variants[robot.name], strict=True):
                path = stack is not None and has_memory(variant)  # one after another
                together = len(rows) if path else ROWS
                for first in range(0, len(rows), together):
                    part = slice(first, first + together)
                    problems = Problems.of(variant, rows[part], None, wrench, rotations=matrices[part])
                    values, found = _check_rows(problems, label or cables_name(robot), threads, certify, path)
                    parts.append(values)
                    disagreements += found
                    advance(len(problems))
    if materials is None:
        sizes, names = {"robot": len(group)}, ("robot", [cables_name(robot) for robot in group])
    else:
        sizes, names = {"robot": len(group), "material": len(labels)}, ("material", labels)
    dataset = xr.Dataset(
        {
            name: ((*sizes, *axes), np.concatenate([part[name] for part in parts]).reshape(*sizes.values(), *shape))
            for name in parts[0]
        },
        coords={
            "robot": [robot.name for robot in group],
            "material": names,
            **{name: (*place, {"units": "m", "long_name": f"commanded {name}"}) for name, place in places.items()},
            "frame": (("robot", "corner", "axis"), [robot.frame for robot in group], {"units": "m"}),
            "axis": list(grids.AXES),
        },
        attrs={"title": "MuJoCo and statics over the workspace of cable-driven parallel robots"},
    )
    for name in dataset.data_vars:
        dataset[name].attrs = QUANTITIES[str(name)].attrs
    return Check(dataset, tuple(disagreements))


QUANTITIES = {
    "outcome": Quantity(
        (), np.int8, "1", "outcome of the comparison of MuJoCo with statics", dict(enumerate(OUTCOMES))
    ),
    "position_error": Quantity((), float, "m", "distance between the platform's origins"),
    "rotation_error": Quantity((), float, "rad", "angle between the platforms"),
    "tension_error": Quantity((), float, "N", "largest difference in a cable"),
    "static_in_mujoco": Quantity((), float, "N", "residual of MuJoCo at the static pose"),
    "settled_in_statics": Quantity((), float, "N", "residual of statics at the settled pose"),
    "proved": Quantity((), bool, "1", "whether the equilibria of both methods are proved"),
}  # fmt: skip
COMPARED = [name for name in QUANTITIES if name not in ("outcome", "proved")]


def _check_rows(
    problems: Problems, material: str, threads: int, certify: bool, path: bool
) -> tuple[dict[str, np.ndarray], list[Disagreement]]:
    """The columns of ``QUANTITIES`` of each problem, and the disagreements."""
    solved, settled = both(problems, threads=threads, path=path)
    comparison = compare_many(solved, settled, threads=threads)
    values = {"outcome": outcomes_of(comparison), **comparison.errors}
    disagreements = []
    for row in np.flatnonzero(~np.isin(values["outcome"], [*AGREEING, REFUSED])).tolist():
        if comparison.verdicts[row]:
            reasons = comparison.agreement(row).reasons
        else:
            status = (settled if solved.converged[row] else solved).status[row]
            reasons = (Status(int(status)).sentence,)
        position, outcome = tuple(problems.positions[row].tolist()), OUTCOMES[values["outcome"][row]]
        disagreements.append(Disagreement(problems.robot.name, material, position, outcome, reasons))
    if certify:
        values["proved"] = np.array(
            [
                bool(converged) and all(proof.certify(equilibria[row]).proved for equilibria in (solved, settled))
                for row, converged in enumerate(solved.converged & settled.converged)
            ]
        )
    return values, disagreements


def outcomes_of(comparison: Comparison) -> Int8[np.ndarray, " rows"]:
    """Index into ``OUTCOMES`` of each row."""
    names = [
        verdict.name.lower() if verdict else "unsettled" if known else "unsolved"
        for verdict, known in zip(comparison.verdicts, comparison.solved.converged, strict=True)
    ]
    refused = comparison.solved.problems.refusals != Status.PENDING
    return np.where(refused, REFUSED, [OUTCOMES.index(name) for name in names]).astype(np.int8)


def both(problems: Problems, *, threads: int = 0, path: bool = False) -> tuple[EquilibriumBatch, EquilibriumBatch]:
    """(rows,) problems by statics and by MuJoCo; with ``path``, each with the memory of the cables from those before.

    Args:
        problems: the problems.
        threads: for MuJoCo; 0 for one per processor.
        path: whether they are a path.
    """
    if path:
        return solve_path(problems), settle_path(problems, threads=threads)
    return solve_many(problems), settle_many(problems, threads=threads)
