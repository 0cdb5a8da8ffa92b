"""Limits of force in robots and their files, and the workspaces within them: volume, hull and map."""

import copy

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.grids import extent_of
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.cli import app
from cdpr_sim.drawing import maps

WIREX = (5.731436529861277, 17.789244457956457, (0, 0, 1))
"""Volume [m³], surface [m²] and centre of the workspace of IPAnema 1, by WireX's README (github.com/gldkhoward/WireX),
which lets WireX compute them by its defaults."""

ROUNDING = 1e-13
"""Relative: sums of the same 512 tetrahedra in another order."""

PUSHES = np.vstack([np.eye(6), -np.eye(6)])[[0, 1, 2, 6, 7, 8]]
"""A newton each way along x, y and z."""


@pytest.fixture(scope="module")
def wirex(catalogue):
    """IPAnema 1 as WireX has it by default: no load, 1 to 10 N."""
    return catalogue["ipanema-1"].replace(gravity=0.0, force_min=1.0, force_max=10.0)


def test_wirex_number_for_its_ipanema_is_reproduced_to_the_last_digits(wirex):
    """A sphere of 512 triangles, rays bisected from 12 m to 0.1 mm, tensions by the closed form amid 1 and 10 N."""
    hull = cdpr.workspace_hull(wirex, closed_form=True, depth=3, reach=12.0, tolerance=1e-4)
    assert hull.triangles.shape == (512, 3)
    assert (hull.volume, hull.surface) == pytest.approx(WIREX[:2], rel=ROUNDING)
    assert hull.centroid == pytest.approx(WIREX[2], abs=1e-12)


@pytest.mark.parametrize(
    "change", [{"force_max": 10.01}, {"force_min": 1.01}, {"gravity": 0.01}, {"anchors": 1.01}], ids=str
)
def test_a_robot_that_is_a_little_different_has_another_volume(wirex, change):
    """Negative control: limits 0.1 or 1 % off, a weight of a quarter newton, a platform 1 % larger."""
    if "anchors" in change:
        change = {"anchors": change["anchors"] * wirex.anchors}
    hull = cdpr.workspace_hull(wirex.replace(**change), closed_form=True, depth=3, reach=12.0)
    assert abs(hull.volume - WIREX[0]) > 1e-4


def test_the_closed_form_gives_up_on_poses_that_other_tensions_hold(wirex):
    """A subset of what is feasible; and that hull is 63 % larger: WireX's number is a lower bound, twice over."""
    positions = np.random.default_rng(0).uniform(*wirex.frame, (2000, 3))
    closed, any_ = cdpr.closed_form_feasible(wirex, positions), cdpr.feasible(wirex, positions)
    assert not (closed & ~any_).any()
    assert (any_ & ~closed).sum() > 200
    hull = cdpr.workspace_hull(wirex, depth=3)
    assert hull.volume == pytest.approx(9.34, abs=0.01)
    finer = cdpr.workspace_hull(wirex, closed_form=True, depth=5)
    assert finer.volume == pytest.approx(1.014 * WIREX[0], rel=1e-3)
    assert cdpr.workspace_hull(wirex, depth=5).volume == pytest.approx(9.75, abs=0.01)


@pytest.mark.parametrize(("most", "holds"), [(9.0, False), (11.0, True)])
def test_the_closed_form_keeps_the_largest_tension_as_well(most, holds):
    """A mass of 10 N on one plumb cable."""
    robot = cdpr.Robot([[0, 0, 2]], [[0, 0, 0]], 1e4, 1.0, gravity=10.0, platform_size=(0.1, 0.1, 0.1))
    assert cdpr.closed_form_feasible(robot, [0, 0, 1], tension_limits=(0, most)) == holds


def test_volume_surface_and_centroid_of_a_hull_do_not_depend_on_where_rays_come_from():
    """A corner cut off a cube: a sixth of it, three halves of faces and the cut, a quarter of the way to each side."""
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for center in ([0.1, 0.2, 0.3], [0.3, 0.1, 0.05]):
        hull = Hull(np.array(center), corner, faces)
        assert (hull.volume, hull.surface) == pytest.approx((1 / 6, 1.5 + np.sqrt(3) / 2))
        assert hull.centroid == pytest.approx(np.full(3, 0.25))


def test_a_mass_on_cables_from_all_corners_can_be_anywhere_between_them(wirex):
    """Without limits the wrench-feasible workspace is the convex hull of the exits: a box, vertex by vertex."""
    mass = copy.copy(wirex.replace(anchors=np.zeros((8, 3)), platform_size=(0.1, 0.1, 0.1)))
    hull = cdpr.workspace_hull(mass, tension_limits=(0, np.inf), wrenches=PUSHES, depth=4, tolerance=1e-6)
    beyond = np.abs((hull.vertices - (0, 0, 1)) / (2, 1.5, 1)).max(1)
    assert beyond == pytest.approx(1, abs=2e-6)
    assert 0.97 * 24 < hull.volume < 24
    one_sided = cdpr.workspace_hull(mass.replace(force_max=100.0), wrenches=PUSHES * 50, depth=2)
    assert one_sided.volume < 0.8 * hull.volume


