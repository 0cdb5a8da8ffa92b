"""What all public names have in common: results that cannot be changed, and the same defaults of the same options."""

import dataclasses
import enum
import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable

import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.cable import PROPERTIES

PUBLIC = {name: getattr(cdpr, name) for name in dir(cdpr) if not name.startswith("_")}
DATA = {name: one for name, one in PUBLIC.items() if inspect.isclass(one) and dataclasses.is_dataclass(one)}

WITH_STATE = {"ElasticLengths", "HeldTensions", "LengthsAndTensions", "PoseFeedback"}
"""Controllers keep what they compute when a motion starts."""

DEFAULTS = {"progress": [False], "force": [False], "seed": [0], "threads": [0, 1], "steps": [1], "saddles": [False]}
DEFAULTS |= {"certify": [False], "contact": [False], "winches": [False], "robust": [False], "polish": [True]}
"""Nothing is printed, replaced, added to a model or searched unless asked."""

ON_ONE_PROCESSOR = {"certify_all"}
"""A planar robot is done before a second thread has started. All other functions use all processors."""


def functions() -> dict[str, tuple]:
    """Functions and methods of the package, by module and name; and which are public ones or constructors."""
    found = {}
    for module in pkgutil.walk_packages(cdpr.__path__, "cdpr_sim."):
        if module.name in ("cdpr_sim.__main__", "cdpr_sim.jax"):  # JAX is an extra that tests do not have everywhere
            continue
        for one in vars(importlib.import_module(module.name)).values():
            if getattr(one, "__module__", None) == module.name:
                for inner in (one, *(vars(one).values() if inspect.isclass(one) else ())):
                    plain = inspect.unwrap(getattr(inner, "__func__", inner))
                    if inspect.isfunction(plain) and plain.__module__ == module.name:
                        constructor = isinstance(inner, classmethod) and PUBLIC.get(one.__name__) is one
                        public = constructor or PUBLIC.get(plain.__name__) is inner
                        found[f"{module.name}.{plain.__qualname__}"] = plain, public and plain.__name__[0] != "_"
    return found


def test_docstrings_describe_all_parameters_or_none():
    """All, of public functions and constructors; elsewhere none if the first sentence says it; never another one's."""
    wrong = {}
    for name, (function, public) in functions().items():
        parameters = set(inspect.signature(function).parameters) - {"self", "cls"}
        before, _, described = (inspect.getdoc(function) or "").partition("\nArgs:\n")
        described = re.split(r"\n(?=\S)", described)[0]
        named = set(re.findall(r"^    \*{0,2}(\w+):", described, re.MULTILINE))
        astray = set(re.findall(r"^ +(\w+):", before, re.MULTILINE)) & parameters
        if astray or (named != parameters and (named or public)):
            wrong[name] = astray | (named ^ parameters)
    assert not wrong


def arguments(function: Callable) -> str:
    """Names, order and defaults; of a robot without the keywords of cables, which ``test_robot`` checks."""
    declared = PROPERTIES if function is cdpr.Robot else {}
    plain = inspect.signature(function)
    given = [one for one in plain.parameters.values() if one.kind is not one.KEYWORD_ONLY or one.name not in declared]
    bare = [one.replace(annotation=one.empty) for one in given]
    return re.sub(r"<function .*?>+ at \w+>", "...", str(inspect.Signature(bare)))


def test_signatures_are_as_reviewed(snapshot):
    """Every argument that a user may give, its order and its default: of functions, constructors and methods."""
    pytest.importorskip("gymnasium", reason='environments need pip install "cdpr-sim[learn]"')
    learning = [vars(importlib.import_module(f"cdpr_sim.learning.{name}")) for name in ("environments", "tasks")]
    kinds = {one.__name__: one for names in learning for one in names.values() if inspect.isclass(one)}
    lines = []
    for name, one in (PUBLIC | kinds).items():
        if inspect.isclass(one) and issubclass(one, enum.Enum | Exception):
            continue
        inner = vars(one) if inspect.isclass(one) else {}
        some = {name: one} | {f"{name}.{of}": getattr(method, "__func__", method) for of, method in inner.items()}
        for which, function in some.items():
            if "._" not in which and str(getattr(function, "__module__", "")).startswith("cdpr_sim"):
                lines.append(which + arguments(function))
    snapshot("signatures.txt", "\n".join(sorted(lines)))


@pytest.mark.parametrize("name", sorted(DATA.keys() - WITH_STATE))
def test_results_cannot_be_changed(name):
    """Neither by a user nor by a function that is given one."""
    assert DATA[name].__dataclass_params__.frozen


@pytest.mark.parametrize("name", sorted(DATA.keys() - WITH_STATE))
def test_data_with_arrays_have_no_equality_of_arrays(name):
    """``==`` of two arrays is no truth value: such data are equal only if they are the same object."""
    arrays = any("ndarray" in str(field.type) for field in dataclasses.fields(DATA[name]) if field.compare)
    assert not (arrays and DATA[name].__dataclass_params__.eq)


@pytest.mark.parametrize("name", sorted(name for name, one in PUBLIC.items() if inspect.isfunction(one)))
def test_options_have_the_same_default_in_all_functions(name):
    """Whoever knows one function knows the others."""
    for option, parameter in inspect.signature(PUBLIC[name]).parameters.items():
        if option in DEFAULTS and isinstance(parameter.default, int):
            assert repr(parameter.default) in map(repr, DEFAULTS[option])
        if option == "threads" and isinstance(parameter.default, int):
            assert parameter.default == (1 if name in ON_ONE_PROCESSOR else 0)
