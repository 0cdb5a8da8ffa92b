"""Better layouts: batches over robots, symmetry, bounds, exact slopes, the search, and what MuJoCo says of it."""

import dataclasses

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.pose import angle_between
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.crosscheck.layout_validation import validate_layout
from cdpr_sim.design import search
from cdpr_sim.design.constraints import constraints_of
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria, solve_layouts
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.design.objectives import NO_LIMITS, OBJECTIVES
from cdpr_sim.design.polish import margins, slopes_of_margins
from cdpr_sim.design.symmetry import group
from cdpr_sim.report.layout_pictures import driven
from real_cables import crane
from tests.sample_problems import grid, symmetric_pair

LINE = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 6)]
"""Along the paper's line [m]."""


ORDER = 2.9
"""Least exponent with which a central difference's remainder falls with the step."""

DRIVE_LINES = {"winch_to_exit": [0.3, 0.0] * 4, "reeving": [1, 2, 1, 1] * 2}


@pytest.fixture(scope="module")
def parallel() -> cdpr.Robot:
    return cdpr.load_robot("parallel")


@pytest.fixture(scope="module")
def better(parallel) -> cdpr.LayoutResult:
    return cdpr.find_layout(parallel, LINE, within=0.1, generations=40)


@pytest.mark.parametrize("kind", ["plain", "bent", "heavy"])
def test_a_batch_of_layouts_rests_where_each_robot_does(kind: str, parallel):
    """Every layout in every case, by the same solver as one robot alone: loads, stiffness and slack cables included."""
    robot = {
        "plain": parallel,
        "bent": parallel.replace(pulley_radius=0.01, pulley_axis=(0, 0, 1), stiffening=(50, 0), **DRIVE_LINES),
        "heavy": parallel.replace(linear_density=0.01, **DRIVE_LINES),
    }[kind]
    space = Space.of(robot, [Move("exits", 0.05), Move("anchors", 0.005), Move("diameter", 1.5)])
    values = np.random.default_rng(0).uniform(space.lower, space.upper, (3, len(space)))
    cases = Cases.of(robot, LINE[:3], [np.zeros(6), [0.2, 0, -0.5, 0, 0, 0]], [1.0, 0.3])
    found = solve_layouts(space.layouts(values), cases)
    assert found.shape == (3, 12)
    for row in range(3):
        alone = cdpr.solve_many(cases.problems(found.layouts.robot_at(row)))
        assert alone.converged.all()
        assert found.positions[row] == pytest.approx(alone.positions, abs=1e-9)
        assert found.tensions[row] == pytest.approx(alone.tensions, abs=1e-6)
        assert found.eigenvalues[row] == pytest.approx(alone.eigenvalues, rel=1e-5, abs=1e-3)
        frequencies = [cdpr.natural_modes(alone[case]).frequencies[0] for case in range(12)]
        assert found.frequencies[row] == pytest.approx(frequencies, rel=1e-5, abs=1e-3)
    one = found[1, 7]
    assert one.residual == found.residuals[1, 7]
    assert np.array_equal(one.problem.robot.exits, found.layouts.exits[1])


def test_symmetries_are_found_and_not_imagined(parallel):
    """Parallel has both mirrors and the half turn; Cogiro the half turn alone; one exit 1 mm off has none."""
    assert [len(group(robot, "detected")) for robot in (parallel, cdpr.load_robot("cogiro"))] == [4, 2]
    exits = parallel.exits.copy()
    exits[0, 0] += 1e-3
    assert len(group(parallel.replace(exits=exits), "detected")) == 1
    assert len(group(parallel.replace(center_of_mass=(0.001, 0, 0)), "detected")) == 2  # the mirror in y is left
    assert len(group(parallel, ["mirror-x", "mirror-y"])) == 4


