"""What is fitted to measurements is what made them, with errors as large as they are; what they do not say is said."""

import json
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import cdpr_sim as cdpr
from cdpr_sim.analysis.identifiability import WORSE, certainty
from cdpr_sim.analysis.identification_model import UNKNOWNS, IdentificationModel, unknowns_of
from cdpr_sim.report import as_json
from cdpr_sim.report.analysis_tables import identification_note, identification_table
from interval_coverage import fitted, held

NOISE = 2e-5
"""[m] of a measured coordinate; DemoBot's tracker states 6.5e-5."""

FRAME = "exit_compliance"
SLOPE, SAGGING = 1e-5, 1e-4
"""Relative error of central differences through the solver: 7e-7 measured at worst; of cables with mass over pulleys
5e-5, of a tension by the wheels' radius."""

SOLVED = 1e-7
"""Of the largest derivative by an unknown: two equilibria of sagging cables differ by 4e-11 rad, over steps of 1e-4."""

FITTED = 1e-5
"""Relative error of what is fitted to MuJoCo's poses without noise: they are 1e-9 m from statics', over a sag of
4e-4 m."""

FITS, LIKELY = 20, [0.0005, 0.9995]
"""Fits by which standard errors are judged, nine numbers each; and quantiles between which a sum of squares lies in all
but one of a thousand cases."""

WEIGHED = 0.01
"""Of a standard error: judged scatters settle to a thousandth of themselves, which weighs positions against angles."""

LINEAR = 0.01
"""Relative error of predictions to first order in the noise: 1e-3 measured."""

ROBOT = cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")
"""What one believes the robot to be: DemoBot on the catalogue's fishing line."""

ERRORS: dict[str, Any] = {"position_error": NOISE, "rotation_error": NOISE / ROBOT.characteristic_length}
EA, EACH, OFFSETS, MASS, CENTER = (
    "axial_stiffness", "axial_stiffness_each", "rest_length_offsets", "mass", "center_of_mass"
)  # fmt: skip


def places(rows: int = 12) -> np.ndarray:
    """Positions all over DemoBot's workspace."""
    return np.random.default_rng(0).uniform([0.15, 0.12, 0.05], [0.65, 0.38, 0.3], (rows, 3))


def poses_of(robot: cdpr.Robot, positions: np.ndarray, offsets: Any = 0.0, seed: Any = None):
    """Six-vectors of statics; with noise, by a seed."""
    rest = np.array([robot.rest_lengths(position) for position in positions]) + offsets
    solved = cdpr.solve_many(robot, positions, rest)
    poses = np.hstack([solved.positions, solved.euler])
    if seed is None:
        return poses
    return poses + np.random.default_rng(seed).normal(size=poses.shape) * np.repeat([*ERRORS.values()], 3)


def measured(
    rows: int = 12, columns: str = "xyzabc", seed: Any = None, noise: Any = None, offsets: Any = 0.0, EA=800.0
):
    """Of DemoBot with this stiffness: some coordinates; with the noise of a tracker, or another one."""
    names, some = ("x", "y", "z", "alpha", "beta", "gamma"), ["xyzabc".index(one) for one in columns]
    poses = poses_of(ROBOT.replace(axial_stiffness=EA), places(rows), offsets, None if noise else seed)[:, some]
    if noise:
        poses = poses + np.random.default_rng(seed).normal(size=poses.shape) * noise
    return cdpr.Measurements.of(places(rows), poses, coordinates=[names[k] for k in some])


