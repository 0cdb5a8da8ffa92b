"""Shapes are checked at run time under test; Hypothesis is deterministic, so that a red run can be repeated."""

import functools
import importlib.util
import re
from collections.abc import Callable
from pathlib import Path

import hypothesis
import jaxtyping
import pytest
import typechecker
import typer.testing

DOORS = {
    "core.cable", "core.checks", "core.controller", "core.limits", "core.pose", "core.problem", "core.property",
    "core.robot", "robots.catalogue", "robots.importing", "robots.importers.draft", "statics.solve",
    "statics.two_cable_closed_form",
    "analysis.compensation", "analysis.workspace.feasibility", "analysis.workspace.grids", "analysis.workspace.hull",
    "analysis.workspace.sweep", "analysis.clearance", "design.front", "design.layout_equilibria", "design.moves",
    "design.search",
    "drawing.video.writing", "physics.damping", "physics.mjcf", "physics.reset", "physics.track", "physics.winches",
    "jax",
}  # fmt: skip
"""Where what users give is checked, with messages of its own."""

BEYOND_BEARTYPE = {
    "core.plausibility",  # its warnings count frames
    "drawing.figures", "drawing.video.frame_layout",  # arrays among sequences
    "report.table_style",  # Rich's own types
    "core.equilibrium",  # fields that are read in another type than they may be given in
    "core.materials",  # its check of a dict draws random numbers, which Hypothesis refuses while it draws a robot
}  # fmt: skip
"""Where it does not follow."""

COMPILED = {
    "core.cable_path", "core.cable_law", "core.compiling", "drawing.video.raycast", "statics.any_cable",
    "statics.catenary",
}  # fmt: skip
"""Whose functions Numba compiles, beside the kernels."""

AT_EVERY_STEP = {"core.pose_path", "physics.cable", "statics.forces", "statics.derivatives"}
"""Or at every step of a search: called so often that a check takes longer than what they do."""


FLOOR = {
    "numpy, scipy, jaxtyping": ("test_pose.py", "test_equilibrium_batch.py"),
    "mujoco-core": ("test_settle.py",),
    "numba": (
        "test_compiling.py",
        "test_many.py::test_threads_change_no_result",
        "test_many.py::test_forces_and_derivatives_at_many_poses_are_those_at_each",
    ),
    "pydantic": ("test_catalogue.py", "test_refusals.py::test_what_is_wrong_in_a_robot_file_is_one_sentence"),
    "pyyaml, defusedxml": (
        "test_formats.py::test_every_format_tells_of_the_same_crane_which_our_file_keeps",
        "test_refusals.py::test_hostile_files_are_refused_in_one_sentence",
    ),
    "typer, rich": (
        "test_commands.py::test_commands_answer_in_words_in_json_and_by_their_status",
        "test_commands.py::test_a_narrow_terminal_gets_row_below_row_and_no_number_cut",
    ),
    "lazy-loader": ("test_extras.py",),
    "matplotlib, pillow": (
        "test_shown_figures.py::test_every_picture_has_a_title_labels_with_units_and_a_legend",
        "test_shown_figures.py::test_each_line_is_what_its_name_says",
        "test_shown_figures.py::test_maps_fill_their_panels",
        "test_shown_figures.py::test_any_plane_can_be_drawn",
        "test_paper_figures.py",
    ),
    "xarray, dask, distributed, zarr, h5netcdf, filelock": ("test_store.py", "test_sweep.py"),
    "mediapy, imageio-ffmpeg": (
        "test_video.py::test_a_video_decodes_to_the_frames_and_size_asked_for",
        "test_video.py::test_an_encoder_that_fails_is_one_sentence",
        "test_video.py::test_show_plays_in_a_notebook",
    ),
    "gymnasium": ("test_learning.py",),
    "pymoo": ("test_design.py::test_a_front_trades_displacement_against_tilt",),
    "python-flint": ("test_problem_set.py",),
    "jinja2, selenium": ("test_html_page.py",),
}
"""Files, or functions of them, whose tests are marked ``floor``: those that use the most of each dependency."""


def checked_modules() -> list[str]:
    """All other modules of the package; found without importing it."""
    spec = importlib.util.find_spec("cdpr_sim")
    assert spec is not None
    assert spec.origin is not None
    package = Path(spec.origin).parent
    modules = {".".join(path.relative_to(package).with_suffix("").parts) for path in package.rglob("*.py")}
    kernels = {module for module in modules if module.endswith("_kernel")}
    left_out = DOORS | BEYOND_BEARTYPE | COMPILED | kernels | AT_EVERY_STEP
    assert modules >= left_out
    return [f"cdpr_sim.{module}" for module in sorted(modules - left_out) if not module.endswith("__init__")]


vars(jaxtyping)["jaxtyped"] = typechecker.first_calls_checked  # the name that the hook decorates with
jaxtyping.install_import_hook(checked_modules(), "typechecker.check")

# A runner of commands makes all commands of the application anew for each one that it runs: 40 ms.
vars(typer.testing)["_get_command"] = functools.cache(typer.main.get_command)

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=100)
hypothesis.settings.load_profile("default")

import compile_first  # noqa: E402  (after the hook)

import cdpr_sim as cdpr  # noqa: E402


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests of ``FLOOR``."""
    marked = {test for tests in FLOOR.values() for test in tests}
    for item in items:
        function = item.nodeid.rpartition("/")[2].partition("[")[0]
        if not marked.isdisjoint((function, function.partition("::")[0])):
            item.add_marker("floor")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config, specs: list) -> None:
    """Compiles before there are workers, which would all compile the same code and count it as the tests' time."""
    if not config.option.collectonly and (names := compile_first.missing()):
        config.get_terminal_writer().line(f"compiling {len(names)} kernels")
        compile_first.compile_all(names, len(specs))


def pytest_runtest_setup() -> None:
    """Each test checks its own calls."""
    typechecker.calls.clear()


@pytest.fixture(scope="session")
def catalogue() -> dict[str, cdpr.Robot]:
    """The robots that come with the package."""
    return {name: cdpr.load_robot(name) for name in cdpr.list_robots()}


SNAPSHOTS = Path(__file__).with_name("snapshots")
"""Texts as a person reads them, reviewed when they are written: one file each."""

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--update-snapshots``: the files are written, to be reviewed by ``git diff``."""
    parser.addoption("--update-snapshots", action="store_true", help=f"write {SNAPSHOTS.name}/ instead of comparing")


@pytest.fixture
def snapshot(request: pytest.FixtureRequest) -> Callable[..., None]:
    """``snapshot(name, text, rel=0)``: the text is that of ``tests/snapshots/name``, its numbers within ``rel``."""

    def same(name: str, text: str, rel: float = 0.0) -> None:
        path, text = SNAPSHOTS / name, "\n".join(line.rstrip() for line in text.strip().splitlines()) + "\n"
        if request.config.getoption("update_snapshots"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert path.exists(), f"no snapshot {name}: review what pytest --update-snapshots writes"
        expected = path.read_text(encoding="utf-8")
        if rel:
            numbers = [[float(number) for number in NUMBER.findall(one)] for one in (text, expected)]
            assert numbers[0] == pytest.approx(numbers[1], rel=rel, abs=1e-12)
            text, expected = (NUMBER.sub("#", one) for one in (text, expected))
        assert text == expected

    return same
