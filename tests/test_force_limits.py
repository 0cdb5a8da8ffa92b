"""Limits of force in robots and their files, and the workspaces within them: volume, hull and map."""

import copy

import numpy as np
import pytest
import xarray as xr

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.grids import extent_of
from cdpr_sim.analysis.workspace.hull import Hull
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


@pytest.mark.parametrize("change", [{"force_max": 10.01}, {"force_min": 1.01}, {"gravity": 0.01}, {"anchors": 1.01}])
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
    assert cdpr.workspace_hull(wirex, depth=3).volume == pytest.approx(9.34, abs=0.01)
    finer = cdpr.workspace_hull(wirex, closed_form=True, depth=5)
    assert finer.volume == pytest.approx(1.014 * WIREX[0], rel=1e-3)
    assert cdpr.workspace_hull(wirex, depth=5).volume == pytest.approx(9.75, abs=0.01)


@pytest.mark.parametrize(("most", "holds"), [(9.0, False), (11.0, True)])
def test_the_closed_form_keeps_the_largest_tension_as_well(most, holds):
    """A mass of 10 N on one plumb cable."""
    robot = cdpr.Robot([[0, 0, 2]], [[0, 0, 0]], 1e4, 1.0, gravity=10.0, platform_size=(0.1, 0.1, 0.1))
    assert cdpr.closed_form_feasible(robot, [0, 0, 1], tension_limits=(0, most)) == holds


@pytest.mark.parametrize("center", [[0.1, 0.2, 0.3], [0.3, 0.1, 0.05]])
def test_volume_surface_and_centroid_of_a_hull_do_not_depend_on_where_rays_come_from(center):
    """A corner cut off a cube: a sixth of it, three halves of faces and the cut, a quarter of the way to each side."""
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    hull = Hull(np.array(center), corner, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert (hull.volume, hull.surface) == pytest.approx((1 / 6, 1.5 + np.sqrt(3) / 2))
    assert hull.centroid == pytest.approx(np.full(3, 0.25))


def test_a_mass_on_cables_from_all_corners_can_be_anywhere_between_them(wirex):
    """Without limits the wrench-feasible workspace is the convex hull of the exits: a box, vertex by vertex."""
    mass = copy.copy(wirex.replace(anchors=np.zeros((8, 3)), platform_size=(0.1, 0.1, 0.1)))
    hull = cdpr.workspace_hull(mass, tension_limits=(0, np.inf), wrenches=PUSHES, depth=4, tolerance=1e-6)
    assert np.abs((hull.vertices - (0, 0, 1)) / (2, 1.5, 1)).max(1) == pytest.approx(1, abs=2e-6)
    assert 0.97 * 24 < hull.volume < 24
    one_sided = cdpr.workspace_hull(mass.replace(force_max=100.0), wrenches=PUSHES * 50, depth=2)
    assert one_sided.volume < 0.8 * hull.volume


def test_what_hangs_from_above_ends_at_the_frame(catalogue):
    """A crane holds its load however deep below the floor: rays end at the frame's faces, or where they are told to."""
    robot = catalogue["cogiro"]
    for reach, lowest in (({}, 0.0), ({"reach": 2.0}, -1.8)):
        hull = cdpr.workspace_hull(robot, center=(0.4, 0.25, 0.2), depth=3, **reach)
        assert hull.vertices[:, 2].min() == pytest.approx(lowest, abs=1e-9)
        assert reach or (hull.vertices >= robot.frame[0] - 1e-9).all()


def test_a_robots_own_limits_are_those_of_its_workspace(wirex, catalogue):
    """``feasible``, margins and sweeps, by default; given ones go first; where a platform rests does not know them."""
    free = wirex.replace(force_min=0.0, force_max=np.inf)
    positions, limits = np.random.default_rng(1).uniform(*wirex.frame, (300, 3)), (1.0, 10.0)
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
    robot = catalogue["cogiro"]
    limited = robot.replace(force_min=0.1, force_max=[1.0] * 4 + [np.inf] * 4)
    assert cdpr.compare(cdpr.solve(robot, robot.home), cdpr.settle(limited, robot.home)).agrees


@pytest.mark.parametrize(("cells", "whole"), [((5, 4, 3), 6.0), ((5, 1, 3), 3.0), ((1, 4, 1), 2.0)])
def test_extent_is_that_of_a_box(cells, whole):
    """A mask of everything is the grid's own volume, area or length; of half of it half, to half a cell."""
    coords = [(name, np.linspace(0, size, n)) for name, size, n in zip("xyz", (1, 2, 3), cells, strict=True)]
    assert extent_of(xr.DataArray(np.ones(cells, dtype=bool), coords=coords)) == pytest.approx(whole, rel=1e-12)
    coords = [("x", np.linspace(0, 1, 101)), ("y", [0, 2]), ("z", [0, 3])]
    fine = xr.DataArray(np.ones((101, 2, 2), dtype=bool), coords=coords)
    assert extent_of(fine & (fine.x <= 0.5)) == pytest.approx(3, abs=0.05)


def test_the_map_shows_what_holds_all_wrenches_with_its_own_border(catalogue):
    """The panel's share and outline are of that mask, not of the static feasible workspace's."""
    plane = {"x": np.linspace(-1.9, 1.9, 21), "z": np.linspace(0.1, 1.9, 11)}
    names, loads = ["feasible", "capacity_margin"], [0, 0, -1500.0, 0, 0, 0]
    dataset = cdpr.sweep(catalogue["ipanema-1"], plane, wrenches=loads, quantities=names)
    figure = maps.draw_elastic_map(dataset, names=["feasible", "wrench_feasible"])
    shares = [ax.get_title(loc="left") for ax in figure.axes]
    for name in ("feasible", "wrench_feasible"):
        share = 100 * float(dataset[name].mean())
        assert any(f"{share:.0f}" in text or f"{share:.1f}" in text for text in shares), (name, share, shares)
    assert float(dataset.wrench_feasible.mean()) < float(dataset.feasible.mean())
    assert "feasible for\nall wrenches" in [ax.get_ylabel() for ax in figure.axes]


def test_a_pose_that_is_no_number_is_not_held():
    """It is a mark, as elsewhere: no LinAlgError of NumPy's."""
    held = cdpr.closed_form_feasible(cdpr.load_robot("ipanema-1"), [[0, 0, 1], [np.nan, 0, 1]])
    assert held.tolist() == [True, False]