def test_every_symmetry_takes_each_cable_to_its_image(parallel):
    """The one that two others make, too; wheels turn along, and what cables are must be the same."""
    pairs = [["mirror-x", "mirror-y"], ["half-turn", "mirror-y"]]
    points = np.hstack([parallel.exits - [0.4, 0.25, 0], parallel.anchors])
    for one in (symmetry for names in pairs for symmetry in group(parallel, names)):
        assert points * np.tile(one.signs, 2) == pytest.approx(points[one.images], abs=1e-12)
    outwards = np.sign(points[:, :3]) * [1, 1, 0] + [0, 0, 1]
    wheels = {"pulley_radius": 0.01, "pulley_axis": outwards}
    assert len(group(parallel.replace(**wheels), "detected")) == 4
    wheels["pulley_axis"] = (1, 0, 1)
    assert len(group(parallel.replace(**wheels), "detected")) == 2  # the mirror that changes y alone
    stiffer = parallel.replace(axial_stiffness=[1e4] * 7 + [2e4])
    assert len(group(stiffer, "detected")) == 1


def test_the_search_begins_at_the_nearest_layout_within_bounds(parallel):
    """An exit that stands outside of its box is put on its face."""
    space = Space.of(parallel, [Move("exits", [[0, 0, 0], [0.5, 0.5, 0.4]], cables=(5,))], "none")
    assert (space.layouts(space.given[None]).exits[0, 4] <= np.array([0.5, 0.5, 0.4]) + 1e-12).all()
    assert parallel.exits[4, 2] > 0.4


def test_what_moves_stays_within_bounds_and_symmetric(parallel):
    """Any choice of the variables: the mirrored exits are each other's images, all in the box."""
    box = [[0.0, 0.0, 0.4], [0.8, 0.5, 0.5]]
    space = Space.of(parallel, [Move("exits", box)])
    assert len(space) == 6  # two exits of a corner, three coordinates each
    values = np.random.default_rng(0).uniform(space.lower, space.upper, (50, 6))
    for row in range(50):
        robot = space.layouts(values).robot_at(row)
        assert len(group(robot, "detected")) == 4
        assert (robot.exits >= np.array(box[0]) - 1e-12).all()
        assert (robot.exits <= np.array(box[1]) + 1e-12).all()
        assert np.array_equal(robot.anchors, parallel.anchors)
    corners = space.layouts(np.array([space.lower, space.upper])).exits
    assert corners.min() == pytest.approx(0.0, abs=1e-12)  # and the box is used up
    narrow = Space.of(parallel, [Move("exits", [[0.0, 0.0, 0.4], [0.78, 0.5, 0.5]])])  # not symmetric itself
    exits = narrow.layouts(np.array([narrow.lower, narrow.upper])).exits
    assert (exits[..., 0].min(), exits[..., 0].max()) == pytest.approx((0.02, 0.78))


def test_points_slide_along_lines_and_cables_can_be_named(parallel):
    """On masts, along z; two cables alone, and those that symmetry ties to them."""
    space = Space.of(parallel, [Move("exits", (-0.1, 0.0), along=(0, 0, 2), cables=(1,))])
    (exits,) = space.layouts(np.array([[-0.05]])).exits
    moved = exits - parallel.exits
    assert np.flatnonzero(moved.any(1)).tolist() == [0, 2, 4, 6]
    assert moved[0] == pytest.approx([0, 0, -0.05])
    assert len(Space.of(parallel, [Move("center_of_mass", 0.01)])) == 1  # up and down; sideways breaks the symmetry
    assert len(Space.of(parallel, [Move("center_of_mass", 0.01)], "none")) == 3
    pulleys = parallel.replace(pulley_radius=[0.01, 0, 0, 0, 0, 0, 0, 0], pulley_axis=(0, 0, 1))
    assert Space.of(pulleys, [Move("pulleys", 0.01)]).names == tuple(f"{axis} of exits 1" for axis in "xyz")
    thick = Space.of(crane().replace(linear_density=0.1), [Move("diameter", 2.0)], "none").layouts(
        np.full((1, 8), np.log(2))
    )
    assert thick.axial_stiffness == pytest.approx(4e6 * np.ones((1, 8)))
    assert thick.linear_density == pytest.approx(0.4 * np.ones((1, 8)))


def test_a_box_holds_the_centre_of_mass_whatever_cables_are_named(parallel):
    """Which have no part in it: once an error of NumPy, where cable 1 was not among them."""
    box = [[-0.01, -0.01, 0], [0.01, 0.01, 0.01]]
    bounds = [Space.of(parallel, [Move("center_of_mass", box, cables=some)], "none").upper for some in (None, [2])]
    assert bounds[0].tolist() == bounds[1].tolist() == [0.01] * 3


