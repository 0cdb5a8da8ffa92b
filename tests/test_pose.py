import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import pose


def test_six_vector_follows_the_papers_convention():
    """R = Rz(gamma) Ry(beta) Rx(alpha), written out."""
    a, b, g = 0.3, -0.2, 0.7
    Rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    Ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    Rz = np.array([[np.cos(g), -np.sin(g), 0], [np.sin(g), np.cos(g), 0], [0, 0, 1]])
    made = pose.Pose.of([1, 2, 3, a, b, g]).transform
    np.testing.assert_allclose(made.rotation.as_matrix(), Rz @ Ry @ Rx, atol=1e-15)
    np.testing.assert_allclose(pose.six_vector(made), [1, 2, 3, a, b, g], atol=1e-15)


def test_position_alone_is_a_level_pose():
    """Three numbers are (x, y, z) with the platform level."""
    made = pose.Pose.of((1, 2, 3)).transform
    np.testing.assert_array_equal(made.rotation.as_matrix(), np.eye(3))


def test_rigid_transform_passes_through():
    """SciPy's type is the pose type."""
    transform = RigidTransform.from_translation([1, 2, 3])
    assert pose.Pose.of(transform).transform is transform


def test_stack_of_transforms_is_refused():
    """One pose at a time."""
    stack = RigidTransform.from_translation([[1, 2, 3], [4, 5, 6]])
    with pytest.raises(ValueError, match="stack of 2"):
        pose.Pose.of(stack)


@pytest.mark.parametrize("degrees", [0, 1e-6, 30, 90, 150, 180])
def test_tilt_is_the_angle_to_the_vertical_whatever_the_heading(degrees):
    """Turning about the vertical does not tilt; turning about a horizontal axis does, at every size."""
    angle = np.radians(degrees)
    rotation = Rotation.from_rotvec([0, 0, 0.4]) * Rotation.from_rotvec([angle * 0.6, angle * 0.8, 0])
    assert pose.tilt_of_matrices(rotation.as_matrix()) == pytest.approx(angle, abs=1e-12)


def test_euler_at_gimbal_lock_is_quiet_and_right():
    """At beta = 90° alpha and gamma are not unique, but what comes out is the same rotation."""
    rotation = Rotation.from_euler("xyz", [0.2, np.pi / 2, 0.5])
    again = Rotation.from_euler("xyz", pose.euler(rotation))
    assert (again * rotation.inv()).magnitude() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 0.3, np.pi / 2, np.pi - 1e-7, np.pi])
def test_the_angle_between_rotations_is_scipys(angle):
    """To rounding, however small or large; of many as of one."""
    one, turn = Rotation.from_euler("xyz", [0.3, -0.2, 2.0]), Rotation.from_rotvec(angle * np.array([0.6, 0, 0.8]))
    matrices = np.array([(turn * one).as_matrix(), one.as_matrix()])
    found = pose.angle_between(matrices, one.as_matrix())
    np.testing.assert_allclose(found, [(turn).magnitude(), 0], atol=1e-15)


def test_a_pose_reads_as_what_it_was_given_as():
    """As arrays and as SciPy's object, which is made once, and is the one that was given."""
    given = pose.Pose.of([1, 2, 3, 0.1, 0.2, 0.3]).transform
    arrays = pose.Pose(given.translation, given.rotation.as_matrix())
    assert pose.Pose.of(given).transform is given
    assert arrays.transform is arrays.transform
    np.testing.assert_allclose(arrays.transform.as_matrix(), given.as_matrix(), atol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        arrays.position[0] = 0.0
