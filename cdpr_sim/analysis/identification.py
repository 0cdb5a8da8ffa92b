"""Identification: fit of stiffness, lengths, mass, geometry and sensors of a robot to measurements of its equilibria.

Nonlinear least squares (Levenberg 1944; SciPy's trust-region reflective) on

    r = (h(x(θ), θ) − y) / sigma

where x(θ) is the equilibrium of statics, and h what the sensors show there (``identification_model``). Positive
unknowns are fitted by their logarithm. Rest lengths with errors are corrected, and their errors are propagated into the
covariance of their row. Standard errors are the square roots of the diagonal of (JᵀJ)⁻¹; directions of θ that the data
do not see, by the singular values of J with unit columns, have infinite ones, and a sentence. Whether the data hold so
many unknowns is tested against fits of fewer (``identifiability``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm, t

from cdpr_sim.analysis.identifiability import (
    INVISIBLE,
    certainty,
    directions,
    leverages,
    prediction_error,
    too_many,
)
from cdpr_sim.analysis.identification_model import (
    GROUPS,
    POSITIVE,
    RANGE,
    ROUGH,
    SENSORS,
    UNKNOWNS,
    IdentificationModel,
    Unknown,
    parameters_at,
    unknowns_of,
)
from cdpr_sim.analysis.lengths_fit import (
    SMALLEST,
    LengthsFit,
    LengthsModel,
    fitted,
    gauge_of,
    places,
)
from cdpr_sim.analysis.measurements import KINDS, Measurements
from cdpr_sim.core.checks import checked_array, listed, one_of, positive, refuse_unless, shown
from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot

LARGEST_ERROR = 1e30
"""Largest standard error that is taken, and the inverse of the least: their squares are numbers, and so are those of
residuals over them."""

REWEIGHTINGS = 20
"""Number of fits, each weighted by the scatters from the residuals of the last one; they converge in three or four."""

CORRECTIONS = 3
"""Number of fits with fewer unknowns, each at the rest lengths that the last one corrected."""

LEAST_FREEDOM = 1e-6
"""Least number of degrees of freedom of a kind of measurement: with fewer, its scatter cannot be estimated
separately."""

EXACT = 1e-9
"""[m, rad] Least estimate of a scatter: two solutions of one equilibrium differ by as much. Of a tension, times the
stiffness of a cable; of a frequency, times the frequency of a pendulum of the platform's size over that size."""

SURPRISING = 1e-3
"""Probability of residuals as large as found, below which the model does not explain the data. Also the probability
that any of normally distributed numbers is named as an outlier."""

TUNING = 1.345
"""Huber's: residuals above this many standard errors count in proportion to their size, not to its square. Standard
errors of normally distributed data become larger by 1/sqrt(0.95) (Huber 1964, doi:10.1214/aoms/1177703732)."""

EFFICIENCY = 0.95
"""Of Huber's estimate with that tuning, on normally distributed data."""

SCAN = 10.0 ** np.arange(-2, 2.01, 0.25)
"""Factors of EA that are tried before the fit: far from the true one the platform may have another equilibrium."""

SAID = 3
"""Unknowns that ``repr`` names one by one."""


@dataclass(frozen=True)
class Outlier:
    """A number that the fit to all others does not explain.

    Attributes:
        row: its row, from 1.
        name: its column of ``Measurements.values``, such as "tension 2".
        size: residual over its standard error, given the fit.
    """

    row: int
    name: str
    size: float

    def __str__(self) -> str:
        return f"row {self.row}: {self.name} is {abs(self.size):.1f} standard errors off"


