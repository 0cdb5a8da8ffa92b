"""What is called proved holds: by another evaluation in balls, and by faults that must never be called proved."""

import dataclasses
import json
import math
import re
import sys
from decimal import ROUND_FLOOR

import numpy as np
import oracle
import pytest
from inputs import row, run
from sample_problems import garage_crane, symmetric_pair
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.pose import Pose
from cdpr_sim.proof import cables as proof_cables
from cdpr_sim.proof.balance import Balance
from cdpr_sim.proof.balls import arithmetic, exact, middle, middles
from cdpr_sim.proof.cables import Cable
from cdpr_sim.proof.certificate import index_of
from cdpr_sim.report import proof_tables

flint = pytest.importorskip("flint")

BITS = 500
"""Of the other evaluation: steps of 2⁻¹⁰⁰ leave 300 bits to the second difference."""

STEP = 100
"""Central differences with steps of 2⁻¹⁰⁰ m are off by 1e-60 of a derivative, below any box's width."""

LONG_STEP = 40
"""The same of forces from Taylor series, whose remainder of 1e-25 is divided by the step."""

BOX = 1e-6
"""[m] About a pose, over which derivatives are enclosed."""

POSE = (0.3, 0.2, 0.15)


def cogiro(**changes) -> cdpr.Robot:
    return cdpr.load_robot("cogiro").replace(**changes)


CASES = {
    "plain": (cogiro(), POSE, None),
    "force": (cogiro(), POSE, (0.3, 0.2, -0.1, 0, 0, 0)),
    "wrench": (cogiro(), POSE, (0.3, 0.2, -0.1, 0.002, 0.001, -0.003)),
    "pulleys": (cogiro(pulley_radius=0.02, pulley_axis=(0.1, 0.2, -1)), POSE, None),
    "law": (cogiro(stiffening=(20, 100)), POSE, None),
    "beyond 20 %": (cogiro(stiffening=(2, 1), axial_stiffness=10.0), POSE, None),
    "mass": (cogiro(linear_density=1e-3), POSE, None),
    "mass and all": (
        cdpr.load_robot("cogiro-crane").replace(
            linear_density=0.064, pulley_radius=0.1, stiffening=(100, 2e4), winch_to_exit=6, reeving=2
        ),
        (1.0, 1.0, 2.0),
        (100, 0, 0, 0, 20, 0),
    ),
    "mass on some": (
        cdpr.load_robot("cogiro-crane").replace(
            linear_density=0.064 * np.array([1, 0, 1, 1, 0, 1, 0, 0.5]),
            pulley_radius=0.1 * np.array([1, 1, 0, 0.5, 0, 1, 1, 0]),
            stiffening=[(100, 2e4)] * 3 + [(0, 0)] * 5,
            winch_to_exit=[0, 0, 6, 0, 0, 6, 6, 6],
        ),
        (2.0, -1.0, 2.5),
        None,
    ),
    "planar": (cdpr.load_robot("planar-vertical"), (0.3, 0, 0.2), (0.2, 0, -0.1, 0, 0.001, 0)),
    "fully constrained": (cdpr.load_robot("ipanema-3"), (0.1, 0.2, 1.1), None),
}
"""A robot, a pose and a wrench, of each kind of cable and load."""


def problem_of(case: str) -> cdpr.Problem:
    robot, pose, wrench = CASES[case]
    return cdpr.Problem.of(robot, pose, external_wrench=wrench)


# --- another evaluation, in balls of 500 bits: rotations by Rodrigues' formula, wheels by the point of tangency


