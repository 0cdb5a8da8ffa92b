"""The flow is the architecture: folders in one order, imports one way, walls between statics, simulation, proof."""

import ast
import functools
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
import typechecker

import cdpr_sim as cdpr
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.property import REQUIRED
from cdpr_sim.physics import dynamic_relaxation

PACKAGE = Path(cdpr.__file__).parent
SCRIPTS = Path(__file__).parents[1] / "scripts"
"""They use the package, which does not know them."""

SCRIPT_FOLDERS = ("figures", "research", "benchmarks", "dev")

FOLDERS = (
    "core", "robots", "statics", "analysis", "jax", "design", "control", "physics", "anymodel", "proof", "crosscheck",
    "drawing", "learning", "report", "cli",
)  # fmt: skip
"""In the order of the flow: each may import only from those before it, and from itself."""

WALLS = {
    # the mathematics never imports MuJoCo
    "statics": {"core"},
    "analysis": {"core", "robots", "statics"},
    "jax": {"core", "statics", "analysis"},
    "design": {"core", "robots", "statics", "analysis"},
    "control": {"core", "statics", "analysis"},
    # the physics side never uses our formulas
    "physics": {"core"},
    "anymodel": {"core", "physics.quiet"},
    # a proof uses data alone: neither method's formulas
    "proof": {"core"},
    # environments are MuJoCo's dynamics; statics says where they begin
    "learning": {"core", "robots", "statics", "control", "physics", "drawing"},
    # drawing is given results, and the scene to draw them in
    "drawing": {"core", "physics.mjcf"},
}
"""What these folders may import besides themselves: a folder of this package, or one module of it."""

BEYOND = {
    (folder, module) for folder in ("physics", "anymodel", "proof") for module in ("core.cable_path", "core.cable_law")
}
"""(folder, module) that its wall would let through, and must not: where a cable runs and how hard it pulls, MuJoCo and
the proof say by their own means."""

CABLE_ROOMS = {
    "core.cable", "core.cable_law", "core.cable_path", "core.materials", "core.memory",
    "statics.any_cable", "statics.cable_kernel", "statics.memory_kernel", "statics.memory_law",
    "physics.cable", "physics.chains", "physics.exits", "physics.pulleys", "physics.rope_memory", "proof.cables",
}  # fmt: skip
"""The declaration of the properties, and what a cable does, in the terms of each method."""

PHYSICS_ROOMS = {"physics.cable", "physics.pulleys", "physics.chains"}
"""Where simulation knows what a property of a cable does; its other modules ask these."""

OWN_PROPERTIES = {
    "physics.exits": {"exit_compliance"},  # is a body of the frame on slides, and no part of a cable
    "physics.rope_memory": {"hysteresis", "creep", "pulley_friction"},  # of which the law with a memory is made
    "physics.settle": {"axial_stiffness"},  # an argument of settle_many
}
"""The properties that other modules of simulation name, and why."""

FOREIGN = {f"robots.importers.{name}" for name in ("bologna", "caspr", "cdpyr", "hangprinter", "uacdpr", "wirex")}
"""They read the formats of other projects, which have names of their own for the same properties."""

NAME_A_PROPERTY = {
    # arguments and keys: of robots, of robots side by side, of robot files, of importers, of a sweep's files
    "core.robot", "core.robot_batch", "robots.catalogue", "robots.importers.draft", "analysis.workspace.sweep",
    # the creep of MuJoCo's constraints
    "anymodel.evidence", "anymodel.model_equilibrium", "report.as_json", "report.model_tables",
}  # fmt: skip
"""All other modules that name a property of cables: 53 once, at most 10, and the number can only go down."""

HEAVY = {
    "xarray", "dask", "distributed", "zarr", "h5netcdf", "matplotlib", "pandas", "PIL", "mediapy", "pymoo", "numba",
    "scipy.stats", "scipy.ndimage", "scipy.interpolate", "scipy.integrate", "scipy.signal",
    "defusedxml", "cdpr_sim.robots.importing", "cdpr_sim.analysis.identification", "cdpr_sim.physics.release",
}  # fmt: skip
"""What takes long to import, and is there for other commands than ``settle``."""

WAITED_FOR = {
    "help": (["--help"], HEAVY | {"numpy", "scipy", "mujoco", "pydantic", "jaxtyping"}, {"typer"}),
    "settle": (["settle", "parallel"], HEAVY, {"mujoco", "scipy.optimize", "pydantic"}),
}
"""Of a command: its words, what is not loaded when it is done, and what is."""


