"""Corners from lengths alone: nobody measured where the platform was."""

import functools
from pathlib import Path

import numpy as np
import pytest

import cdpr_sim as cdpr
from tests.inputs import run

NOISE = 0.5e-3
"""[m] Standard error of a length."""

MOVED = 1e-3 * np.array([[15, 0, -10], [-12, 0, 18], [0, 0, 0], [8, 0, 0]])
"""[m] By how much the corners differ from those of the catalogue, with the lower left one at the origin."""

EXACT = 1e-9
"""[m] Of lengths without noise: both methods settle as exactly."""


@functools.cache
def maslow() -> cdpr.Robot:
    return cdpr.load_robot("maslow-4")


@functools.cache
def settled() -> tuple[cdpr.Robot, np.ndarray, cdpr.EquilibriumBatch]:
    """The true machine, its rest lengths at 25 places, and where MuJoCo settles it."""
    true = maslow().replace(exits=maslow().exits + MOVED)
    places = [(x, 0, z) for x in np.linspace(0.4, 2.5, 5) for z in np.linspace(0.45, 1.6, 5)]
    pulled = true.replace(pretension=150.0)
    rest = np.array([pulled.rest_lengths(place) for place in places])
    return true, rest, cdpr.settle_many(true, places, rest)


def read(noise: float = NOISE, seed: int = 0, tensions: bool = True) -> cdpr.Measurements:
    """What was read: all lengths, and the tensions of the lower belts."""
    _, rest, found = settled()
    lengths = rest + noise * np.random.default_rng(seed).normal(size=rest.shape)
    lower = np.where([False, False, True, True], found.tensions, np.nan)
    return cdpr.Measurements.of(lengths=lengths, tensions=lower if tensions else None)


def missed(found: cdpr.Identification) -> np.ndarray:
    """Errors of the identified coordinates of exits [m]."""
    truth = [settled()[0].exits[int(name.split()[1]) - 1, "xyz".index(name[-1])] for name in found.names]
    return found.values - truth


def test_corners_are_found_from_lengths_that_mujoco_gives():
    """All of them to rounding without noise, and the poses; with 0.5 mm, within 1.5 mm and as exactly as is said."""
    exact = cdpr.identify(maslow(), read(0.0), ["exits"], length_error=NOISE)
    assert exact.gauge == ("exit 3 x", "exit 3 z", "exit 4 z")
    assert set(exact.names) == {"exit 1 x", "exit 1 z", "exit 2 x", "exit 2 z", "exit 4 x"}
    assert np.abs(missed(exact)).max() < EXACT
    assert exact.poses is not None
    assert exact.poses[:, :3] == pytest.approx(settled()[2].positions, abs=EXACT)
    found = cdpr.identify(maslow(), read(), ["exits"], length_error=NOISE)
    assert found.reasons == () == found.outliers
    assert found.degrees_of_freedom == 25 * 2 - 5
    assert np.abs(missed(found)).max() < 1.5e-3
    assert 0.2e-3 < found.standard_errors.min() < found.standard_errors.max() < 0.7e-3
    judged = cdpr.identify(maslow(), read(), ["exits"])
    assert judged.scatters["length"] == pytest.approx(NOISE, rel=0.3)
    assert judged.values == pytest.approx(found.values, abs=1e-7)
    assert found.robot.exits == pytest.approx(settled()[0].exits, abs=1.5e-3)


def test_rigid_belts_find_other_corners():
    """Negative control: without the stretch, the same rows give errors of some millimetres, several standard errors."""
    found = cdpr.identify(maslow(), read(0.0, tensions=False), ["exits"], length_error=NOISE)
    elastic = cdpr.identify(maslow(), read(0.0), ["exits"], length_error=NOISE)
    assert np.abs(missed(found)).max() > 2e-3 > 1e6 * np.abs(missed(elastic)).max()
    assert np.abs(missed(found)).max() > 3 * found.standard_errors.max()