@pytest.mark.parametrize(
    ("properties", "smooth"),
    [
        ("none", "worst tilt"), ("none", "worst deviation"), ("none", "lowest tension"),
        ("wheels", "worst deviation"), ("mass and pretension", "lowest tension"),
    ],
)  # fmt: skip
def test_slopes_of_layouts_are_those_of_a_taylor_series(smooth: str, properties: str):
    """Of all margins, by every kind of variable at once, with slack cables, loads with torques, and two stiffnesses."""
    robot = cdpr.load_robot("parallel" if properties == "none" else "cogiro")
    if properties == "wheels":
        robot = robot.replace(pulley_radius=0.02, pulley_axis=(0, 0, 1), stiffening=(50, 0), **DRIVE_LINES)
    if properties == "mass and pretension":
        robot = robot.replace(linear_density=1e-3, pretension=1.0)
    moves = [Move("exits", 0.05), Move("anchors", 0.005), Move("center_of_mass", 0.005), Move("axial_stiffness", 2)]
    space = Space.of(robot, moves, "none")
    cases = Cases.of(robot, [(0.2, 0.22, 0.12, 0, 0.05, 0.1)], [np.zeros(6), [0.3, 0, 0.1, 0, 0.01, 0.02]], [1, 0.5])
    limits = (np.full(8, 0.1), np.full(8, 50.0))

    def numbers(shares):
        values = space.lower + shares * (space.upper - space.lower)
        return margins(values, space, cases, OBJECTIVES[smooth], limits, 0.2)

    middle, step = np.full(len(space), 0.5), 4e-3 * np.random.default_rng(0).uniform(-1, 1, len(space))
    assert properties != "none" or (numbers(middle[None])[1] < 0).any()  # slack
    for kind, slope in enumerate(slopes_of_margins(numbers, middle)):
        left = []
        for part in (1.0, 0.5):
            up, down = (numbers((middle + sign * part * step)[None])[kind][0] for sign in (1, -1))
            left.append(np.abs(up - down - 2 * part * slope @ step).max())
        solved = 1e-12 * np.abs(numbers(middle[None])[kind]).max()  # accuracy to which equilibria are solved
        least = 1e-6 * np.abs(slope @ step).max()
        assert left[1] < max(left[0] / 2**ORDER, least) + 2 * solved, kind
        assert np.abs(slope @ step).max() > 100 * left[0]


@pytest.mark.parametrize("density", [0.0, 0.01])
def test_sensitivity_to_errors_is_that_of_single_equilibria(parallel, density):
    """The objective against ``sensitivity``, coordinate by coordinate, for cables with and without mass."""
    robot = parallel.replace(linear_density=density)
    cases = Cases.of(robot, LINE[:2])
    found = OBJECTIVES["worst sensitivity"].score(
        solve_layouts(RobotBatch.of([robot]), cases, 1), (np.zeros(8), np.ones(8))
    )
    squares = []
    for pose in LINE[:2]:
        by = cdpr.sensitivity(robot, pose).pose
        squares.append(sum(((by[name].T * robot.units) ** 2).sum() for name in ("exits", "anchors")))
    assert found[0] == pytest.approx(np.sqrt(max(squares)), rel=1e-6)


def test_feasible_volume_counts_the_feasible_poses(parallel):
    """As ``feasible`` says, for cables with and without mass and for each layout; the weight changes the count."""
    volumes = []
    for density in (0.0, 0.01):
        robot = parallel.replace(linear_density=density)
        robots = [robot, robot.replace(exits=robot.exits * [0.8, 1.0, 1.0])]
        equilibria = solve_layouts(RobotBatch.of(robots), Cases.of(robot, grid(robot, 400)), 1)
        volumes.append(OBJECTIVES["feasible volume"].score(equilibria, (np.full(8, 0.1), np.full(8, 2.5))))
        asked = {"tension_limits": (0.1, 2.5)}
        shares = [cdpr.feasible(one, grid(robot, 400), **asked).mean() for one in robots]
        assert volumes[-1] == pytest.approx(shares)
        _, limit = constraints_of(robot, {"feasible volume": 1.0, "tensions": (0.1, 2.5)})[0]  # within the same limits
        assert limit.violation(equilibria) == pytest.approx(1 - volumes[-1])
        assert 0 < min(shares) < max(shares) < 1
    assert not np.isclose(*volumes).all()


