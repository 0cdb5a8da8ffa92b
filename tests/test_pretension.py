"""Rest lengths that hold a pose with wanted tensions, by both methods; what nothing holds; the study of it."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.core.describe import describe_twist
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.layout_equilibria import Cases
from cdpr_sim.statics import forces
from fully_constrained import ABOVE, PUSHES, conclusions, least_pretension, pretension, shifts, taut_from

METHODS = (cdpr.solve, cdpr.settle)

HELD = 1e-9
"""[m, rad] How close both methods come back to a pretensioned pose; 1e-12 measured."""

PULL = 1e-6
"""Of a tension, as a fraction: 1e-9 measured; a length cut for an EA 1 % off misses by 1e-2."""

LENGTH, EA = 1.5, 2e4


def planar(exits, anchors, gravity: float = 0.0, mass: float = 1.0) -> cdpr.Robot:
    return cdpr.Robot(
        exits, anchors, EA, mass, mobility="planar", gravity=gravity, platform_size=(0.1, 0.1, 0.1),
        frame=[(-LENGTH, -1, -1), (LENGTH, 1, 1)],
    )  # fmt: skip


def string() -> cdpr.Robot:
    """A mass between two collinear cables along x, without gravity: a plucked string, with closed forms."""
    return planar([(-LENGTH, 0, 0), (LENGTH, 0, 0)], np.zeros((2, 3)))


def off(found: cdpr.Equilibrium, pose) -> float:
    wanted = found.problem.robot.pose(pose)
    turned = (found.rotation * wanted.rotation.inv()).magnitude()
    return max(np.linalg.norm(found.position - wanted.translation), turned)


# --- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_string_is_as_stiff_as_its_pretension_makes_it(method):
    """Along it 2 (EA + p)/L, as k = EA/l0 with l0 = L EA/(EA + p); across it 2 p/L; the mass itself turns freely.

    Pulled along, it moves by F L/(2 (EA + p)) up to F = 2 p; then one cable is slack and the other gives twice as much.
    """
    robot = string()
    for p in (1.0, 50.0, 700.0):
        found = method(robot, (0, 0, 0), robot.rest_lengths((0, 0, 0), p))
        assert found.tensions == pytest.approx(p, rel=PULL)
        stiffest = 2 * (EA + p) / LENGTH
        assert found.eigenvalues == pytest.approx([0, 2 * p / LENGTH, stiffest], abs=1e-6 * stiffest)
        assert found.stability is cdpr.Stability.NEUTRAL
    p = 100.0
    lengths, k = robot.rest_lengths((0, 0, 0), p), (EA + p) / LENGTH
    for force, x, slack in ((199.0, 199 / (2 * k), 0), (201.0, (201 - p) / k, 1), (400.0, 300 / k, 1)):
        found = method(robot, (0, 0, 0), lengths, external_wrench=[force, 0.0, 0, 0, 0, 0])
        assert found.position[0] == pytest.approx(x, rel=1e-6)
        assert found.slack.sum() == slack


# --- lengths for tensions --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"stiffening": (40, 300), "pulley_radius": 0.05},
        {"linear_density": 0.004, "winch_to_exit": 2.0, "reeving": 2},
    ],
)
def test_ipanema_is_held_with_any_tensions_that_balance(catalogue, change):
    """Both methods come to the pose, and each cable has its tension, whatever the cables; in one call as for each.

    Chosen within limits, or nearest to a pretension: those differ from it by what is orthogonal to all that the cables
    do without effect.
    """
    axis = [(0, 0, 1)] * 4 + [(0, 0, -1)] * 4
    robot = catalogue["ipanema-1"].replace(pulley_axis=axis, center_of_mass=(0.01, -0.005, 0.02), **change)
    pose, wrench = (0.2, -0.15, 1.1, 0.02, -0.03, 0.05), [20.0, 10.0, -50.0, 0.1, -0.1, 0.1]
    if "linear_density" in change:  # chosen by pretension alone
        near = cdpr.solve(
            robot, pose, robot.rest_lengths(pose, 300.0, external_wrench=wrench), external_wrench=wrench
        ).tensions
    else:
        chosen = cdpr.compensate(robot, pose, external_wrench=wrench, tensions=(50, 700), prefer="stiffest")
        assert chosen.exact
        near = chosen.tensions
    lengths = robot.rest_lengths(pose, near, external_wrench=wrench)
    for method in METHODS:
        found = method(robot, robot.pose(pose), lengths, external_wrench=wrench)
        assert off(found, pose) < HELD
        assert found.tensions == pytest.approx(near, rel=PULL)
    # Negative control: cut for cables 1 % stiffer, they pull by some percent less or more.
    stiffer = robot.replace(axial_stiffness=1.01 * robot.axial_stiffness)
    wrong = stiffer.rest_lengths(pose, near, external_wrench=wrench)
    assert np.abs(cdpr.solve(robot, pose, wrong, external_wrench=wrench).tensions / near - 1).max() > 1000 * PULL
    if "linear_density" not in change:  # by pretension, of a weight that turns the tilted platform about its origin
        eccentric, at = robot.replace(center_of_mass=(0.05, -0.03, 0.1)), robot.pose(pose)
        lengths = eccentric.rest_lengths(pose, 300.0, external_wrench=wrench)
        found = cdpr.solve(eccentric, pose, lengths, external_wrench=wrench)
        assert off(found, pose) < HELD
        W = forces.geometry(eccentric, at.translation, at.rotation.as_matrix()).wrench_matrix
        assert np.abs(np.linalg.svd(W)[2][6:] @ (found.tensions - 300.0)).max() < 1e-6
    held, poses = robot.replace(pretension=300.0), robot.home + np.array([[0, 0, 0], [0.2, -0.1, 0.1]])
    for method in (cdpr.solve_many, cdpr.settle_many):
        found = method(held, poses)
        assert np.abs(found.deviation).max() < HELD
        np.testing.assert_allclose(found.rest_lengths, [held.rest_lengths(pose) for pose in poses], rtol=1e-12)


# --- what nothing holds ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_a_point_mass_is_held_in_three_directions_and_turns_freely_in_three(catalogue, gravity):
    """Both methods: three zeros, three stiffnesses; its rotations are neutral, which is said. Compensation holds."""
    with pytest.warns(cdpr.ImplausibleRobot, match="all anchors in one point"):
        robot = cdpr.Robot(catalogue["ipanema-1"].exits, np.zeros((8, 3)), 2e5, 5.0, gravity=gravity,
                           platform_size=(0.1, 0.1, 0.1), name="mass")  # fmt: skip
    pose = (0.3, 0.2, 1.1)
    lengths = cdpr.compensate(robot, pose, tensions=(50, 500)).rest_lengths
    static, settled = (method(robot, (0.2, 0.2, 1.0), lengths) for method in METHODS)
    for found in (static, settled):
        assert np.linalg.norm(found.position - pose) < HELD
        assert found.stability is cdpr.Stability.NEUTRAL
        assert np.abs(found.eigenvalues[:3]).max() < 1e-6
        assert found.eigenvalues[3:].min() > 1e4
        words = [describe_twist(one, robot) for one in cdpr.neutral_directions(found)]
        assert words == ["rotation about x", "rotation about y", "rotation about z"]
    assert cdpr.compare(static, settled).agrees
    # Hung by its cables from a point above its middle, it swings: only the vertical is left.
    pendulum = robot.replace(center_of_mass=(0, 0, -0.1), gravity=9.81)
    found = cdpr.solve(pendulum, pose, pendulum.rest_lengths(pose, 100.0))
    assert [describe_twist(one, robot) for one in cdpr.neutral_directions(found)] == ["rotation about z"]


def test_what_is_held_is_not_called_neutral(catalogue):
    """Of a stable platform nothing is; of one whose cables are all slack everything."""
    robot = catalogue["ipanema-1"]
    assert len(cdpr.neutral_directions(cdpr.solve(robot, robot.home))) == 0
    assert len(cdpr.neutral_directions(cdpr.settle(robot.replace(gravity=0.0), robot.home))) == 6


# --- commands --------------------------------------------------------------------------------------------------------


def said(*words: str, status: int = 0) -> str:
    told = CliRunner().invoke(app, [*words], env={"COLUMNS": "100"})
    assert told.exit_code == status, told.output
    return " ".join((told.stderr if status else told.stdout).split())


def test_commands_pretension_and_say_what_is_not_held(tmp_path):
    """`settle` and `solve` hold the pose: no sag, nothing slack; free directions and limits of tensions are said."""
    told = said("settle", "ipanema-1", "--pretension", "200")
    assert "0 of 8" in told
    assert "the two methods agree" in told
    assert "pretension: found -60.16 N in cable 5" in said("solve", "ipanema-1", "--pretension", "20", status=2)
    file = tmp_path / "mass.toml"
    file.write_text(
        'name = "mass"\naxial_stiffness = 1e4\nforce_max = 5\n[platform]\nmass = 1\nsize = [0.1, 0.1, 0.1]\n'
        "[[cables]]\nexit = [-1, 0, 2]\nanchor = [0, 0, 0]\nforce_max = 100\n"
        "[[cables]]\nexit = [1, 0, 2]\nanchor = [0, 0, 0]\n[[cables]]\nexit = [0, 1, 2]\nanchor = [0, 0, 0]\n"
    )
    told = said("solve", str(file), "--pose", "0", "0.1", "1")
    assert "Neutrally stable: rotation about x; rotation about y; rotation about z." in told
    assert re.search(r"Cable 2: tension .* outside its limits of 0 to 5 N\.", told)
    assert "Cable 1: tension" not in told


def test_a_map_of_a_fully_constrained_machine_is_of_use_with_pretension(tmp_path, monkeypatch):
    """Slack everywhere without; none with it, level under its weight; both methods agree under a force."""
    monkeypatch.chdir(tmp_path)

    def of(*words):
        return re.search(r"aramid-1mm +(.*)", said("map", "falcon-7", "--points", "9", "--force", *words))[1].split()

    solved, *_, worst, slack, _ = of()[:7]
    assert (solved, slack) == ("100", "100")
    assert float(worst) > 0.5
    assert of("--pretension", "30")[:7] == ["100", *["0.00"] * 4, "0", "100"]
    robot = cdpr.load_robot("falcon-7").replace(pretension=30.0)
    assert cdpr.check(robot, (2, 2, 2), external_wrench=(0, 0, -5, 0, 0, 0)).agrees


# --- a pretension belongs to the robot -------------------------------------------------------------------------------


def test_a_pretension_belongs_to_the_robot(tmp_path, catalogue):
    """One pose and many, stiffness, mass and layouts that differ, a motion, a controller, a store: the same lengths."""
    plain = catalogue["ipanema-1"]
    robot, store = plain.replace(pretension=300.0), tmp_path / "sweep.zarr"
    poses = robot.home + np.array([[0, 0, 0], [0.2, -0.1, 0.1], [0.9, 0.9, 0.9]])
    lengths = [plain.rest_lengths(pose, 300.0) for pose in poses[:2]]
    np.testing.assert_array_equal([robot.rest_lengths(pose) for pose in poses[:2]], lengths)
    found = cdpr.solve_many(robot, poses)
    np.testing.assert_allclose(found.rest_lengths[:2], lengths, rtol=1e-14)
    nothing = cdpr.Status.NO_PRETENSION
    assert found.status.tolist() == [cdpr.Status.CONVERGED] * 2 + [nothing]
    assert cdpr.settle_many(robot, poses).status[2] == nothing
    with pytest.raises(cdpr.InvalidInput, match=r"pretension: found -.* N in cable"):
        cdpr.solve(robot, poses[2])
    heavy = robot.replace(linear_density=2.0)  # at the second pose a cable weighs more than it would be pulled by
    assert cdpr.solve_many(heavy, poses[:2]).status.tolist() == [cdpr.Status.CONVERGED, nothing]
    varied = cdpr.Problems.of(robot, poses[:2], axial_stiffness=[[1e5], [2e5]], mass=[5.0, 20.0])
    for row, (stiffness, mass) in enumerate(((1e5, 5.0), (2e5, 20.0))):
        alone = robot.replace(axial_stiffness=stiffness, mass=mass)
        np.testing.assert_allclose(varied.rest_lengths[row], alone.rest_lengths(poses[row]), rtol=1e-14)
    moved = robot.replace(exits=robot.exits + np.array([0.05, 0, 0]))
    layouts = Cases.of(robot, poses[:2]).layout_problems(RobotBatch.of([robot, moved]))
    np.testing.assert_allclose(layouts.rest_lengths[1, 1], moved.rest_lengths(poses[1]), rtol=1e-14)
    motion = cdpr.drive(robot, poses[:2], states=5)
    np.testing.assert_allclose(motion.rest_lengths[[0, -1]], lengths, rtol=1e-14)
    assert not motion.slack.any()
    tracked = cdpr.track(robot, poses[:2], cdpr.RigidLengths(robot))
    assert np.linalg.norm(tracked.positions[-1] - poses[1]) < 1e-4
    assert cdpr.compensate(robot, poses[1], tensions=(10, 200)).tensions.max() < 200  # tensions of its own
    heavy = catalogue["cogiro"].replace(linear_density=1e-3, pretension=50.0)
    assert cdpr.solve_many(heavy, [heavy.home]).status.tolist() == [nothing]
    for _ in range(2):
        cdpr.sweep(robot, (2, 2, 2), store=store)
    with pytest.raises(cdpr.InvalidInput, match="exists and holds something else"):
        cdpr.sweep(plain, (2, 2, 2), store=store)


# --- the study -------------------------------------------------------------------------------------------------------


def test_the_study_finds_what_single_solves_do(catalogue):
    """Its pretensions, its slack thresholds, its wrong lengths; methods 1e-9 m apart at most."""
    robot = catalogue["ipanema-1"]
    study = pretension(points=5, every=2, errors=5)
    least = study.unloaded.values[0]
    tensions = robot.weight / 8 * np.linalg.norm(robot.exits[0] - robot.anchors[0] - robot.home)
    assert least == pytest.approx(tensions, abs=2e-3)  # by symmetry: up against down, along z
    assert study.method_differences()[0] < 1e-9
    for what, taut in study.taut.items():
        lengths = [robot.rest_lengths(robot.home, taut + more) for more in (-0.1, 0.1)]
        slack = [cdpr.settle(robot, robot.home, one, external_wrench=PUSHES[what]).slack.sum() for one in lengths]
        assert slack[0] > 0 == slack[1]
    wrong = study.wrong[ABOVE].static
    lengths = robot.rest_lengths(robot.home, 300.0)
    lengths[0] *= 0.99
    found = cdpr.solve(robot, robot.home, lengths)
    assert wrong.tensions[0].max() == pytest.approx(found.tensions.max(), rel=1e-9)
    assert shifts(wrong)[0] == pytest.approx(np.linalg.norm(found.deviation), rel=1e-6)
    assert taut_from(robot, np.zeros(6)) == pytest.approx(least_pretension(robot))


def test_what_pretension_gains_is_said_by_one_baseline(catalogue):
    """The stiffness on rigid lengths, of the softest and the stiffest direction; the manual says the same numbers."""
    robot = catalogue["ipanema-1"]
    rigid = cdpr.solve(robot, robot.home).eigenvalues[[0, -1]]
    study = pretension(points=3, every=2, errors=3)
    low, high = study.unloaded.values[[0, -1]]
    for outside in (low - 0.01, high + 0.01):
        with pytest.raises(cdpr.InvalidInput, match="another pretension may do"):
            robot.rest_lengths(robot.home, outside)
    held = [robot.rest_lengths(robot.home, one) for one in (low, high)]
    at = [cdpr.solve(robot, robot.home, one).eigenvalues[[0, -1]] for one in held]
    softest, stiffest = np.array(at).T / 1e3
    gains = np.array(at[1]) / rigid
    page = (Path(__file__).parents[1] / "docs" / "concepts" / "workspaces.md").read_text(encoding="utf-8")
    numbers = [
        f"from {low:.1f} to {high:.1f} N",
        f"{rigid[0] / 1e3:.1f} kN/m",
        f"stiffest {rigid[1] / 1e3:.0f} kN/m",
        f"{softest[0]:.0f} to {softest[1]:.0f} kN/m, at most {gains[0]:.0f} times as much",
        f"{stiffest[0]:.0f} to {stiffest[1]:.0f} kN/m, at most {gains[1]:.2f} times as much",
    ]
    for told in (" ".join(conclusions(study)), " ".join(page.split())):
        for number in numbers:
            assert number in told.replace(" as with rigid lengths", ""), number
