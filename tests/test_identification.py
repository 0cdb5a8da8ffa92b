import json
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import cdpr_sim as cdpr
from cdpr_sim.analysis.identifiability import WORSE
from cdpr_sim.analysis.identification_model import UNKNOWNS, IdentificationModel, unknowns_of
from cdpr_sim.report import as_json
from cdpr_sim.report.analysis_tables import identification_note, identification_table
from cdpr_sim.statics import newton
from studies.coverage import fitted, held

NOISE = 2e-5
"""[m] of a measured coordinate; DemoBot's tracker states 6.5e-5."""

SLOPE = 1e-5
"""Relative error of central differences through the solver: 7e-7 measured at worst."""

SAGGING = 1e-4
"""As ``SLOPE``, of cables with mass over pulleys: 5e-5 measured at worst, of a tension by the wheels' radius."""

SOLVED = 1e-7
"""Of the largest derivative by an unknown: two equilibria of sagging cables differ by 4e-11 rad, over steps of 1e-4."""

FITTED = 1e-5
"""Relative error of what is fitted to MuJoCo's poses without noise: they are 1e-9 m from
statics', over a sag of 4e-4 m."""

FITS = 20
"""To judge standard errors by: all of them together, nine numbers each, and the test asserts what they can tell."""

WEIGHED = 0.01
"""Of a standard error: judged scatters settle to a thousandth of themselves, which weighs positions against angles."""

LINEAR = 0.01
"""Relative error of predictions to first order in the noise: 1e-3 measured."""

LIKELY = [0.0005, 0.9995]
"""Quantiles between which a sum of squares lies in all but one of a thousand cases."""


def commanded(rows: int = 12, seed: int = 0) -> np.ndarray:
    """Positions all over DemoBot's workspace."""
    return np.random.default_rng(seed).uniform([0.15, 0.12, 0.05], [0.65, 0.38, 0.3], (rows, 3))


def exact_poses(robot: cdpr.Robot, positions: np.ndarray, offsets: np.ndarray | float = 0.0) -> np.ndarray:
    """Six-vectors of statics."""
    rest = np.array([robot.rest_lengths(position) for position in positions]) + offsets
    solved = newton.solve_many(robot, positions, rest_lengths=rest)
    return np.hstack([solved.positions, solved.euler])