@pytest.mark.parametrize(
    ("left_out", "linear_density", "least"),
    [((EA, "angle_zeros"), 0.0, SLOPE), ((EACH, "yaw_zero"), 1e-3, SAGGING)],
    ids=["straight", "sagging"],
)
def test_derivatives_of_the_residuals_are_exact(left_out, linear_density, least):
    """Every unknown, every kind of measurement, at poses away from the middle with a load, against central differences.

    All unknowns of a parameter (of every cable, of every axis) change at once, each by its own step. Those that exclude
    each other take turns. A frame that gives way excludes swivel angles, and has the tests of sensitivities.
    """
    robot = ROBOT.replace(winch_to_exit=0.1, pulley_radius=0.01, linear_density=linear_density)
    measurements = cdpr.Measurements.of(
        places(2), np.zeros((2, 6)), tensions=np.ones((2, 8)), swivels=np.zeros((2, 8)), frequencies=np.ones((2, 6)),
        masses=[np.nan, 0.5], wrenches=np.tile([1.0, 0.5, 0.0, 0.0, 0.0, 0.0], (2, 1)),
    )  # fmt: skip
    unknowns = unknowns_of(robot, measurements, [name for name in UNKNOWNS if name not in {*left_out, FRAME}])
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


# What is there is found. A row returns the believed robot, the measurements, the unknowns, the stated errors, and the
# true values.


def cables_with_every_property():
    """With mass, over pulleys and nonlinear; believed to be twice as stiff."""
    true = ROBOT.replace(linear_density=5e-3, pulley_radius=0.01, stiffening=(1.0, 20.0))
    offsets = 1e-3 * np.array([1, -1, 2, 0, 1, 0, -2, 1])
    data = cdpr.Measurements.of(places(3), poses_of(true, places(3), offsets))
    stiffness = true.axial_stiffness[0]
    return true.replace(axial_stiffness=2 * stiffness), data, [EA, OFFSETS], {}, [stiffness, *offsets]


def a_known_load():
    """Tells stiffness and mass apart, which nothing else does: a mass that was weighed, a force that was measured."""
    true = ROBOT.replace(axial_stiffness=800.0, mass=0.45)
    masses, wrenches = np.where(np.arange(8) % 2, 0.6, np.nan), np.zeros((8, 6))
    wrenches[:2, 2] = -1.0
    solved = cdpr.solve_many(true, places(8), external_wrench=wrenches, mass=np.where(np.isnan(masses), 0.45, masses))
    data = cdpr.Measurements.of(places(8), solved.positions, coordinates="xyz", masses=masses, wrenches=wrenches)
    return ROBOT, data, [EA, MASS], {"position_error": NOISE}, [800, 0.45]


def natural_frequencies_alone():
    """Of a platform whose mass is known; and rows may have any subset of them."""
    true = ROBOT.replace(axial_stiffness=730.0)
    frequencies = np.array([cdpr.natural_modes(true, pose).frequencies for pose in places(3)])
    frequencies[0, 2:] = np.nan
    return ROBOT, cdpr.Measurements.of(places(3), frequencies=frequencies), [EA], {"frequency_error": 1e-3}, [730]


def sensors_on_mujocos_cables():
    """Gains and offsets of load cells, and swivel zeros, of cables over pulleys."""
    believed = cdpr.load_robot("irma4u")
    true = believed.replace(axial_stiffness=15e3)
    poses = np.random.default_rng(1).uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.1], (6, 3))
    settled = cdpr.settle_many(true, poses)
    anchors = true.anchors @ settled.poses.rotation.as_matrix().swapaxes(1, 2) + settled.poses.translation[:, None]
    apart, across = anchors - true.exits, np.cross(true.cabling.pulley_axis, [0.0, 0.0, -1.0])
    swivels = np.arctan2((apart * across).sum(-1), -apart[..., 2])
    gains, offsets, zeros = np.array([1.1, 0.9, 1.0, 1.2]), np.array([5, -3, 0, 2]), np.array([0.01, 0, -0.02, 0])
    data = cdpr.Measurements.of(
        poses, settled.poses.rotation.as_euler("xyz")[:, :2], coordinates=("alpha", "beta"),
        tensions=gains * settled.tensions + offsets, swivels=swivels + zeros,
    )  # fmt: skip
    errors = dict(tension_error=1.0, swivel_error=1e-3, rotation_error=1e-3)
    asked = [EA, "force_gains", "force_offsets", "swivel_zeros"]
    return believed, data, asked, errors, [15e3, *gains, *offsets, *zeros]