@dataclass(frozen=True, eq=False)
class Identification(HtmlRepr):
    """Result of an identification.

    Attributes:
        robot: the robot with the identified values (offsets and gains of rest lengths and sensors are not part of it).
        names: names of the unknowns, one by one: "axial_stiffness", "mass", "rest_length_offset 3".
        units: unit of each.
        values: value of each.
        standard_errors: standard error of each; ``inf`` where the data do not determine it, nan where nothing says how
            large the errors of measurement are.
        correlations: between them, (unknowns, unknowns); nan where undetermined.
        residuals: computed minus measured numbers, at the corrected rest lengths if these have errors, (rows, numbers)
            as ``Measurements.values`` [m, rad, N, rad, Hz]; nan where not measured.
        spread: root mean square of residuals over their stated error; 1 if model and errors are right, and by
            construction where errors were estimated.
        scatters: standard error of each kind of measurement, as stated (root mean square) or estimated:
            "position" [m], "rotation" [rad], "tension" [N], "swivel" [rad], "frequency" [Hz]; nan where unknown.
        estimated: which of them were estimated from the residuals.
        predictions: root mean square error of predictions of each row by fits to all other rows, over ``scatters``, by
            the names of the unknowns: first all that were requested, then fewer; nan with a single row or unknown
            errors, inf where one row alone determines an unknown. Rows with the same inputs count as one row there.
        reasons: what the data do not determine, and whether the model explains them, a sentence each.
        degrees_of_freedom: the count of measured numbers minus that of the unknowns which they determine.
        deviance: −2 log of the likelihood of normally distributed errors, estimated ones included; nan where they are
            unknown.
        outliers: numbers that the others do not explain, the worst first.
        kinds: index into ``KINDS`` of each column of ``residuals``.
        given: the robot as it was given.
        requested: the unknowns that were requested.
        repeats: which rows repeat an earlier one to the last digit, inputs and measured numbers, without a stated
            error, (rows,): they add nothing, and are not counted.
        gauge: unknown coordinates that were held as given, because lengths at unknown poses do not tell where the whole
            frame stands.
        poses: where the platform was in each row, found from lengths, (rows, 6) [m, rad]; nan where it was commanded.
    """

    robot: Robot
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " unknowns"]
    standard_errors: Float[np.ndarray, " unknowns"]
    correlations: Float[np.ndarray, "unknowns unknowns"]
    residuals: Float[np.ndarray, "rows numbers"]
    spread: float
    scatters: Mapping[str, float]
    estimated: tuple[str, ...]
    predictions: Mapping[tuple[str, ...], float]
    reasons: tuple[str, ...]
    degrees_of_freedom: int
    deviance: float
    outliers: tuple[Outlier, ...]
    kinds: Int[np.ndarray, " numbers"]
    given: Robot
    requested: tuple[str, ...]
    repeats: Bool[np.ndarray, " rows"]
    gauge: tuple[str, ...] = ()
    poses: Float[np.ndarray, "rows 6"] | None = None

    def __getitem__(self, name: str) -> tuple[float, float]:
        """(value, standard error) of the unknown called ``name``.

        Raises:
            UnknownName: no such unknown.
        """
        index = self.names.index(one_of("unknown", name, self.names))
        return float(self.values[index]), float(self.standard_errors[index])

    def intervals(self, coverage: float = 0.95) -> Float[np.ndarray, "unknowns 2"]:
        """Intervals that contain the true values with this probability, if model and errors are right.

        To first order in the errors: Student's t where errors were estimated, with all degrees of freedom, otherwise
        the normal distribution; in the logarithm of positive unknowns. ``scripts/research/interval_coverage.py``
        measures how often they do.

        Args:
            coverage: the probability, between 0 and 1.

        Returns:
            (unknowns, 2) lower and upper ends; −inf or 0 and inf where the data do not determine an unknown; nan where
            its standard error is.

        Raises:
            InvalidInput: not a probability.
        """
        coverage = float(checked_array("coverage", coverage, ()))
        if not 0 < coverage < 1:
            raise InvalidInput(f"coverage: found {coverage:g}, expected a probability between 0 and 1")
        upper = 0.5 + 0.5 * coverage
        half = float(t.ppf(upper, max(self.degrees_of_freedom, 1)) if self.estimated else norm.ppf(upper))
        found = np.stack([self.values - half * self.standard_errors, self.values + half * self.standard_errors], axis=1)
        positives = np.array([name.partition(" ")[0] in POSITIVE for name in self.names], dtype=bool)
        with np.errstate(over="ignore"):
            ratios = np.exp(half * self.standard_errors[positives] / self.values[positives])
        found[positives] = np.stack([self.values[positives] / ratios, self.values[positives] * ratios], axis=1)
        return found

    @property
    def aicc(self) -> float:
        """Akaike's information criterion, corrected for few numbers: smaller is better, for fits to the same data.

        Hurvich and Tsai 1989 (doi:10.1093/biomet/76.2.297); estimated scatters count as unknowns. inf with too few
        numbers.
        """
        count, k = self._counts
        return self.deviance + 2 * k + 2 * k * (k + 1) / (count - k - 1) if count > k + 1 else np.inf

    @property
    def bic(self) -> float:
        """Schwarz's information criterion (1978, doi:10.1214/aos/1176344136); as ``aicc``."""
        count, k = self._counts
        return self.deviance + k * float(np.log(count))

    @property
    def _counts(self) -> tuple[int, int]:
        """Measured numbers, and parameters with the estimated scatters."""
        count = int((~np.isnan(self.residuals[~self.repeats])).sum())
        return count, count - self.degrees_of_freedom + len(self.estimated)

    def predict(self, measurements: Measurements) -> Float[np.ndarray, "rows numbers"]:
        """Computed minus measured numbers of other rows, with all unknowns as identified.

        Args:
            measurements: with columns of the same kinds; offsets, gains and zeros count as of the same sensors.

        Returns:
            (rows, numbers) as ``residuals``; nan where not measured.

        Raises:
            InvalidInput: measurements of another robot.
            NotConverged: no equilibrium at some row.
        """
        refuse_unless(Measurements, measurements=measurements)
        measurements.check_robot(self.robot)
        if measurements.lengths is not None:
            raise InvalidInput("measurements: found lengths at unknown poses, which nothing predicts; expected poses")
        wanted = {one.name: one for one in unknowns_of(self.given, measurements, self.requested)}
        kept = [wanted[name] for name in self.names if name in wanted]
        values = [value for name, value in zip(self.names, self.values, strict=True) if name in wanted]
        x = np.array([one.coordinate(value) for one, value in zip(kept, values, strict=True)])
        model = IdentificationModel(self.given, measurements, kept)
        return np.where(measurements.known, model.residuals(x), np.nan)

    def __repr__(self) -> str:
        described = [
            f"{name} = {value:.6g} ± {'unknown' if np.isnan(error) else f'{error:.2g}'} {unit}"
            for name, value, error, unit in zip(self.names, self.values, self.standard_errors, self.units, strict=True)
        ]
        more = f"; and {len(described) - SAID} more" if len(described) > SAID else ""
        warned = f"; {self.reasons[0]}" if self.reasons else ""
        warned += f" (and {len(self.reasons) - 1} more warnings)" if len(self.reasons) > 1 else ""
        return f"<Identification of {self.robot.name!r}: {'; '.join(described[:SAID])}{more}{warned}>"


