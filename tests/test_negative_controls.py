"""The cross-check notices what is wrong: parts of MuJoCo's model that are 1 % off, one row for each kind of fault.

1 % of each property of a robot, in each answer, is in ``test_matrix.py``, judged by the oracle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from test_settle_path import LAW

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import CROSS_TOLERANCE, Verdict
from cdpr_sim.physics.settle import residual_of

STRAIN = 1e-3
"""By which the cables of fully constrained robots are shortened."""

WHEELS = {"pulley_radius": 0.01, "pulley_axis": (0.3, -0.2, -0.93)}
DEMO = {"axial_stiffness": 100.0, "stiffening": (8.0, -20.0), "winch_to_exit": 0.6, "reeving": 2} | WHEELS
STEEL = {"linear_density": 0.064, "pulley_radius": 0.1, "winch_to_exit": 6.0, "reeving": 2} | LAW

ROBOTS = {
    "plain": ("cogiro", {}, 0.0),
    "slack": ("parallel", {}, 0.0),
    "massless": ("cogiro", DEMO, 0.0),
    "with mass": ("cogiro-crane", STEEL, 0.0),
    "tight": ("ipanema-2", {}, STRAIN),
    "no weight": ("ipanema-1", {"gravity": 0}, STRAIN),
}
"""Name in the catalogue, changes, and by how much the cables are shortened."""


def problem_of(which: str) -> cdpr.Problem:
    name, changes, strain = ROBOTS[which]
    robot = cdpr.load_robot(name).replace(**changes)
    aside = 0.1 * np.ptp(robot.workspace, axis=0)
    pose = (0.17, 0.25, 0.1) if name == "parallel" else robot.home + aside * [1, robot.mobility == "spatial", -1]
    wrench = 0.05 * robot.weight * np.array([1, 0, 0, 0, 0, 0])
    return cdpr.Problem.of(robot, pose, (1 - strain) * robot.rest_lengths(pose), wrench)


def test_a_rope_of_several_parts_that_is_that_many_times_too_stiff_is_noticed():
    """n EA for n² EA; and another rest length, and another force on the platform."""
    problem = problem_of("massless")
    robot, rest, wrench = problem.robot, problem.rest_lengths, problem.external_wrench
    for wrong in (
        cdpr.Problem.of(robot.replace(axial_stiffness=robot.axial_stiffness / 2), problem.pose, rest, wrench),
        cdpr.Problem.of(robot, problem.pose, rest * np.where(np.arange(8) == 0, 1.0001, 1), wrench),
        cdpr.Problem.of(robot, problem.pose, rest, 1.01 * wrench),
    ):
        settled = dataclasses.replace(cdpr.settle(wrong), problem=problem)
        assert not cdpr.compare(cdpr.solve(problem), settled).agrees


# --- faults of a model ---------------------------------------------------------------------------------------------


def of(model: mujoco.MjModel, kind: str, *names: str) -> np.ndarray:
    """1 for each geom or body whose name begins so."""
    count = getattr(model, f"n{kind}")
    return np.array([float(getattr(model, kind)(i).name.startswith(names)) for i in range(count)])


FAULTS: dict[str, tuple[Callable[[mujoco.MjModel], list], tuple[str, ...]]] = {
    "a tendon stiffer": (lambda m: [(m.tendon_stiffness[:1], m.tendon_stiffness[0] / 100)],
        ("plain", "slack", "tight", "no weight")),
    "a law": (lambda m: [(m.tendon_stiffnesspoly[:, 0], m.tendon_stiffnesspoly[:, 0] / 100)], ("massless",)),
    "a spring longer by 1e-4": (lambda m: [(m.tendon_lengthspring[:1, 1], m.tendon_lengthspring[0, 1] * 1e-4)],
        ("plain", "massless", "tight")),
    "slack cables that push": (lambda m: [(m.tendon_lengthspring[:, 0], m.tendon_lengthspring[:, 1])], ("slack",)),
    "an anchor 1 mm lower": (lambda m: [(m.site("anchor_1").pos, [0, 0, -1e-3])], ("plain", "slack", "tight")),
    "an exit 1 mm aside": (lambda m: [(m.site("exit_1").pos, [1e-3, 0, 0])], ("plain", "tight")),
    "gravity leaning by 0.1°": (lambda m: [(m.opt.gravity, [0.017, 0, 1.5e-5])], ("plain", "slack", "with mass")),
    "the platform heavier": (lambda m: [(m.body("platform").mass, m.body("platform").mass / 100)],
        ("plain", "with mass")),
    "the centre of mass 1 mm aside": (lambda m: [(m.body("platform").ipos, [1e-3, 0, 0])], ("plain",)),
    "wheels larger": (lambda m: [
        (values, values * of(m, "geom", "groove_")[:, None] / 100) for values in (m.geom_pos, m.geom_size)
        ], ("massless", "with mass")),
    "cables heavier": (lambda m: [(m.body_mass, m.body_mass * of(m, "body", "node_", "end_") / 100)], ("with mass",)),
}  # fmt: skip
"""What is added to which numbers of the compiled model, 1 % or as said; and on which robots."""


def model_of(problem: cdpr.Problem) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(cdpr.to_mjcf(problem))


@pytest.mark.parametrize(("fault", "which"), [(fault, which) for fault, (_, some) in FAULTS.items() for which in some])
def test_a_broken_model_is_noticed(fault, which):
    """The platform settles where statics is out of balance, and where statics rests, the model is out of balance."""
    problem, model = problem_of(which), model_of(problem_of(which))
    solved = cdpr.solve(problem)
    for values, added in FAULTS[fault][0](model):
        values += added
    found = cdpr.compare(solved, cdpr.settle(problem, model=model))
    assert found.verdict is Verdict.DISAGREE
    assert found.settled_in_statics > 10 * CROSS_TOLERANCE * problem.force_scale
    assert residual_of(problem, solved.pose, model=model) > CROSS_TOLERANCE * problem.force_scale


def test_a_wheel_that_is_turned_is_out_of_balance():
    """With its groove 0.1 mm beside the plane of its swivel, it never rests."""
    problem, model = problem_of("massless"), model_of(problem_of("massless"))
    model.geom("groove_3").pos[1] += 1e-4
    assert residual_of(problem, cdpr.solve(problem).pose, model=model) > CROSS_TOLERANCE * problem.force_scale
    with pytest.raises(cdpr.NotSettled):
        cdpr.settle(problem, model=model)


@pytest.mark.parametrize("which", ROBOTS)
def test_an_unbroken_model_agrees(which):
    """The controls' own control: written, compiled and settled, and in balance where statics rests."""
    problem = problem_of(which)
    solved = cdpr.solve(problem)
    assert cdpr.compare(solved, cdpr.settle(problem, model=model_of(problem))).verdict is Verdict.AGREE
    assert residual_of(problem, solved.pose, model=model_of(problem)) < 1e-7 * problem.force_scale