THERE = {
    cables_with_every_property: FITTED, a_known_load: FITTED,
    natural_frequencies_alone: FITTED, sensors_on_mujocos_cables: 1e-4,
}  # fmt: skip
"""And the relative error of what is found."""


@pytest.mark.parametrize("case", THERE, ids=lambda one: one.__name__)
def test_what_is_there_is_found(case):
    """And predicts the rows; a robot of another mass, or only stiffness fitted, does not have these values."""
    robot, data, asked, errors, true = case()
    found = cdpr.identify(robot, data, asked, **errors)
    assert found.values == pytest.approx(np.array(true), rel=THERE[case], abs=1e-5)
    assert np.nanmax(np.abs(found.predict(data.rows([0, 1])))) < 1e-2
    other = cdpr.identify(robot.replace(mass=1.05 * robot.mass), data, [EA], **errors)
    assert abs(other.values[0] / true[0] - 1) > 100 * THERE[case]


# Standard errors.


def test_standard_errors_are_as_large_as_the_errors():
    """Over many noises, EA and eight rest-length offsets: errors over standard errors have squares that sum to chi².

    One by one, and all nine together by their correlations, which are those of the errors; standard errors wrong by a
    third would be found out.
    """
    random = np.random.default_rng(7)
    offsets = random.normal(size=8) * 1e-4
    truth, products, together, spreads = np.array([800.0, *offsets]), np.zeros((9, 9)), 0.0, 0.0
    for _ in range(FITS):
        found = cdpr.identify(ROBOT, measured(4, seed=random, offsets=offsets), (EA, OFFSETS), **ERRORS)
        assert found.reasons == ()
        off = (found.values - truth) / found.standard_errors
        products += np.outer(off, off)
        together += off @ np.linalg.solve(found.correlations, off)
        spreads += (24 - 9) * found.spread**2
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
    low, high = chi2.ppf(LIKELY, (24 - 9) * FITS)
    assert low <= spreads <= high


@pytest.mark.parametrize(("columns", "kinds"), [("xyz", ("position",)), ("xyzabc", ("position", "rotation"))])
def test_errors_that_are_judged_are_as_if_they_were_stated(columns, kinds):
    """By the residuals, of each kind; what was not measured has no part in the standard errors."""
    data = measured(columns=columns, seed=3, EA=850.0)
    judged = cdpr.identify(ROBOT, data)
    assert judged.estimated == kinds
    for kind in kinds:
        assert 0.5 < judged.scatters[kind] / ERRORS[f"{kind}_error"] < 2
    stated = cdpr.identify(ROBOT, data, **{f"{kind}_error": judged.scatters[kind] for kind in kinds})
    assert (np.abs(judged.values - stated.values) < WEIGHED * stated.standard_errors).all()
    assert judged.standard_errors == pytest.approx(stated.standard_errors, rel=WEIGHED)


@pytest.mark.parametrize("case", ["judged", "lengths"])
def test_intervals_hold_what_they_say(case):
    """Of a few simulated measurements; of many, 0.93 to 0.97 (``scripts/research/interval_coverage.py``)."""
    found = fitted(case, 3, seed=1)
    assert held(found).mean() >= 0.85
    assert held(found, coverage=0.3).mean() < 0.6