def name_of(path: Path) -> str:
    """``statics.newton``; of a folder's ``__init__``, the folder."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@functools.cache
def trees() -> dict[str, ast.Module]:
    """Per module its syntax; not of ``__init__`` and ``__main__`` of the package itself.

    It and what follows from it are computed by the first test that asks: every worker imports this file.
    """
    paths = {name_of(path): path for path in PACKAGE.rglob("*.py")}
    return {module: ast.parse(paths[module].read_text(encoding="utf-8")) for module in paths.keys() - {"", "__main__"}}


@functools.cache
def scripts() -> dict[str, ast.Module]:
    """The same of the scripts; they import each other by name, from one folder."""
    return {path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in SCRIPTS.rglob("*.py")}


def imports(nodes: Iterable[ast.AST]) -> set[str]:
    """All that these nodes import, in full: modules, and what is taken from them."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where they lead"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def own(names: Iterable[str]) -> set[str]:
    """Modules of this package among imported names: the module itself, or the one that a name is taken from."""
    ours = {name.removeprefix("cdpr_sim.") for name in names if name.startswith("cdpr_sim.")}
    return {name if name in trees() else name.rpartition(".")[0] for name in ours} & trees().keys()


@functools.cache
def anywhere() -> dict[str, set[str]]:
    """All that each module imports, in functions and for type checkers as well."""
    return {module: imports(ast.walk(tree)) for module, tree in trees().items()}


@functools.cache
def in_scripts() -> dict[str, set[str]]:
    """The same of the scripts."""
    return {script: imports(ast.walk(tree)) for script, tree in scripts().items()}


@functools.cache
def graph() -> dict[str, set[str]]:
    """Per module, the modules of this package that it imports anywhere."""
    return {module: own(names) - {module} for module, names in anywhere().items()}


def folder(module: str) -> str:
    return module.split(".")[0]