def test_a_level_layout_is_found_and_mujoco_agrees(better, parallel):
    """From 26° to a few; in MuJoCo, between the poses as well; what it claims is what the robot does."""
    assert np.degrees(better.before) == pytest.approx(26.42, abs=0.01)
    assert better.after < 0.3 * better.before
    assert better.after == pytest.approx(cdpr.solve_many(better.robot, LINE).tilt.max(), abs=1e-9)
    assert np.abs(better.robot.exits - parallel.exits).max() <= 0.1 + 1e-12
    assert {one.name for one in better.changes} == {f"exit {c} {a}" for c in range(1, 9) for a in "xyz"}
    proof = validate_layout(better)
    assert len(proof.cases) == 2 * len(LINE) - 1
    assert proof.agrees
    assert proof.better
    assert proof.after.score == pytest.approx(np.nanmax(proof.after.solved.tilt), abs=1e-7)
    # Negative control: the same claim of the robot as it was.
    false = validate_layout(dataclasses.replace(better, robot=better.given, given=better.robot))
    assert not false.better


def test_a_neutral_pose_is_counted_and_its_difference_left_out(better, parallel):
    """Where a platform turns freely, the two methods may end at any angle: that is no error of either."""
    low, high = parallel.workspace
    poses = np.random.default_rng(0).uniform(low, high, (200, 3))
    free = poses[cdpr.solve_many(parallel, poses).stability == cdpr.Stability.NEUTRAL][:2]
    cases = Cases.of(parallel, [LINE[0], *free])
    as_given = dataclasses.replace(better, robot=better.given, cases=cases)
    found = validate_layout(as_given).after
    turned = np.degrees(angle_between(found.solved.rotations, found.settled.rotations))
    neutral = np.any([one.stability == cdpr.Stability.NEUTRAL for one in (found.solved, found.settled)], axis=0)
    assert turned[neutral].max() > 1  # negative control
    assert found.neutral == (turned > 1e-3).sum()
    assert found.agrees.all()
    assert np.degrees(found.errors["rotation_error"]) == pytest.approx(turned[~neutral].max(), abs=1e-9)
    assert f"{found.neutral} are neutrally stable, the others agree within" in " ".join(
        validate_layout(as_given).sentences
    )
    alone = dataclasses.replace(as_given, cases=Cases.of(parallel, free[:1]))
    assert "agree at all of them: all are neutrally stable." in " ".join(validate_layout(alone).sentences)


def test_poses_twice_as_fine_lie_midway(parallel):
    """Along each dimension of a grid; rotations turn halfway, whatever the sign of their quaternions."""
    grid = np.zeros((2, 3, 6))
    grid[..., 0], grid[..., 2] = [[0.2], [0.4]], 0.1
    grid[..., 1] = [0.1, 0.2, 0.4]
    grid[1, :, 5] = 0.4
    cases = Cases.of(parallel, grid, [np.zeros(6), np.ones(6)], [1, 2])
    fine = cases.finer()
    assert fine.shape == (3, 5)
    assert len(fine) == 15 * 4
    assert fine.positions[::4].reshape(3, 5, 3)[1, 3] == pytest.approx([0.3, 0.3, 0.1])
    turned = fine.rotations[::4].reshape(3, 5, 3, 3)
    assert np.arctan2(turned[:, 0, 1, 0], turned[:, 0, 0, 0]) == pytest.approx([0, 0.2, 0.4])
    assert np.array_equal(fine.wrench[:4], cases.wrench[:4])
    assert np.array_equal(fine.factors[4:8], cases.factors[:4])


def test_both_layouts_are_driven_side_by_side(better):
    """The same commands for both, from the first pose to the last."""
    before, after = driven(validate_layout(better), 4, 1.0, drive_seconds=0.5)
    assert [one.robot.name for one in (before, after)] == ["parallel, before", "parallel, after"]
    for motion in (before, after):
        assert motion.problems.positions[[0, -1]] == pytest.approx(np.array(LINE)[[0, -1]], abs=1e-9)


def test_a_seed_repeats_a_front(parallel):
    """Of the first layouts and of all that the search makes of them."""

    def scores(seed: int) -> np.ndarray:
        return cdpr.find_front(parallel, LINE, within=0.1, generations=4, population=6, seed=seed).scores

    assert np.array_equal(scores(1), scores(1))
    assert not np.array_equal(scores(1), scores(2))