@pytest.mark.parametrize(
    ("measured", "coordinates", "why"),
    [
        ([[0.0991], [0.0991]], ["z"], "no residual is left"),
        ([[0.0991]], ["z"], "no residual is left"),
        ("exact", ["x", "y", "z"], "the residuals are rounding"),
    ],
)
def test_errors_are_unknown_where_residuals_say_nothing_of_them(measured, coordinates, why):
    """A reading, the same twice, exact data: nan, a sentence, and null in JSON; with a stated error they are known."""
    at = np.array([[0.4, 0.25, 0.1], [0.4, 0.25, 0.1]])[: len(measured)]
    if measured == "exact":
        at[1] = [0.3, 0.2, 0.1]
        measured = poses_of(ROBOT.replace(axial_stiffness=850.0), at)[:, :3]
    readings = cdpr.Measurements.of(at, measured, coordinates=coordinates)
    found = cdpr.identify(ROBOT, readings)
    for numbers in (found.standard_errors, found.intervals(), [found.bic, found.scatters["position"]]):
        assert np.isnan(numbers).all()
    assert why in found.reasons[0]
    assert found.reasons[0].endswith("state position_error")
    assert "± unknown N" in repr(found)
    assert "nan" not in identification_note(found)
    assert "unknown" in [*identification_table(found).columns[2].cells]
    values = as_json.identification(found)
    json.dumps(values, allow_nan=False)
    assert values["unknowns"]["axial_stiffness"]["standard_error"] is None
    stated = cdpr.identify(ROBOT, readings, position_error=1e-4)
    assert stated.values == pytest.approx(found.values, rel=1e-6)
    assert (stated.standard_errors > 1).all()
    assert not stated.reasons


# What the data do not say is said.

TENTH = np.radians(0.1)


def angles():
    return measured(30, "ab", 1, TENTH, EA=ROBOT.axial_stiffness)


SAID = {
    "EA and mass": (measured, [EA, MASS], {}, "cannot distinguish axial_stiffness and mass"),
    "EA": (measured, [EA], ERRORS, None),
    "mass": (measured, [MASS], ERRORS, None),
    "other offsets": (lambda: measured(offsets=1e-3 * np.eye(8)[0]), [EA], ERRORS, "does not explain the data"),
    "angles": (angles, [EA, OFFSETS], {"rotation_error": TENTH}, "hardly determine axial_sti"),
    "angles, EA": (angles, [EA], {"rotation_error": TENTH}, None),
    "two angles": (lambda: measured(12, "ab", 2, TENTH, EA=1000), [EA, OFFSETS], {}, "so many unknowns: omitted"),
    "positions": (lambda: measured(columns="xyz", seed=5), [CENTER], {"position_error": NOISE},
        "hardly determine center_of_mass z"),
    "heights": (lambda: measured(12, "z", 3, 2e-4, EA=1000), [EACH], {}, "the data do not determine so many unknowns:"),
    "offsets": (lambda: measured(seed=2, offsets=1e-4 * np.cos(np.arange(8))), [EA, OFFSETS], {}, None),
    "no offsets": (lambda: measured(seed=2), [EA, OFFSETS], {}, None),
}  # fmt: skip
"""Measurements, unknowns, stated errors; and words of a reason, or None: there is none."""


@pytest.mark.parametrize("case", SAID)
def test_what_the_data_do_not_say_is_said(case):
    """In a sentence that names the unknowns; and data that do say it get none."""
    data, asked, errors, words = SAID[case]
    found = cdpr.identify(ROBOT, data(), asked, **errors)
    if words is None:
        assert not [one for one in found.reasons if "center_of_mass z" not in one]
        assert np.isfinite(found.standard_errors).all()
    else:
        (said,) = [one for one in found.reasons if words in one]
        if "so many unknowns" in said:
            worse = found.predictions[tuple(asked)] / min(found.predictions.values())
            assert worse > WORSE
            best = "axial_stiffness alone" if case == "two angles" else "the robot as it was given"
            assert said.endswith(f"predicted {worse:.2g} times better by {best}")
    if case == "EA and mass":  # doubling both moves nothing
        assert np.isinf(found.standard_errors).all()
        assert found.values[0] / found.values[1] == pytest.approx(800.0 / 0.4, rel=FITTED)
    if case == "heights":
        assert list(found.predictions) == [(EACH,), (), (EA,)]
    if "offsets" in case and OFFSETS in asked:  # those that are there are needed to predict, others spoil little
        there, fewer = case == "offsets", cdpr.identify(ROBOT, data(), EA)
        assert (found.predictions[EA, OFFSETS] < found.predictions[EA,]) == there
        assert (found.aicc < fewer.aicc - 10) == (found.bic < fewer.bic - 10) == there


