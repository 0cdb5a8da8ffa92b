import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb

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


def test_maps_fill_their_panels():
    """Whatever part of its frame a grid covers: the cells reach from edge to edge, also of coarse and slender grids."""
    for plane in (PLANE, {"x": [0.3, 0.5], "z": [0.1, 0.15, 0.2]}, {"x": np.linspace(0.1, 0.7, 40), "z": [0.2, 0.21]}):
        dataset = cdpr.sweep("cogiro", plane, quantities=maps.QUANTITIES)
        figure = maps.draw_elastic_map(dataset, names=["slack_count", "feasible"])
        for ax in panels(figure):
            corners = meshes(ax)[-1].get_coordinates()
            assert [*ax.get_xlim()] == pytest.approx(corners[0, [0, -1], 0], rel=1e-9)
            assert [*ax.get_ylim()] == pytest.approx(corners[[0, -1], 0, 1], rel=1e-9)
        feasible = panels(figure)[-1].collections[-1].get_paths()[0].get_extents()
        assert feasible.extents == pytest.approx([*corners[0, 0], *corners[-1, -1]], rel=1e-9)
        height = figure.get_figheight()
        least = min(ax.get_position().height * height for ax in figure.axes if ax.get_label() == "bar")
        assert least >= style.MAP_HEIGHT[0] - 1e-9


def test_a_small_picture_shows_where_in_the_frame_the_maps_lie(dataset):
    """One for each robot, above its name: its frame and exits, and shaded the grid, all on one scale."""
    figure = maps.draw_elastic_map(dataset, names=["tilt"])
    located = [ax for ax in figure.axes if ax.get_label() == "locator"]
    figure.draw_without_rendering()
    for ax, robot in zip(located, ("parallel", "cogiro"), strict=True):
        shown = {patch.get_label(): patch.get_bbox().extents.tolist() for patch in ax.patches}
        assert shown["frame"] == [0, 0, 0.8, 0.5]
        assert shown["maps"] == pytest.approx([0.1 - 0.025, 0.05 - 0.025, 0.7 + 0.025, 0.4 + 0.025])
        np.testing.assert_array_equal(ax.lines[0].get_xydata(), cdpr.load_robot(robot).exits[:, [0, 2]])
        box, size = ax.get_window_extent(), np.array([0.8, 0.5])
        assert box.width / box.height == pytest.approx(size[0] / size[1], rel=0.05)
        name = next(text for text in figure.texts if text.get_text() == robot)
        assert box.x0 < name.get_window_extent().get_points()[:, 0].mean() < box.x1
        assert name.get_window_extent().y1 < box.y0


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


def test_picture_is_written_whole_or_not_at_all(four, tmp_path):
    """A picture that exists is not replaced unasked, and survives a failed attempt to replace it."""
    figure = maps.draw_elastic_map(four, names=["feasible"])
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


def shown(ax) -> np.ndarray:
    """Colour of each cell of a panel, as it is seen: of the mesh on top that is not transparent there."""
    seen = None
    for mesh in meshes(ax):
        colors = mesh.to_rgba(np.ma.masked_invalid(mesh.get_array()))
        words = np.vectorize(to_hex, signature="(n)->()")(colors)
        seen = words if seen is None else np.where(colors[..., 3] > 0, words, seen)
    assert seen is not None
    return seen


def bar(figure, row: int = 0) -> dict[str, str]:
    """What each colour of a row's bar is called."""
    ax = [ax for ax in figure.axes if ax.get_label() == "bar"][row]
    mesh = meshes(panels(figure)[row])[-1]
    labels = [label.get_text() for label in ax.get_yticklabels()]
    return dict(zip(labels, [to_hex(color) for color in mesh.to_rgba(ax.get_yticks())], strict=True))


@pytest.fixture(scope="module")
def four():
    """A pose in each corner, to be given other numbers."""
    return cdpr.sweep("cogiro", {"x": [0.3, 0.5], "z": [0.1, 0.2]})


def given(dataset, **values):
    """A copy of the dataset with these numbers at (x, z)."""
    return dataset.assign({name: dataset[name].copy(data=np.reshape(v, (2, 1, 2))) for name, v in values.items()})