def test_errors_are_as_large_as_said():
    """Over 20 draws of the noise, the squares of the errors over the standard errors have the mean 1."""
    draws = [cdpr.identify(maslow(), read(seed=seed), ["exits"], length_error=NOISE) for seed in range(20)]
    squares = np.mean([((missed(one) / one.standard_errors) ** 2).mean() for one in draws])
    assert squares == pytest.approx(1.0, abs=0.45)  # 20 draws of 5 correlated numbers


def test_errors_of_tensions_widen_those_of_corners():
    """And stated ones are propagated into lengths: 20 N are 0.2 mm of a belt of 2 m."""
    plain = cdpr.identify(maslow(), read(), ["exits"], length_error=NOISE)
    wide = cdpr.identify(maslow(), read(), ["exits"], length_error=NOISE, tension_error=50.0)
    assert (wide.standard_errors > 1.05 * plain.standard_errors).all()


def test_a_row_that_was_read_wrong_counts_less_where_that_is_asked():
    """One belt of one row is 20 standard errors off: least squares miss the corners by twice what Huber's fit does."""
    right = read(0.0)
    lengths = right.lengths.copy()
    lengths[7, 0] += 20 * NOISE
    wrong = cdpr.Measurements.of(lengths=lengths, tensions=right.tensions)
    plain, robust = (cdpr.identify(maslow(), wrong, ["exits"], length_error=NOISE, robust=one) for one in (False, True))
    assert np.abs(missed(robust)).max() < 0.5 * np.abs(missed(plain)).max()


def test_chosen_corners_and_a_stated_gauge():
    """One corner alone needs none; a stated gauge holds what it names."""
    true, _, _ = settled()
    known = maslow().replace(exits=np.vstack([maslow().exits[:1], true.exits[1:]]))
    found = cdpr.identify(known, read(0.0), ["exit 1"], length_error=NOISE)
    assert (found.gauge, found.names) == ((), ("exit 1 x", "exit 1 z"))
    assert np.abs(missed(found)).max() < EXACT
    found = cdpr.identify(known, read(0.0), ["exit 1 x"], length_error=NOISE)
    assert found.names == ("exit 1 x",)
    gauge = ("exit 4 x", "exit 4 z", "exit 3 z")
    other = cdpr.identify(maslow(), read(0.0), ["exits"], length_error=NOISE, gauge=gauge)
    apart = [np.linalg.norm(robot.exits[0] - robot.exits[1]) for robot in (other.robot, true)]
    assert apart[0] == pytest.approx(apart[1], abs=1e-6)
    assert other.robot.exits[3] == pytest.approx(maslow().exits[3], abs=0)


def test_what_lengths_cannot_tell_apart_is_named():
    """The size of the whole frame and the scale of all lengths, of belts without a dead length, which keeps its own."""
    belts = maslow().replace(rigid_length=0.0)
    found = cdpr.identify(belts, read(), ["exits", "rest_length_gains"], length_error=NOISE)
    (said,) = [one for one in found.reasons if "cannot distinguish" in one]
    assert "exit 4 x" in said
    assert "rest_length_gain 1" in said
    assert said.endswith("without changing a length")
    none = cdpr.identify(maslow(), read(), ["exits"], length_error=NOISE, gauge=())
    assert any("cannot distinguish" in one for one in none.reasons)


def test_a_spatial_robot_is_found_as_well():
    """Eight cables, six degrees of freedom: two lengths a row are left over."""
    robot = cdpr.load_robot("ipanema-1").replace(linear_density=0.0)
    true = robot.replace(exits=robot.exits + np.array([0.01, -0.02, 0.015]) * (np.arange(8) == 5)[:, None])
    low, high = robot.workspace
    places = low + (high - low) * np.random.default_rng(1).random((12, 3))
    rest = 0.998 * np.array([true.rest_lengths(place) for place in places])
    solved = cdpr.solve_many(true, places, rest)
    data = cdpr.Measurements.of(lengths=rest, tensions=solved.tensions)
    found = cdpr.identify(robot, data, ["exit 6"], length_error=NOISE)
    assert found.gauge == ()
    assert found.robot.exits[5] == pytest.approx(true.exits[5], abs=1e-7)