def test_a_slack_cables_stiffness_is_not_in_the_data_and_keeps_its_value(catalogue):
    """Where a cable never pulls, its EA has no effect, and it is named; it once came back as 562, from nowhere."""
    robot = catalogue["planar-vertical"].replace(axial_stiffness=1000.0)
    positions = np.array([[0.15, 0, z] for z in (0.1, 0.15, 0.2)])
    solved = cdpr.solve_many(robot.replace(axial_stiffness=550.0), positions)
    slack = np.flatnonzero((solved.tensions == 0).all(0))
    assert slack.size
    poses = np.stack([*solved.positions[:, [0, 2]].T, solved.euler[:, 1]], axis=1)
    data = cdpr.Measurements.of(positions, poses, coordinates=("x", "z", "beta"))
    found = cdpr.identify(robot, data, (EACH,), position_error=NOISE)
    for cable in slack:
        assert f"the data do not depend on axial_stiffness {cable + 1}" in found.reasons
        assert np.isinf(found.standard_errors[cable])
    assert found.values[slack] == pytest.approx(1000.0, rel=1e-9)
    assert np.delete(found.values, slack) == pytest.approx(550.0, rel=1e-3)


# Rows that are left out, repeated or wrong.


def test_rows_left_out_are_missed_by_as_much_as_said():
    """By fits without each in turn, which the prediction does without."""
    asked, poses = (EA, CENTER), poses_of(ROBOT, places(6), seed=4)
    found = cdpr.identify(ROBOT, cdpr.Measurements.of(places(6), poses), asked, **ERRORS)
    missed = []
    for row in range(6):
        others = np.arange(6) != row
        fit = cdpr.identify(ROBOT, cdpr.Measurements.of(places(6)[others], poses[others]), asked, **ERRORS)
        missed.append(poses_of(fit.robot, places(6)[row : row + 1])[0] - poses[row])
    truth = np.sqrt(np.mean((np.array(missed) / np.repeat([*found.scatters.values()], 3)) ** 2))
    assert found.predictions[asked] == pytest.approx(truth, rel=LINEAR)


def test_rows_that_cannot_be_left_out_predict_nothing():
    """One row; two of positions, which do not hold EA and a centre of mass without each other; one place many times."""
    one = cdpr.identify(ROBOT, measured(1))
    assert np.isnan(list(one.predictions.values())).all()
    assert "omitted" not in identification_note(one).lower()
    two = cdpr.identify(ROBOT, measured(2, "xyz"), (EA, CENTER), position_error=NOISE)
    assert two.predictions[EA, CENTER] == np.inf
    assert "No prediction of omitted rows" in identification_note(two)
    same = np.tile(places(1), (5, 1))
    many = cdpr.identify(ROBOT, cdpr.Measurements.of(same, poses_of(ROBOT, same, seed=1)))
    assert not many.repeats.any()
    assert np.isfinite(many.standard_errors).all()
    assert np.isnan([*many.predictions.values()]).all()


def test_rows_that_are_identical_count_once():
    """A file with each row ten times has the errors, the predictions and the criteria of the file with each once."""
    poses = poses_of(ROBOT, places(4), seed=1)
    once = cdpr.identify(ROBOT, cdpr.Measurements.of(places(4), poses))
    many = cdpr.identify(ROBOT, cdpr.Measurements.of(np.tile(places(4), (10, 1)), np.tile(poses, (10, 1))))
    np.testing.assert_allclose(many.standard_errors, once.standard_errors, rtol=1e-9)
    assert many.bic == pytest.approx(once.bic)
    assert many.predictions == pytest.approx(once.predictions)
    assert many.residuals.shape == (40, 6)
    assert "36 of 40 rows repeat another one exactly" in identification_note(many)


