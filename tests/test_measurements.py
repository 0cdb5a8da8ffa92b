import numpy as np
import pytest

import cdpr_sim as cdpr

GOOD = """# DemoBot, fishing line
commanded_x [mm], commanded_y [mm], commanded_z [mm], measured_z [mm], measured_beta [deg], robot
170, 250, 100, 92.3, 26.4, parallel
400, 250, 100, 99.5,, parallel
"""


SENSORS = """commanded_x [m],commanded_y [m],commanded_z [m],rest_length_1 [m],rest_length_2 [m],\
rest_length_1_error [mm],tension_2 [kN],tension_2_error [N],swivel_1 [deg],frequency_1 [Hz],mass [g],\
force_z [N],torque_y [N mm]
0.4,0,0.2,0.5,0.6,1,0.03,2,90,2.5,400,-1,20
0.4,0,0.3,0.4,0.5,,,,,,,,
"""


def written(tmp_path, text: str):
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_units_and_gaps_are_read_as_written(tmp_path):
    """Millimetres and degrees become metres and radians; an empty cell and an absent column were not measured."""
    found = cdpr.read_measurements(written(tmp_path, GOOD))
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
    found = cdpr.read_measurements(written(tmp_path, text + "0.6,0.4,0,0.2,500,0.2\n"))
    assert found.rest_lengths == pytest.approx(np.array([[0.5, 0.6]]))


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            GOOD,
            "measured_beta",
            "mesured_beta",
            "unknown column 'mesured_beta \\[deg\\]': did you mean 'measured_beta'",
        ),
        (GOOD, "measured_z [mm]", "measured_z", "column 'measured_z': found no unit, expected one of m, cm, mm"),
        (GOOD, "measured_z [mm]", "measured_z [deg]", "found unit 'deg', expected one of m, cm"),
        (GOOD, "measured_z [mm]", "measured_beta [deg]", "found column 'measured_beta' twice"),
        (GOOD, "commanded_x [mm]", "commanded_alpha [deg]", "found no column 'commanded_x'"),
        (GOOD, "92.3", "nan", "line 3, column 'measured_z': found 'nan', expected a finite number"),
        (GOOD, "92.3", "92,3", "line 3: found 7 cells, expected 6"),
        (GOOD, "92.3", "high", "line 3, column 'measured_z': found 'high'"),
        (GOOD, "170,", ",", "line 3, column 'commanded_x': found nothing"),
        (
            GOOD,
            ", parallel\n400",
            ", cogiro\n400",
            "found measurements of cogiro, parallel, expected those of one robot",
        ),
        (SENSORS, "tension_2_error", "tension_3_error", "found column 'tension_3_error', expected 'tension_3' as well"),
        (SENSORS, ",0.03,2,", ",0.03,0,", "line 2, column 'tension_2_error': found 0, expected a positive number"),
        (SENSORS, ",2.5,400", ",-2.5,400", "frequencies: found -2.5, expected positive numbers"),
        (SENSORS, "mass [g]", "mass [m]", "column 'mass': found unit 'm', expected one of kg, g"),
        (SENSORS, "force_z [N]", "force_w [N]", "unknown column 'force_w \\[N\\]': did you mean 'force_"),
        (SENSORS, "0.03,2,90,2.5", ",,,", "found no measured number"),
    ],
)
def test_what_is_wrong_is_said_with_line_and_column(tmp_path, file, old, new, message):
    """One sentence each."""
    assert old in file
    with pytest.raises(cdpr.InvalidInput, match=message) as caught:
        cdpr.read_measurements(written(tmp_path, file.replace(old, new, 1)))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_empty_or_no_text_is_said(tmp_path):
    """One sentence each."""
    with pytest.raises(cdpr.InvalidInput, match="no such file"):
        cdpr.read_measurements(tmp_path / "none.csv")
    with pytest.raises(cdpr.InvalidInput, match="found no rows"):
        cdpr.read_measurements(written(tmp_path, GOOD.splitlines()[1]))
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(cdpr.InvalidInput, match="found bytes that are not UTF-8, expected text"):
        cdpr.read_measurements(path)
    with pytest.raises(cdpr.InvalidInput, match="cannot be read: Is a directory"):
        cdpr.read_measurements(tmp_path)
    for separator, said in ((";", "';'"), ("\t", "a tab")):
        with pytest.raises(cdpr.InvalidInput, match=f"found {said} between the columns, expected ','"):
            cdpr.read_measurements(written(tmp_path, GOOD.replace(",", separator)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"commanded": [[0, 0, 0]], "measured": [[0, 0]]}, "measured: found an array of shape"),
        ({"commanded": [[0, 0]], "measured": [[0] * 6]}, "commanded: found 2 columns"),
        ({"commanded": [[0, 0, 0]], "measured": [[np.nan] * 6]}, "found no measured number"),
        ({"commanded": [[0, 0, 0]], "measured": [[0]], "coordinates": ["h"]}, "unknown coordinate 'h'"),
    ],
)
def test_arrays_that_do_not_fit_are_said(arguments, message):
    """The field, what was found and what is expected."""
    with pytest.raises(cdpr.CdprError, match=message):
        cdpr.Measurements.of(**arguments)


def test_all_that_robots_measure_is_read_with_its_errors(tmp_path):
    """Tensions, swivel angles, frequencies, loads: in SI units, nan where not measured; an absent load is none."""
    found = cdpr.read_measurements(written(tmp_path, SENSORS))
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


@pytest.mark.parametrize(
    ("arguments", "robot", "message"),
    [
        ({"tensions": [[1.0] * 4]}, "cogiro", "found 4 tensions, expected 8, one per cable"),
        ({"swivels": [[1.0] * 8]}, "cogiro", "found the swivel angle of cable 1, which has no pulley"),
        ({"frequencies": [[1.0] * 7]}, "cogiro", "found 7 natural frequencies, expected at most 6"),
        ({"frequencies": [[1.0]], "wrenches": [[0, 0, 0, 0, 1.0, 0]]}, "cogiro", "under an external torque"),
    ],
)
def test_what_a_robot_cannot_have_measured_is_said(arguments, robot, message):
    """The kind, and what the robot has."""
    with pytest.raises(cdpr.InvalidInput, match=message):
        cdpr.Measurements.of([[0.4, 0.25, 0.2]], **arguments).check_robot(cdpr.load_robot(robot))