def identify(
    robot: Robot,
    measurements: Measurements,
    unknowns: Sequence[str] = ("axial_stiffness",),
    *,
    position_error: float | None = None,
    rotation_error: float | None = None,
    tension_error: float | None = None,
    swivel_error: float | None = None,
    frequency_error: float | None = None,
    rest_length_error: float | None = None,
    length_error: float | None = None,
    gauge: Sequence[str] | None = None,
    robust: bool = False,
) -> Identification:
    """Fit ``unknowns`` to what was measured in equilibrium.

    The error arguments apply where the measurements state no errors. If a kind of measurement has no error at all, its
    error is estimated from the residuals. Where the residuals say nothing of it, because there are as many unknowns as
    numbers or the fit is exact, standard errors are unknown: nan, and a sentence. Rows that are identical to the last
    digit count once, unless their errors are stated.

    Args:
        robot: the known values, and the start of the fit.
        measurements: from ``read_measurements`` or ``Measurements.of``.
        unknowns: any of ``UNKNOWNS``.
        position_error: standard error of a measured coordinate [m].
        rotation_error: standard error of a measured angle [rad].
        tension_error: standard error of a measured tension [N].
        swivel_error: standard error of a measured swivel angle [rad].
        frequency_error: standard error of a measured natural frequency [Hz].
        rest_length_error: standard error of a rest length [m]; default: rest lengths are exact.
        length_error: standard error of a length at an unknown pose [m].
        gauge: names of coordinates of unknown exits that are held as given where only lengths were measured, such as
            "exit 3 x"; default: all of the exit nearest to the origin, and heights of others, as many as the frame has
            rigid motions.
        robust: by Huber's weights, so that outliers count in proportion to their size, not to its square.

    Returns:
        Values of the unknowns with standard errors in the unit of each, the residuals, and a robot with the identified
        values.

    Raises:
        InvalidInput: measurements of another robot or too few, errors that are not positive, or unknowns that exclude
            each other, or that these measurements do not have.
        UnknownName: no such unknown.
        NotConverged: no equilibrium at some commanded pose for any stiffness near the best.
    """
    refuse_unless(Robot, robot=robot)
    refuse_unless(Measurements, measurements=measurements)
    refuse_unless(bool, robust=robust)
    robot.cabling.refuse_memory()
    measurements.check_robot(robot)
    names = _names(unknowns)
    wanted = unknowns_of(robot, measurements, names)
    given = (
        position_error, rotation_error, tension_error, swivel_error, frequency_error, length_error, rest_length_error,
    )  # fmt: skip
    kinds_and_lengths = zip((*KINDS, "rest_length"), given, ("m", "rad", "N", "rad", "Hz", "m", "m"), strict=True)
    stated = {
        kind: _standard_error(f"{kind}_error", error, unit)
        for kind, error, unit in kinds_and_lengths
        if error is not None
    }
    measured = {kind for i, kind in enumerate(KINDS) if (measurements.known & (measurements.kinds == i)).any()}
    measurements = measurements.with_errors(
        {kind: error for kind, error in stated.items() if kind in measured | {"rest_length"}}
    )
    if measurements.lengths is not None:
        return _from_lengths(robot, measurements, wanted, names, gauge, robust)
    if gauge is not None:
        raise InvalidInput(f"gauge: found {shown(gauge)} beside known poses, expected it with lengths at unknown ones")
    asked, kept, of = measurements, *_distinct_rows(measurements)
    measurements = asked.rows(kept)
    known = measurements.known
    unstated = np.isnan(measurements.errors) & known
    estimated = [i for i in range(len(KINDS)) if (unstated & (measurements.kinds == i)).any()]
    count = int(known.sum())
    if count < len(wanted):
        once = ", identical rows counted once" if len(kept) < len(of) else ""
        raise InvalidInput(
            f"{measurements.source}: found {count} measured numbers{once}, expected {len(wanted)} or more for "
            f"{len(wanted)} unknowns"
        )
    scales, floors = _scales(robot)
    scatters = _start_scatters(measurements, estimated, scales)
    model = IdentificationModel(robot, measurements, wanted, _errors(measurements, scatters))
    x = _scanned(model)
    reweighted = bool(estimated) or robust or measurements.rest_length_errors is not None
    if estimated and not robust and unstated[known].all() and (model.kinds == model.kinds[0]).all():
        reweighted = measurements.rest_length_errors is not None  # a factor common to all numbers moves no fit
    for _ in range(REWEIGHTINGS):
        model.whiten(x)
        last, x = x, model.fitted_from(x, ROUGH)
        before, weights = scatters, model.weights
        if robust:
            sizes = np.abs(model.weighted(x) / weights)
            model.weights = _huber(sizes)
        scatters = _scatters(before, estimated, model, x, unstated[known], scales, floors, robust)
        model.errors = _errors(measurements, scatters)
        settled = np.allclose(scatters, before, rtol=1e-3, atol=0) and np.allclose(model.weights, weights, atol=1e-3)
        still = (
            measurements.rest_length_errors is None or np.abs(model.weighted_slopes(x) @ (x - last)).max() < INVISIBLE
        )
        if not reweighted or (settled and still):
            break
    model.whiten(x)
    x = _nearest_to_known(model.fitted_from(x), model)
    left, slope = model.weighted(x), model.weighted_slopes(x)
    why = _why_unknown(scatters, estimated, model, x, unstated[known], floors, robust)
    sizes = [(np.inf, "") if why else one.size for one in wanted]
    errors, correlations, reasons = certainty(slope, [one.name for one in wanted], sizes)
    if robust:  # the weights count fewer numbers, Huber's efficiency says how much less certain the fit is
        model.weights = np.ones(count)
        plain = model.weighted_slopes(x)
        errors = certainty(plain, [one.name for one in wanted], sizes)[0] / np.sqrt(EFFICIENCY)
    predictions = {names: np.nan} if why else {names: model.prediction(x)} | _predictions_of_fewer(model, names)
    if why:
        if np.isfinite(errors).any():
            stating = " and ".join(f"{KINDS[kind]}_error" for kind in estimated)
            reasons.append(f"the standard errors are unknown: {why}; state {stating}")
        errors, scatters = np.where(np.isfinite(errors), np.nan, errors), scatters.copy()
        scatters[estimated] = np.nan
    else:
        reasons += too_many(predictions)
    stated_errors = ~np.isin(model.kinds, estimated)  # which the model must explain
    size, freedom = float(np.sum(left[stated_errors] ** 2)), float((1 - leverages(slope))[stated_errors].sum())
    spread = np.sqrt(size / freedom) if freedom > LEAST_FREEDOM else 1.0
    if freedom > LEAST_FREEDOM and chi2.sf(size, freedom) < SURPRISING:
        reasons.append(
            f"the model does not explain the data: residuals are {spread:.3g} times their stated error; the standard "
            "errors do not count that"
        )
    at_bound = [
        one.name for one, at in zip(wanted, x, strict=True) if one.logarithmic and abs(at) > 0.99 * np.log(RANGE)
    ]
    reasons += [f"{name} runs away: the data fit best at {RANGE:g} times or a {RANGE:g}th of it" for name in at_bound]
    values = np.array([one.value(at) for one, at in zip(wanted, x, strict=True)])
    factors = np.array([value if one.logarithmic else 1.0 for one, value in zip(wanted, values, strict=True)])
    whole = model.weighted(x)
    determined = slope.shape[1] - len(directions(slope)[1])
    return Identification(
        robot=model.changed(x)[0],
        names=tuple(one.name for one in wanted),
        units=tuple(one.unit for one in wanted),
        values=values,
        standard_errors=errors * factors,
        correlations=correlations,
        residuals=np.where(known, model.residuals(x), np.nan)[of],
        spread=float(spread),
        scatters={
            KINDS[kind]: float(
                np.sqrt(np.mean(_errors(measurements, scatters)[known & (measurements.kinds == kind)] ** 2))
            )
            for kind in np.unique(model.kinds)
        },
        estimated=tuple(KINDS[kind] for kind in estimated),
        predictions=predictions,
        reasons=tuple(reasons),
        degrees_of_freedom=count - determined,
        deviance=np.nan if why else float((whole**2).sum()) + model.log_determinant() + count * np.log(2 * np.pi),
        outliers=() if why else _outliers(measurements, whole, leverages(model.weighted_slopes(x)), kept),
        kinds=measurements.kinds,
        given=robot,
        requested=names,
        repeats=np.not_equal(kept[of], np.arange(len(asked))),
    )


