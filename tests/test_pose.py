import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import pose


def test_six_vector_follows_the_papers_convention():
    """R = Rz(gamma) Ry(beta) Rx(alpha), written out; three numbers are a level pose; SciPy's type passes through."""
    a, b, g = 0.3, -0.2, 0.7
    Rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    Ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    Rz = np.array([[np.cos(g), -np.sin(g), 0], [np.sin(g), np.cos(g), 0], [0, 0, 1]])
    made = pose.Pose.of([1, 2, 3, a, b, g]).transform
    np.testing.assert_allclose(made.rotation.as_matrix(), Rz @ Ry @ Rx, atol=1e-15)
    np.testing.assert_allclose(pose.six_vector(made), [1, 2, 3, a, b, g], atol=1e-15)
    level = RigidTransform.from_translation([1, 2, 3])
    np.testing.assert_array_equal(pose.Pose.of((1, 2, 3)).transform.as_matrix(), level.as_matrix())
    assert pose.Pose.of(level).transform is level


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
    found = pose.angle_between(np.array([(turn * one).as_matrix(), one.as_matrix()]), one.as_matrix())
    np.testing.assert_allclose(found, [turn.magnitude(), 0], atol=1e-15)


def test_a_pose_of_arrays_reads_as_scipys():
    """SciPy's object is made once; the arrays are read-only."""
    given = pose.Pose.of([1, 2, 3, 0.1, 0.2, 0.3]).transform
    arrays = pose.Pose(given.translation, given.rotation.as_matrix())
    assert arrays.transform is arrays.transform
    np.testing.assert_allclose(arrays.transform.as_matrix(), given.as_matrix(), atol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        arrays.position[0] = 0.0
