"""What all public names have in common: results that cannot be changed, and the same defaults of the same options."""

import dataclasses
import inspect

import pytest

import cdpr_sim as cdpr

PUBLIC = {name: getattr(cdpr, name) for name in dir(cdpr) if not name.startswith("_")}
DATA = {name: one for name, one in PUBLIC.items() if inspect.isclass(one) and dataclasses.is_dataclass(one)}

WITH_STATE = {"ElasticLengths", "HeldTensions", "LengthsAndTensions", "PoseFeedback"}
"""Controllers keep what they compute when a motion starts."""

DEFAULTS = {"progress": [False], "force": [False], "seed": [0], "threads": [0, 1], "steps": [1], "saddles": [False]}
DEFAULTS |= {"certify": [False], "contact": [False], "winches": [False], "robust": [False], "polish": [True]}
"""Nothing is printed, replaced, added to a model or searched unless asked."""

ON_ALL_PROCESSORS = {"check", "settle_many", "settle_path", "find_layout", "find_front"}
"""Simulations and searches; statics run on one, since a pose takes microseconds there."""


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
            assert parameter.default == (0 if name in ON_ALL_PROCESSORS else 1)