def test_outliers_are_named_and_count_less():
    """One coordinate of 72 that is off by 30 standard errors: it is named, and Huber's fit is near the true EA."""
    clean = poses_of(ROBOT.replace(axial_stiffness=800.0), places(), seed=5)
    poses = clean + 30 * NOISE * np.outer(np.arange(12) == 4, np.arange(6) == 2)
    data = cdpr.Measurements.of(places(), poses)
    plain, robust = (cdpr.identify(ROBOT, data, robust=one, **ERRORS) for one in (False, True))
    assert [(one.row, one.name) for one in robust.outliers] == [(5, "z")]
    assert abs(robust.values[0] - 800) < 3 * robust.standard_errors[0] < abs(plain.values[0] - 800)
    assert "outlier: row 5: z is" in identification_note(robust)
    # On data without any, both are the same but for the noise, and no number is named.
    plain, robust = (cdpr.identify(ROBOT, cdpr.Measurements.of(places(), clean), robust=one) for one in (False, True))
    assert robust.outliers == plain.outliers == ()
    assert abs(robust.values[0] - plain.values[0]) < plain.standard_errors[0]
    assert robust.scatters["position"] == pytest.approx(plain.scatters["position"], rel=0.3)


def test_the_papers_15_mm_need_cables_ten_times_softer_than_assumed(catalogue):
    """EA of about 0.12 kN for the ends of the line at z = 0.1 m; MuJoCo, given that EA, is 15 mm off there.

    Half of it is no elasticity: on all but rigid cables the platform is 7.6 mm off, so that two cables whose EA differ
    tenfold cannot both be 15 mm off: the stiffer one is then 8.3 mm off, or the softer one more than 50 mm.
    """
    robot, ends = catalogue["parallel"], np.array([[0.17, 0.25, 0.1], [0.63, 0.25, 0.1]])
    data = cdpr.Measurements.of(ends, ends[:, 2:] - 0.015, coordinates=["z"])
    stiffness = cdpr.identify(robot, data)["axial_stiffness"][0]
    assert 100 < stiffness < 140
    heights = [
        1e3 * float(cdpr.settle(robot.replace(axial_stiffness=factor * stiffness), ends[0]).deviation[2])
        for factor in (1, 10, 1e4, 0.1)
    ]
    assert heights[:3] == pytest.approx([-15, -8.34, -7.6], abs=0.02)
    assert heights[3] < -50


def test_unknowns_that_look_alike_are_named_in_one_sentence_for_each_group():
    """Five that together change almost nothing are ten pairs; two others are a group of their own."""
    slope = np.random.default_rng(4).normal(size=(60, 7))
    slope[:, 4] -= 100 * slope[:, :4].sum(1)
    slope[:, 6] += 100 * slope[:, 5]
    reasons = certainty(slope, list("abcdefg"), [(np.inf, "")] * 7)[2]
    first, second = (one for one in reasons if "hardly distinguish" in one)
    assert first.startswith("the data hardly distinguish a, b, c, d and e: correlations up to +")
    assert second.startswith("the data hardly distinguish f and g: correlation -1.0000")


@pytest.mark.parametrize("error", [1e-300, 1e300])
def test_standard_errors_whose_squares_are_no_numbers_are_refused(error):
    """In one sentence, without a warning of NumPy's."""
    with pytest.raises(cdpr.InvalidInput, match=r"^position_error: found 1e[+-]300 m, expected 1e-30 to 1e\+30$"):
        cdpr.identify(ROBOT, measured(2, "xyz"), position_error=error)
