"""Shapes are checked at run time under test; Hypothesis is deterministic, so that a red run can be repeated."""

import hypothesis
import pytest
from jaxtyping import install_import_hook

# Behind the doors (Robot, Problem, catalog, compensation, identification, cli), where what users give is checked, with
# messages of its own. descent, modes and feasibility stay out too: their functions are compiled by Numba.
MODULES = [
    "agreement", "balance", "bench", "derivatives", "distribution", "equilibrium", "mjcf", "newton", "releasing",
    "render", "scene", "seecr", "sensitivities", "settling", "solver_studies", "statics", "studies", "trajectory",
    "two_cable_studies", "vibration",
]  # fmt: skip
install_import_hook([f"cdpr_sim.{module}" for module in MODULES], "typechecker.check")

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=100)
hypothesis.settings.load_profile("default")

import cdpr_sim as cdpr  # noqa: E402  (after the hook)


@pytest.fixture(scope="session")
def catalogue() -> dict[str, cdpr.Robot]:
    """The robots that come with the package."""
    return {name: cdpr.load_robot(name) for name in cdpr.list_robots()}
