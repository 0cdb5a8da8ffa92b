import dataclasses
import inspect
import pickle

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.describe import describe_stiffness
from cdpr_sim.core.property import REQUIRED
from cdpr_sim.core.robot import FIELDS

EXITS = [[-1, 0, 1], [1, 0, 1], [0, 1, 1.0]]
ANCHORS = [[-0.1, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]


def robot(**changes) -> cdpr.Robot:
    values = dict(exits=EXITS, anchors=ANCHORS, axial_stiffness=1e3, mass=1.0) | changes
    return cdpr.Robot(**values)


@pytest.mark.parametrize("law", [(0.0, -8.0), (-20.0, 135.0)])
def test_a_law_may_fall_beyond_a_strain_of_20_percent(law):
    """1 + 2 a2 eps + 3 a3 eps² is 0.04 at 20 %, and 1 − 400/(3 a3) at its least; a little more is refused."""
    assert robot(stiffening=law).stiffening.tolist() == [[*law]] * 3


def test_robot_is_frozen_down_to_its_arrays():
    """A robot that two results share cannot change under them, nor by an array that it was given."""
    exits = np.array(EXITS, dtype=float)
    made = robot(exits=exits)
    exits[0, 0] = 99
    assert made.exits[0, 0] == made.replace(mass=2.0).exits[0, 0] == -1
    with pytest.raises(AttributeError):
        made.mass = 2.0
    with pytest.raises(ValueError, match="read-only"):
        made.exits[0, 0] = 5


@pytest.mark.parametrize(
    "changes",
    [
        dict(pulley_radius=[0.02, 0, 0.03], pulley_axis=(0, 0, -2), stiffening=(1.0, 2.0), force_min=1.0),
        dict(linear_density=[0.1, 0.2, 0], material="rope", notes=("assumed",), force_max=[10, 20, np.inf]),
    ],
)
def test_all_that_a_robot_is_given_can_be_read_back(changes):
    """One value per cable; and made anew from what was read, it is the same robot."""
    made = robot(**changes)
    read = {name: getattr(made, name) for name in FIELDS}
    for name, value in changes.items():
        if not isinstance(value, str) and name not in ("pulley_axis", "notes"):
            np.testing.assert_array_equal(read[name], np.broadcast_to(value, np.shape(read[name])), err_msg=name)
    np.testing.assert_array_equal(made.pulley_axis, [[0, 0, -1]] * 3)
    again = cdpr.Robot(**read)
    for name, value in read.items():
        np.testing.assert_array_equal(getattr(again, name), value, err_msg=name)
    with pytest.raises(ValueError, match="read-only"):
        made.pulley_radius[0] = 1.0


def test_default_inertia_is_that_of_a_uniform_box():
    """m/12 (b² + c²) about each edge's direction."""
    made = robot(mass=12.0, platform_size=(1, 2, 3))
    np.testing.assert_allclose(made.inertia, np.diag([4 + 9, 1 + 9, 1 + 4]))


DERIVED = {
    "exits": (np.array(EXITS) * [2, 2, 3], {"frame", "workspace"}),
    "anchors": (np.array(ANCHORS) * 2.0, {"platform_size", "inertia", "characteristic_length"}),
    "frame": ([[-3, -3, 0], [3, 3, 2]], {"workspace"}),
    "platform_size": ([0.5, 0.4, 0.3], {"inertia"}),
    "mass": (2.0, {"inertia", "weight"}),
    "gravity": (1.62, {"weight"}),
    "center_of_mass": ([0, 0, 0.1], set()),
}
"""Per field: another value, and what follows from the field unless it is given."""

FOLLOWS = sorted(set.union(*(names for _, names in DERIVED.values())))


@pytest.mark.parametrize("field", DERIVED)
def test_replace_derives_anew_what_follows_from_the_change(field):
    """Frame, workspace, platform and inertia are those of a robot made like that; nothing else moves."""
    value, follows = DERIVED[field]
    made = robot()
    changed, anew = made.replace(**{field: value}), robot(**{field: value})
    for name in FOLLOWS:
        np.testing.assert_array_equal(getattr(changed, name), getattr(anew, name))
        moved = not np.array_equal(getattr(changed, name), getattr(made, name))
        assert moved == (name in follows or name == field), name
    np.testing.assert_array_equal(made.exits, EXITS)
    assert made.mass == 1.0


def test_replace_keeps_what_was_given():
    """Only defaults follow: an inertia, a frame, a workspace and a platform that were given stay."""
    given = dict(
        inertia=[1, 1, 1], frame=[[-5, -5, 0], [5, 5, 5]], workspace=[[-1, -1, 0], [1, 1, 1]], platform_size=[1, 2, 3]
    )
    made = robot(**given)
    changed = made.replace(mass=2.0, exits=np.array(EXITS) * 2.0, anchors=np.array(ANCHORS) * 2.0)
    for name in given:
        np.testing.assert_array_equal(getattr(changed, name), getattr(made, name))
    np.testing.assert_array_equal(changed.replace(gravity=1.0).inertia, np.eye(3))  # twice removed


def test_replace_material_sets_the_stiffness_and_a_stiffness_forgets_the_material():
    """The name of a material never stands beside a stiffness that is not its own; changes add up."""
    soft = robot().replace(material="fishing-0.4mm").replace(mass=2.0)
    assert (soft.material, soft.mass) == ("fishing-0.4mm", 2.0)
    assert (soft.axial_stiffness == cdpr.MATERIALS["fishing-0.4mm"].axial_stiffness).all()
    assert soft.replace(axial_stiffness=5.0).material is None


def test_numbers_of_a_material_follow_it_and_those_given_by_hand_stay():
    """In the constructor and in ``replace``, for all cables or some; ``from_material`` tells which is which."""
    rope = robot(axial_stiffness="material", linear_density="material", material="steel-rope-4mm")
    steel, dyneema = cdpr.ROPES["steel-rope"].of(0.004), cdpr.ROPES["dyneema"].of(0.002)
    for one, material in ((rope, steel), (rope.replace(material="dyneema-2mm"), dyneema)):
        for name in ("axial_stiffness", "linear_density", "breaking_load"):
            assert (getattr(one, name) == getattr(material, name)).all(), name
            assert set(one.from_material[name]) == {material.name}
    kept = rope.replace(linear_density=[0.1, "material", "material"], breaking_load=7.0).replace(material="dyneema-2mm")
    assert kept.linear_density.tolist() == [0.1, *[dyneema.linear_density] * 2]
    assert kept.breaking_load.tolist() == [7.0] * 3
    own = "dyneema-2mm"
    assert kept.from_material == {"axial_stiffness": (own,) * 3, "linear_density": (None, own, own)}
    measured = rope.replace(axial_stiffness=5e5)
    assert (measured.linear_density == steel.linear_density).all()
    assert not measured.from_material
    assert pickle.loads(pickle.dumps(kept)).from_material == kept.from_material


def test_a_breaking_load_belongs_to_the_material():
    """Set with it, forgotten with it, and kept where it is given beside it."""
    rope = robot().replace(material="dyneema-2mm")
    assert (rope.breaking_load == cdpr.ROPES["dyneema"].of(0.002).breaking_load).all()
    assert (rope.replace(mass=2.0).breaking_load == rope.breaking_load).all()
    assert np.isinf(rope.replace(material="fishing-0.4mm").breaking_load).all()
    assert np.isinf(rope.replace(axial_stiffness=5.0).breaking_load).all()
    assert (rope.replace(axial_stiffness=5.0, breaking_load=7.0).breaking_load == 7.0).all()


def test_rotations_are_compared_by_the_anchors_distance():
    """Root mean square of 30, 40 and 50 mm; half the platform's diagonal where all anchors lie at the origin."""
    anchors = [[0.03, 0, 0], [0, 0.04, 0], [0.03, 0, -0.04]]
    assert robot(anchors=anchors).characteristic_length == pytest.approx(np.sqrt((9 + 16 + 25) / 3) / 100)
    point = robot(anchors=np.zeros((3, 3)), platform_size=(0.02, 0.03, 0.06))
    assert point.characteristic_length == pytest.approx(0.035)


@pytest.mark.parametrize(
    ("stiffness", "words"),
    [(999.0, "999 N"), (500.0, "500 N"), (1e3, "1 kN"), (1.5e4, "15 kN"), (1e6, "1 MN"), (5e5, "500 kN")],
)
def test_a_force_is_said_in_the_unit_that_suits_its_size(stiffness, words):
    """From 1 of a unit up."""
    assert describe_stiffness(robot(axial_stiffness=stiffness)) == f"EA = {words}"


def test_arguments_are_the_declared_properties():
    """Robot's signature has each property of ``core.cable`` with its default, and its docstring explains it."""
    arguments = inspect.signature(cdpr.Robot).parameters
    for name, one in PROPERTIES.items():
        usual = inspect.Parameter.empty if one.default is REQUIRED else one.default
        of_material = name == "breaking_load" and arguments[name].default is None
        assert of_material or arguments[name].default == usual, name
        assert f"\n    {name}: " in (inspect.getdoc(cdpr.Robot) or ""), name


@pytest.mark.parametrize(
    ("method", "known_to"),
    [
        (cdpr.solve, ()),
        (cdpr.settle, ("statics", "proof")),
        (lambda problem: cdpr.certify(cdpr.solve(problem)), ("statics",)),
        (cdpr.certify_all, ("statics",)),
    ],
)
def test_a_method_refuses_a_property_that_it_does_not_know(monkeypatch, method, known_to):
    """A property is known to no method before its declaration says so."""
    monkeypatch.setitem(
        PROPERTIES, "winch_to_exit", dataclasses.replace(PROPERTIES["winch_to_exit"], known_to=known_to)
    )
    made = cdpr.load_robot("two-cable").replace(winch_to_exit=3.0)
    with pytest.raises(cdpr.InvalidInput, match="found winch_to_exit in cable 1, expected cables without"):
        method(cdpr.Problem.of(made, made.home))


def test_what_acts_only_with_another_property_is_had_by_cables_with_both(catalogue, monkeypatch):
    """A wheel's axis, whose default acts, by all wheels; one of wheels that is 0 by default, by those it has."""
    robot = catalogue["cogiro"].replace(pulley_radius=[0.0, 0.02] * 4, pulley_friction=[0.0, 0.05, 0.05, 0.0] * 2)
    assert robot.cabling.has("pulley_axis").tolist() == [False, True] * 4
    of_wheels = dataclasses.replace(PROPERTIES["pulley_friction"], only_with="pulley_radius")
    monkeypatch.setitem(PROPERTIES, "pulley_friction", of_wheels)
    assert robot.cabling.has("pulley_friction").tolist() == [False, True, False, False] * 2