def noisy(robot: cdpr.Robot, poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    sigma = np.repeat([NOISE, NOISE / robot.characteristic_length], 3)
    return poses + rng.normal(size=poses.shape) * sigma


@pytest.fixture(scope="module")
def robot() -> cdpr.Robot:
    """What one believes the robot to be: DemoBot on the catalogue's fishing line."""
    return cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")


@pytest.mark.parametrize(
    ("left_out", "linear_density", "least"),
    [(("axial_stiffness", "angle_zeros"), 0.0, SLOPE), (("axial_stiffness_each", "yaw_zero"), 1e-3, SAGGING)],
    ids=["straight", "sagging"],
)
def test_derivatives_of_the_residuals_are_exact(robot, left_out, linear_density, least):
    """Every unknown, every kind of measurement, at poses away from the middle with a load, against central differences.

    All unknowns of a parameter (of every cable, of every axis) change at once, each by its own step. Those that exclude
    each other take turns.
    """
    robot = robot.replace(winch_to_exit=0.1, pulley_radius=0.01, linear_density=linear_density)
    measurements = cdpr.Measurements.of(
        commanded(2),
        np.zeros((2, 6)),
        tensions=np.ones((2, 8)),
        swivels=np.zeros((2, 8)),
        frequencies=np.ones((2, 6)),
        masses=[np.nan, 0.5],
        wrenches=np.tile([1.0, 0.5, 0.0, 0.0, 0.0, 0.0], (2, 1)),
    )
    unknowns = unknowns_of(robot, measurements, [name for name in UNKNOWNS if name not in left_out])
    assert len({one.name for one in unknowns}) == len(unknowns) > 90
    model, at = IdentificationModel(robot, measurements, unknowns), np.zeros(len(unknowns))
    exact = model.slopes(at)
    assert (np.abs(exact).max((0, 1)) > 0).all()
    random = np.random.default_rng(0)
    for parameter in dict.fromkeys(one.parameter for one in unknowns):
        members = [k for k, one in enumerate(unknowns) if one.parameter == parameter]
        step = np.zeros(len(unknowns))
        step[members] = random.choice([-1, 1], len(members)) * random.uniform(0.5, 1, len(members))
        small = 1e-4 if unknowns[members[0]].logarithmic else 1e-6
        if len(members) == 1 and unknowns[members[0]].value(-small) < unknowns[members[0]].least:
            continue
        differenced = (model.residuals(at + small * step) - model.residuals(at - small * step)) / (2 * small)
        along, largest = exact @ step, np.abs(exact[:, :, members]).max()
        for kind in range(4):  # frequencies are differenced themselves
            of_kind = measurements.kinds == kind
            off = np.abs(differenced - along)[:, of_kind].max()
            by = np.abs(exact[:, of_kind][:, :, members]).max()
            assert off <= least * by + SOLVED * largest, (parameter, kind)


def test_stiffness_is_found_from_poses_that_mujoco_made(robot):
    """The solver made none of the data: MuJoCo settled a robot of another EA, and EA comes out to six digits."""
    true = robot.replace(axial_stiffness=730.0)
    settled = cdpr.settle_many(true, commanded(8))
    poses = np.hstack([settled.poses.translation, settled.poses.rotation.as_euler("xyz")])
    found = cdpr.identify(robot, cdpr.Measurements.of(commanded(8), poses))
    assert found["axial_stiffness"][0] == pytest.approx(730.0, rel=FITTED)
    # Negative control: with the wrong mass in the model the same data give another EA.
    other = cdpr.identify(robot.replace(mass=0.41), cdpr.Measurements.of(commanded(8), poses))
    assert other["axial_stiffness"][0] == pytest.approx(730.0 * 0.41 / 0.4, rel=1e-4)


def test_standard_errors_are_as_large_as_the_errors(robot):
    """Over many noises, EA and eight rest-length offsets: errors over standard errors have squares that sum to chi².

    One by one, and all nine together by their correlations, which are those of the errors; standard errors wrong by a
    third would be found out. Where no errors are stated they are judged, and stating what was judged is the same.
    """
    rng = np.random.default_rng(7)
    offsets = rng.normal(size=8) * 1e-4
    true = robot.replace(axial_stiffness=800.0)
    positions, asked = commanded(4), ("axial_stiffness", "rest_length_offsets")
    poses, truth = exact_poses(true, positions, offsets), np.array([800.0, *offsets])
    products, together, spreads = np.zeros((9, 9)), 0.0, 0.0
    for fit in range(FITS):
        measurements = cdpr.Measurements.of(positions, noisy(true, poses, rng))
        errors: dict[str, Any] = dict(position_error=NOISE, rotation_error=NOISE / robot.characteristic_length)
        found = cdpr.identify(robot, measurements, asked, **errors)
        assert found.reasons == ()
        off = (found.values - truth) / found.standard_errors
        products += np.outer(off, off)
        together += off @ np.linalg.solve(found.correlations, off)
        spreads += (poses.size - 9) * found.spread**2
        if fit == 0:
            judged = cdpr.identify(robot, measurements, asked)
            assert judged.estimated == ("position", "rotation")
            assert 0.5 < judged.scatters["position"] / errors["position_error"] < 2
            assert 0.5 < judged.scatters["rotation"] / errors["rotation_error"] < 2
            position_error, rotation_error = judged.scatters.values()
            same = cdpr.identify(
                robot, measurements, asked, position_error=position_error, rotation_error=rotation_error
            )
            assert (np.abs(judged.values - same.values) < WEIGHED * same.standard_errors).all()
            assert judged.standard_errors == pytest.approx(same.standard_errors, rel=WEIGHED)
    low, high = chi2.ppf(LIKELY, FITS)
    assert (np.diag(products) >= low).all()
    assert (np.diag(products) <= high).all()
    scatter = np.sqrt((1 + found.correlations**2) / FITS)  # of the mean product of two correlated normal numbers
    assert (np.abs(products / FITS - found.correlations) < 3.5 * scatter).all()
    assert (np.abs(products / FITS - np.eye(9)) > 3.5 / np.sqrt(FITS)).any()  # were they not correlated
    low, high = chi2.ppf(LIKELY, 9 * FITS)
    assert low <= together <= high
    assert not low <= together / 1.33**2 <= high
    assert not low <= together * 1.33**2 <= high
    low, high = chi2.ppf(LIKELY, (poses.size - 9) * FITS)
    assert low <= spreads <= high


def test_positions_alone_are_judged_by_themselves(robot):
    """No angle was measured: what an angle's scatter might be has no part in the standard errors."""
    truth = robot.replace(axial_stiffness=850.0)
    rng = np.random.default_rng(3)
    measured = exact_poses(truth, commanded())[:, :3] + rng.normal(size=(12, 3)) * NOISE
    measurements = cdpr.Measurements.of(commanded(), measured, coordinates="xyz")
    judged = cdpr.identify(robot, measurements)
    stated = cdpr.identify(robot, measurements, position_error=judged.scatters["position"])
    assert judged.estimated == ("position",)
    assert 0.5 < judged.scatters["position"] / NOISE < 2
    assert judged.standard_errors == pytest.approx(stated.standard_errors, rel=WEIGHED)


def test_stiffness_and_mass_cannot_be_told_apart_and_it_says_so(robot):
    """Doubling both moves nothing: their errors are infinite, their ratio is right, and a sentence names the two."""
    measurements = cdpr.Measurements.of(commanded(), exact_poses(robot.replace(axial_stiffness=800.0), commanded()))
    found = cdpr.identify(robot, measurements, ("axial_stiffness", "mass"))
    assert np.isinf(found.standard_errors).all()
    assert found.values[0] / found.values[1] == pytest.approx(800.0 / 0.4, rel=FITTED)
    assert "cannot distinguish axial_stiffness and mass" in found.reasons[0]
    # Negative control: either alone is determined.
    for name in ("axial_stiffness", "mass"):
        alone = cdpr.identify(robot, measurements, (name,), position_error=NOISE, rotation_error=1e-4)
        assert np.isfinite(alone.standard_errors).all()
        assert alone.reasons == ()


def test_a_slack_cables_stiffness_is_not_in_the_data_and_keeps_its_value(catalogue):
    """Where a cable never pulls, its EA has no effect, and it is named; it once came back as 562, from nowhere."""
    robot = catalogue["planar-vertical"].replace(axial_stiffness=1000.0)
    positions = np.array([[0.15, 0, z] for z in (0.1, 0.15, 0.2)])
    solved = cdpr.solve_many(robot.replace(axial_stiffness=550.0), positions)
    slack = np.flatnonzero((solved.tensions == 0).all(0))
    assert slack.size
    measured = np.stack([*solved.positions[:, [0, 2]].T, solved.euler[:, 1]], axis=1)
    measurements = cdpr.Measurements.of(positions, measured, coordinates=("x", "z", "beta"))
    found = cdpr.identify(robot, measurements, ("axial_stiffness_each",), position_error=NOISE)
    for cable in slack:
        assert f"the data do not depend on axial_stiffness {cable + 1}" in found.reasons
        assert np.isinf(found.standard_errors[cable])
    assert found.values[slack] == pytest.approx(1000.0, rel=1e-9)
    assert np.delete(found.values, slack) == pytest.approx(550.0, rel=1e-3)


def test_a_model_that_does_not_explain_the_data_is_said(robot):
    """Poses of a robot with rest lengths off by a millimetre: EA alone cannot mend that."""
    poses = exact_poses(robot, commanded(), np.array([1e-3, 0, 0, 0, 0, 0, 0, 0]))
    found = cdpr.identify(robot, cdpr.Measurements.of(commanded(), poses), position_error=NOISE)
    assert "does not explain the data" in found.reasons[0]


def test_only_what_was_measured_counts(catalogue):
    """From heights alone, as the paper's Fig. 12a gives them."""
    robot = catalogue["parallel"]
    positions = np.array([[x, 0.25, 0.1] for x in np.linspace(0.2, 0.6, 7)])
    poses = exact_poses(robot.replace(axial_stiffness=2500.0), positions)
    found = cdpr.identify(robot, cdpr.Measurements.of(positions, poses[:, 2:3], coordinates=["z"]))
    assert found["axial_stiffness"][0] == pytest.approx(2500.0, rel=1e-4)
    assert np.isnan(found.residuals[:, [0, 1, 3, 4, 5]]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unknowns": ["axial_stifness"]}, "did you mean axial_stiffness"),
        ({"unknowns": []}, "unknowns: found none"),
        ({"unknowns": ["mass", "mass"]}, "expected each once"),
        ({"unknowns": ["axial_stiffness", "axial_stiffness_each"]}, "expected one of the two"),
        ({"position_error": -1}, "position_error: found -1"),
        ({"position_error": np.nan}, "position_error: found nan"),
        (
            {"unknowns": ["axial_stiffness_each", "rest_length_offsets"]},
            "found 6 measured numbers, expected 16 or more",
        ),
    ],
)
def test_requests_that_cannot_be_right_get_one_sentence(robot, changes, message):
    """The field, what was found and what is expected."""
    measurements = cdpr.Measurements.of(commanded(1), exact_poses(robot, commanded(1)))
    with pytest.raises(cdpr.CdprError, match=message):
        cdpr.identify(robot, measurements, **changes)


