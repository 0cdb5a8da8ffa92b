import numpy as np
import pytest

from cdpr_sim.analysis.workspace.grids import AXES, DEFAULT, as_grid, plane


def test_counts_fill_the_workspace_from_face_to_face(catalogue):
    """The first and last coordinates are the workspace's faces, the default is ten thousand poses."""
    robot = catalogue["parallel"]
    axes = as_grid(None, [robot])
    assert tuple(len(axes[name]) for name in AXES) == DEFAULT
    for i, name in enumerate(AXES):
        assert (axes[name][0], axes[name][-1]) == tuple(robot.workspace[:, i])


def test_one_position_along_an_axis_is_the_middle(catalogue):
    """A count of 1, and an axis that is left out, both mean the middle of the workspace."""
    robot = catalogue["parallel"]
    assert as_grid((3, 1, 2), [robot])["y"].tolist() == [0.25]
    assert as_grid({"x": [0.2, 0.3]}, [robot])["y"].tolist() == [0.25]


def test_planar_robot_stays_in_its_plane_whatever_the_counts(catalogue):
    """Its workspace has no width in y, so there is one y = 0."""
    robot = catalogue["two-cable"]
    assert as_grid((3, 7, 2), [robot])["y"].tolist() == [0.0]


def test_robots_of_different_workspaces_need_coordinates(catalogue):
    """By name: then nobody has to guess whose workspace is meant."""
    robots = [catalogue["parallel"], catalogue["planar-vertical"]]
    assert len(as_grid({"x": [0.4], "y": [0.0], "z": [0.2]}, robots)["x"]) == 1


def test_plane_is_square_and_lies_where_it_is_told(catalogue):
    """181 poses along 0.6 m of x give 106 along 0.35 m of z."""
    axes = plane("xz", 0.2, 181, [catalogue["parallel"]])
    assert [len(axes[name]) for name in AXES] == [181, 1, 106]
    assert axes["y"].tolist() == [0.2]
    assert np.diff(axes["x"]).mean() == pytest.approx(np.diff(axes["z"]).mean(), rel=0.01)  # counts are rounded