def test_a_seed_repeats_and_a_store_goes_on(better, parallel, tmp_path):
    """The same layout from the same seed; interrupted and gone on with, the same as in one run."""
    store = tmp_path / "search.npz"
    first = cdpr.find_layout(parallel, LINE, within=0.1, generations=20, store=store, polish=False)
    again = cdpr.find_layout(parallel, LINE, within=0.1, generations=40, store=store)
    assert np.array_equal(again.robot.exits, better.robot.exits)
    assert again.after <= first.after
    done = cdpr.find_layout(parallel, LINE, within=0.1, generations=40, store=store)
    assert np.array_equal(done.robot.exits, better.robot.exits)
    assert len(again.history) == 40
    np.testing.assert_array_equal(again.history[:, 1], better.history[:, 1])  # of layouts evaluated
    other = cdpr.find_layout(parallel, LINE, within=0.1, generations=20, seed=1, polish=False)
    assert not np.array_equal(other.robot.exits, first.robot.exits)
    with pytest.raises(cdpr.InvalidInput, match="holds a search with other arguments"):
        cdpr.find_layout(parallel, LINE, within=0.2, store=store)
    (tmp_path / "no.npz").write_text("not a store")
    with pytest.raises(cdpr.InvalidInput, match="is not the store of a search"):
        cdpr.find_layout(parallel, LINE, within=0.2, store=tmp_path / "no.npz")
    content = bytearray(store.read_bytes())
    content[content.index(b"PK\x01\x02") + 10] ^= 64  # in the first entry of a zip file's directory: its compression
    store.write_bytes(content)
    with pytest.raises(cdpr.InvalidInput, match="or a damaged one"):
        cdpr.find_layout(parallel, LINE, within=0.1, store=store)


def test_ctrl_c_keeps_the_best_so_far(parallel, monkeypatch):
    """And says so."""
    calls = []

    def interrupted(layouts, cases, threads=None):
        calls.append(len(layouts))
        if len(calls) == 8:
            raise KeyboardInterrupt
        return solve_layouts(layouts, cases, threads)

    monkeypatch.setattr(search, "solve_layouts", interrupted)
    found = cdpr.find_layout(parallel, LINE, within=0.1)
    assert "Interrupted after 5 generations: this is the best layout so far." in str(found)
    assert found.after < found.before


def test_the_gradient_goes_on_where_evolution_stops(parallel):
    """From the same few generations, polished is better; and the tensions keep within their limits."""
    asked = dict(within=0.05, generations=5, subject_to={"tensions": (0.0, 1.9)})
    rough, smooth = (cdpr.find_layout(parallel, LINE, polish=polish, **asked) for polish in (False, True))
    assert smooth.after < 0.99 * rough.after
    assert smooth.equilibria.tensions.max() <= 1.9 * (1 + 1e-6)


def test_a_robot_that_falls_is_laid_out_so_that_it_does_not(parallel):
    """A pose above every exit, which masts reach; before, nothing rests there, and that is what is said."""
    masts = Move("exits", (0, 0.2), along=(0, 0, 1))
    found = cdpr.find_layout(parallel, [(0.4, 0.25, 0.5), (0.4, 0.25, 0.3)], move=masts, generations=5)
    assert np.isnan(found.before)
    assert "no equilibrium at some pose before" in str(found)
    assert found.equilibria.converged.all()
    assert validate_layout(found).better


@pytest.fixture(scope="module")
def two_layouts(parallel) -> tuple[LayoutEquilibria, list[list[cdpr.Equilibrium]]]:
    """Rests of two layouts, on a line and at a pose where ``parallel`` turns freely; and those of each robot alone."""
    low, high = parallel.workspace
    poses = np.random.default_rng(0).uniform(low, high, (200, 3))
    free = poses[cdpr.solve_many(parallel, poses).stability == cdpr.Stability.NEUTRAL][0]
    exits = parallel.exits.copy()
    exits[0] += (0.03, 0.04, 0.0)
    robots = [parallel, parallel.replace(exits=exits)]
    cases = Cases.of(parallel, [*LINE, tuple(free)])
    alone = [[cdpr.solve(robot, pose) for pose in [*LINE, tuple(free)]] for robot in robots]
    return solve_layouts(RobotBatch.of(robots), cases, 1), alone