def test_measurements_of_another_robot_are_refused(catalogue):
    """By name, by the number of cables, and by what a planar robot cannot do."""
    positions = commanded(2)
    named = cdpr.Measurements.of(positions, np.zeros((2, 6)), robot="cogiro")
    with pytest.raises(cdpr.InvalidInput, match="found measurements of 'cogiro', expected those of 'parallel'"):
        cdpr.identify(catalogue["parallel"], named)
    lengths = cdpr.Measurements.of(positions, np.zeros((2, 6)), rest_lengths=np.ones((2, 4)))
    with pytest.raises(cdpr.InvalidInput, match="found 4 rest lengths, expected 8"):
        cdpr.identify(catalogue["parallel"], lengths)
    with pytest.raises(cdpr.InvalidInput, match="'two-cable' is planar"):
        cdpr.identify(catalogue["two-cable"], cdpr.Measurements.of(positions, np.zeros((2, 6))))


def test_the_papers_15_mm_need_cables_ten_times_softer_than_assumed(catalogue):
    """EA of about 0.12 kN for the ends of the line at z = 0.1 m; MuJoCo, given that EA, is 15 mm off there.

    Half of it is no elasticity: on all but rigid cables the platform is 7.6 mm off, so that two cables whose EA differ
    tenfold cannot both be 15 mm off: the stiffer one is then 8.3 mm off, or the softer one more than 50 mm.
    """
    robot = catalogue["parallel"]
    ends = np.array([[0.17, 0.25, 0.1], [0.63, 0.25, 0.1]])
    measurements = cdpr.Measurements.of(ends, ends[:, 2:] - 0.015, coordinates=["z"])
    found = cdpr.identify(robot, measurements)
    stiffness = found["axial_stiffness"][0]
    assert 100 < stiffness < 140

    def height(factor: float) -> float:
        settled = cdpr.settle(robot.replace(axial_stiffness=factor * stiffness), ends[0])
        return 1e3 * float(settled.deviation[2])

    assert height(1) == pytest.approx(-15, abs=1e-3)
    assert height(10) == pytest.approx(-8.34, abs=0.01)
    assert height(0.1) < -50
    assert height(1e4) == pytest.approx(-7.6, abs=0.02)


