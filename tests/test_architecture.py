"""The flow is the architecture: imports run one way, and the two roads share no physics."""

import ast
from pathlib import Path

import pytest

import cdpr_sim as cdpr

PACKAGE = Path(cdpr.__file__).parent

ORDER = [
    "errors", "pose", "materials", "robot", "catalog", "problem", "equilibrium",
    "statics", "descent", "seecr", "newton", "solvers", "two_cable",
    "derivatives", "distribution", "compensation", "sensitivities", "vibration", "equilibria", "measurements",
    "identification", "mjcf", "bench", "settling",
    "agreement", "releasing", "models", "report", "answer_tables", "figure_compensation", "cli",
]  # fmt: skip
"""The rooms, in the order of the flow: each may import only from those before it."""

MATHEMATICS = {
    "statics", "descent", "seecr", "newton", "solvers", "two_cable", "derivatives", "distribution", "compensation",
    "sensitivities", "vibration", "equilibria", "identification",
}  # fmt: skip
PHYSICS = {"mjcf", "bench", "settling", "releasing"}


def imports(module: str) -> set[str]:
    """Names of all modules that ``module`` imports, at run time, in full."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    skipped = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    found = set()
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def rooms(module: str) -> set[str]:
    """The rooms of this package that ``module`` imports from."""
    return {name.split(".")[1] for name in imports(module) if name.startswith("cdpr_sim.")} & set(ORDER)


def test_every_module_has_its_place_in_the_flow():
    """A new room is put in order, not only into the folder."""
    assert {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"} == set(ORDER)


@pytest.mark.parametrize("module", ORDER)
def test_imports_run_one_way(module):
    """Each room imports only from rooms before it."""
    assert rooms(module) <= set(ORDER[: ORDER.index(module)])


@pytest.mark.parametrize("module", sorted(MATHEMATICS))
def test_mathematics_never_imports_mujoco(module):
    """First wall: not MuJoCo, nor anything of the physics side."""
    assert not any(name.split(".")[0] == "mujoco" for name in imports(module))
    assert not rooms(module) & PHYSICS


@pytest.mark.parametrize("module", sorted(PHYSICS))
def test_physics_never_imports_our_formulas(module):
    """Second wall: the physics side uses neither statics nor a solver."""
    assert not rooms(module) & MATHEMATICS


def test_every_public_name_resolves():
    """What ``__all__`` promises is there, and functions are functions even after their modules are imported."""
    for name in cdpr.__all__:
        assert getattr(cdpr, name) is not None
    for name in ("solve", "settle", "compare", "to_mjcf", "load_robot"):
        assert callable(getattr(cdpr, name))
