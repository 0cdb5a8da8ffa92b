"""Rope between winch and exit, and several parts of line: both methods, every answer, and what is refused.

The formulas are written again here: a rope of the tension T, of which n parts lie between exit and platform, and the
length g between winch and exit, has the strain n (l − l0)/(n l0 + g), and pulls with n T.
"""

import dataclasses
import tomllib

import mujoco
import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from test_real_cables import wheel_by_hand

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import (
    capacity_margin,
    closed_form_feasible,
    feasible,
    feasible_by_linprog,
)
from cdpr_sim.core.describe import describe_properties
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.layout_equilibria import Cases, feasible_cases
from cdpr_sim.report.as_json import solution
from cdpr_sim.report.crosscheck_tables import equilibrium_notes
from cdpr_sim.robots.robot_file_text import as_toml

SOFT = 1e3
"""[N] EA with which DemoBot's ropes strain by some per mille, so that laws and lengths show."""

LAW = (8.0, -20.0)

KINDS = {
    "plain": {},
    "pulleys": dict(pulley_radius=0.01),
    "law": dict(stiffening=LAW),
    "pulleys and law": dict(pulley_radius=0.01, stiffening=LAW),
}

AT_REST = 1e-9
"""[m] Between the methods; measured 5e-10 on IPAnema, 5e-11 on DemoBot."""

BALANCED = 1e-8
"""Unbalanced force over the weight; the solvers' own tolerance."""

DIFFERENCED = 1e-6
"""Relative error of central differences over 1e-6 m: rounding of 1e-16/1e-6 times what nearly cancels."""

SOLVED = 2e-5
"""The same through the solver, whose equilibria are 1e-11 m apart."""

POSE = (0.3, 0.25, 0.1)


def mixed(name: str, seed: int = 0, **changes) -> cdpr.Robot:
    """A robot with a drive line of its own on every cable."""
    robot, rng = cdpr.load_robot(name), np.random.default_rng(seed)
    size = float(np.ptp(robot.exits, axis=0).max())
    behind, parts = rng.uniform(0, size, robot.cables), rng.integers(1, 4, robot.cables)
    if size < 3:
        changes = {"axial_stiffness": SOFT} | changes
    return robot.replace(winch_to_exit=behind, reeving=parts, **changes)


def tension_by_hand(robot: cdpr.Robot, cable: int, length: float, rest: float) -> float:
    """Tension of a rope of this length from exit to anchor."""
    n, g = robot.reeving[cable], robot.winch_to_exit[cable]
    strain = max(n * (length - rest), 0.0) / (n * rest + g)
    a2, a3 = robot.stiffening[cable]
    return robot.axial_stiffness[cable] * (strain + a2 * strain**2 + a3 * strain**3)