def turn(quaternion) -> list:
    """R = 1 + sin θ K + (1 − cos θ) K² of the axis and angle of a quaternion that has any length."""
    length = np.dot(quaternion, quaternion).sqrt()
    w, *v = (part / length for part in quaternion)
    sine = np.dot(v, v).sqrt()
    angle = 2 * flint.arb.atan2(sine, w)
    x, y, z = (part / sine for part in v)
    K = flint.arb_mat([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = flint.arb_mat([[1, 0, 0], [0, 1, 0], [0, 0, 1]]) + K * angle.sin() + K * K * (1 - angle.cos())
    return R.tolist()


def path(apart, axis, radius):
    """The length of a cable: over a wheel, the arc to the point of tangency and the straight piece from there."""
    if not radius > 0:
        return np.dot(apart, apart).sqrt()
    size = np.dot(axis, axis).sqrt()
    e = [part / size for part in axis]
    h = np.dot(apart, e)
    across = [a - h * b for a, b in zip(apart, e, strict=True)]
    u = np.dot(across, across).sqrt() - radius  # in the wheel's plane the anchor is at (u, h) from its centre
    far = u * u + h * h
    root = (far - radius * radius).sqrt()
    touch = [(radius * radius * u - radius * h * root) / far, (radius * radius * h + radius * u * root) / far]
    if not ((touch[1] > 0) or (touch[1] < 0)):
        raise ValueError("no side of the wheel is proved")
    arc = flint.arb.atan2(touch[1], -touch[0])
    straight = [(u - touch[0]), (h - touch[1])]
    return radius * arc + np.dot(straight, straight).sqrt()


def energy(problem: cdpr.Problem, balance: Balance, x) -> "flint.arb":
    """V [J], from the problem's own data."""
    robot = problem.robot
    p = [exact(v) for v in problem.position]
    for k, axis in enumerate(balance.axes):
        p[axis] = x[k]
    tangents = zip(balance.tangents, x[len(balance.axes) :], strict=True)
    q = list(balance.quaternion)
    for tangent, delta in tangents:
        q = [a + delta * b for a, b in zip(q, tangent, strict=True)]
    R = turn(q)

    def at(arm):
        return [p[i] + np.dot(R[i], [exact(v) for v in arm]) for i in range(3)]

    total = exact(robot.mass) * exact(robot.gravity) * at(robot.center_of_mass)[2]
    total -= np.dot([exact(v) for v in problem.external_wrench[:3]], p)
    cabling = robot.cabling
    for i in range(robot.cables):
        apart = [a - exact(b) for a, b in zip(at(cabling.anchors[i]), cabling.exits[i], strict=True)]
        length = path(apart, [exact(v) for v in cabling.pulley_axis[i]], exact(cabling.pulley_radius[i]))
        rest, EA = exact(problem.rest_lengths[i]), exact(cabling.axial_stiffness[i])
        a2, a3 = (exact(v) for v in cabling.stiffening[i])
        strain = length / rest - 1
        if not strain > 0:
            continue
        most = exact(0.2)
        knee = strain if strain < most else most
        total += EA * rest * (knee**2 / 2 + a2 * knee**3 / 3 + a3 * knee**4 / 4)
        if strain > most:
            over = strain - most
            start, slope = most + a2 * most**2 + a3 * most**3, 1 + 2 * a2 * most + 3 * a3 * most**2
            total += EA * rest * (over * start + slope * over**2 / 2)
    return total


@pytest.mark.parametrize("case", [name for name in CASES if "mass" not in name])
def test_the_balance_encloses_the_derivatives_of_an_energy_that_is_evaluated_by_other_formulas(case):
    """At a random point of a box, first and second differences of the other energy lie in what holds over the box.

    Torques have no energy: their part is compared with the spin of Rodrigues' rotation.
    """
    problem = problem_of(case)
    random = np.random.default_rng(1)
    start = RigidTransform.from_components(
        problem.position, Rotation.from_rotvec([0, 0.3, 0] if problem.robot.mobility == "planar" else [0.2, 0.3, -0.1])
    )
    problem = cdpr.Problem.of(problem.robot, start, problem.rest_lengths, problem.external_wrench)
    with arithmetic(BITS):
        balance = Balance(problem, Pose.of(start))
        n, h = balance.free, exact(2.0**-STEP)
        x = [centre + exact(BOX * v) for centre, v in zip(balance.start, random.uniform(-1, 1, n), strict=True)]

        def moved(*steps):
            return [v + h * sum(s == k for s in steps) - h * sum(s == ~k for s in steps) for k, v in enumerate(x)]

        def potential(*steps):
            return energy(problem, balance, moved(*steps))

        def spin(k):
            R, R1, R0 = (turn_at(balance, moved(*s)) for s in ((), (k,), (~k,)))
            rate = [[(a - b) / (2 * h) for a, b in zip(*rows, strict=True)] for rows in zip(R1, R0, strict=True)]
            W = (flint.arb_mat(rate) * flint.arb_mat(R).transpose()).tolist()
            return [W[2][1], W[0][2], W[1][0]]

        twisted = [exact(v) for v in problem.external_wrench[3:]]
        slopes = [(potential(k) - potential(~k)) / (2 * h) for k in range(n)]
        for k in range(len(balance.axes), n):
            slopes[k] -= np.dot(twisted, spin(k))
        bends = [
            [
                (potential(k, m) - potential(k, ~m) - potential(~k, m) + potential(~k, ~m)) / (4 * h * h)
                for m in range(n)
            ]
            for k in range(n)
        ]
    with arithmetic():
        over = balance.at(balance.start + flint.arb(0, 1.1 * BOX))
        for k in range(n):
            assert over.forces[k].contains(slopes[k].mid())
            for m in range(n):
                if not problem.external_wrench[3:].any():
                    assert over.slope[k][m].contains(bends[k][m].mid())
                assert float(over.slope[k][m].rad()) < 1e-2 * max(abs(middle(e)) for row_ in over.slope for e in row_)


def turn_at(balance: Balance, x) -> list:
    q = list(balance.quaternion)
    for tangent, delta in zip(balance.tangents, x[len(balance.axes) :], strict=True):
        q = [a + delta * b for a, b in zip(q, tangent, strict=True)]
    return turn(q)


@pytest.mark.parametrize("case", ["wrench", "mass", "mass and all", "planar"])
def test_the_slope_is_the_derivative_of_the_forces(case):
    """Central differences of the forces lie in the slope's enclosure: torques and cables with mass included."""
    problem = problem_of(case)
    with arithmetic(BITS):
        balance = Balance(problem, Pose.of(problem.pose))
        h = exact(2.0**-LONG_STEP)
        x = balance.start + exact(1e-9)
        columns = []
        for m in range(balance.unknowns):
            step = h * np.eye(len(x), dtype=int)[m]
            columns.append((balance.at(x + step).forces - balance.at(x - step).forces) / (2 * h))
    with arithmetic():
        over = balance.at(balance.start + flint.arb(0, 2e-9))
        for k in range(balance.unknowns):
            for m in range(balance.unknowns):
                assert over.slope[k][m].contains(columns[m][k].mid())


@pytest.mark.parametrize("case", ["mass", "mass and all", "mass on some"])
def test_a_cable_with_mass_ends_where_the_integral_of_its_strain_does(case):
    """Over wheels, nonlinear, with a drive line: by the oracle's integral."""
    problem = problem_of(case)
    robot, there = problem.robot, problem.position + problem.robot.anchors
    pulls = np.ones((robot.cables, 3))
    with arithmetic():
        for i in np.flatnonzero(robot.linear_density).tolist():
            cable = Cable(problem, i)
            pulls[i] = middles(cable.pull(exact(there[i]), cable.tension_near(there[i])).force)
    rig, heavy = oracle.Rig.of(robot), robot.linear_density > 0
    mine = oracle.balance(rig, problem.position, np.eye(3), oracle.Ropes(rig, problem.rest_lengths)).pulls
    np.testing.assert_allclose(pulls[heavy], mine[heavy], rtol=0, atol=1e-9 * np.abs(mine).max())


def test_the_remainder_of_a_nonlinear_cable_covers_what_its_series_omit(monkeypatch):
    """Longer series over shorter parts, in more digits, end within the balls of the usual ones: taut, and sagging."""
    robot, pose, _ = CASES["mass and all"]
    for longer in (0.998, 1.0, 1.02):
        problem = cdpr.Problem.of(robot, pose, robot.rest_lengths(pose) * longer)
        at = problem.position + robot.anchors[2]
        with arithmetic():
            cable = Cable(problem, 2)
            t = cable.tension_near(at)
            usual = cable.pull(exact(at), t)
        with monkeypatch.context() as finer, arithmetic(BITS):
            finer.setattr(proof_cables, "TERMS", 40)
            finer.setattr(proof_cables, "PIECE", 0.1)
            cable = Cable(problem, 2)
            fine = cable.pull(exact(at), t)
        ends = ([*one.gap, *one.compliance.ravel()] for one in (usual, fine))
        for one, other in zip(*ends, strict=True):
            assert one.contains(other)
            assert float(one.rad()) < 1e-15 * problem.rest_lengths[2]


# --- what is proved


@pytest.mark.parametrize("case", CASES)
def test_equilibria_of_both_methods_are_proved(case):
    """Of every kind of cable and load; the enclosures of the two overlap, and hold more digits than a double."""
    problem = problem_of(case)
    proofs = [cdpr.certify(method(problem)) for method in (cdpr.solve, cdpr.settle)]
    for one in proofs:
        assert one.proved, one.reasons
        assert one.stable
        assert one.digits > 16
        assert one.slack == tuple(one.equilibrium.slack)
        assert (one.position[0] <= one.position[1]).all()
        assert (one.position[0] - one.position_error <= one.equilibrium.position).all()
        assert (one.equilibrium.position <= one.position[1] + one.position_error).all()
    for part in ("position", "rotation", "tensions"):
        ends = [getattr(one, part) for one in proofs]
        assert (np.maximum(ends[0][0], ends[1][0]) <= np.minimum(ends[0][1], ends[1][1])).all()


def test_a_saddle_is_proved_with_its_unstable_directions():
    """The bar turned over on its two cables: it exists, and leaves along one direction."""
    robot = cdpr.load_robot("two-cable")
    found = cdpr.find_equilibria(robot, (0.3, 0, 0.2), saddles=True, starts=50)
    proofs = [cdpr.certify(one) for one in found]
    assert [one.index for one in proofs] == [0, 1]
    assert all(one.proved for one in proofs)
    assert [one.stable for one in proofs] == [True, False]


# --- what must never be called proved


@pytest.fixture(scope="module")
def solved() -> cdpr.Equilibrium:
    return cdpr.solve(*CASES["plain"][:2])


def faulty(equilibrium: cdpr.Equilibrium, **changes) -> cdpr.Certificate:
    return cdpr.certify(dataclasses.replace(equilibrium, **changes))


@pytest.mark.parametrize("case", CASES)
def test_a_pose_that_is_10_micrometres_off_is_not_proved(case):
    """Newton's steps in balls lead back to the equilibrium; it is said how far that is."""
    found = cdpr.solve(problem_of(case))
    moved = RigidTransform.from_components(found.position + np.array([1e-5, 0, 0]), found.rotation)
    proof = faulty(found, pose=moved)
    assert not proof.proved
    assert not proof.exists or proof.position_error == pytest.approx(1e-5, rel=1e-3)


WRONG = [
    *(
        (case, "axial_stiffness")
        for case in ("plain", "pulleys", "law", "mass", "mass and all", "mass on some", "planar")
    ),
    *(("mass and all", name) for name in ("linear_density", "pulley_radius", "stiffening", "winch_to_exit")),
    ("mass on some", "linear_density"),
]
"""A case, and what is wrong in it by one percent. (Of the mass of DemoBot's cables, that moves it by only 4e-8 m.)"""


@pytest.mark.parametrize(("case", "name"), WRONG)
def test_a_wrong_property_is_not_proved(case, name):
    """The equilibrium of cables with one percent more of it is another one."""
    problem = problem_of(case)
    other = problem.robot.replace(**{name: 1.01 * getattr(problem.robot, name)})
    found = cdpr.solve(other, problem.pose, problem.rest_lengths, external_wrench=problem.external_wrench)
    assert not faulty(found, problem=problem).proved


@pytest.mark.parametrize("case", ["plain", "mass on some", "slack with mass"])
def test_a_taut_cable_that_is_called_slack_is_not_proved(case):
    """And the sentence says which cable. Those with mass are called so by their lengths and their tensions."""
    heavy = cdpr.Problem.of(garage_crane(linear_density=2.0), (1.5, 1.5, 0.3))
    found = cdpr.solve(heavy if case == "slack with mass" else problem_of(case))
    assert found.slack.any() == (case == "slack with mass")
    assert cdpr.certify(found).slack == tuple(found.slack)
    for cable in range(8):
        tensions, lengths = found.tensions.copy(), found.lengths.copy()
        tensions[cable] = 0.0 if not found.slack[cable] else found.tensions[cable] + 1e-9
        lengths[cable] = found.rest_lengths[cable] + (1e-9 if found.slack[cable] else -1e-9)
        proof = faulty(found, tensions=tensions, lengths=lengths)
        assert not proof.proved
        words = ("slack", "taut") if found.slack[cable] else ("taut", "slack")
        assert f"cable {cable + 1} is {words[0]}, and the equilibrium calls it {words[1]}" in proof.reasons


def test_wrong_tensions_are_not_proved(solved):
    """One percent in every cable."""
    assert not faulty(solved, tensions=1.01 * solved.tensions).proved


def test_a_cable_with_mass_that_ends_on_its_wheel_is_not_proved():
    """Its rest length is less than what lies on the wheel: it has no end, which is a reason and no error."""
    found = cdpr.solve(problem_of("mass and all"))
    short = dataclasses.replace(found.problem, rest_lengths=np.full(8, 1e-3))
    proof = faulty(found, problem=short)
    assert not proof.exists
    assert proof.reasons


def test_a_cable_exactly_at_its_rest_length_is_neither_taut_nor_slack():
    """A bar on two vertical cables, stretched from 1 m to 1.5 m, and a third of exactly 1.5 m in the middle.

    The equilibrium exists and is stable, by convexity; which side of the kink it lies on, nothing can say.
    """
    robot = cdpr.Robot(
        exits=[[-0.5, 0, 2], [0.5, 0, 2], [0, 0, 2]],
        anchors=[[-0.5, 0, 0], [0.5, 0, 0], [0, 0, 0]],
        axial_stiffness=[64, 64, 1e6],
        mass=8,
        gravity=8,
        mobility="planar",
        platform_size=(1, 0.1, 0.1),
    )
    found = cdpr.solve(robot, (0, 0, 0.5), [1, 1, 1.5])
    proof = cdpr.certify(found)
    assert proof.exists
    assert proof.stable
    assert proof.slack == (False, False, None)
    assert not proof.proved
    assert "cable 3 is within" in proof.reasons[0]


def test_a_neutral_direction_is_named_as_the_reason():
    """A point on two cables by its centre of mass turns freely: equilibria are not isolated."""
    proof = cdpr.certify(cdpr.solve(symmetric_pair()))
    assert not proof.proved
    assert "neutral" in proof.reasons[0]


def test_the_index_is_that_of_every_matrix_in_the_enclosure():
    """Signs that a radius leaves open are not counted."""
    with arithmetic():
        ball = flint.arb
        assert index_of(np.array([[ball(2), ball(1)], [ball(1), ball(2)]])) == 0
        assert index_of(np.array([[ball(1), ball(2)], [ball(2), ball(1)]])) == 1
        assert index_of(np.array([[ball(1), ball(1)], [ball(1), ball(1)]])) is None
        assert index_of(np.array([[ball(1, 1.1), ball(0)], [ball(0), ball(1)]])) is None


def test_certify_prints_what_is_proved_of_both_methods():
    """With status 0; and of what cannot be proved, with status 1 and the reason."""
    result = run("certify", "parallel", "--pose", "0.285", "0.25", "0.1")
    assert result.exit_code == 0
    assert row(result.stdout, "proved") == ["proved", "yes", "yes"]
    assert row(result.stdout, "slack cables")[2:] == ["4", "of", "8", "4", "of", "8"]
    printed = run("certify", "parallel", "--pose", "0.285", "0.25", "0.1", "--wrench", "0,0,-1,0,0,0.001", "--json")
    assert '"proved": true' in printed.stdout


def test_settle_shows_the_proved_errors_where_the_extra_is_installed(monkeypatch):
    """With details in a row, on request in a column too; without the extra it prints what ``--no-certify`` prints."""
    words = "settle", "parallel", "--pose", "0.38", "0.25", "0.1"  # where SEECR needs few steps
    label = re.escape("proved within [mm]")
    default, column, without = (run(*words, "--all", *more) for more in ((), ("--certify",), ("--no-certify",)))
    assert [one.exit_code for one in (default, column, without)] == [0, 0, 0]
    (bounds,) = re.findall(f"^ {label} +(.*)$", default.stdout, re.MULTILINE)
    assert all(float(bound) < 1e-6 for bound in bounds.split())
    assert len(bounds.split()) >= 2
    heads = [next(line for line in one.stdout.splitlines() if " commanded " in line) for one in (default, column)]
    assert " proved " not in heads[0]
    assert " proved " in heads[1]
    assert set(json.loads(run(*words, "--json").stdout)["certificates"]) >= {"mujoco", "newton"}
    monkeypatch.setitem(sys.modules, "flint", None)
    plain = run(*words, "--all")
    assert plain.stdout == without.stdout
    assert "proved" not in plain.stdout
    assert "certificates" not in json.loads(run(*words, "--json").stdout)
    asked = run(*words, "--certify")
    assert asked.exit_code == 2
    assert 'pip install "cdpr-sim[proof]"' in asked.stderr


def test_settle_says_why_an_equilibrium_is_not_proved(monkeypatch):
    """Once for the methods that share the reason; the exit status is still that of the comparison."""
    certify = cdpr.certify

    def unproved(equilibrium):
        return dataclasses.replace(certify(equilibrium), reasons=("a reason",))

    monkeypatch.setattr(cdpr, "certify", unproved)
    result = run("settle", "cogiro", "--all")
    assert result.exit_code == 0
    assert len(re.findall("MuJoCo, Newton.*: not proved: a reason", result.stdout)) == 1


def test_printed_bounds_are_never_better_than_the_proved_ones():
    """One digit: errors are rounded up, the distance to the next equilibrium is rounded down."""
    for value in (1.2e-9, 9.5e-9, 3e-8, 2.0000001e-12):
        assert value <= float(proof_tables._bound(value)) <= 2 * value
        assert value / 2 <= float(proof_tables._bound(value, ROUND_FLOOR)) <= value
    assert proof_tables._bound(math.inf) == ""


def test_bounds_are_rounded_outwards():
    """The doubles that are printed enclose the ball, and are no more than one step wider."""
    from cdpr_sim.proof.balls import lower, upper

    with arithmetic():
        third = exact(1) / 3
        assert exact(lower(third)) <= third
        assert exact(upper(third)) >= third
        assert upper(third) <= math.nextafter(lower(third), 1)
