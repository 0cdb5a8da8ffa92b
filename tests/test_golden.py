"""The proved equilibria of the problem set are golden values: of the oracle of the tests, and of the solver."""

import json

import numpy as np
import oracle
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.crosscheck import problem_set

UNBALANCED = 5e-15
"""Of EA: what rounding of lengths leaves unbalanced; measured 2.0e-15, and 8e-16 of the tensions."""

AGREE, STRAIN = 1e-9, 1e-10
"""[m] and of EA: where the solver stops, at a billionth of the load; measured 4.6e-10 m and 9.6e-12 of EA."""

PROBLEMS = [
    one for file in sorted(problem_set.PROBLEMS.glob("*.json")) for one in json.loads(file.read_text())["problems"]
]


def proved(one):
    """(position, rotation, tensions, slack, number of unstable directions) of each equilibrium."""
    for each in one["equilibria"]:
        numbers = [np.array(each[name], float) for name in ("position", "rotation_matrix", "tensions")]
        yield *numbers, each["slack"], each["unstable_directions"]


def test_the_oracle_balances_every_proved_equilibrium() -> None:
    """All 418 of 300 problems, with their tensions and slack cables, from what the files state alone."""
    for one in PROBLEMS:
        robot = cdpr.Robot(**one["robot"])
        rig = oracle.Rig.of(robot)
        ropes = oracle.Ropes(rig, np.array(one["rest_lengths"]))
        for position, rotation, tensions, slack, _ in proved(one):
            found = oracle.balance(rig, position, rotation, ropes, np.array(one["external_wrench"]))
            unbalanced = (found.wrench / np.repeat([1.0, rig.size], 3))[list(rig.free)]
            assert np.abs(unbalanced).max() < UNBALANCED * rig.axial_stiffness.max(), one["name"]
            assert np.abs(found.tensions - tensions).max() < UNBALANCED * rig.axial_stiffness.max(), one["name"]
            assert found.slack.tolist() == slack, one["name"]


def test_the_solver_finds_every_proved_stable_equilibrium() -> None:
    """From a pose beside it; pose and tensions to the digits that rounding of the forces allows."""
    for one in PROBLEMS:
        robot = cdpr.Robot(**one["robot"])
        for position, rotation, tensions, slack, unstable in proved(one):
            if unstable:
                continue
            start = RigidTransform.from_components(
                position + np.array([1e-7, 0, -1e-7]), Rotation.from_matrix(rotation)
            )
            found = cdpr.solve(robot, start, one["rest_lengths"], external_wrench=one["external_wrench"])
            assert np.abs(found.position - position).max() < AGREE, one["name"]
            assert np.abs(found.tensions - tensions).max() < STRAIN * robot.axial_stiffness.max(), one["name"]
            assert found.slack.tolist() == slack, one["name"]