def libraries(names: Iterable[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


def test_every_module_lives_in_a_folder_of_the_flow():
    """A new folder is put in order, and says in its first line what it is for."""
    assert {folder(module) for module in trees()} == set(FOLDERS)
    for init in PACKAGE.rglob("__init__.py"):
        assert ast.get_docstring(ast.parse(init.read_text(encoding="utf-8"))), init


def test_contributing_has_the_rooms_and_their_flow():
    """One table of at most fourteen folders, in the order of the flow; in the picture data goes to the right."""
    page = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rooms = [room for room in FOLDERS if (PACKAGE / room).is_dir()]
    assert re.findall(r"^\| `([a-z]+)/` \|", page, re.MULTILINE) == rooms
    assert len(rooms) <= 14
    picture = page.partition("```text\n")[2].partition("```")[0]
    places = {
        one[0]: one.start() for line in picture.splitlines() for one in re.finditer(r"[a-z]+", line.replace(".py", ""))
    }
    assert places.keys() == set(FOLDERS)
    for module, used in graph().items():
        beyond = {folder(one) for one in used} - {folder(module)}
        assert all(places[one] < places[folder(module)] for one in beyond), module


def test_imports_run_one_way():
    """Between folders in their order; and no circle anywhere, imports for types included."""
    for module, used in graph().items():
        assert {folder(one) for one in used} <= set(FOLDERS[: FOLDERS.index(folder(module)) + 1]), module
    TopologicalSorter(graph()).prepare()  # raises CycleError


def test_the_package_does_not_need_the_scripts():
    """Those import the package and each other, in no circle; an installed package is without them."""
    assert all(ast.get_docstring(tree) for tree in scripts().values())
    assert len(scripts()) == len(list(SCRIPTS.rglob("*.py")))  # names of their own, as tests import them by name
    assert not {module for module, names in anywhere().items() if (scripts().keys() | {"scripts"}) & libraries(names)}
    used = {script: libraries(names) & scripts().keys() for script, names in in_scripts().items()}
    assert used["better_layouts"] == {"real_cables"}  # the test can fail
    TopologicalSorter(used).prepare()  # raises CycleError


def test_every_script_is_in_the_table_of_its_folder():
    """Those at the top settle one configuration each, and are on the page of the robots; each folder has a table."""
    assert {path.name for path in SCRIPTS.iterdir() if path.is_dir()} - {"__pycache__"} == set(SCRIPT_FOLDERS)
    page = (SCRIPTS.parent / "docs" / "robots.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"scripts/(\w+\.py)", page)) == sorted(path.name for path in SCRIPTS.glob("*.py"))
    for folder in SCRIPT_FOLDERS:
        table = (SCRIPTS / folder / "README.md").read_text(encoding="utf-8")
        listed = [one for row in re.findall(r"^\| (`.*?) \|", table, re.M) for one in re.findall(r"`(\w+)\.py`", row)]
        assert sorted(listed) == sorted(path.stem for path in (SCRIPTS / folder).glob("*.py")), folder


def test_walls_stand():
    """Neither method knows the other, and what draws knows neither."""
    for module, used in graph().items():
        allowed = WALLS.get(folder(module))
        if allowed is not None:
            beyond = {one for one in used if folder(one) != folder(module)}
            assert {one for one in beyond if folder(one) not in allowed and one not in allowed} == set(), module
            assert not {(folder(module), one) for one in used} & BEYOND, module
    for module, names in anywhere().items():
        if folder(module) in {"core", "robots", "statics", "analysis", "jax", "design", "control", "proof"}:
            # A model is read as MuJoCo reads it; nothing is computed.
            compiles = module == "robots.importers.mujoco_model"
            assert ("mujoco" in libraries(names)) == compiles, module


def test_the_compiler_is_used_by_its_documented_functions_alone():
    """Internals of Numba and LLVM change from version to version."""
    for module, names in (anywhere() | in_scripts()).items():
        assert not any(f"{name}.".startswith(("numba.core.", "llvmlite.")) for name in names), module
        assert "numba.core" not in ast.unparse((trees() | scripts())[module]), module


def test_nothing_touches_matplotlibs_global_state():
    """No pyplot: figures are objects, and nobody's open windows or styles are changed."""
    for module, names in (anywhere() | in_scripts()).items():
        assert not any(name.startswith(("matplotlib.pyplot", "pylab")) for name in names), module


def test_commands_open_with_nothing_but_words():
    """What a command computes with is imported inside it; at the head of its module, only what reads words."""
    light = set(sys.stdlib_module_names) | {"typer", "rich", "cdpr_sim"}
    for module in trees():
        if folder(module) == "cli":
            assert libraries(imports(trees()[module].body)) <= light, module
            assert {folder(one) for one in own(imports(trees()[module].body))} <= {"cli"}, module
    # The test can fail: inside, they import a lot.
    assert not libraries(anywhere()["cli.design_commands"]) <= light
    assert "report.crosscheck_tables" in own(anywhere()["cli.equilibrium_commands"])


@pytest.mark.parametrize(("words", "without", "needed"), WAITED_FOR.values(), ids=WAITED_FOR)
def test_a_command_waits_for_no_library_that_it_does_not_use(words, without, needed):
    """In a process of its own, what is loaded when it is done."""
    command = "from cdpr_sim.cli import app; app(standalone_mode=False)"
    script = f"import sys; sys.argv[0] = 'cdpr-sim'; {command}; print(*sys.modules, file=sys.stderr)"
    place = os.environ | {"PYTHONPATH": str(PACKAGE.parent)}
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, env=place, check=True)
    loaded = set(done.stderr.split())
    assert not loaded & without
    assert needed <= loaded


def test_annotated_shapes_are_checked_at_the_first_calls_of_a_test():
    """Arrays of another shape are found, however many right ones were given before in other tests; then it is quick."""
    right, wrong = np.zeros((4, 3)), np.zeros((4, 3, 1))
    for _ in range(typechecker.CHECKED - 1):
        dynamic_relaxation.parallel(right, right)
    with pytest.raises(jaxtyping.TypeCheckError, match="parallel"):
        dynamic_relaxation.parallel(wrong, wrong)
    assert dynamic_relaxation.parallel(wrong, wrong).shape == (4, 3)


def test_few_modules_name_a_property_of_cables():
    """A property is known where it is declared, in robot files, and in the room of each method; others ask for cables.

    So a new property touches few files. Points, EA and force limits do not count: they are quantities of every robot.
    Texts count as well, but for docstrings.
    """
    counted = {name for name, one in PROPERTIES.items() if one.image and one.default is not REQUIRED}
    naming = {
        module for module, tree in trees().items() if module not in CABLE_ROOMS | FOREIGN and counted & set(words(tree))
    }
    assert naming == NAME_A_PROPERTY
    assert len(naming) <= 10


def test_simulation_knows_a_property_in_its_room():
    """All count here, EA and force limits included; not exits and anchors, which are points of the robot."""
    counted, found = PROPERTIES.keys() - {"exits", "anchors"}, {}
    for module, tree in trees().items():
        if folder(module) == "physics" and (named := counted & set(words(tree))):
            found[module] = named
    assert found.keys() >= PHYSICS_ROOMS
    assert {module: named for module, named in found.items() if module not in PHYSICS_ROOMS} == OWN_PROPERTIES


def words(tree: ast.Module) -> Iterator[str]:
    """Names, attributes and arguments of a module, and the words of its texts, but not of docstrings."""
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        for field in ("id", "attr", "arg", "value"):
            word = getattr(node, field, None)
            if isinstance(word, str) and id(node) not in docstrings:
                yield from re.findall(r"\w+", word)
