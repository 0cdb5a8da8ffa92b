"""Results say what they are: in a line in the terminal, and in a notebook as tables whose numbers are their own."""

import contextlib
import copy
import dataclasses
import importlib
import inspect
import pickle
import pkgutil
import re
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from page_reader import Page

import cdpr_sim as cdpr
from cdpr_sim.core.errors import MissingExtra
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.drawing.video import render
from cdpr_sim.report import html
from cdpr_sim.report.notebook import content_of

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
    equilibria = cdpr.settle_many(robot, [POSE, (0.4, 0.25, 0.2)])
    found = [
        robot, equilibrium, equilibrium.problem, cdpr.Problems.of(robot, [POSE]), equilibria,
        cdpr.Trajectory.through(equilibria, np.array([0.0, 2.0])), cdpr.compare(equilibrium, settled),
        cdpr.check(robot, (2, 1, 2)), compensation, cdpr.verify_compensation(compensation),
        cdpr.natural_modes(equilibrium),
        cdpr.sensitivity(equilibrium), cdpr.sensitivity(equilibrium).effects()[0],
        cdpr.find_equilibria(equilibrium.problem, starts=20), cdpr.follow_load(equilibrium.problem),
        cdpr.clearances(robot, [POSE]), measurements, cdpr.identify(robot, measurements), layout,
        front, cdpr.validate_layout(layout), cdpr.release(equilibrium, seconds=0.01), cdpr.certify(equilibrium),
        cdpr.certify_all(cdpr.Problem.of(cdpr.load_robot("two-cable").replace(name=HOSTILE), (0.4, 0, 0.2))),
        cdpr.workspace_hull(cdpr.load_robot("ipanema-1"), depth=1), cdpr.solve_path(robot, [POSE, (0.4, 0.25, 0.2)]),
    ]  # fmt: skip
    return {type(one).__name__: one for one in found}


def test_every_public_result_is_among_them(results):
    """A new kind of result is asked for its introduction here, too."""
    public = {name for name in cdpr.__all__ if inspect.isclass(getattr(cdpr, name))}
    introduced = {name for name in public if issubclass(getattr(cdpr, name), HtmlRepr)}
    assert introduced <= results.keys()
    assert {
        "Robot",
        "Equilibrium",
        "Trajectory",
        "Compensation",
        "Modes",
        "Agreement",
        "EquilibriumBatch",
    } <= introduced
    arrays = {  # other public data with arrays in it: each says in a line what it is
        name
        for name in public
        if dataclasses.is_dataclass(getattr(cdpr, name))
        and any("np.ndarray" in str(field.type) for field in dataclasses.fields(getattr(cdpr, name)))
    }
    inherited = {name: [vars(one) for one in getattr(cdpr, name).__mro__[:-1]] for name in arrays}
    assert {name for name, classes in inherited.items() if not any("__repr__" in one for one in classes)} == set()


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
    plain = content_of.dispatch(object)
    for name, result in results.items():
        if isinstance(result, HtmlRepr):
            assert content_of.dispatch(type(result)) is not plain, name
            text = result._repr_html_()
            page = Page(text)
            assert any(tag == "table" for tag, _ in page.tags), name
            assert "http" not in text.replace("https://", "http").split("</style>")[0], name
            assert all(values.get("src", "data:").startswith("data:") for _, values in page.tags), name


def test_names_are_shown_and_not_obeyed(results):
    """A robot may be called anything: its name stands in the words, and makes no tag."""
    for name, result in results.items():
        if isinstance(result, HtmlRepr) and name not in ("Hull", "Agreement"):
            page = Page(result._repr_html_())
            assert HOSTILE in page.words or HOSTILE in str(page.tags), name
            assert not any("onerror" in values for _, values in page.tags), name
    assert Page(html.sentences(html.plain(HOSTILE))).words == HOSTILE


# --- copies ---------------------------------------------------------------------------------------------------------


def parts(value: object, name: str = "") -> Iterator[tuple[str, object]]:
    """What a value holds, down to arrays, numbers and words, by names."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield name, type(value)
        for field in dataclasses.fields(value):
            if hasattr(value, field.name):  # a controller has not planned yet
                yield from parts(getattr(value, field.name), f"{name}.{field.name}")
    elif isinstance(value, (tuple, list)):
        yield name, (type(value), len(value))
        for i, one in enumerate(value):
            yield from parts(one, f"{name}[{i}]")
    else:
        yield name, value if isinstance(value, np.ndarray) else repr(value)


def copies(value: object) -> list:
    """By each way of making one: between processes, and within one."""
    return [pickle.loads(pickle.dumps(value)), copy.deepcopy(value), copy.copy(value)]


def assert_same(one: object, other: object) -> None:
    """In all that they hold, to the bit; what cannot be written to in one cannot be in the other."""
    mine, theirs = dict(parts(one)), dict(parts(other))
    assert mine.keys() == theirs.keys()
    for name, value in mine.items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, theirs[name], err_msg=name)
            assert value.flags.writeable == theirs[name].flags.writeable, name  # type: ignore[attr-defined]
        else:
            assert value == theirs[name], name


def worst_reach(equilibria) -> np.ndarray:
    """An objective of a user's."""
    return np.linalg.norm(equilibria.positions, axis=-1).max(-1)


