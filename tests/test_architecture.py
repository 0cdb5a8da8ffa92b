"""The flow is the architecture: imports run one way, and the two roads share no physics."""

import ast
from pathlib import Path

import pytest

import cdpr_sim as cdpr

PACKAGE = Path(cdpr.__file__).parent

ORDER = [
    "errors", "pose", "materials", "robot", "catalog", "problem", "equilibrium", "trajectory",
    "progress", "writing", "grids",
    "statics", "compiling", "descent", "modes", "seecr", "newton", "solvers", "two_cable", "feasibility", "stores",
    "sweeping", "derivatives", "distribution", "compensation", "sensitivities", "vibration", "equilibria",
    "measurements", "identification",
    "mjcf", "bench", "settling", "driving",
    "agreement", "releasing", "checking", "studies", "two_cable_studies", "balance", "solver_studies",
    "style", "drawing", "figures", "two_cable_figures", "solver_figures", "gallery", "figure_compensation", "maps",
    "pictures", "scene", "raycast", "render", "panel", "video",
    "models", "report", "overview", "answer_tables", "cli",
]  # fmt: skip
"""The rooms, in the order of the flow: each may import only from those before it."""

MATHEMATICS = {
    "statics", "descent", "modes", "seecr", "newton", "solvers", "two_cable", "feasibility", "sweeping",
    "derivatives", "distribution", "compensation", "sensitivities", "vibration", "equilibria", "identification",
}  # fmt: skip
PHYSICS = {"mjcf", "bench", "settling", "driving", "releasing"}
DRAWING = {
    "style", "drawing", "figures", "two_cable_figures", "solver_figures", "figure_compensation", "maps", "pictures",
    "scene", "raycast", "render", "panel", "video",
}  # fmt: skip


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


@pytest.mark.parametrize("module", ORDER)
def test_nothing_touches_matplotlibs_global_state(module):
    """No pyplot: figures are objects, and nobody's open windows or styles are changed."""
    assert not any(name.startswith(("matplotlib.pyplot", "pylab")) for name in imports(module))


@pytest.mark.parametrize("module", sorted(DRAWING))
def test_drawing_is_given_results(module):
    """Third wall: what draws may know the types of results and the scene, but has no formula, solver or physics."""
    assert not rooms(module) & (MATHEMATICS | PHYSICS - {"mjcf"} | {"agreement"})


@pytest.mark.parametrize("module", ["sweeping", "checking", "stores", "maps", "overview", "cli"])
def test_heavy_libraries_are_imported_where_they_are_used(module):
    """xarray, Dask and matplotlib take a second: never at the head of a module."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    head = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
    head |= {node.module for node in tree.body if isinstance(node, ast.ImportFrom) and node.module}
    assert not {name.split(".")[0] for name in head} & {"xarray", "dask", "distributed", "zarr", "matplotlib"}


def test_every_public_name_resolves():
    """What ``__all__`` promises is there, and functions are functions even after their modules are imported."""
    for name in cdpr.__all__:
        assert getattr(cdpr, name) is not None
    for name in ("solve", "settle", "compare", "to_mjcf", "load_robot"):
        assert callable(getattr(cdpr, name))