def test_objectives_are_what_single_rests_say(two_layouts):
    """Worst, mean or least over the cases, one layout at a time; the frame is the diagonal of a box."""
    equilibria, alone = two_layouts
    shift = lambda one: np.linalg.norm(one.position - one.problem.pose.translation)  # noqa: E731
    expected = {
        "worst tilt": [max(one.tilt for one in row) for row in alone],
        "mean tilt": [sum(one.tilt for one in row) / 7 for row in alone],
        "worst deviation": [max(map(shift, row)) for row in alone],
        "mean deviation": [sum(map(shift, row)) / 7 for row in alone],
        "most slack cables": [max(sum(one.slack) for one in row) for row in alone],
        "mean slack cables": [sum(sum(one.slack) for one in row) / 7 for row in alone],
        "lowest tension": [min(min(one.tensions) for one in row) for row in alone],
        "highest tension": [max(max(one.tensions) for one in row) for row in alone],
        "softest stiffness": [min(min(one.eigenvalues) for one in row) for row in alone],
        "points moved": [0.0, 0.05],
        "size of frame": [np.sqrt(sum((max(x) - min(x)) ** 2 for x in row[0].problem.robot.exits.T)) for row in alone],
    }
    for name, values in expected.items():
        assert OBJECTIVES[name].score(equilibria, NO_LIMITS) == pytest.approx(values, rel=1e-5, abs=1e-5), name
    assert OBJECTIVES["worst sensitivity"].score(equilibria, NO_LIMITS)[0] == np.inf  # of a platform that turns freely


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("worst tilt", 0.1, "5.73°"), ("mean tilt", 0.1, "5.73°"), ("worst deviation", 0.0123, "12.3 mm"),
        ("mean deviation", 0.0123, "12.3 mm"), ("most slack cables", 3, "3"), ("lowest tension", 1.25, "1.25 N"),
        ("softest stiffness", 1500, "1500 N/m"), ("lowest frequency", 11.5, "11.5 Hz"),
        ("feasible volume", 0.42, "42 %"), ("worst sensitivity", 2.5, "2.5 mm/mm"), ("points moved", 0.05, "50 mm"),
        ("size of frame", 1.06, "1.06 m"), ("worst tilt", np.nan, "no equilibrium at some pose"),
    ],
)  # fmt: skip
def test_objectives_are_read_in_their_units(name: str, value: float, shown: str):
    """SI units inside; degrees, millimetres and percent where somebody reads."""
    assert OBJECTIVES[name].shown(value) == shown


def test_what_is_missing_is_counted_from_single_rests(two_layouts, parallel):
    """Of every constraint, by how much the worst case misses it: in loads, in shares of cables, rests and limits."""
    equilibria, alone = two_layouts
    asked = {
        "tensions": (0.3, 2.0), "all taut": True, "stable": True, "worst tilt": 0.1, "lowest tension": 0.5,
        "points moved": 0.04, "mean slack cables": 8.0,
    }  # fmt: skip
    found, (lower, upper), reach = constraints_of(parallel, asked)
    assert (lower.tolist(), upper.tolist(), reach) == ([0.3] * 8, [2.0] * 8, 0.04)
    missed = lambda row: max(max(0.3 - min(one.tensions), max(one.tensions) - 2.0) for one in row)  # noqa: E731
    tilts = [max(one.tilt for one in row) for row in alone]
    stable = [sum(one.stability is cdpr.Stability.STABLE for one in row) for row in alone]
    assert stable[0] < 7
    expected = [
        [missed(row) / parallel.weight for row in alone],
        [sum(sum(one.slack) for one in row) / 56 for row in alone],
        [1 - count / 7 for count in stable],
        [(tilt - 0.1) / 0.1 for tilt in tilts],
        [(0.5 - 0) / 0.5] * 2,  # slack cables pull with 0
        [0, 0.01 / 0.04],
        [0, 0],
    ]
    for constraint, values in zip(found, expected, strict=True):
        assert constraint.violation(equilibria) == pytest.approx(values, abs=1e-6), constraint.name