def _standard_error(field: str, error: float, unit: str) -> float:
    """A standard error whose square, and that of whose inverse, are numbers.

    Raises:
        InvalidInput: any other value.
    """
    number = positive(field, error, unit)
    if not 1 / LARGEST_ERROR <= number <= LARGEST_ERROR:
        raise InvalidInput(f"{field}: found {number:g} {unit}, expected {1 / LARGEST_ERROR:g} to {LARGEST_ERROR:g}")
    return number


def _from_lengths(
    robot: Robot,
    measurements: Measurements,
    wanted: Sequence[Unknown],
    names: tuple[str, ...],
    gauge: Sequence[str] | None,
    robust: bool,
) -> Identification:
    """``identify`` where only lengths were measured, and tensions of cables that were pulled tight."""
    sensors = [one.name for one in wanted if one.parameter in SENSORS]
    if sensors:
        raise InvalidInput(f"unknowns: found {sensors[0]} beside lengths alone, expected numbers of robot and winches")
    held = gauge_of(robot, wanted, None if gauge is None else listed("gauge", gauge, "a list of names"))
    wanted = [one for one in wanted if one.name not in held]
    model = LengthsModel(robot, measurements, wanted)
    rows, cables = model.lengths.shape
    stated = measurements.errors[:, measurements.kinds == KINDS.index("length")]
    estimated = bool(np.isnan(stated).any())
    tension_errors = np.zeros((rows, cables))
    if measurements.tensions is not None:
        tension_errors = np.nan_to_num(measurements.errors[:, measurements.kinds == KINDS.index("tension")])
    scatter, weights = 1e-4 * robot.characteristic_length if estimated else 0.0, np.ones(rows)
    fit, x = None, None
    at = places(model)
    for _ in range(REWEIGHTINGS):
        errors = np.where(np.isnan(stated), scatter, stated)
        fit = fitted(model, at, errors, tension_errors, x, weights)
        x, at = fit.x, (fit.positions, fit.rotations)
        left, slopes, of = _left_over(fit)
        freedom = float((1 - leverages(slopes)).sum())
        if freedom < -0.5 or len(left) < len(wanted):
            break
        before, weighed = scatter, weights
        if robust:
            sizes = np.sqrt((fit.left**2).mean(1)) / weights
            weights = _huber(sizes)
        if estimated and freedom > LEAST_FREEDOM:
            squares = float((left**2).sum()) / (_WEIGHTED_SQUARES if robust else 1.0)
            scatter = max(scatter * float(np.sqrt(squares / freedom)), SMALLEST)
        if np.isclose(scatter, before, rtol=1e-3) and np.allclose(weights, weighed, atol=1e-3):
            break
    assert fit is not None
    left, slopes, of = _left_over(fit)
    if len(left) < len(wanted):
        raise InvalidInput(
            f"{measurements.source}: found {rows * cables} lengths at {rows} unknown poses, which leave {len(left)} "
            f"numbers, expected {len(wanted)} or more for {len(wanted)} unknowns"
        )
    freedom = float((1 - leverages(slopes)).sum())
    errors, correlations, reasons = certainty(
        slopes, [one.name for one in wanted], [one.size for one in wanted], "changing a length"
    )
    if robust:
        errors = errors / np.sqrt(EFFICIENCY)
    if estimated and not freedom > LEAST_FREEDOM:
        reasons.append("the standard errors are unknown: no residual is left to estimate them from; state length_error")
        errors = np.where(np.isfinite(errors), np.nan, errors)
    size = float((left**2).sum())
    spread = float(np.sqrt(size / freedom)) if freedom > LEAST_FREEDOM else 1.0
    if not estimated and freedom > LEAST_FREEDOM and chi2.sf(size, freedom) < SURPRISING:
        reasons.append(
            f"the model does not explain the data: residuals are {spread:.3g} times their stated error; the standard "
            "errors do not count that"
        )
    lengths, misfits = fit.misfits()
    misfits = misfits / weights[:, None]
    limit = norm.isf(SURPRISING / 2 / misfits.size)
    outliers = []
    for row in np.flatnonzero(np.abs(misfits).max(1) > limit):
        cable = int(np.abs(misfits[row]).argmax())
        outliers.append(Outlier(int(row) + 1, f"length {cable + 1}", float(misfits[row, cable])))
        reasons.append(
            f"row {row + 1}: length {cable + 1} reads {1e3 * abs(lengths[row, cable]):.3g} mm "
            f"{'more' if lengths[row, cable] > 0 else 'less'} than the others allow, {abs(misfits[row, cable]):.1f} "
            "standard errors: did the cable skip, or are two lengths exchanged?"
        )
    values = np.array([one.value(coordinate) for one, coordinate in zip(wanted, fit.x, strict=True)])
    factors = np.array([value if one.logarithmic else 1.0 for one, value in zip(wanted, values, strict=True)])
    residuals = np.full(measurements.values.shape, np.nan)
    residuals[:, measurements.kinds == KINDS.index("length")] = fit.residuals
    known = np.log(np.linalg.det(fit.whitening)).sum()
    length = float(np.sqrt(np.mean(np.where(np.isnan(stated), scatter, stated) ** 2)))
    euler = np.array([Rotation.from_matrix(one).as_euler("xyz") for one in fit.rotations])
    return Identification(
        robot=parameters_at(robot, wanted, fit.x)[0],
        names=tuple(one.name for one in wanted),
        units=tuple(one.unit for one in wanted),
        values=values,
        standard_errors=errors * factors,
        correlations=correlations,
        residuals=residuals,
        spread=spread,
        scatters={"length": length},
        estimated=("length",) if estimated else (),
        predictions={names: prediction_error(slopes, left, of)},
        reasons=tuple(reasons),
        degrees_of_freedom=len(left) - len(directions(slopes)[2]),
        deviance=size - 2 * float(known) + len(left) * np.log(2 * np.pi),
        outliers=tuple(sorted(outliers, key=lambda one: -abs(one.size))),
        kinds=measurements.kinds,
        given=robot,
        requested=names,
        repeats=np.zeros(rows, bool),
        gauge=held,
        poses=np.hstack([fit.positions, euler]),
    )