def unbalanced_by_hand(problem: cdpr.Problem, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Force and torque on the platform [N, N m]."""
    robot = problem.robot
    weight = np.array([0, 0, -robot.mass * robot.gravity])
    force, torque = weight + 0.0, np.cross(rotation @ robot.center_of_mass, weight)
    for cable in range(robot.cables):
        arm = rotation @ robot.anchors[cable]
        if robot.pulley_radius[cable] > 0:
            wheel = robot.exits[cable], robot.pulley_axis[cable], robot.pulley_radius[cable]
            length, direction = wheel_by_hand(*wheel, position + arm)
        else:
            apart = robot.exits[cable] - position - arm
            length = float(np.linalg.norm(apart))
            direction = apart / length
        tension = tension_by_hand(robot, cable, length, problem.rest_lengths[cable])
        pull = robot.reeving[cable] * tension * direction
        force, torque = force + pull, torque + np.cross(arm, pull)
    return np.concatenate([force, torque])[robot.free]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["cogiro", "planar-vertical", "ipanema-1"])
def test_both_methods_agree_and_balance_by_hand(name, kind):
    """Poses, tensions of the ropes and stiffness at 10 poses; and forces by formulas that stand only in this file."""
    robot = mixed(name, **KINDS[kind])
    positions = np.random.default_rng(1).uniform(*robot.workspace, (10, 3))
    solved, settled = cdpr.solve_many(robot, positions), cdpr.settle_many(robot, positions)
    assert solved.converged.all()
    assert settled.converged.all()
    assert np.abs(solved.positions - settled.positions).max() < AT_REST
    assert np.abs(solved.tensions - settled.tensions).max() < 1e-6 * robot.weight
    assert np.abs(solved.eigenvalues - settled.eigenvalues).max() < 1e-6 * np.abs(solved.eigenvalues).max()
    assert (solved.slack == settled.slack).all()
    for row, found in enumerate(solved):
        left = unbalanced_by_hand(found.problem, found.position, found.rotation_matrix)
        assert np.abs(left).max() < BALANCED * robot.weight
        for cable in range(robot.cables):
            by_hand = tension_by_hand(robot, cable, found.lengths[cable], found.rest_lengths[cable])
            assert found.tensions[cable] == pytest.approx(by_hand, abs=1e-9 * robot.weight)
        assert (found.pulls == robot.reeving * found.tensions).all()
        assert (solved.pulls[row] == found.pulls).all()


@pytest.mark.parametrize(
    ("name", "behind", "before", "after"),
    [
        ("cogiro-crane", 6.0, 13.36, 21.61),
        ("caroca", 3.0, 0.785, 1.382),
        ("ipanema-3", 3.0, 0.449, 0.788),
        ("cogiro", 0.5, 0.0717, 0.1493),
    ],
)
def test_rope_behind_the_exits_lowers_real_robots_by_half_or_more(name, behind, before, after):
    """[mm] at home: SciPy's root of the balance by hand, ``solve`` and ``settle`` give the same deviation."""
    robot = cdpr.load_robot(name)
    for length, drop in ((0.0, before), (behind, after)):
        driven = robot.replace(winch_to_exit=length)
        problem = cdpr.Problem.of(driven, driven.home)

        def net(thousandths, problem=problem):
            step = 1e-3 * thousandths
            rotation = Rotation.from_rotvec(step[3:]).as_matrix()
            return unbalanced_by_hand(problem, problem.position + step[:3], rotation) / problem.robot.weight

        near = cdpr.solve(problem)
        start = 1.1e3 * np.append(near.deviation, near.rotation.as_rotvec())  # at 0 all ropes are just slack
        by_hand = root(net, start, tol=1e-13, options={"eps": 1e-8}).x
        assert -by_hand[2] == pytest.approx(drop, rel=1e-3)
        for found in (cdpr.solve(problem), cdpr.settle(problem)):
            assert np.abs(found.deviation - 1e-3 * by_hand[:3]).max() < 1e-8


def test_one_percent_less_rope_in_mujoco_alone_is_noticed():
    """As is another number of parts, or n EA in the place of n² EA: differences far above the agreement."""
    robot = mixed("cogiro").replace(reeving=2)
    solved = cdpr.solve(robot, POSE)
    true = cdpr.settle(robot, POSE)
    for change in (
        {"winch_to_exit": 0.99 * robot.winch_to_exit},
        {"reeving": 3},
        {"axial_stiffness": robot.axial_stiffness / robot.reeving},
    ):
        false = cdpr.settle(robot.replace(**change), POSE)
        assert np.abs(false.position - solved.position).max() > 1e3 * np.abs(true.position - solved.position).max()
        claimed = dataclasses.replace(false, problem=solved.problem)
        assert not cdpr.compare(solved, claimed).agrees


@pytest.mark.parametrize("kind", [*KINDS, "mass", "mass, pulleys and law"])
def test_parts_of_line_are_as_many_ropes_side_by_side(kind):
    """Three parts of EA, w and g are one cable of 3 EA, 3 w and g/3, with a third of its tension."""
    changes = KINDS.get(kind, {})
    if "mass" in kind:
        changes = dict(linear_density=5e-3) | (KINDS["pulleys and law"] if "law" in kind else {})
    robot = cdpr.load_robot("cogiro").replace(axial_stiffness=SOFT, winch_to_exit=0.6, reeving=3, **changes)
    cable = robot.replace(
        axial_stiffness=3 * SOFT, winch_to_exit=0.2, reeving=1, linear_density=3 * robot.linear_density
    )
    for find in (cdpr.solve, cdpr.settle):
        if find is cdpr.settle and "mass" in kind:
            continue
        reeved, single = find(robot, POSE), find(cable, POSE)
        assert np.abs(reeved.position - single.position).max() < AT_REST
        assert reeved.pulls == pytest.approx(single.tensions, abs=1e-6)
        assert np.abs(reeved.eigenvalues - single.eigenvalues).max() < 1e-6 * single.eigenvalues.max()
        # Negative control: without the division by the number of parts.
        assert np.abs(reeved.tensions - single.tensions).max() > 0.1 * single.tensions.max()


@pytest.mark.parametrize("kind", [*KINDS, "mass, pulleys and law"])
def test_a_rope_wound_at_its_exit_is_the_limit(kind):
    """Exactly, to the last bit, at g = 0 and n = 1; and within 1e-8 m per metre where g goes to 0."""
    changes = KINDS.get(kind, KINDS["pulleys and law"] | dict(linear_density=5e-4))
    robot = cdpr.load_robot("cogiro").replace(axial_stiffness=SOFT, **changes)
    plain = cdpr.solve(robot, POSE)
    same = cdpr.solve(robot.replace(winch_to_exit=[0.0] * 8, reeving=[1] * 8), POSE)
    for name in ("position", "rotation_matrix", "tensions", "lengths", "eigenvalues"):
        assert (getattr(plain, name) == getattr(same, name)).all()
    near = cdpr.solve(robot.replace(winch_to_exit=1e-7), POSE)
    assert 0 < np.abs(near.position - plain.position).max() < 1e-7
    assert (plain.pulls == plain.tensions).all()


def test_sensitivity_has_a_column_for_the_rope_behind_each_exit():
    """Pose and tensions against equilibria with a little more rope; massless cables and others, two kinds each."""
    robot = mixed(
        "cogiro", linear_density=[5e-3] * 6 + [0, 0], pulley_radius=[0.01, 0] * 4, stiffening=[LAW] * 4 + [(0, 0)] * 4
    )
    problem = cdpr.Problem.of(robot, POSE, 0.999 * robot.rest_lengths(POSE))
    by = cdpr.sensitivity(problem)
    assert any(effect.name.startswith("winch to exit") for effect in by.effects())
    for cable in range(8):
        ends = []
        for sign in (1, -1):
            behind = robot.winch_to_exit.copy()
            behind[cable] += sign * 1e-4
            changed = cdpr.Problem(robot.replace(winch_to_exit=behind), problem.pose, problem.rest_lengths, np.zeros(6))
            ends.append(cdpr.solve(changed))
        position = (ends[0].position - ends[1].position) / 2e-4
        tensions = (ends[0].tensions - ends[1].tensions) / 2e-4
        scale = np.abs(by.pose["winch_to_exit"][:3]).max()
        assert np.abs(position - by.pose["winch_to_exit"][:3, cable]).max() < 1e-4 * scale + 1e-12
        scale = np.abs(by.tensions["winch_to_exit"]).max()
        assert np.abs(tensions - by.tensions["winch_to_exit"][:, cable]).max() < 1e-4 * scale


def test_rope_behind_the_exits_is_identified_from_poses_in_mujoco():
    """Half a metre on all cables, from a model that knows of none, with a load that changes its share."""
    robot = cdpr.load_robot("cogiro").replace(axial_stiffness=SOFT)
    true = robot.replace(winch_to_exit=0.5)
    positions = np.random.default_rng(0).uniform([0.15, 0.12, 0.05], [0.65, 0.38, 0.3], (6, 3))
    settled = cdpr.settle_many(true, positions)
    measured = cdpr.Measurements.of(positions, np.hstack([settled.positions, settled.euler]))
    fit = cdpr.identify(robot, measured, unknowns=["winch_to_exit"])
    assert fit.robot.winch_to_exit == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("kind", ["plain", "pulleys and law", "mass"])
def test_lengths_for_tensions_give_the_ropes_these_tensions(kind):
    """``compensate`` holds the commanded pose within limits of the ropes' tensions."""
    robot = mixed("ipanema-1", **({"linear_density": 0.01} if kind == "mass" else KINDS[kind]))
    held = cdpr.compensate(robot, robot.home, tension_limits=(50.0, 800.0))
    assert held.exact
    assert held.tensions.min() >= 50 * (1 - 1e-6)
    found = cdpr.solve(robot, robot.home, held.rest_lengths)
    assert np.abs(found.deviation).max() < 1e-6
    assert found.tensions == pytest.approx(held.tensions, abs=1e-3)
    rest = robot.rest_lengths(robot.home, tensions=held.tensions)
    assert rest == pytest.approx(held.rest_lengths, abs=1e-9)
    settled = cdpr.settle(robot, robot.home, rest)
    assert settled.tensions == pytest.approx(held.tensions, abs=1e-3)
    if kind != "mass":
        for cable in range(robot.cables):
            length = settled.lengths[cable]
            assert tension_by_hand(robot, cable, length, rest[cable]) == pytest.approx(held.tensions[cable], abs=1e-2)


def test_a_rope_that_would_be_wound_in_beyond_its_exit_is_refused():
    """The part behind the exit stretches by more than the cable is long."""
    robot = cdpr.load_robot("ipanema-1").replace(axial_stiffness=1e4, winch_to_exit=500.0, force_max=np.inf)
    with pytest.raises(cdpr.InvalidInput, match=r"tensions: found .* N in cable \d, under which the rope between"):
        robot.rest_lengths(robot.home, tensions=700.0)
    with pytest.raises(cdpr.NotConverged, match="found no pose near the commanded one"):
        cdpr.compensate(robot, robot.home, tension_limits=(600.0, 800.0))


def test_force_limits_are_those_of_the_ropes():
    """Feasible by linear programming and by the compiled kernel; the margin is where limits begin to fail."""
    robot = mixed("ipanema-1")
    positions = np.random.default_rng(3).uniform(*robot.frame, (30, 3))
    limits = (20.0, 250.0)
    can = feasible(robot, positions, tension_limits=limits)
    assert 0 < can.sum() < len(can)
    assert [feasible_by_linprog(robot, at, tension_limits=limits) for at in positions] == can.tolist()
    assert (can >= closed_form_feasible(robot, positions, tension_limits=limits)).all()
    single = robot.replace(reeving=1)
    assert (feasible(single, positions, tension_limits=limits) != can).any()
    margins = capacity_margin(robot, positions, tension_limits=limits)
    assert ((margins > 0) == can).all()
    row = int(np.argmax((margins > 1) & (margins < 100)))
    for share, expected in ((0.999, True), (1.001, False)):
        shift = share * margins[row]
        assert feasible(robot, positions[row], tension_limits=(20 + shift, 250 - shift)) == expected
    limits = (np.full(8, 20.0), np.full(8, 250.0))
    share = feasible_cases(RobotBatch.of([robot]), Cases.of(robot, positions), limits).mean(-1)
    assert share[0] == pytest.approx(can.mean())


@pytest.mark.parametrize("kind", ["plain", "pulleys", "law"])
def test_a_model_driven_by_its_winches_comes_to_rest_where_solve_says(kind):
    """Wound to other lengths; its sensors read the pull of all parts."""
    robot = mixed("cogiro", **KINDS[kind])
    target = robot.rest_lengths(robot.home + np.array([-0.05, 0, -0.03]))
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    controls = cdpr.winch_controls(robot, robot.home, target)
    while data.time < 12:
        data.ctrl = controls * min(1, data.time / 2)
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    expected = cdpr.solve(robot, robot.home, target)
    assert np.abs(data.body("platform").xpos - expected.position).max() < 1e-8
    if kind != "law":  # whose sensors read the servo that holds the drum
        read = [data.sensor(f"tension_{i}").data[0] for i in range(1, 9)]
        assert read == pytest.approx(expected.pulls, abs=1e-6)


def test_driving_tracking_and_releasing_take_a_drive_line():
    """A motion ends where the command's equilibrium is; winches that control tensions give the ropes theirs."""
    robot = mixed("cogiro")
    line = [[0.3, 0.25, 0.1], [0.33, 0.25, 0.1]]
    end = cdpr.solve(robot, line[-1])
    driven = cdpr.drive(robot, line, seconds=2.0, states=2)
    assert np.abs(driven.positions[-1] - end.position).max() < 1e-4
    tracked = cdpr.track(robot, line, cdpr.RigidLengths(robot), seconds=1.0)
    assert np.abs(tracked.positions[-1] - end.position).max() < 1e-4
    assert np.abs(tracked.tensions[-1] - end.tensions).max() < 1e-2 * end.tensions.max()
    crossed = mixed("ipanema-1")
    limits = (50.0, 500.0)
    still = cdpr.track(crossed, [crossed.home, crossed.home], cdpr.HeldTensions(crossed, limits), seconds=0.2)
    held = cdpr.compensate(crossed, crossed.home, tension_limits=limits)
    assert np.abs(still.tensions[-1] - held.tensions).max() < 1e-2 * held.tensions.max()
    assert np.abs(still.positions[-1] - held.equilibrium.position).max() < 1e-4
    assert cdpr.release(end, seconds=0.3).stays


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"winch_to_exit": -1.0}, "winch_to_exit: found -1 m in cable 1, expected 0 or more"),
        ({"winch_to_exit": np.nan}, "winch_to_exit: found nan"),
        ({"winch_to_exit": [1.0, 2.0]}, r"winch_to_exit: found an array of shape \(2,\), expected shape \(8,\)"),
        ({"winch_to_exit": 1e9}, "winch_to_exit: found 1e"),
        ({"reeving": 1.5}, "reeving: found 1.5 parts of line in cable 1, expected a whole number from 1 to 100"),
        ({"reeving": [1, 0] + [1] * 6}, "reeving: found 0 parts of line in cable 2, expected a whole number"),
        ({"reeving": 1000}, "reeving: found 1000 parts"),
        ({"reeving": np.nan}, "reeving: found nan"),
        ({"reeving": [1, 2, 3]}, r"reeving: found an array of shape \(3,\), expected shape \(8,\)"),
    ],
)
def test_drive_lines_that_cannot_be_are_refused(change, sentence):
    """In one sentence, with the field and the cable."""
    with pytest.raises(cdpr.InvalidInput, match=sentence):
        cdpr.load_robot("cogiro").replace(**change)


