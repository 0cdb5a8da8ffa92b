"""Problems with proved equilibria, as files that any solver in any language can read.

A file states each problem completely, so that the set stays the same when a robot of the catalogue is corrected; the
solutions follow from the file alone. ``scripts/dev/generate_problems.py`` draws and proves problems.

They serve static equilibrium as NIST's Statistical Reference Datasets serve regression: a robot, rest lengths,
a load and three starting poses, with every proved digit of the pose and the tensions, the slack cables, the index,
and, where it is proved, the list of all equilibria.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import readable, refuse_irregular
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot

LEVELS = ("lower", "average", "higher")
"""All cables stretched; some not; stiff, nearly slack, nearly neutral, or with several equilibria."""

FORMAT = 1
"""Version of the file format."""

PROBLEMS = Path(__file__).parent / "problems"
"""The package's own set."""


@dataclass(frozen=True, eq=False)
class SetProblem:
    """One problem of the set.

    Attributes:
        name: key of its answers.
        level: of ``LEVELS``.
        problem: robot, rest lengths and load; its pose is the first start.
        starts: poses to start from, (3,).
        positions: of the proved equilibria, (equilibria, 3) [m].
        rotations: rotation matrices, (equilibria, 3, 3).
        index: number of unstable directions of each.
        complete: whether it is proved that there are no others.
    """

    name: str
    level: str
    problem: Problem
    starts: tuple[RigidTransform, ...]
    positions: np.ndarray
    rotations: np.ndarray
    index: tuple[int, ...]
    complete: bool


def read_problems(folder: Path = PROBLEMS) -> list[SetProblem]:
    """Read all problems of a folder.

    Raises:
        InvalidInput: no such folder, no file of a level in it, or an invalid file.
    """
    problems = []
    for level in LEVELS:
        path = folder / f"{level}.json"
        refuse_irregular(path)
        if not path.exists():
            raise InvalidInput(f"{path}: no such file, expected the folder of the set of problems")
        with readable(path):
            text = path.read_text(encoding="utf-8")
        try:
            content = json.loads(text)
            if content["format"] != FORMAT:
                raise InvalidInput(f"{path}: found format {content['format']!r}, expected {FORMAT}")
            problems += [_read(level, one) for one in content["problems"]]
        except InvalidInput:
            raise
        except (ValueError, KeyError, TypeError):
            raise InvalidInput(f"{path}: found no set of problems, expected a file of the folder problems") from None
    return problems


def _read(level: str, content: dict[str, Any]) -> SetProblem:
    robot = Robot(**content["robot"], name=content["name"])
    starts = tuple(
        RigidTransform.from_components(start["position"], Rotation.from_quat(start["quaternion"]))
        for start in content["starts"]
    )
    equilibria = content["equilibria"]
    return SetProblem(
        name=content["name"],
        level=level,
        problem=Problem.of(robot, starts[0], content["rest_lengths"], content["external_wrench"]),
        starts=starts,
        positions=np.array([[float(v) for v in one["position"]] for one in equilibria]),
        rotations=np.array([[[float(v) for v in row] for row in one["rotation_matrix"]] for one in equilibria]),
        index=tuple(one["unstable_directions"] for one in equilibria),
        complete=content["complete"],
    )