def _left_over(
    fit: LengthsFit,
) -> tuple[Float[np.ndarray, " numbers"], Float[np.ndarray, "numbers unknowns"], Int[np.ndarray, " numbers"]]:
    """Numbers that no pose moves, over their standard errors, their slopes, and the rows that they belong to."""
    return fit.left[fit.counted], fit.slopes[fit.counted], np.nonzero(fit.counted)[0]


def _scales(robot: Robot) -> tuple[Float[np.ndarray, " kinds"], Float[np.ndarray, " kinds"]]:
    """Scatters that are of one size, as a metre of the platform's position; and the least of each that is estimated."""
    arm, weight = robot.characteristic_length, max(robot.weight, 1.0)
    stiffness = float(np.median(robot.axial_stiffness)) / arm
    pendulum = float(np.sqrt(max(robot.gravity, 1.0) / arm)) / (2 * np.pi)
    alike = np.array([1.0, 1 / arm, weight / arm, 1 / arm, pendulum / arm, 1.0])
    return alike, EXACT * np.array([1.0, 1.0, stiffness, 1.0, pendulum / arm, 1.0])


def _distinct_rows(measurements: Measurements) -> tuple[Int[np.ndarray, " kept"], Int[np.ndarray, " rows"]]:
    """Rows without those that repeat an earlier one and have a number without a stated error; and where each row is."""
    parts = [part for part in (*measurements.inputs, measurements.values, measurements.errors) if part is not None]
    table = np.concatenate([part.reshape(len(measurements), -1) for part in parts], axis=1) + 0.0
    unstated = np.asarray((measurements.known & np.isnan(measurements.errors)).any(1))
    seen: dict[bytes, int] = {}
    kept, of = [], []
    for row, numbers in enumerate(table):
        key = numbers.tobytes() if unstated[row] else bytes(str(row), "ascii")
        if key not in seen:
            seen[key] = len(kept)
            kept.append(row)
        of.append(seen[key])
    return np.array(kept), np.array(of)