def test_a_stiffness_that_the_data_hardly_determine_is_said(robot):
    """Two angles of 30 poses, with offsets of lengths beside EA: its error is a good part of it. EA alone: no word."""
    poses = exact_poses(robot, commanded(30))
    angles = poses[:, 3:5] + np.random.default_rng(1).normal(size=(30, 2)) * np.radians(0.1)
    measurements = cdpr.Measurements.of(commanded(30), angles, coordinates=("alpha", "beta"))
    noise = np.radians(0.1)
    both = cdpr.identify(robot, measurements, ("axial_stiffness", "rest_length_offsets"), rotation_error=noise)
    alone = cdpr.identify(robot, measurements, "axial_stiffness", rotation_error=noise)
    value, error = both["axial_stiffness"]
    assert error > value / 3
    assert any("hardly determine axial_stiffness" in reason for reason in both.reasons)
    assert not any("hardly determine" in reason for reason in alone.reasons)


def test_more_unknowns_than_the_data_hold_are_said_to_be_so(robot):
    """EA and eight offsets from two angles of 12 poses: EA alone predicts those left out several times better.

    The whole poses hold as many unknowns: offsets that are there are needed to predict poses, and those that are none
    spoil little.
    """
    asked, alone = ("axial_stiffness", "rest_length_offsets"), ("axial_stiffness",)
    true = robot.replace(axial_stiffness=1000.0)
    angles = exact_poses(true, commanded())[:, 3:5] + np.random.default_rng(2).normal(size=(12, 2)) * np.radians(0.1)
    found = cdpr.identify(robot, cdpr.Measurements.of(commanded(), angles, coordinates=("alpha", "beta")), asked)
    worse = found.predictions[asked] / found.predictions[alone]
    assert worse > 2 * WORSE
    said = f"the data do not determine so many unknowns: omitted rows are predicted {worse:.2g} times better by"
    assert [one for one in found.reasons if "so many unknowns" in one] == [f"{said} axial_stiffness alone"]
    rng = np.random.default_rng(2)
    for offsets in (1e-4 * rng.normal(size=8), np.zeros(8)):
        poses = noisy(true, exact_poses(true, commanded(), offsets), rng)
        found = cdpr.identify(robot, cdpr.Measurements.of(commanded(), poses), asked)
        assert found.reasons == ()
        assert (found.predictions[asked] < found.predictions[alone]) == offsets.any()


