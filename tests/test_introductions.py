"""Results say what they are: in a line in the terminal, and in a notebook as tables whose numbers are their own."""

import dataclasses
import inspect
import re

import numpy as np
import pytest
from page_reader import Page

import cdpr_sim as cdpr
from cdpr_sim.core.introduced import Introduced
from cdpr_sim.report import html
from cdpr_sim.report.introductions import introduce

POSE = (0.285, 0.25, 0.1)
"""Where four cables of eight are slack, and the platform tilts by 5.3°."""

HOSTILE = '<img src=x onerror="alert(1)"> [bold]& [red]'
"""A name that is printable, and is to be read as it is."""

LONGEST = 300
"""Letters: a few lines of a terminal."""


@pytest.fixture(scope="module")
def robot() -> cdpr.Robot:
    return cdpr.load_robot("parallel").replace(name=HOSTILE)


@pytest.fixture(scope="module")
def results(robot) -> dict[str, object]:
    """One of each kind of result, by the name of its class."""
    equilibrium, settled = cdpr.solve(robot, POSE), cdpr.settle(robot, POSE)
    compensation = cdpr.compensate(robot, POSE)
    pose = np.array([*POSE, 0.0, 0.0, 0.0])
    measurements = cdpr.Measurements.of([pose], [equilibrium.position], coordinates=("x", "y", "z"), robot=robot.name)
    layout = cdpr.find_layout(robot, [POSE], within=0.005, generations=1, population=8, threads=1)
    front = cdpr.find_front(robot, [POSE], within=0.005, generations=1, population=5, threads=1)
    rests = cdpr.settle_many(robot, [POSE, (0.4, 0.25, 0.2)])
    found = [
        robot, equilibrium, equilibrium.problem, cdpr.Problems.of(robot, [POSE]), rests,
        cdpr.Trajectory.through(rests, np.array([0.0, 2.0])), cdpr.compare(equilibrium, settled),
        cdpr.check(robot, (2, 1, 2)), compensation, cdpr.confirm(compensation), cdpr.natural_modes(equilibrium),
        cdpr.sensitivity(equilibrium), cdpr.sensitivity(equilibrium).effects()[0],
        cdpr.find_equilibria(equilibrium.problem, starts=20), cdpr.follow_load(equilibrium.problem),
        cdpr.clearances(robot, [POSE]), measurements, cdpr.identify(robot, measurements), layout,
        front, cdpr.prove_layout(layout), cdpr.release(equilibrium, seconds=0.01), cdpr.certify(equilibrium),
        cdpr.certify_all(cdpr.Problem.of(cdpr.load_robot("two-cable").replace(name=HOSTILE), (0.4, 0, 0.2))),
        cdpr.workspace_hull(cdpr.load_robot("ipanema-1"), depth=1),
    ]  # fmt: skip
    return {type(one).__name__: one for one in found}


def test_every_public_result_is_among_them(results):
    """A new kind of result is asked for its introduction here, too."""
    public = {name for name in cdpr.__all__ if inspect.isclass(getattr(cdpr, name))}
    introduced = {name for name in public if issubclass(getattr(cdpr, name), Introduced)}
    assert introduced <= results.keys()
    assert {"Robot", "Equilibrium", "Trajectory", "Compensation", "Modes", "Agreement", "Rests"} <= introduced
    arrays = {  # other public data with arrays in it: each says in a line what it is
        name
        for name in public
        if dataclasses.is_dataclass(getattr(cdpr, name))
        and any("np.ndarray" in str(field.type) for field in dataclasses.fields(getattr(cdpr, name)))
    }
    assert {name for name in arrays if "__repr__" not in getattr(cdpr, name).__dict__} == set()


def test_results_say_in_a_line_what_they_are(results):
    """No arrays in a terminal: a line or two, with the name of the class."""
    for name, result in results.items():
        said = repr(result)
        assert len(said) <= LONGEST + len(HOSTILE), said
        assert "\n" not in said, said
        assert "array" not in said, said
        assert said.startswith((f"<{name}", f"{name}(")), said