def _start_scatters(
    measurements: Measurements, estimated: list[int], scales: Float[np.ndarray, " kinds"]
) -> Float[np.ndarray, " kinds"]:
    """First scatters of the kinds that are estimated, alike; as those that are stated, where some are."""
    for kind in range(len(KINDS)):
        errors = measurements.errors[:, measurements.kinds == kind]
        if kind not in estimated and not np.isnan(errors).all():
            return float(np.nanmedian(errors)) / scales[kind] * scales
    return scales


def _errors(measurements: Measurements, scatters: Float[np.ndarray, " kinds"]) -> Float[np.ndarray, "rows numbers"]:
    """Stated errors, and by kind where there is none."""
    return np.where(np.isnan(measurements.errors), scatters[measurements.kinds], measurements.errors)


def _huber(sizes: np.ndarray) -> np.ndarray:
    """Square roots of Huber's weights of residuals, whose ``sizes`` are in standard errors."""
    return np.sqrt(TUNING / np.maximum(sizes, TUNING))


_WEIGHTED_SQUARES = float(1 - 2 * norm.sf(TUNING))
"""Mean of the squares of normally distributed numbers with Huber's weights."""


def _scatters(
    scatters: Float[np.ndarray, " kinds"],
    estimated: list[int],
    model: IdentificationModel,
    x: Float[np.ndarray, " unknowns"],
    unstated: np.ndarray,
    scales: Float[np.ndarray, " kinds"],
    floors: Float[np.ndarray, " kinds"],
    robust: bool,
) -> Float[np.ndarray, " kinds"]:
    """Scatters by kind; those that are ``estimated`` are estimated from their residuals, separately.

    Each by the degrees of freedom of its kind: the count of its numbers, less their share in the fit (the trace of
    their block of the hat matrix; Förstner 1979). Of kinds that were measured, none is below a thousandth of another,
    compared by ``scales``.
    """
    if not estimated:
        return scatters
    found, _ = _estimates(scatters, estimated, model, x, unstated, robust)
    found = np.where(np.isin(np.arange(len(KINDS)), estimated), np.maximum(found, floors), found)
    least = 1e-3 * (found / scales)[np.unique(model.kinds)].max() * scales
    return np.where(np.isin(np.arange(len(KINDS)), estimated), np.maximum(found, least), scatters)