def test_notes_say_the_largest_number_in_its_unit(four):
    """0.4 rad is 22.9°, 12.3 mm are 0.0123 m; half of a degree's thousandth is not told apart."""
    numbers = {"tilt": [[0.1, 0.2], [0.3, 0.4]], "distance": [[0.0, 0.0], [0.0123, 0.001]]}
    figure = maps.draw_elastic_map(given(four, **numbers), names=["tilt", "distance"])
    assert [ax.texts[0].get_text() for ax in panels(figure)] == ["at most 23°", "at most 12 mm"]
    small = given(four, tilt=np.radians([[0, 0], [0, 5e-4]]))
    assert panels(maps.draw_elastic_map(small, names=["tilt"]))[0].texts[0].get_text() == "less than 0.001°"


def test_feasible_poses_are_green_and_called_yes(four):
    """The others are not; x goes to the right and z up."""
    figure = maps.draw_elastic_map(given(four, feasible=[[True, False], [True, True]]), names=["feasible"])
    yes, no = style.MAP_FEASIBLE, style.MAP_INFEASIBLE
    assert shown(panels(figure)[0]).tolist() == [[yes, yes], [no, yes]]
    assert bar(figure) == {"no": no, "yes": yes}
    green, grey = to_rgb(yes), to_rgb(no)
    assert green[1] > 1.4 * green[0]
    assert np.ptp(grey) == 0


def test_only_poses_without_equilibrium_are_grey(four):
    """Nor is one coloured, of slack cables or of tilt; paler to darker as cables go slack."""
    numbers = {"tilt": [[0.1, np.nan], [0.3, 0.4]], "slack_count": [[0, np.nan], [2, 1]]}
    tilt, slack = panels(maps.draw_elastic_map(given(four, **numbers), names=["tilt", "slack_count"]))
    for ax in (tilt, slack):
        assert (shown(ax) == style.MAP_UNSOLVED).tolist() == [[False, False], [True, False]]
    assert shown(slack)[[0, 0, 1], [0, 1, 1]].tolist() == [style.MAP_SLACK[n] for n in (0, 2, 1)]
    darkness = [sum(to_rgb(color)) for color in shown(tilt)[[0, 0, 1], [0, 1, 1]]]
    assert darkness[0] > darkness[1] > darkness[2]  # 0.1, 0.3 and 0.4 rad


def test_each_outcome_has_its_own_colour_and_name():
    """In the panel as beside the bar, whichever of them there are."""
    checked = cdpr.check("cogiro", {"x": [0.3, 0.5], "z": [0.1, 0.2]}).dataset
    code = {name: i for i, name in enumerate(checked["outcome"].attrs["flag_meanings"].split())}
    words = [["agree", "refused"], ["disagree", "agree_except_neutral"]]
    checked["outcome"][:] = np.reshape([code[word] for row in words for word in row], checked["outcome"].shape)
    figure = maps.draw_agreement_map(checked)
    assert shown(panels(figure)[0]).tolist() == [[style.MAP_OUTCOMES[row[z]] for row in words] for z in (0, 1)]
    names = {
        "agree": "agree",
        "agree\nexcept neutral": "agree_except_neutral",
        "disagree": "disagree",
        "refused": "refused",
    }
    assert bar(figure) == {label: style.MAP_OUTCOMES[name] for label, name in names.items()}


def test_maps_label_their_axes_and_their_columns(dataset):
    """The plane's own two axes, in metres; robots and materials above the panels that show them."""
    figure = maps.draw_elastic_map(dataset, names=["tilt"])
    left, *_ = panels(figure)
    assert (left.get_xlabel(), left.get_ylabel()) == ("x [m]", "z [m]")
    above = {text.get_text(): text.get_position()[0] for text in figure.texts}
    middles = [ax.get_position().x0 + ax.get_position().width / 2 for ax in panels(figure)]
    assert above["parallel"] == pytest.approx(np.mean(middles[:2]))
    assert above["cogiro"] == pytest.approx(np.mean(middles[2:]))
    columns = [text for text in figure.texts if text.get_text() in MATERIALS]
    assert [text.get_text() for text in columns] == MATERIALS * 2
    assert [text.get_position()[0] for text in columns] == pytest.approx(middles)
    over = maps.draw_elastic_map(cdpr.sweep("parallel", {"x": [0.3, 0.4], "y": [0.2, 0.3]}), names=["tilt"])
    assert (panels(over)[0].get_xlabel(), panels(over)[0].get_ylabel()) == ("x [m]", "y [m]")