def test_what_hangs_from_above_ends_at_the_frame(catalogue):
    """A crane holds its load however deep below the floor: rays end at the frame's faces, or where they are told to."""
    robot = catalogue["cogiro"]
    hull = cdpr.workspace_hull(robot, center=(0.4, 0.25, 0.2), depth=3)
    assert (hull.vertices >= robot.frame[0] - 1e-9).all()
    assert hull.vertices[:, 2].min() == pytest.approx(0, abs=1e-9)
    deeper = cdpr.workspace_hull(robot, center=(0.4, 0.25, 0.2), depth=3, reach=2.0)
    assert deeper.vertices[:, 2].min() == pytest.approx(-1.8)


def test_a_robots_own_limits_are_those_of_its_workspace(wirex):
    """``feasible``, ``shortfall``, margins and sweeps, by default; given ones go first."""
    free = wirex.replace(force_min=0.0, force_max=np.inf)
    positions = np.random.default_rng(1).uniform(*wirex.frame, (300, 3))
    limits = (1.0, 10.0)
    own = cdpr.feasible(wirex, positions)
    assert (own == cdpr.feasible(free, positions, tension_limits=limits)).all()
    assert 0 < own.sum() < len(own)
    assert cdpr.feasible(free, positions).all()  # without load, slack cables do
    assert cdpr.feasible(wirex, positions, tension_limits=(0, np.inf)).all()
    swept = cdpr.sweep([wirex, free.replace(name="free")], (5, 4, 3), quantities=["feasible"])
    assert swept.feasible.sel(robot="free").all()
    grid = np.stack(np.meshgrid(swept.x, swept.y, swept.z, indexing="ij"), axis=-1)
    assert (swept.feasible.sel(robot="ipanema-1").values == cdpr.feasible(wirex, grid)).all()
    assert swept.attrs["tension_limits"] == [0.0, np.inf]


def test_limits_play_no_part_in_where_a_platform_rests(catalogue):
    """The two methods' answers are to the same question; a copy keeps its limits, and they are read-only."""
    robot = catalogue["cogiro"]
    limited = robot.replace(force_min=0.1, force_max=[1.0] * 4 + [np.inf] * 4)
    assert cdpr.compare(cdpr.solve(robot, robot.home), cdpr.settle(limited, robot.home)).agrees
    again = copy.deepcopy(limited)
    assert again.force_max.tolist() == [1.0] * 4 + [np.inf] * 4
    with pytest.raises(ValueError, match="read-only"):
        again.force_min[0] = 1


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"force_min": 5, "force_max": 2}, "force_min: found 5 N above force_max, 2 N, in cable 1; expected force_min"),
        ({"force_min": [0] * 7 + [9], "force_max": 8}, "found 9 N above force_max, 8 N, in cable 8"),
        ({"force_min": -1}, "force_min: found -1 N in cable 1, expected 0 or more"),
        ({"force_min": np.inf}, "force_min: found inf, expected finite numbers"),
        ({"force_max": 0}, "force_max: found 0 N in cable 1, expected more than 0"),
        ({"force_max": -np.inf}, "force_max: found -inf, expected finite numbers"),
        ({"force_max": np.nan}, "force_max: found nan, expected finite numbers"),
        ({"force_max": [1, 2]}, r"force_max: found an array of shape \(2,\)"),
        ({"force_max": "many"}, "force_max: found 'many', expected numbers"),
    ],
)
def test_limits_that_cannot_be_right_are_refused(catalogue, limits, said):
    """One sentence: which, in which cable, what was found, what is expected."""
    with pytest.raises(cdpr.InvalidInput, match=said):
        catalogue["cogiro"].replace(**limits)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (dict(center=(1.9, 1.4, 1.9)), "center: found .1.9, 1.4, 1.9. m, which is not feasible"),
        (dict(center=(0, 0, 3)), "center: found .0, 0, 3. m, outside the robot's frame"),
        (dict(reach=0), "reach: found 0 m, expected more than 0"),
        (dict(depth=8), "depth: found 8, expected 0 to 7"),
        (dict(tolerance=0.0), "tolerance: found 0 m"),
        (dict(closed_form=True, tension_limits=(1, np.inf)), "found no largest tension in cable 1"),
        (dict(tension_limits=(2, 1)), "tau_min <= tau_max"),
        (dict(orientation=(0, 0)), "orientation: found an array of shape"),
    ],
)
def test_a_hull_that_cannot_be_is_refused(wirex, ask, said):
    """One sentence each."""
    with pytest.raises(cdpr.InvalidInput, match=said):
        cdpr.workspace_hull(wirex, **ask)