def _estimates(
    scatters: Float[np.ndarray, " kinds"],
    estimated: list[int],
    model: IdentificationModel,
    x: Float[np.ndarray, " unknowns"],
    unstated: np.ndarray,
    robust: bool,
) -> tuple[Float[np.ndarray, " kinds"], float]:
    """The same without bounds; and the degrees of freedom of all kinds that are estimated."""
    squares, leverage = model.weighted(x) ** 2, leverages(model.weighted_slopes(x))
    if robust:
        squares = squares / _WEIGHTED_SQUARES
    freedom = max(float((1 - leverage[unstated]).sum()), 0.0)
    pooled = np.sqrt(float(squares[unstated].sum()) / freedom) if freedom > LEAST_FREEDOM else 1.0
    found = scatters.copy()
    for kind in estimated:
        rows = (model.kinds == kind) & unstated
        free = float((1 - leverage[rows]).sum())
        found[kind] *= np.sqrt(float(squares[rows].sum()) / free) if free > LEAST_FREEDOM else pooled
    return found, freedom


def _why_unknown(
    scatters: Float[np.ndarray, " kinds"],
    estimated: list[int],
    model: IdentificationModel,
    x: Float[np.ndarray, " unknowns"],
    unstated: np.ndarray,
    floors: Float[np.ndarray, " kinds"],
    robust: bool,
) -> str:
    """Why the residuals say nothing of the errors of measurement; "" if they do, or if all errors are stated."""
    if not estimated:
        return ""
    found, freedom = _estimates(scatters, estimated, model, x, unstated, robust)
    if not freedom > LEAST_FREEDOM:
        return (
            "the unknowns fit all numbers without a stated error exactly, and no residual is left to estimate it from"
        )
    if not (found[estimated] > floors[estimated]).any():
        return "the residuals are rounding, and no error can be estimated from them"
    return ""