def test_each_kind_has_an_introduction_of_its_own(results):
    """Well-formed, with a table, and nothing that is fetched."""
    plain = introduce.dispatch(object)
    for name, result in results.items():
        if isinstance(result, Introduced):
            assert introduce.dispatch(type(result)) is not plain, name
            text = result._repr_html_()
            page = Page(text)
            assert any(tag == "table" for tag, _ in page.tags), name
            assert "http" not in text.replace("https://", "http").split("</style>")[0], name
            assert all(values.get("src", "data:").startswith("data:") for _, values in page.tags), name


def test_names_are_shown_and_not_obeyed(results):
    """A robot may be called anything: its name stands in the words, and makes no tag."""
    for name, result in results.items():
        if isinstance(result, Introduced) and name not in ("Hull", "Agreement"):
            page = Page(result._repr_html_())
            assert HOSTILE in page.words or HOSTILE in str(page.tags), name
            assert not any("onerror" in values for _, values in page.tags), name
    assert Page(html.sentences(html.plain(HOSTILE))).words == HOSTILE


def test_a_robot_shows_a_picture_and_its_numbers(robot):
    """The picture says in words what it is of; each cable's row has its own numbers."""
    page = Page(robot._repr_html_())
    (picture,) = (values for tag, values in page.tags if tag == "img")
    assert picture["src"].startswith("data:image/png;base64,")
    assert HOSTILE in picture["alt"]
    for cable in range(robot.cables):
        numbers = np.array(page.rows[str(cable + 1)], dtype=float)
        assert numbers[:3] == pytest.approx(1e3 * robot.exits[cable], abs=0.05)
        assert numbers[3:6] == pytest.approx(1e3 * robot.anchors[cable], abs=0.05)
        assert numbers[6] == robot.axial_stiffness[cable]


def test_an_equilibrium_shows_forces_that_balance(robot):
    """Position and tensions, as they are read from the page, hold the platform: they carry m g and leave no moment."""
    page = Page(cdpr.solve(robot, POSE)._repr_html_())
    position = 1e-3 * np.array([float(page.rows[f"{axis} [mm]"][-1]) for axis in "xyz"])
    tilt = np.radians(float(page.rows["about y [°]"][-1]))
    words = [page.rows[f"tension {cable + 1} [N]"][-1] for cable in range(robot.cables)]
    assert words.count("slack") == 4
    tensions = np.array([0.0 if word == "slack" else float(word) for word in words])
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    arms = robot.anchors @ turn.T
    ways = robot.exits - position - arms
    forces = tensions[:, None] * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    # Four decimals of a newton and three of a millimetre are printed.
    assert forces.sum(0) == pytest.approx([0, 0, robot.mass * robot.gravity], abs=1e-3)
    assert np.cross(arms, forces).sum(0) == pytest.approx(np.zeros(3), abs=1e-4)


def test_a_batch_shows_its_worst_and_what_does_not_rest(robot):
    """The largest numbers are those of the rows; a row that fell is counted, in words."""
    rests = cdpr.solve_many(robot, [POSE, (0.4, 0.25, 0.2), (0.4, 0.25, 5.0)])
    page = Page(rests._repr_html_())
    assert page.rows["at rest"][-1] == "2 of 3"
    assert page.rows[f"not at rest: {cdpr.Status.FALLS.sentence}"][-1] == "1"
    tilts = [np.degrees(cdpr.solve(robot, pose).tilt) for pose in (POSE, (0.4, 0.25, 0.2))]
    assert float(page.rows["tilt [°]"][-1]) == pytest.approx(max(tilts), abs=5e-4)
    assert float(page.rows["tilt [°]"][0]) == pytest.approx(np.mean(tilts), abs=5e-4)


def test_introductions_are_legible_on_dark_and_on_light_paper():
    """No colour is set but mixtures with that of the text around; pictures bring their white paper along."""
    colors = re.findall(r"(?:^|[;{\s])(?:color|background|border[a-z-]*):([^;}]+)", html.STYLE)
    assert len(colors) >= 8
    for color in colors:
        assert color.strip() in ("inherit", "none", "0", "collapse", "white", "4px") or "currentColor" in color, color
    assert html.STYLE.count("white;") == 1
