import pickle

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.describe import describe_stiffness
from cdpr_sim.core.robot import FIELDS

EXITS = [[-1, 0, 1], [1, 0, 1], [0, 1, 1.0]]
ANCHORS = [[-0.1, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]


def robot(**changes) -> cdpr.Robot:
    values = dict(exits=EXITS, anchors=ANCHORS, axial_stiffness=1e3, mass=1.0) | changes
    return cdpr.Robot(**values)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (dict(exits=[[np.nan, 0, 1]] * 3), "exits: found nan, expected finite"),
        (dict(anchors=[[0, 0, np.inf]] * 3), "anchors: found inf, expected finite"),
        (dict(exits=[[0, 0]] * 3), r"exits: found an array of shape \(3, 2\), expected shape \(any, 3\)"),
        (dict(anchors=ANCHORS[:2]), r"anchors: found an array of shape \(2, 3\), expected shape \(3, 3\)"),
        (dict(exits=np.empty((0, 3)), anchors=np.empty((0, 3))), "exits: found no cable"),
        (dict(exits="here"), "exits: found 'here', expected numbers"),
        (dict(axial_stiffness=[1e3, 0, 1e3]), "axial_stiffness: found 0 N, expected more than 0"),
        (dict(axial_stiffness=[1e3, 1e3]), "axial_stiffness: .*expected shape"),
        (dict(mass=0), "mass: found 0 kg, expected more than 0"),
        (dict(mass=[1, 2]), "mass: .*expected a single number"),
        (dict(gravity=-9.81), "gravity: found -9.81 m/s², expected 0 or more"),
        (dict(inertia=[1, 1, 3]), "inertia: found principal moments"),
        (dict(inertia=[1, 1, -1]), "inertia: found principal moments"),
        (dict(inertia=[[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "inertia: found an unsymmetric matrix"),
        (dict(platform_size=(1, 0, 1)), "platform_size: .*three positive edges"),
        (dict(mobility="flat"), "unknown mobility 'flat': .*planar, spatial"),
        (dict(mobility="planar"), r"exits of cable 3: found y = 1 m, expected 0: a planar robot"),
        (dict(anchors=np.zeros((3, 3))), "platform_size: not given"),
        (dict(linear_density=-1.0), "linear_density: found -1 kg/m in cable 1"),
        (dict(pulley_radius=[0, 0, -0.1]), "pulley_radius: found -0.1 m in cable 3"),
        (dict(pulley_radius=[0, 1e-7, 0]), "pulley_radius: found 1e-07 m in cable 2, expected 0, for a point"),
        (dict(pulley_radius=0.02, pulley_axis=(0, 0, 0)), "pulley_axis: found an axis of length zero in cable 1"),
        (dict(stiffening=(1.0, 0.0, 0.0)), "stiffening: found an array of shape"),
    ],
)
def test_bad_robot_is_refused_with_the_field_and_what_is_expected(changes, words):
    """A robot that cannot be right never exists, and the message says which field is wrong."""
    with pytest.raises(cdpr.CdprError, match=words):
        robot(**changes)


@pytest.mark.parametrize(
    ("law", "rises"),
    [
        ((0.0, -8.0), True),  # 1 − 24 eps² is 0.04 at a strain of 20 %
        ((0.0, -9.0), False),
        ((-3.0, 0.0), False),
        ((-13.0, 50.0), False),  # by 1 − 26 eps + 150 eps², in between
        ((-20.0, 135.0), True),  # 1 − 40 eps + 3 a3 eps² has its least, 1 − 400/(3 a3), at 20/(3 a3)
        ((-20.0, 132.0), False),
    ],
)
def test_a_law_has_to_rise_up_to_a_strain_of_20_percent(law, rises):
    """Also one that falls in between only."""
    if rises:
        assert robot(stiffening=law).stiffening.tolist() == [[*law]] * 3
        return
    with pytest.raises(cdpr.InvalidInput, match=r"stiffening: .* tension falls before a strain of 20%"):
        robot(stiffening=law)


def test_robot_is_frozen_down_to_its_arrays():
    """A robot that two results share cannot change under them."""
    made = robot()
    with pytest.raises(AttributeError):
        made.mass = 2.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        made.exits[0, 0] = 5


def test_robot_keeps_a_copy_of_the_arrays_it_is_given():
    """Changing an array afterwards does not change the robot."""
    exits = np.array(EXITS, dtype=float)
    made = robot(exits=exits)
    exits[0, 0] = 99
    assert made.exits[0, 0] == -1
    assert made.replace(mass=2.0).exits[0, 0] == -1


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


def test_replace_of_a_changed_copy_remembers_both_changes():
    """Material, then mass: neither undoes the other."""
    changed = robot().replace(material="fishing-0.4mm").replace(mass=2.0)
    assert (changed.material, changed.mass) == ("fishing-0.4mm", 2.0)
    assert (changed.axial_stiffness == cdpr.MATERIALS["fishing-0.4mm"].axial_stiffness).all()


def test_replace_material_sets_the_stiffness_and_a_stiffness_forgets_the_material():
    """The name of a material never stands beside a stiffness that is not its own."""
    soft = robot().replace(material="fishing-0.4mm")
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
    with pytest.raises(cdpr.InvalidInput, match=r"linear_density: found 'material', .* mass of vectran-0.7mm is not"):
        rope.replace(material="vectran-0.7mm")
    with pytest.raises(cdpr.InvalidInput, match="linear_density: found 'material' without a material"):
        robot(linear_density="material")
    with pytest.raises(cdpr.InvalidInput, match="diameter: found it in replace, expected material='steel-rope-4mm'"):
        rope.replace(diameter=0.004)
    with pytest.raises(cdpr.UnknownName, match=r"'steel-4mm': did you mean steel-rope-4mm\?"):
        rope.replace(material="steel-4mm")


def test_a_breaking_load_belongs_to_the_material():
    """Set with it, forgotten with it, and kept where it is given beside it."""
    rope = robot().replace(material="dyneema-2mm")
    assert (rope.breaking_load == cdpr.ROPES["dyneema"].of(0.002).breaking_load).all()
    assert (rope.replace(mass=2.0).breaking_load == rope.breaking_load).all()
    assert np.isinf(rope.replace(material="fishing-0.4mm").breaking_load).all()
    assert np.isinf(rope.replace(axial_stiffness=5.0).breaking_load).all()
    assert (rope.replace(axial_stiffness=5.0, breaking_load=7.0).breaking_load == 7.0).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (dict(material="nylon"), "unknown material 'nylon'.*vectran-0.7mm"),
        (dict(materiel="x"), "unknown field of a robot 'materiel': did you mean material"),
    ],
)
def test_replace_names_what_it_does_not_know(changes, words):
    """A typo gets the nearest valid name."""
    with pytest.raises(cdpr.UnknownName, match=words):
        robot().replace(**changes)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ((0, 0), r"pose: found an array of shape \(2,\)"),
        ((0, 0, np.nan), "pose: .*finite"),
        ("up", "pose: found 'up'"),
        ((-0.9, 0, 1), r"exit of cable 1 lies on its anchor"),
    ],
)
def test_bad_pose_is_refused(pose, words):
    """A pose is three or six finite numbers, away from the exits."""
    with pytest.raises(cdpr.InvalidInput, match=words):
        robot().rest_lengths(pose)


@pytest.mark.parametrize("pose", [(0.4, 0.1, 0.2), (0.4, 0, 0.2, 0.1, 0, 0), (0.4, 0, 0.2, 0, 0.1, 0.1)])
def test_planar_robot_refuses_a_pose_out_of_its_plane(pose):
    """A planar robot moves along x and z and turns about y."""
    with pytest.raises(cdpr.InvalidInput, match="planar: expected y = 0 and"):
        cdpr.load_robot("two-cable").pose(pose)


def test_rest_lengths_are_distances_at_the_commanded_pose():
    """Eq. 1 and 2, by Pythagoras: exit (-1, 0, 1), anchor at (-0.1, 0, 0)."""
    assert robot().rest_lengths((0, 0, 0))[0] == pytest.approx(np.hypot(0.9, 1.0))


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