def test_one_stiffness_predicts_better_than_eight_that_the_data_do_not_hold(robot):
    """Heights of 12 poses, of cables that are alike."""
    heights = exact_poses(robot, commanded())[:, 2:3] + np.random.default_rng(3).normal(size=(12, 1)) * 2e-4
    measurements = cdpr.Measurements.of(commanded(), heights, coordinates=["z"])
    found = cdpr.identify(robot, measurements, "axial_stiffness_each")
    assert list(found.predictions) == [("axial_stiffness_each",), (), ("axial_stiffness",)]
    assert any("the data do not determine so many unknowns" in reason for reason in found.reasons)


def test_rows_left_out_are_missed_by_as_much_as_said(robot):
    """By fits without each in turn, which the prediction does without."""
    asked = ("axial_stiffness", "center_of_mass")
    poses = noisy(robot, exact_poses(robot, commanded(6)), np.random.default_rng(4))
    errors: dict[str, Any] = dict(position_error=NOISE, rotation_error=NOISE / robot.characteristic_length)
    found = cdpr.identify(robot, cdpr.Measurements.of(commanded(6), poses), asked, **errors)
    missed = []
    for row in range(6):
        others = np.arange(6) != row
        fit = cdpr.identify(robot, cdpr.Measurements.of(commanded(6)[others], poses[others]), asked, **errors)
        missed.append(exact_poses(fit.robot, commanded(6)[row : row + 1])[0] - poses[row])
    truth = np.sqrt(np.mean((np.array(missed) / np.repeat([*found.scatters.values()], 3)) ** 2))
    assert found.predictions[asked] == pytest.approx(truth, rel=LINEAR)


