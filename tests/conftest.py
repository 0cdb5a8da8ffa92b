"""Shapes are checked at run time under test; Hypothesis is deterministic, so that a red run can be repeated."""

import hypothesis
import pytest
from jaxtyping import install_import_hook

# Behind the doors (Robot, Problem, catalogue, compensation, identification, cli), where what users give is checked, with
# messages of its own. The kernels stay out too: their functions are compiled by Numba.
MODULES = [
    "analysis.modes", "analysis.sensitivity", "analysis.tensions", "core.trajectory",
    "crosscheck.compare", "drawing.video.render", "drawing.video.scene", "physics.batch", "physics.mjcf",
    "physics.release", "physics.settle", "statics.derivatives", "statics.forces", "statics.newton", "statics.seecr",
    "studies.lines", "studies.solvers", "studies.tilt_condition", "studies.two_cable",
]  # fmt: skip
install_import_hook([f"cdpr_sim.{module}" for module in MODULES], "typechecker.check")

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=100)
hypothesis.settings.load_profile("default")

import cdpr_sim as cdpr  # noqa: E402  (after the hook)


@pytest.fixture(scope="session")
def catalogue() -> dict[str, cdpr.Robot]:
    """The robots that come with the package."""
    return {name: cdpr.load_robot(name) for name in cdpr.list_robots()}
