"""Files of measurements are read as they are written, in SI units; what was not measured is no number."""

import numpy as np
import pytest
from test_refusals_motion import POSES, SENSORS, read

import cdpr_sim as cdpr


def test_units_and_gaps_are_read_as_written(tmp_path):
    """Millimetres and degrees become metres and radians; an empty cell and an absent column were not measured."""
    found = read(tmp_path, file=POSES)
    assert found.commanded == pytest.approx(np.array([[0.17, 0.25, 0.1, 0, 0, 0], [0.4, 0.25, 0.1, 0, 0, 0]]))
    assert found.measured[0, [2, 4]] == pytest.approx([0.0923, np.radians(26.4)])
    assert found.known.tolist() == [[False, False, True, False, True, False], [False, False, True, False, False, False]]
    assert found.robot == "parallel"


def test_commanded_angles_are_kept():
    """A six-vector is a position [m] and angles [rad]; a position alone is level."""
    six, three = np.arange(1.0, 7.0), np.arange(1.0, 4.0)
    assert cdpr.Measurements.of([six], [[0.5]], coordinates=["z"]).commanded.tolist() == [six.tolist()]
    assert cdpr.Measurements.of([three], [[0.5]], coordinates=["z"]).commanded.tolist() == [[1, 2, 3, 0, 0, 0]]


def test_rest_lengths_are_read_in_the_order_of_their_numbers(tmp_path):
    """Whatever the order of the columns."""
    text = "rest_length_2 [m],commanded_x [m],commanded_y [m],commanded_z [m],rest_length_1 [mm],measured_z [m]\n"
    found = read(tmp_path, file=text + "0.6,0.4,0,0.2,500,0.2\n")
    assert found.rest_lengths == pytest.approx(np.array([[0.5, 0.6]]))


def test_all_that_robots_measure_is_read_with_its_errors(tmp_path):
    """Tensions, swivel angles, frequencies, loads: in SI units, nan where not measured; an absent load is none."""
    found = read(tmp_path, file=SENSORS)
    assert found.names[6:] == ("tension 1", "tension 2", "swivel 1", "swivel 2", "frequency 1")
    assert found.values[0, 6:] == pytest.approx(np.array([np.nan, 30, np.pi / 2, np.nan, 2.5]), nan_ok=True)
    assert found.known.sum(1).tolist() == [3, 0]
    assert found.errors[0, 7] == 2
    assert np.isnan(found.errors).sum() == found.errors.size - 1
    assert found.rest_length_errors is not None
    assert found.rest_length_errors.tolist() == [[1e-3, 0], [0, 0]]
    assert found.masses == pytest.approx(np.array([0.4, np.nan]), nan_ok=True)
    assert found.wrenches is not None
    assert found.wrenches.tolist() == [[0, 0, -1, 0, 0.02, 0], [0] * 6]
    # Errors by kind count where none is stated.
    later = found.with_errors({"tension": 5.0, "swivel": 0.1, "rest_length": 3e-3})
    assert later.errors[0, 6:] == pytest.approx(np.array([5, 2, 0.1, 0.1, np.nan]), nan_ok=True)
    assert later.rows([0]).values.tolist()[0][7] == 30