def test_constraints_hold_where_they_bind(parallel):
    """Without the constraint the best layout breaks it; with it, it does not, and the objective pays."""
    free = cdpr.find_layout(parallel, LINE, within=0.1, generations=20)
    assert free.largest_displacement > 0.06
    bound = cdpr.find_layout(parallel, LINE, within=0.1, generations=20, subject_to={"points moved": 0.06})
    assert bound.largest_displacement <= 0.06 * (1 + 1e-8)
    assert free.after < bound.after < bound.before
    near = cdpr.find_layout(
        cdpr.load_robot("cogiro"), LINE[:2], within=0.03, generations=4, subject_to={"clearance": 0.006}
    )
    assert cdpr.clearances(near.robot, LINE[:2], points=9).least.min() >= 0.006 * (1 - 1e-9)
    assert cdpr.clearances(cdpr.load_robot("cogiro"), LINE[:2], points=9).least.min() < 0.006


def test_tension_is_least_where_a_closed_form_says():
    """A point on two equal cables: tau = m g/(2 cos), so that the exits go as far up their masts as they may.

    To what evolution leaves of the bound: nothing holds the point's rotation, and so there is no gradient.
    """
    robot = symmetric_pair(axial_stiffness=1e7).robot
    found = cdpr.find_layout(
        robot, [(0, 0, 0)], move=Move("exits", 0.2, along=(0, 0, 1)), objective="highest tension", generations=10
    )
    x, z = robot.exits[1, [0, 2]]
    assert found.robot.exits[:, 2] == pytest.approx(z + 0.2, abs=1e-3)
    assert found.after == pytest.approx(9.81 / 2 * np.hypot(x, z + 0.2) / (z + 0.2), rel=1e-4)


@pytest.mark.parametrize("name", sorted(OBJECTIVES))
def test_every_objective_is_improved(name: str, parallel):
    """Each by its own sense; "feasible volume" cannot be, since all of these poses are feasible already."""
    moves = [Move("exits", 0.05), Move("axial_stiffness", 2.0)]
    found = cdpr.find_layout(parallel, LINE[:2], move=moves, objective=name, generations=2, population=20)
    assert np.isfinite([found.before, found.after]).all()
    assert not found.objective.better(found.before, found.after)


def test_a_function_of_ones_own_is_an_objective(parallel):
    """Of all equilibria at once, (layouts, cases)."""
    found = cdpr.find_layout(
        parallel,
        LINE,
        within=0.05,
        objective=lambda equilibria: equilibria.tilt.sum(-1),
        generations=5,
        stiffness=[0.5, 2],
    )
    assert found.after == pytest.approx(cdpr.solve_many(found.cases.problems(found.robot)).tilt.sum(), abs=1e-7)


def test_heavy_cables_are_laid_out_as_well():
    """A crane whose cables have mass: evolution alone, since there is no gradient."""
    heavy = crane().replace(linear_density=0.064)
    poses = [(-3, -2, 1.5), (3, 2, 2.5)]
    found = cdpr.find_layout(heavy, poses, within=0.3, objective="worst deviation", generations=4, population=12)
    assert found.after < found.before
    assert np.linalg.norm(cdpr.solve_many(found.robot, poses).deviation, axis=-1).max() == pytest.approx(found.after)


def test_a_front_trades_displacement_against_tilt(parallel):
    """Nothing on it is better than another in both; its ends are the robot as given and one that tilts far less."""
    pytest.importorskip("pymoo")
    front = cdpr.find_front(parallel, LINE, within=0.1, generations=10, population=20)
    fewer, last = front.thinned(2), len(front) - 1
    np.testing.assert_array_equal(fewer.scores, front.scores[[0, last]])
    np.testing.assert_array_equal(fewer.robot(1).exits, front.robot(last).exits)
    moved, tilt = front.scores.T
    assert moved[0] == 0
    assert tilt[0] == pytest.approx(front.before[1])
    assert tilt[-1] < 0.8 * tilt[0]
    better = (front.scores[:, None] <= front.scores).all(-1) & (front.scores[:, None] < front.scores).any(-1)
    assert not better.any()
    assert cdpr.solve_many(front.robot(len(front) - 1), LINE).tilt.max() == pytest.approx(tilt[-1], abs=1e-9)
    with pytest.raises(cdpr.InvalidInput, match="satisfies all constraints"):
        cdpr.find_front(parallel, LINE, within=0.01, generations=1, population=5, subject_to={"lowest tension": 9.0})
