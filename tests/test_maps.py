import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.files import check_place
from cdpr_sim.drawing import maps, style

PLANE = {"x": np.linspace(0.1, 0.7, 13), "z": np.linspace(0.05, 0.4, 8)}
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]


@pytest.fixture(scope="module")
def dataset():
    """Both layouts and materials in the plane of the paper's Fig. 10 and 11."""
    return cdpr.sweep(["parallel", "cogiro"], PLANE, MATERIALS)


def meshes(ax):
    """Colour meshes of a panel, the last drawn last."""
    from matplotlib.collections import QuadMesh

    return [artist for artist in ax.collections if isinstance(artist, QuadMesh)]


def panels(figure):
    """Axes that are maps, row by row (the rest are colour bars)."""
    return [ax for ax in figure.axes if ax.get_label() == "panel"]


def test_map_draws_what_the_sweep_found_on_shared_scales(dataset):
    """Rows of four panels: the numbers in each are the dataset's, in degrees, millimetres and cables."""
    figure = maps.draw_elastic_map(dataset)
    axes = np.array(panels(figure)[:12]).reshape(3, 4)
    factors = {"tilt": 180 / np.pi, "distance": 1e3, "slack_count": 1.0}
    for row, (name, factor) in zip(axes, factors.items(), strict=True):
        limits = {meshes(ax)[-1].get_clim() for ax in row}
        assert len(limits) == 1
        for ax, (robot, material) in zip(row, [(r, m) for r in ("parallel", "cogiro") for m in MATERIALS], strict=True):
            one = dataset[name].sel(robot=robot).squeeze("y")
            one = one.sel(material=material) if "material" in one.dims else one
            drawn = np.ma.filled(meshes(ax)[-1].get_array().astype(float), np.nan)
            np.testing.assert_allclose(drawn, one.transpose("z", "x") * factor, rtol=1e-12, atol=0)
    texts = [text.get_text() for text in figure.texts]
    for word in ("parallel", "cogiro", *MATERIALS, "tilt [°]", "deviation [mm]", "slack cables", "feasible"):
        assert word in texts


def test_map_shows_frame_and_exits(dataset):
    """The outline is the robot's own, at its place."""
    figure = maps.draw_elastic_map(dataset, names=["tilt"])
    (outline,) = [patch for patch in panels(figure)[0].patches if patch.get_label() == "frame"]
    assert outline.get_bbox().extents.tolist() == [0, 0, 0.8, 0.5]
    exits = panels(figure)[0].lines[0].get_xydata()
    np.testing.assert_array_equal(exits, cdpr.load_robot("parallel").exits[:, [0, 2]])


def test_pose_without_equilibrium_is_grey():
    """Above the exits nothing is drawn over the grey, in the row of tilt as in that of slack cables."""
    dataset = cdpr.sweep("parallel", {"x": [0.3, 0.5], "z": [0.2, 0.6]})
    figure = maps.draw_elastic_map(dataset)
    for ax in panels(figure)[:3]:
        assert np.ma.masked_invalid(meshes(ax)[-1].get_array()).mask.tolist() == [[False, False], [True, True]]


@pytest.mark.parametrize("plane", [{"x": PLANE["x"], "y": [0.2, 0.3]}, {"y": [0.2, 0.25, 0.3], "z": PLANE["z"]}])
def test_any_plane_can_be_drawn(plane):
    """Seen from above and along x as well; one robot, its own material."""
    figure = maps.draw_elastic_map(cdpr.sweep("parallel", plane))
    assert len(panels(figure)) == 4


def test_agreement_map_draws_the_outcomes():
    """Agreement, and how well, in two rows."""
    flat = cdpr.check("cogiro", (4, 2, 3)).across()
    figure = maps.draw_agreement_map(flat)
    assert len(panels(figure)) == 2
    assert [text.get_text() for text in figure.axes[1].get_yticklabels()] == ["agree"]
    assert any("the worst along y" in text.get_text() for text in figure.texts)


def test_every_outcome_has_a_colour():
    """Also those that nobody wants to see."""
    from cdpr_sim.crosscheck.check import OUTCOMES

    assert set(style.MAP_OUTCOMES) == set(OUTCOMES)


@pytest.mark.parametrize("grid", [(3, 2, 2), (3, 1, 1)])
def test_map_refuses_what_is_no_plane(grid):
    """It does not choose a plane of its own."""
    with pytest.raises(cdpr.InvalidInput, match="expected a plane"):
        maps.draw_elastic_map(cdpr.sweep("cogiro", grid))


def test_map_refuses_a_dataset_without_the_variable():
    """And names it."""
    with pytest.raises(cdpr.InvalidInput, match="no variable 'distance'"):
        maps.draw_elastic_map(cdpr.sweep("cogiro", (3, 1, 3), quantities=["tilt"]))


@pytest.mark.parametrize("largest", [1e-9, 0.062, 0.3, 1, 1.9, 2.2, 4.9, 7, 41.2, 64, 99.9, 3e5])
def test_levels_are_three_to_six_round_numbers(largest):
    """1, 2 or 5 times a power of ten apart, the highest within the data."""
    levels = maps._round_levels(largest)
    assert 2 <= len(levels) <= 6
    assert levels[-1] <= largest * (1 + 1e-9)
    digits = levels[0] / 10 ** np.floor(np.log10(levels[0]) + 1e-9)
    assert round(digits, 6) in (1, 2, 5)


def test_picture_is_written_whole_or_not_at_all(dataset, tmp_path):
    """A picture that exists is not replaced unasked, and survives a failed attempt to replace it."""
    figure = maps.draw_elastic_map(dataset, names=["tilt"])
    for suffix in maps.SUFFIXES:
        maps.write(figure, tmp_path / f"map{suffix}")
        with pytest.raises(cdpr.InvalidInput, match="exists"):
            check_place(tmp_path / f"map{suffix}", maps.SUFFIXES, field="output")
    before = (tmp_path / "map.png").read_bytes()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    figure.savefig = full
    with pytest.raises(cdpr.StoreError, match="No space left on device"):
        maps.write(figure, tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize(("name", "message"), [("map.bmp", "ends in"), ("nowhere/map.png", "no folder")])
def test_picture_that_cannot_be_is_refused(tmp_path, name, message):
    """Before anything is computed."""
    with pytest.raises(cdpr.InvalidInput, match=message):
        check_place(tmp_path / name, maps.SUFFIXES, field="output")