def _outliers(
    measurements: Measurements,
    white: Float[np.ndarray, " numbers"],
    leverage: Float[np.ndarray, " numbers"],
    kept: Int[np.ndarray, " rows"],
) -> tuple[Outlier, ...]:
    """Numbers whose studentised residuals are as large once in a thousand fits to normally distributed data.

    ``kept`` are the indices of the rows in the given measurements.
    """
    sizes = white / np.sqrt(np.maximum(1 - leverage, INVISIBLE))
    rows, columns = np.nonzero(measurements.known)
    found = [
        Outlier(int(kept[rows[i]]) + 1, measurements.names[columns[i]], float(sizes[i]))
        for i in np.flatnonzero(np.abs(sizes) > norm.isf(SURPRISING / 2 / len(sizes)))
    ]
    return tuple(sorted(found, key=lambda one: -abs(one.size)))


def _predictions_of_fewer(model: IdentificationModel, names: tuple[str, ...]) -> dict[tuple[str, ...], float]:
    """Prediction errors without one of the unknowns, each in turn, and with one EA in place of one for each cable.

    By the weights of the larger fit. Where a smaller one meets a pose without an equilibrium, it predicts nothing.
    """
    fewer = [tuple(name for name in names if name != left_out) for left_out in names]
    if "axial_stiffness_each" in names:
        fewer.append(tuple(name.removesuffix("_each") for name in names))
    found = {}
    for some in fewer:
        smaller = IdentificationModel(
            model.robot, model.measurements, unknowns_of(model.robot, model.measurements, some), model.errors
        )
        with suppress(NotConverged):
            best = _scanned(smaller)
            for _ in range(1 if model.measurements.rest_length_errors is None else CORRECTIONS):
                smaller.whiten(best)
                best = smaller.fitted_from(best, ROUGH)
            found[some] = smaller.prediction(best)
    return found


def _nearest_to_known(x: Float[np.ndarray, " unknowns"], model: IdentificationModel) -> Float[np.ndarray, " unknowns"]:
    """``x`` without its part along what the data do not see: there, what is known of the robot stays."""
    slopes = model.weighted_slopes(x)
    seen, unseen, _ = directions(slopes)
    scaled = x * seen
    nearer = np.where(slopes.any(0), (scaled - unseen.T @ (unseen @ scaled)) / seen, 0.0)
    if np.array_equal(nearer, x):
        return x
    try:
        same = np.abs(model.weighted(nearer) - model.weighted(x)).max() <= INVISIBLE
    except NotConverged:
        return x
    return nearer if same else x


def _names(unknowns: Sequence[str]) -> tuple[str, ...]:
    unknowns = [unknowns] if isinstance(unknowns, str) else listed("unknowns", unknowns, "a list of names")
    if not unknowns:
        raise InvalidInput(f"unknowns: found none, expected some of {', '.join(UNKNOWNS)}")
    for name in unknowns:
        one_of("unknown", GROUPS.get(str(name).partition(" ")[0], name), UNKNOWNS)
    if len(set(unknowns)) < len(unknowns):
        raise InvalidInput(f"unknowns: found {', '.join(unknowns)}, expected each once")
    for one, other in (("axial_stiffness", "axial_stiffness_each"), ("angle_zeros", "yaw_zero")):
        if {one, other} <= set(unknowns):
            raise InvalidInput(f"unknowns: found {one} and {other}, expected one of the two")
    return tuple(unknowns)


def _scanned(model: IdentificationModel) -> Float[np.ndarray, " unknowns"]:
    """The best of several stiffnesses to start from, all else as known."""
    start = np.zeros(len(model.unknowns))
    stiff = np.array([one.parameter == "axial_stiffness" for one in model.unknowns], dtype=bool)
    if not stiff.any():
        return start

    def size(x: Float[np.ndarray, " unknowns"]) -> float:
        try:
            return float(np.sum(model.weighted(x) ** 2))
        except NotConverged:
            return np.inf

    best = min((np.where(stiff, np.log(factor), start) for factor in SCAN), key=size)
    model.solve(best)  # which raises an error if there is no equilibrium for any of them
    return best