def test_results_survive_pickle_and_copies(results, robot):
    """Between processes of a pool, and in a notebook: all that they hold is the same; so is what tracks and senses."""
    rigid = cdpr.RigidLengths(robot)
    sought = dict(within=0.005, generations=1, population=8, threads=1)
    others = [
        robot.cabling, cdpr.solve_many(robot, [POSE]), cdpr.drive(robot, [POSE], seconds=0.1, states=2),
        cdpr.Memory.fresh(robot),
        rigid, cdpr.ElasticLengths(robot), cdpr.HeldTensions(robot), cdpr.LengthsAndTensions(robot),
        cdpr.PoseFeedback(rigid), cdpr.Command.of(robot.rest_lengths(POSE), robot.cables), cdpr.Sensors(),
        cdpr.MATERIALS["vectran-0.7mm"], cdpr.ROPES["dyneema"], cdpr.Move("exits", 0.01),
        cdpr.CompensationOutcome.EXACT,
        cdpr.Stability.STABLE, cdpr.Status.CONVERGED, cdpr.Verdict.AGREE,
        cdpr.find_layout(robot, [POSE], objective=worst_reach, **sought),
    ]  # fmt: skip
    for value in [*results.values(), *others]:
        for other in copies(value):
            assert_same(value, other)
    asked = {type(value).__name__ for value in [*results.values(), *others]}
    public = {name for name in cdpr.__all__ if inspect.isclass(getattr(cdpr, name))}
    errors = {name for name in public if issubclass(getattr(cdpr, name), Exception)}
    assert public - errors - asked == {
        "Controller",
        "Measurement",
        "Reference",
    }  # a protocol, and what only controllers see


def all_errors() -> set[type[Exception]]:
    """Every exception and warning of the package, public or not, but for those that others derive from privately."""
    for module in pkgutil.walk_packages(cdpr.__path__, "cdpr_sim."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(MissingExtra):  # cdpr_sim.jax without JAX
                importlib.import_module(module.name)
    found, waiting = set(), [cdpr.CdprError, cdpr.ImplausibleRobot]
    while waiting:
        one = waiting.pop()
        found |= {one} if one.__module__.startswith("cdpr_sim") and not one.__name__.startswith("_") else set()
        waiting += one.__subclasses__()
    return found


def raised(ask: Callable[[], object]) -> Exception:
    """What that ends in."""
    with pytest.raises(Exception) as caught:  # noqa: PT011
        ask()
    return caught.value


def test_errors_survive_pickle_and_copies(results, robot):
    """An exception that cannot be pickled hangs a ``multiprocessing.Pool``; all say the same, and carry the same."""
    trajectory, equilibrium = results["Trajectory"], results["Equilibrium"]
    errors = [
        raised(lambda: cdpr.load_robot("cogir")),
        raised(lambda: cdpr.load_robot("x" * 100)),
        raised(lambda: cdpr.solve(robot, (np.nan, 0, 0))),
        raised(lambda: cdpr.load_robot(__file__ + ".toml")),
        cdpr.NotConverged("stalled", equilibrium), cdpr.NotSettled("sways", equilibrium),
        cdpr.PlatformFell("fell", trajectory), cdpr.BadCommand("nan", trajectory), cdpr.StoreError("full"),
        cdpr.CdprError("on purpose"), cdpr.ImplausibleRobot("in millimetres"), cdpr.InvalidInput("mass: found 0"),
        render.OpenGLUnavailable("none"), MissingExtra("python-flint"),
    ]  # fmt: skip
    assert {type(error) for error in errors} == all_errors()
    for error in errors:
        for other in copies(error):
            assert type(other) is type(error)
            assert str(other) == str(error)
            assert vars(other).keys() == vars(error).keys()
            for name, value in vars(error).items():
                assert_same(value, getattr(other, name))
    assert "did you mean cogiro" in str(errors[0])


# --- in a notebook --------------------------------------------------------------------------------------------------


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
    found = {label: cells[-1] for label, cells in page.rows.items() if label.startswith("tension ")}
    assert sum(label.endswith(", slack") for label in found) == 4
    tensions = np.array([float(word) for word in found.values()])
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    arms = robot.anchors @ turn.T
    ways = robot.exits - position - arms
    forces = tensions[:, None] * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    # Four decimals of a newton and three of a millimetre are printed.
    assert forces.sum(0) == pytest.approx([0, 0, robot.mass * robot.gravity], abs=1e-3)
    assert np.cross(arms, forces).sum(0) == pytest.approx(np.zeros(3), abs=1e-4)


def test_a_batch_shows_its_worst_and_what_does_not_rest(robot):
    """The largest numbers are those of the rows; a row that fell is counted, in words."""
    equilibria = cdpr.solve_many(robot, [POSE, (0.4, 0.25, 0.2), (0.4, 0.25, 5.0)])
    page = Page(equilibria._repr_html_())
    assert page.rows["equilibria"][-1] == "2 of 3"
    assert page.rows[f"none: {cdpr.Status.FALLS.sentence}"][-1] == "1"
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