def test_a_row_that_cannot_be_left_out_is_said(robot):
    """One row predicts nothing; two of positions do not hold EA and a centre of mass without each other."""
    one = cdpr.identify(robot, cdpr.Measurements.of(commanded(1), exact_poses(robot, commanded(1))))
    assert np.isnan(list(one.predictions.values())).all()
    assert "omitted" not in identification_note(one).lower()
    positions = exact_poses(robot, commanded(2))[:, :3]
    measurements = cdpr.Measurements.of(commanded(2), positions, coordinates="xyz")
    two = cdpr.identify(robot, measurements, ("axial_stiffness", "center_of_mass"), position_error=NOISE)
    assert two.predictions["axial_stiffness", "center_of_mass"] == np.inf
    assert "No prediction of omitted rows" in identification_note(two)


def test_a_centre_of_mass_that_the_data_hardly_determine_is_said(robot):
    """Its height: the cables hardly let the platform tilt. Where it is along x and y, whole poses say."""
    poses = noisy(robot, exact_poses(robot, commanded()), np.random.default_rng(5))
    positions = cdpr.Measurements.of(commanded(), poses[:, :3], coordinates="xyz")
    found = cdpr.identify(robot, positions, "center_of_mass", position_error=NOISE)
    assert found["center_of_mass z"][1] > robot.characteristic_length / 3
    assert any("hardly determine center_of_mass z" in reason for reason in found.reasons)
    whole = cdpr.identify(robot, cdpr.Measurements.of(commanded(), poses), "center_of_mass")
    assert [one for one in whole.reasons if "center_of_mass z" not in one] == []


def test_stiffness_and_offsets_of_cables_with_every_property_are_found(robot):
    """With mass, over pulleys and nonlinear; believed to be massless, the same cables are far from what they are."""
    true = robot.replace(linear_density=5e-3, pulley_radius=0.01, stiffening=(1.0, 20.0))
    offsets = 1e-3 * np.array([1, -1, 2, 0, 1, 0, -2, 1])
    positions = commanded(3)
    measurements = cdpr.Measurements.of(positions, exact_poses(true, positions, offsets))
    believed = true.replace(axial_stiffness=2 * true.axial_stiffness)
    found = cdpr.identify(believed, measurements, unknowns=["axial_stiffness", "rest_length_offsets"])
    assert found.robot.axial_stiffness == pytest.approx(true.axial_stiffness, rel=FITTED)
    assert np.asarray(found.values)[1:] == pytest.approx(offsets, abs=1e-7)
    massless = cdpr.identify(
        believed.replace(linear_density=0.0), measurements, unknowns=["axial_stiffness", "rest_length_offsets"]
    )
    assert abs(massless.robot.axial_stiffness[0] / true.axial_stiffness[0] - 1) > 0.01


def test_sensors_are_calibrated_from_mujocos_tensions(catalogue):
    """Gains and offsets of load cells, EA and swivel zeros, of cables over pulleys that MuJoCo settled."""
    true = catalogue["irma4u"].replace(axial_stiffness=15e3)
    poses = np.random.default_rng(1).uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.1], (6, 3))
    settled = cdpr.settle_many(true, poses)
    rotations = settled.poses.rotation.as_matrix()
    anchors = np.einsum("nij,cj->nci", rotations, true.anchors) + settled.poses.translation[:, None]
    apart = anchors - true.exits
    across = np.cross(true.cabling.pulley_axis, [0.0, 0.0, -1.0])
    swivels = np.arctan2((apart * across).sum(-1), -apart[..., 2])
    gains, offsets, zeros = np.array([1.1, 0.9, 1.0, 1.2]), np.array([5, -3, 0, 2]), np.array([0.01, 0, -0.02, 0])
    measurements = cdpr.Measurements.of(
        poses,
        settled.poses.rotation.as_euler("xyz")[:, :2],
        coordinates=("alpha", "beta"),
        tensions=gains * settled.tensions + offsets,
        swivels=swivels + zeros,
    )
    asked = ("axial_stiffness", "force_gains", "force_offsets", "swivel_zeros")
    errors: dict[str, Any] = dict(tension_error=1.0, swivel_error=1e-3, rotation_error=1e-3)
    found = cdpr.identify(catalogue["irma4u"], measurements, asked, **errors)
    assert found.values == pytest.approx(np.array([15e3, *gains, *offsets, *zeros]), rel=1e-4, abs=1e-5)
    # The same unknowns predict other rows of the same sensors; without them, tensions are wrong by newtons.
    assert np.nanmax(np.abs(found.predict(measurements.rows([0, 3])))) < 1e-3
    alone = cdpr.identify(catalogue["irma4u"], measurements, **errors)
    assert np.nanmax(np.abs(alone.predict(measurements))) > 1


