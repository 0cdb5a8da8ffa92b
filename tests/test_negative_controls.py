"""The cross-check notices what is wrong: MuJoCo with one property, or one part of its model, that is 1 % off.

One row for each property, and for each kind of fault of a model. For all other answers, 1 % of each property is in
``test_matrix.py``, judged by the oracle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from test_settle_path import CRANE, HEAVY, LAW, MEMORY, apart, there_and_back

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import CROSS_TOLERANCE, Verdict
from cdpr_sim.physics.settle import residual_of

SEEN = 1e-8
"""[m] Least effect of one percent of a property of a memory: ten times what the methods may differ by."""

STRAIN = 1e-3
"""By which the cables of fully constrained robots are shortened."""

WHEELS = {"pulley_radius": 0.01, "pulley_axis": (0.3, -0.2, -0.93)}
DEMO = {"axial_stiffness": 1e3, "stiffening": (8.0, -20.0), "winch_to_exit": 0.6, "reeving": 2} | WHEELS
STEEL = {"linear_density": 0.064, "pulley_radius": 0.1, "winch_to_exit": 6.0, "reeving": 2} | LAW

ROBOTS = {
    "plain": ("cogiro", {}, 0.0),
    "slack": ("parallel", {}, 0.0),
    "massless": ("cogiro", DEMO, 0.0),
    "with mass": ("cogiro-crane", STEEL, 0.0),
    "tight": ("ipanema-2", {}, STRAIN),
    "large": ("fast-like", {}, STRAIN),
    "under-actuated": ("irma4u", {}, 0.0),
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


def first(values: np.ndarray) -> np.ndarray:
    """1 % more of the first cable's."""
    more = np.array(values, float)
    more[0] *= 1.01
    return more


def more(values: np.ndarray) -> np.ndarray:
    return 1.01 * np.asarray(values)


def aside(values: np.ndarray) -> np.ndarray:
    """1 mm beside, the first of them."""
    other = np.array(values, float)
    other.reshape(-1, 3)[0] += [1e-3, 0, 0]
    return other


def tilted(axes: np.ndarray) -> np.ndarray:
    return axes + np.array([0.01, 0, 0])


PROPERTIES: dict[str, tuple[Callable, tuple[str, ...]]] = {
    "axial_stiffness": (first, ("plain", "with mass", "tight", "large", "under-actuated", "no weight")),
    "stiffening": (more, ("massless", "with mass")),
    "linear_density": (more, ("with mass",)),
    "pulley_radius": (more, ("massless", "with mass")),
    "pulley_axis": (tilted, ("massless",)),
    "winch_to_exit": (more, ("massless", "with mass")),
    "reeving": (lambda parts: parts + 1, ("massless", "with mass")),
    "exits": (aside, ("plain", "massless", "with mass")),
    "anchors": (aside, ("plain", "massless", "with mass")),
    "mass": (more, ("plain", "massless", "with mass")),
    "center_of_mass": (aside, ("plain", "under-actuated")),
    "gravity": (more, ("plain", "with mass")),
}
"""How each property of a robot is wrong, and on which robots."""


@pytest.mark.parametrize(("name", "which"), [(name, which) for name, (_, some) in PROPERTIES.items() for which in some])
def test_one_percent_of_a_property_is_noticed(name, which):
    """With MuJoCo's own robot wrong, the methods do not agree; with the same robot, they do."""
    problem = problem_of(which)
    solved, robot = cdpr.solve(problem), problem.robot
    assert cdpr.compare(solved, cdpr.settle(problem)).verdict is Verdict.AGREE
    wrong = robot.replace(**{name: PROPERTIES[name][0](getattr(robot, name))})
    settled = cdpr.settle(wrong, problem.pose, problem.rest_lengths, external_wrench=problem.external_wrench)
    assert not cdpr.compare(solved, dataclasses.replace(settled, problem=problem)).agrees


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


def stiffer(model: mujoco.MjModel) -> None:
    """One tendon."""
    model.tendon_stiffness[0] *= 1.01


def stiffening(model: mujoco.MjModel) -> None:
    """The law's coefficient."""
    model.tendon_stiffnesspoly[:, 0] *= 1.01


def longer(model: mujoco.MjModel) -> None:
    """A spring, by a ten-thousandth."""
    model.tendon_lengthspring[0, 1] *= 1.0001


def pushing(model: mujoco.MjModel) -> None:
    """Springs of slack cables, which push as well."""
    model.tendon_lengthspring[:, 0] = model.tendon_lengthspring[:, 1]


def lower_anchor(model: mujoco.MjModel) -> None:
    """By 1 mm."""
    model.site("anchor_1").pos[2] -= 1e-3