def test_a_planar_robot_has_no_volume(catalogue):
    """And its sentence says so."""
    with pytest.raises(cdpr.InvalidInput, match="which is planar, expected a spatial one"):
        cdpr.workspace_hull(catalogue["planar-vertical"])


def test_extent_is_that_of_a_box():
    """A mask of everything is the grid's own volume, area or length; of half of it half, to half a cell."""
    for axes, whole in (((5, 4, 3), 6.0), ((5, 1, 3), 3.0), ((1, 4, 1), 2.0)):
        coords = [(name, np.linspace(0, size, n)) for name, size, n in zip("xyz", (1, 2, 3), axes, strict=True)]
        mask = xr.DataArray(np.ones(axes, dtype=bool), coords=coords)
        assert extent_of(mask) == pytest.approx(whole, rel=1e-12)
    coords = [("x", np.linspace(0, 1, 101)), ("y", [0, 2]), ("z", [0, 3])]
    fine = xr.DataArray(np.ones((101, 2, 2), dtype=bool), coords=coords)
    assert extent_of(fine & (fine.x <= 0.5)) == pytest.approx(3, abs=0.05)


FILE = """
name = "limited"
axial_stiffness = 1e4
force_min = 2
force_max = 90
[platform]
mass = 1
size = [0.1, 0.1, 0.1]
[[cables]]
exit = [-1, 0, 2]
anchor = [-0.05, 0, 0]
force_max = 40
[[cables]]
exit = [1, 0, 2]
anchor = [0.05, 0, 0]
force_min = 0
"""


def test_a_robot_file_says_limits_for_all_cables_or_for_one(tmp_path):
    """In newtons; what a cable says of its own goes first. A mistake names the file."""
    file = tmp_path / "limited.toml"
    file.write_text(FILE)
    robot = cdpr.load_robot(file)
    assert robot.force_min.tolist() == [2, 0]
    assert robot.force_max.tolist() == [40, 90]
    file.write_text(FILE.replace("force_max = 40", "force_max = 1"))
    with pytest.raises(cdpr.RobotFileError, match=r"limited\.toml: force_min: found 2 N above force_max, 1 N"):
        cdpr.load_robot(file)


def test_sweep_and_map_take_wrenches_and_say_volumes(tmp_path):
    """Each workspace's volume, in m³ over a grid and m² in a map; a panel for what holds all the wrenches."""
    run = CliRunner().invoke
    result = run(app, ["sweep", "ipanema-1", "--grid", "5", "5", "5", "--wrenches", "0,0,-300,0,0,0"])
    assert result.exit_code == 0, result.output
    swept = cdpr.sweep("ipanema-1", (5, 5, 5), wrenches=[0, 0, -300.0, 0, 0, 0], quantities=["feasible"])
    static, loaded = (f"{extent_of(swept[name]):.4g}" for name in ("feasible", "wrench_feasible"))
    told = (
        f"ipanema-1 with rigid cables: static feasible workspace {static}, wrench-feasible workspace {loaded}, of 3 m³."
    )
    assert told in " ".join(result.stdout.split())
    picture = tmp_path / "map.png"
    result = run(
        app, ["map", "ipanema-1", "-o", str(picture), "--points", "9", "--wrenches", "200,0,0,0,0,0",
              "--wrenches=-200,0,0,0,0,0"]
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert ", of 2 m²." in " ".join(result.stdout.split())
    result = run(app, ["sweep", "ipanema-1", "--grid", "2", "2", "2", "--wrenches", "1,2,3"])
    assert (result.exit_code, "--wrenches: found '1,2,3', expected six numbers" in result.stderr) == (2, True)


def test_the_map_shows_what_holds_all_wrenches_with_its_own_border(catalogue):
    """The panel's share and outline are of that mask, not of the static feasible workspace's."""
    robot = catalogue["ipanema-1"]
    plane = {"x": np.linspace(-1.9, 1.9, 21), "z": np.linspace(0.1, 1.9, 11)}
    names = ["feasible", "capacity_margin"]
    dataset = cdpr.sweep(robot, plane, wrenches=[0, 0, -1500.0, 0, 0, 0], quantities=names)
    figure = maps.draw_elastic_map(dataset, names=["feasible", "wrench_feasible"])
    shares = [text.get_text() for ax in figure.axes for text in ax.texts]
    for name in ("feasible", "wrench_feasible"):
        share = 100 * float(dataset[name].mean())
        assert any(f"{share:.0f}" in text or f"{share:.1f}" in text for text in shares), (name, share, shares)
    assert float(dataset.wrench_feasible.mean()) < float(dataset.feasible.mean())
    assert "feasible for\nall wrenches" in [text.get_text() for text in figure.texts]