def test_a_known_load_tells_stiffness_and_mass_apart(robot):
    """Which nothing else does: half of the rows carry a mass that was weighed, or a force that was measured."""
    true = robot.replace(axial_stiffness=800.0, mass=0.45)
    poses = commanded(8)
    masses = np.where(np.arange(8) % 2, 0.6, np.nan)
    wrenches = np.zeros((8, 6))
    wrenches[:2, 2] = -1.0
    solved = cdpr.solve_many(true, poses, external_wrench=wrenches, mass=np.where(np.isnan(masses), 0.45, masses))
    data = cdpr.Measurements.of(poses, solved.positions, coordinates="xyz", masses=masses, wrenches=wrenches)
    found = cdpr.identify(robot, data, ("axial_stiffness", "mass"), position_error=NOISE)
    assert found.values == pytest.approx(np.array([800.0, 0.45]), rel=FITTED)
    assert found.reasons == ()


def test_natural_frequencies_alone_give_the_stiffness(robot):
    """Of a platform whose mass is known; and rows may have any subset of them."""
    true = robot.replace(axial_stiffness=730.0)
    poses = commanded(3)
    frequencies = np.array([cdpr.natural_modes(true, pose).frequencies for pose in poses])
    frequencies[0, 2:] = np.nan
    data = cdpr.Measurements.of(poses, frequencies=frequencies)
    found = cdpr.identify(robot, data, frequency_error=1e-3)
    assert found["axial_stiffness"][0] == pytest.approx(730.0, rel=FITTED)


def test_outliers_are_named_and_count_less(robot):
    """One coordinate of 72 that is off by 30 standard errors: it is named, and Huber's fit is near the true EA."""
    true = robot.replace(axial_stiffness=800.0)
    poses = noisy(true, exact_poses(true, commanded()), np.random.default_rng(5))
    poses[4, 2] += 30 * NOISE
    data = cdpr.Measurements.of(commanded(), poses)
    errors: dict[str, Any] = dict(position_error=NOISE, rotation_error=NOISE / robot.characteristic_length)
    plain, robust = (cdpr.identify(robot, data, robust=one, **errors) for one in (False, True))
    assert [(one.row, one.name) for one in robust.outliers] == [(5, "z")]
    assert abs(robust.values[0] - 800) < 3 * robust.standard_errors[0] < abs(plain.values[0] - 800)
    assert "outlier: row 5: z is" in identification_note(robust)
    # On data without any, both are the same but for the noise, and no number is named.
    clean = cdpr.Measurements.of(commanded(), poses - 30 * NOISE * np.outer(np.arange(12) == 4, np.arange(6) == 2))
    plain, robust = (cdpr.identify(robot, clean, robust=one) for one in (False, True))
    assert robust.outliers == plain.outliers == ()
    assert abs(robust.values[0] - plain.values[0]) < plain.standard_errors[0]
    assert robust.scatters["position"] == pytest.approx(plain.scatters["position"], rel=0.3)


def test_information_criteria_prefer_the_true_model(robot):
    """Offsets that are there lower both criteria by far; those that are none raise them."""
    true, rng = robot.replace(axial_stiffness=800.0), np.random.default_rng(6)
    for offsets in (1e-4 * rng.normal(size=8), np.zeros(8)):
        data = cdpr.Measurements.of(commanded(), noisy(true, exact_poses(true, commanded(), offsets), rng))
        fewer, more = (
            cdpr.identify(robot, data, some) for some in ("axial_stiffness", ("axial_stiffness", "rest_length_offsets"))
        )
        assert (more.aicc < fewer.aicc - 10) == (more.bic < fewer.bic - 10) == offsets.any()