# Rows that are wrong


def written(folder: Path, lengths: np.ndarray) -> Path:
    file = folder / "rows.csv"
    lines = [",".join(f"length_{i} [mm]" for i in range(1, 5)) + ",tension_3 [N],tension_4 [N]"]
    for row, pulls in zip(lengths, settled()[2].tensions, strict=False):
        lines.append(",".join(f"{1e3 * one:.4f}" for one in row) + f",{pulls[2]:.2f},{pulls[3]:.2f}")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def change(kind: str) -> np.ndarray:
    """Lengths with something wrong in row 7, or in all."""
    lengths = np.array(read().lengths)
    if kind == "skip":
        lengths[6, 2] += 0.012
    elif kind == "exchanged":
        lengths[6, [0, 1]] = lengths[6, [1, 0]]
    elif kind == "columns":
        lengths = lengths[:, [0, 1, 3, 2]]
    elif kind == "millimetres":
        lengths = 1e3 * lengths
    elif kind == "unit of one row":
        lengths[6] *= 1e-3
    elif kind == "nothing":
        lengths[6, 1] = np.nan
    elif kind == "negative":
        lengths[6, 1] *= -1
    elif kind == "few":
        lengths = lengths[:2]
    return lengths


WRONG = {
    "skip": (1, "row 7: length 3 reads"),
    "exchanged": (2, "row 7: found lengths that misfit by 424 mm, where half of the rows misfit by less than"),
    "columns": (2, "fit where lengths 3 and 4 are exchanged"),
    "millimetres": (2, "row 1: found a length 1 of 1655.6 m in a frame of 3.63 m, expected at most 7.26 m"),
    "unit of one row": (2, "row 7: found lengths that misfit by 1.8e+03 mm"),
    "nothing": (2, "line 8, column 'length_2': found 'nan', expected a finite number"),
    "negative": (2, "row 7: found a length 2 of -2."),
    "few": (2, "found 8 lengths at 2 unknown poses, which leave 4 numbers, expected 5 or more for 5 unknowns"),
    "right": (0, "Held as given, since lengths do not tell where the frame stands: exit 3 x, exit 3 z and exit 4 z."),
}
"""Exit status, and words of what is said."""


@pytest.mark.parametrize("kind", WRONG)
def test_a_row_that_is_wrong_is_named_in_one_sentence(kind, tmp_path):
    """By the command, as users call it."""
    status, words = WRONG[kind]
    asked = ["identify", "maslow-4", "--lengths", str(written(tmp_path, change(kind))), "--unknown", "exits"]
    answer = run(*asked)
    said = " ".join((answer.stdout + answer.stderr).split())
    assert words in said
    assert answer.exit_code == status


def of_one_belt() -> cdpr.Measurements:
    """With the tension of belt 1 alone, where the balance of a point in a plane gives two more."""
    return cdpr.Measurements.of(lengths=read().lengths, tensions=np.tile([100.0, np.nan, np.nan, np.nan], (25, 1)))


REFUSED = {
    "both": (lambda: cdpr.Measurements.of([(1.0, 0, 1)], lengths=[[1.0] * 4]), "found both of it and lengths"),
    "neither": (lambda: cdpr.Measurements.of(), "found neither of it and lengths"),
    "poses": (lambda: cdpr.Measurements.of(lengths=[[1.0] * 4], measured=[[0.0] * 6]), "found measured poses beside"),
    "one tension": (lambda: cdpr.identify(maslow(), of_one_belt(), ["exits"]), "row 1: found the tensions of 1 cables"),
    "gauge": (lambda: cdpr.identify(maslow(), read(), ["exits"], gauge=["exit 9 x"]), "gauge"),
    "sensor": (lambda: cdpr.identify(maslow(), read(), ["force_gains"]), "expected numbers of robot and winches"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused_in_a_sentence(case):
    """What is given beside lengths, gauges that are no unknowns, unknowns of sensors."""
    call, words = REFUSED[case]
    with pytest.raises(cdpr.CdprError, match=words):
        call()
