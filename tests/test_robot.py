import numpy as np
import pytest

import cdpr_sim as cdpr

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
    ],
)
def test_bad_robot_is_refused_with_the_field_and_what_is_expected(changes, words):
    """A robot that cannot be right never exists, and the message says which field is wrong."""
    with pytest.raises(cdpr.CdprError, match=words):
        robot(**changes)


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


def test_default_inertia_is_that_of_a_uniform_box():
    """m/12 (b² + c²) about each edge's direction."""
    made = robot(mass=12.0, platform_size=(1, 2, 3))
    np.testing.assert_allclose(made.inertia, np.diag([4 + 9, 1 + 9, 1 + 4]))


def test_replace_changes_the_copy_and_what_follows_from_it():
    """A heavier copy has a larger default inertia; the original stays."""
    made = robot()
    heavier = made.replace(mass=2.0)
    np.testing.assert_allclose(heavier.inertia, 2 * made.inertia)
    assert made.mass == 1.0


def test_replace_keeps_an_inertia_that_was_given():
    """Only the default follows the mass."""
    made = robot(inertia=[1, 1, 1])
    np.testing.assert_array_equal(made.replace(mass=2.0).inertia, np.eye(3))


def test_replace_material_sets_the_stiffness_and_a_stiffness_forgets_the_material():
    """The name of a material never stands beside a stiffness that is not its own."""
    soft = robot().replace(material="fishing-0.4mm")
    assert (soft.axial_stiffness == cdpr.MATERIALS["fishing-0.4mm"].axial_stiffness).all()
    assert soft.replace(axial_stiffness=5.0).material is None


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


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        (dict(rest_lengths=[1, 1]), r"rest_lengths: .*expected shape \(3,\)"),
        (dict(rest_lengths=[1, 1, 0]), "rest_lengths: found 0 m, expected more than 0"),
        (dict(external_wrench=[1, 2, 3]), r"external_wrench: .*expected shape \(6,\)"),
        (dict(external_wrench=[0, 0, np.inf, 0, 0, 0]), "external_wrench: found inf"),
    ],
)
def test_bad_problem_is_refused(keywords, words):
    """Rest lengths and wrenches are checked before any solver sees them."""
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.Problem.of(robot(), (0, 0, 0), **keywords)


def test_planar_robot_refuses_a_wrench_out_of_its_plane():
    """What the plane would carry is not ignored in silence."""
    with pytest.raises(cdpr.InvalidInput, match=r"external_wrench: .*planar"):
        cdpr.Problem.of(cdpr.load_robot("two-cable"), (0.4, 0, 0.2), external_wrench=[0, 1, 0, 0, 0, 0])


def test_robot_that_no_cable_holds_falls():
    """Commanded above all its exits, a platform falls: cables cannot push."""
    with pytest.raises(cdpr.InvalidInput, match="falls since cables cannot push"):
        cdpr.Problem.of(robot(), (0, 0, 2.0))
    cdpr.Problem.of(robot(), (0, 0, 2.0), external_wrench=[0, 0, 20, 0, 0, 0])  # held down from above: no fall