def test_unknowns_that_are_not_there_are_refused(robot):
    """A gain without a load cell, a radius without a pulley."""
    data = cdpr.Measurements.of(commanded(2), exact_poses(robot, commanded(2)))
    for name in ("force_gains", "pulley_radius", "swivel_zeros"):
        with pytest.raises(cdpr.InvalidInput, match=f"unknowns: found {name} without a (measurement|robot)"):
            cdpr.identify(robot, data, name)
    with pytest.raises(cdpr.InvalidInput, match="found angle_zeros and yaw_zero, expected one of the two"):
        cdpr.identify(robot, data, ["angle_zeros", "yaw_zero"])


HELD = 0.85
"""Share of the true values that so few 95 % intervals hold at least: 0.93 to 0.97 of many."""


@pytest.mark.parametrize(("case", "fits"), [("judged", 3), ("lengths", 3)])
def test_intervals_hold_what_they_say(case, fits):
    """Of a few simulated measurements; ``scripts/interval_coverage.py`` has many. Narrower ones hold fewer."""
    found = fitted(case, fits, seed=1)
    assert held(found).mean() >= HELD
    assert held(found, coverage=0.3).mean() < 0.6


@pytest.mark.parametrize(
    ("measured", "coordinates", "why"),
    [
        ([[0.0991], [0.0991]], ["z"], "no residual is left"),
        ([[0.0991]], ["z"], "no residual is left"),
        ("exact", ["x", "y", "z"], "the residuals are rounding"),
    ],
)
def test_errors_are_unknown_where_residuals_say_nothing_of_them(robot, measured, coordinates, why):
    """A reading, the same twice, exact data: nan, a sentence, and null in JSON; with a stated error they are known."""
    places = np.array([[0.4, 0.25, 0.1], [0.4, 0.25, 0.1]])[: len(measured)]
    if measured == "exact":
        places[1] = [0.3, 0.2, 0.1]
        measured = exact_poses(robot.replace(axial_stiffness=850.0), places)[:, :3]
    readings = cdpr.Measurements.of(places, measured, coordinates=coordinates)
    found = cdpr.identify(robot, readings)
    assert np.isnan(found.standard_errors).all()
    assert np.isnan(found.intervals()).all()
    assert np.isnan([found.bic, found.scatters["position"]]).all()
    assert why in found.reasons[0]
    assert found.reasons[0].endswith("state position_error")
    assert "± unknown N" in repr(found)
    assert "nan" not in identification_note(found)
    assert "unknown" in [*identification_table(found).columns[2].cells]
    values = as_json.identification(found)
    json.dumps(values, allow_nan=False)
    assert values["unknowns"]["axial_stiffness"]["standard_error"] is None
    stated = cdpr.identify(robot, readings, position_error=1e-4)
    assert stated.values == pytest.approx(found.values, rel=1e-6)
    assert (stated.standard_errors > 1).all()
    assert not stated.reasons


def test_rows_that_are_identical_count_once(robot):
    """A file with each row ten times has the errors, the predictions and the criteria of the file with each once."""
    places = commanded(4)
    poses = noisy(robot, exact_poses(robot, places), np.random.default_rng(1))
    once = cdpr.identify(robot, cdpr.Measurements.of(places, poses))
    many = cdpr.identify(robot, cdpr.Measurements.of(np.tile(places, (10, 1)), np.tile(poses, (10, 1))))
    np.testing.assert_allclose(many.standard_errors, once.standard_errors, rtol=1e-9)
    assert many.bic == pytest.approx(once.bic)
    assert many.predictions == pytest.approx(once.predictions)
    assert many.residuals.shape == (40, 6)
    assert "36 of 40 rows repeat another one exactly" in identification_note(many)


def test_another_reading_at_the_same_place_predicts_nothing(robot):
    """Rows of one place are left out together: with one place, no prediction is made."""
    places = np.tile(commanded(1), (5, 1))
    poses = noisy(robot, exact_poses(robot, places), np.random.default_rng(1))
    found = cdpr.identify(robot, cdpr.Measurements.of(places, poses))
    assert not found.repeats.any()
    assert np.isfinite(found.standard_errors).all()
    assert np.isnan([*found.predictions.values()]).all()