def moved_exit(model: mujoco.MjModel) -> None:
    """By 1 mm."""
    model.site("exit_1").pos[0] += 1e-3


def leaning(model: mujoco.MjModel) -> None:
    """Gravity, by 0.1° towards x."""
    down, angle = model.opt.gravity[2], np.radians(0.1)
    model.opt.gravity[:] = [-down * np.sin(angle), 0, down * np.cos(angle)]


def heavier(model: mujoco.MjModel) -> None:
    """The platform."""
    model.body("platform").mass *= 1.01


def off_centre(model: mujoco.MjModel) -> None:
    """The platform's centre of mass, by 1 mm."""
    model.body("platform").ipos[0] += 1e-3


def larger_wheels(model: mujoco.MjModel) -> None:
    """Wheels, and where the tendons leave them."""
    for i in range(1, 9):
        model.geom(f"groove_{i}").pos *= 1.01
        model.geom(f"groove_{i}").size *= 1.01


def heavier_cables(model: mujoco.MjModel) -> None:
    """All nodes of the chains."""
    for body in range(model.nbody):
        if model.body(body).name.startswith(("node_", "end_")):
            model.body(body).mass *= 1.01


def unbroken(model: mujoco.MjModel) -> None:
    """Nothing is wrong."""


FAULTS: dict[Callable[[mujoco.MjModel], None], tuple[str, ...]] = {
    stiffer: ("plain", "slack", "tight", "no weight"),
    stiffening: ("massless",),
    longer: ("plain", "massless", "tight"),
    pushing: ("slack",),
    lower_anchor: ("plain", "slack", "tight"),
    moved_exit: ("plain", "tight"),
    leaning: ("plain", "slack", "with mass"),
    heavier: ("plain", "with mass"),
    off_centre: ("plain",),
    larger_wheels: ("massless", "with mass"),
    heavier_cables: ("with mass",),
}
"""On which robots each fault of the compiled model is tried."""


def model_of(problem: cdpr.Problem) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(cdpr.to_mjcf(problem))


@pytest.mark.parametrize(("fault", "which"), [(fault, which) for fault, some in FAULTS.items() for which in some])
def test_a_broken_model_is_noticed(fault, which):
    """The platform settles where statics is out of balance, and where statics rests, the model is out of balance."""
    problem, model = problem_of(which), model_of(problem_of(which))
    solved = cdpr.solve(problem)
    fault(model)
    found = cdpr.compare(solved, cdpr.settle(problem, model=model))
    assert found.verdict is Verdict.DISAGREE
    assert found.settled_in_statics > 3 * CROSS_TOLERANCE * problem.force_scale
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


# --- memory --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "given", "wrong"),
    [
        ("cogiro", MEMORY, dict(pulley_friction=1.01 * 0.05)),
        ("cogiro", MEMORY, dict(hysteresis=[(0.1, 1.01 * 5e-5), (0.1, np.inf, 0.3)])),
        ("cogiro", MEMORY, dict(hysteresis=[(0.1, 5e-5), (0.1, np.inf, 1.01 * 0.3)])),
        ("cogiro", MEMORY, dict(hysteresis=[(1.01 * 0.1, 5e-5), (0.1, np.inf, 0.3)])),
        ("cogiro", MEMORY, dict(creep=[(1.01 * 4e4, 600.0), (2e4, 60.0)])),
        ("cogiro", MEMORY, dict(creep=[(4e4, 600.0), (2e4, 1.01 * 60.0)])),
        ("cogiro-crane", HEAVY, dict(pulley_friction=1.01 * 0.05)),
        ("cogiro-crane", HEAVY, dict(hysteresis=[CRANE["hysteresis"][0], (0.1, np.inf, 1.01 * 0.3)])),
        ("cogiro-crane", HEAVY, dict(creep=[(1.01 * 4e6, 60.0)])),
        ("cogiro-crane", HEAVY | LAW | dict(hysteresis=()), dict(stiffening=(101.0, 2e4))),
        ("cogiro-crane", dict(linear_density=0.064), dict(linear_density=1.01 * 0.064)),
    ],
    ids=["friction", "yield strain", "width", "share", "EA of creep", "time of creep",
         "friction, mass", "width, mass", "EA of creep, mass", "law, mass", "mass alone"],
)  # fmt: skip
def test_one_percent_of_a_memory_is_noticed_on_a_path(name, given, wrong):
    """MuJoCo with something that is 1 % wrong, with and without mass, is elsewhere at the end of a path."""
    robot = cdpr.load_robot(name).replace(**given)
    path, times = there_and_back(robot, every=2)[2:7:2], 20.0 * np.arange(3)
    settled = cdpr.settle_path(robot.replace(**wrong), path, times=times)
    assert apart(cdpr.solve_path(robot, path, times=times), settled) > SEEN