def test_parts_of_line_share_an_implausible_weight(recwarn):
    """A weight that stretches one part by 8 % stretches four by 2 %: only the first is doubted."""
    mass = 0.08 * 8 * 1e3 / 9.81
    fields = cdpr.load_robot("cogiro")._given | {"axial_stiffness": 1e3, "mass": mass, "inertia": None}
    assert any("stretch by" in sentence for sentence in cdpr.Robot(**fields).warnings)
    assert not any("stretch by" in sentence for sentence in cdpr.Robot(**fields | {"reeving": 4}).warnings)


def test_robot_files_and_output_name_the_drive_line(tmp_path):
    """Read in the file's unit; described, in JSON, and in the notes of a table; and not where there is none."""
    robot, path = cdpr.load_robot("cogiro").replace(winch_to_exit=6.0, reeving=2), tmp_path / "robot.toml"
    for other in ({"winch_to_exit": 1.0}, {"reeving": 5}):
        assert not robot.cabling.same_as(robot.replace(**other).cabling)
    assert "reeving" not in tomllib.loads(as_toml(cdpr.load_robot("cogiro")))
    text = as_toml(robot).replace("name =", 'units = "mm"\nname =', 1)
    path.write_text(text, encoding="utf-8")
    assert cdpr.load_robot(path).winch_to_exit[0] == pytest.approx(0.006)
    assert describe_properties(robot)[-2:] == ("6 m from winch to exit", "2 parts of line")
    found = cdpr.solve(robot, POSE)
    document = solution(found)
    assert "winch_to_exit" in str(document)
    assert "pulls" in str(document)
    assert any("2 parts of line pull with" in note for note in equilibrium_notes(found))
    assert "pulls" not in str(solution(cdpr.solve(cdpr.load_robot("cogiro"), POSE)))


def test_sagging_ropes_are_drawn_as_long_as_they_are_beyond_their_exits():
    """Their own stretched length, and what the stretch of the rope behind the exit adds to it."""
    robot = cdpr.load_robot("cogiro").replace(
        axial_stiffness=SOFT, linear_density=5e-4, winch_to_exit=0.6, reeving=2, mass=4.0
    )
    found = cdpr.solve_many(robot, [POSE])
    shapes = cdpr.cable_profiles(found, 400)[0]
    lengths = np.linalg.norm(np.diff(shapes, axis=1), axis=2).sum(1)
    taut = found.tensions[0] > 1.0
    strain = found.tensions[0] / SOFT  # within the weight of half a metre over 2 EA: 1e-6
    expected = found.rest_lengths[0] * (1 + strain) + 0.3 * strain
    assert taut.any()
    assert lengths[taut] == pytest.approx(expected[taut], abs=1e-5)
    assert np.abs(lengths - found.rest_lengths[0] * (1 + strain))[taut].min() > 1e-4  # without the rope behind the exit
