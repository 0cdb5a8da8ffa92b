"""Identification: fit of the cables' stiffness, rest lengths, mass or centre of mass to measured poses.

Nonlinear least squares (Levenberg 1944; SciPy's trust-region reflective) on

    r = (x(θ) − x_measured) / sigma

where x(θ) is the equilibrium of statics, with the exact derivatives of the implicit function theorem. Positive unknowns
are fitted by their logarithm. Standard errors are the square roots of the diagonal of (JᵀJ)⁻¹; directions of θ that the
data do not see, by the singular values of J with unit columns, have infinite ones, and a sentence. Whether the data
hold so many unknowns is tested against fits of fewer (``identifiability``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.stats import chi2

from cdpr_sim.analysis.identifiability import INVISIBLE, certainty, directions, leverages, prediction_error, too_many
from cdpr_sim.analysis.measurements import Measurements
from cdpr_sim.core.checks import listed, one_of, positive, refuse_unless
from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import derivatives, forces, newton

UNKNOWNS = (
    "axial_stiffness", "axial_stiffness_each", "rest_length_offsets", "mass", "center_of_mass", "winch_to_exit",
)  # fmt: skip
"""Unknowns that can be fitted: one EA for all cables, one each, an offset of each rest length, mass, centre of mass,
one length of rope between winch and exit for all cables."""

REWEIGHTINGS = 20
"""Number of fits, each weighted by the scatters from the residuals of the last one; they converge in three or four."""

LEAST_FREEDOM = 1e-6
"""Least number of degrees of freedom of a kind of measurement: with fewer, its scatter cannot be estimated
separately."""

EXACT = 1e-9
"""[m, rad] Least estimate of a scatter: two solutions of one equilibrium differ by as much."""

SURPRISING = 1e-3
"""Probability of residuals as large as found, below which the model does not explain the data."""

RANGE = 1e4
"""Positive unknowns are fitted within this factor of the robot's own."""

SCAN = 10.0 ** np.arange(-2, 2.01, 0.25)
"""Factors of EA that are tried before the fit: far from the true one the platform may have another equilibrium."""

SAID = 3
"""Unknowns that ``repr`` names one by one."""


@dataclass(frozen=True, eq=False)
class Identification(HtmlRepr):
    """Result of an identification.

    Attributes:
        robot: the robot with the identified values (rest-length offsets are not part of a robot).
        names: names of the unknowns, one by one: "axial_stiffness", "mass", "rest_length_offset 3".
        units: unit of each.
        values: value of each.
        standard_errors: standard error of each; ``inf`` where the data do not determine it.
        correlations: between them, (unknowns, unknowns); nan where undetermined.
        residuals: residuals in coordinates (rows, 6) [m, rad]; nan where not measured.
        spread: root mean square of residuals over their stated error; 1 if model and errors are right, and by
            construction where errors were judged.
        scatters: standard errors of a measured coordinate [m] and of an angle [rad], as stated or judged.
        judged: which of them were judged from the residuals: "position", "rotation".
        predictions: root mean square of what fits to all other rows miss of each row's numbers, over ``scatters``: of
            the unknowns that were asked for, first, and of fewer, by their names; nan of a single row, inf where one
            row alone determines an unknown.
        reasons: what the data cannot tell, and whether the model explains them, a sentence each.
    """

    robot: Robot
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " unknowns"]
    standard_errors: Float[np.ndarray, " unknowns"]
    correlations: Float[np.ndarray, "unknowns unknowns"]
    residuals: Float[np.ndarray, "rows 6"]
    spread: float
    scatters: tuple[float, float]
    judged: tuple[str, ...]
    predictions: Mapping[tuple[str, ...], float]
    reasons: tuple[str, ...]

    def __getitem__(self, name: str) -> tuple[float, float]:
        """(value, standard error) of the unknown called ``name``.

        Raises:
            UnknownName: no such unknown.
        """
        index = self.names.index(one_of("unknown", name, self.names))
        return float(self.values[index]), float(self.standard_errors[index])

    def __repr__(self) -> str:
        told = [
            f"{name} = {value:.6g} ± {error:.2g} {unit}"
            for name, value, error, unit in zip(self.names, self.values, self.standard_errors, self.units, strict=True)
        ]
        more = f"; and {len(told) - SAID} more" if len(told) > SAID else ""
        warned = f"; {self.reasons[0]}" if self.reasons else ""
        warned += f" (and {len(self.reasons) - 1} more warnings)" if len(self.reasons) > 1 else ""
        return f"<Identification of {self.robot.name!r}: {'; '.join(told[:SAID])}{more}{warned}>"


@dataclass(frozen=True)
class _Unknown:
    """One number to fit: its derivative is the sum of those of ``columns`` of ``parameter``.

    What its standard error is compared with is its ``size``, and that in words; inf where there is nothing.
    """

    name: str
    unit: str
    parameter: str
    columns: tuple[int, ...]
    start: float
    logarithmic: bool
    size: tuple[float, str] = (np.inf, "")


def identify(
    robot: Robot,
    measurements: Measurements,
    unknowns: Sequence[str] = ("axial_stiffness",),
    *,
    position_error: float | None = None,
    rotation_error: float | None = None,
) -> Identification:
    """Fit ``unknowns`` to measured poses.

    Args:
        robot: the known values, and the start of the fit.
        measurements: from ``read_measurements`` or ``Measurements.of``.
        unknowns: any of ``UNKNOWNS``.
        position_error: standard error of a measured coordinate [m]; default: estimated from the residuals of positions.
        rotation_error: standard error of a measured angle [rad]; default: estimated from the residuals of angles.

    Returns:
        Values of the unknowns with standard errors in the unit of each, the residuals, and a robot with the identified
        values.

    Raises:
        InvalidInput: measurements of another robot or too few, errors that are not positive, or unknowns that exclude
            each other.
        UnknownName: no such unknown.
        NotConverged: no equilibrium at some commanded pose for any stiffness near the best.
    """
    refuse_unless(Robot, robot=robot)
    refuse_unless(Measurements, measurements=measurements)
    measurements.check_robot(robot)
    names = _names(unknowns)
    wanted = _wanted(robot, names)
    known = measurements.known
    stated = [
        None if position_error is None else positive("position_error", position_error, "m"),
        None if rotation_error is None else positive("rotation_error", rotation_error, "rad"),
    ]
    kinds = np.broadcast_to(np.repeat([0, 1], 3), known.shape)[known]  # of each number: a position, or an angle
    judged = [kind for kind in (0, 1) if stated[kind] is None and (kinds == kind).any()]
    count, needed = len(kinds), len(wanted) + bool(judged)
    if count < needed:
        raise InvalidInput(
            f"{measurements.source}: found {count} measured numbers, expected {needed} or more for {len(wanted)} "
            "unknowns" + (" and their scatter" if judged else "")
        )
    arm = robot.characteristic_length
    guess = stated[0] or (stated[1] or 1.0 / arm) * arm
    model = _Model(robot, measurements, wanted, (stated[0] or guess, stated[1] or guess / arm))
    x = _scanned(model)
    for _ in range(REWEIGHTINGS):
        x = model.fitted_from(x)
        before = model.scatters
        model.scatters = _scatters(before, judged, kinds, model.weighted(x), model.weighted_slopes(x), arm)
        if not judged or (kinds == kinds[0]).all():
            break  # a factor common to all numbers moves no fit
        if np.allclose(model.scatters, before, rtol=1e-3, atol=0):
            break
    x = _nearest_to_known(x, model)
    left, slope = model.weighted(x), model.weighted_slopes(x)
    errors, correlations, reasons = certainty(slope, [one.name for one in wanted], [one.size for one in wanted])
    predictions = {names: model.prediction(x)} | _predictions_of_fewer(model, names)
    reasons += too_many(predictions)
    told = ~np.isin(kinds, judged)  # numbers whose error was stated, which the model must explain
    size, freedom = float(np.sum(left[told] ** 2)), float((1 - leverages(slope))[told].sum())
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
    values = np.array([_value(one, at) for one, at in zip(wanted, x, strict=True)])
    factors = np.array([value if one.logarithmic else 1.0 for one, value in zip(wanted, values, strict=True)])
    return Identification(
        robot=model.changed(x)[0],
        names=tuple(one.name for one in wanted),
        units=tuple(one.unit for one in wanted),
        values=values,
        standard_errors=errors * factors,
        correlations=correlations,
        residuals=np.where(known, model.residuals(x), np.nan),
        spread=float(spread),
        scatters=(float(model.scatters[0]), float(model.scatters[1])),
        judged=tuple(("position", "rotation")[kind] for kind in judged),
        predictions=predictions,
        reasons=tuple(reasons),
    )


def _scatters(
    scatters: Float[np.ndarray, "2"],
    judged: list[int],
    kinds: np.ndarray,
    residuals: Float[np.ndarray, " numbers"],
    slope: Float[np.ndarray, "numbers unknowns"],
    arm: float,
) -> Float[np.ndarray, "2"]:
    """Scatters of positions and angles; those that are ``judged`` are estimated from their residuals, separately.

    Each by the degrees of freedom of its kind: the count of its numbers, less their share in the fit (the trace of
    their block of the hat matrix; Förstner 1979). Of kinds that were measured, none is below a thousandth of the other
    by the ``arm``.
    """
    leverage = leverages(slope)
    together = np.isin(kinds, judged)
    free = max(float((1 - leverage[together]).sum()), 0.0)
    pooled = np.sqrt(float((residuals[together] ** 2).sum()) / free) if free > LEAST_FREEDOM else 1.0
    found = scatters.copy()
    for kind in judged:
        rows = kinds == kind
        free = float((1 - leverage[rows]).sum())
        own = np.sqrt(float((residuals[rows] ** 2).sum()) / free) if free > LEAST_FREEDOM else pooled
        found[kind] = max(found[kind] * own, EXACT)
    alike = np.array([1.0, 1.0 / arm])  # scatters of one size: an angle's is a position's over the arm
    least = 1e-3 * (found / alike)[np.unique(kinds)].max() * alike
    return np.where(np.isin([0, 1], judged), np.maximum(found, least), scatters)


def _predictions_of_fewer(model: _Model, names: tuple[str, ...]) -> dict[tuple[str, ...], float]:
    """Prediction errors without one of the unknowns, each in turn, and with one EA in place of one for each cable.

    By the weights of the larger fit. Where a smaller one meets a pose without an equilibrium, it predicts nothing.
    """
    fewer = [tuple(name for name in names if name != left_out) for left_out in names]
    if "axial_stiffness_each" in names:
        fewer.append(tuple(name.removesuffix("_each") for name in names))
    found = {}
    for some in fewer:
        smaller = _Model(model.robot, model.measurements, _wanted(model.robot, some), model.scatters)
        with suppress(NotConverged):
            found[some] = smaller.prediction(smaller.fitted_from(_scanned(smaller)))
    return found


def _nearest_to_known(x: Float[np.ndarray, " unknowns"], model: _Model) -> Float[np.ndarray, " unknowns"]:
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
        one_of("unknown", name, UNKNOWNS)
    if len(set(unknowns)) < len(unknowns):
        raise InvalidInput(f"unknowns: found {', '.join(unknowns)}, expected each once")
    if {"axial_stiffness", "axial_stiffness_each"} <= set(unknowns):
        raise InvalidInput("unknowns: found axial_stiffness and axial_stiffness_each, expected one of the two")
    return tuple(unknowns)


def _wanted(robot: Robot, names: Sequence[str]) -> list[_Unknown]:
    cables, EA = range(robot.cables), robot.axial_stiffness
    axes = (0, 2) if robot.mobility == "planar" else (0, 1, 2)
    itself, platform = (1.0, "it"), (robot.characteristic_length, "the platform's size")
    mean = float(np.exp(np.log(EA).mean()))
    choices = {
        "axial_stiffness": [_Unknown("axial_stiffness", "N", "axial_stiffness", tuple(cables), mean, True, itself)],
        "axial_stiffness_each": [
            _Unknown(f"axial_stiffness {i + 1}", "N", "axial_stiffness", (i,), float(EA[i]), True, itself)
            for i in cables
        ],
        "rest_length_offsets": [
            _Unknown(f"rest_length_offset {i + 1}", "m", "rest_lengths", (i,), 0.0, False) for i in cables
        ],
        "mass": [_Unknown("mass", "kg", "mass", (0,), robot.mass, True, itself)],
        "center_of_mass": [
            _Unknown(f"center_of_mass {'xyz'[i]}", "m", "center_of_mass", (i,), at, False, platform)
            for i, at in enumerate(robot.center_of_mass.tolist())
            if i in axes
        ],
        "winch_to_exit": [
            _Unknown("winch_to_exit", "m", "winch_to_exit", tuple(cables), float(robot.winch_to_exit.mean()), False)
        ],
    }
    return [one for name in names for one in choices[name]]


def _value(unknown: _Unknown, x: float) -> float:
    """Value from the fit's coordinate, 0 at the start: a logarithm, or a difference."""
    return unknown.start * float(np.exp(x)) if unknown.logarithmic else unknown.start + float(x)


class _Model:
    """Equilibria at every row, and their derivatives, as functions of the fit's coordinates.

    Attributes:
        scatters: standard errors of a measured coordinate [m] and of an angle [rad].
    """

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        unknowns: list[_Unknown],
        scatters: Sequence[float] | Float[np.ndarray, "2"] = (1.0, 1.0),
    ) -> None:
        self.robot, self.measurements, self.unknowns = robot, measurements, unknowns
        self.scatters = np.array(scatters)
        self.poses = poses = [robot.pose(row) for row in measurements.commanded]
        self.positions = np.array([pose.translation for pose in poses])
        self.rotations = np.array([pose.rotation.as_matrix() for pose in poses])
        rigid = measurements.rest_lengths
        self.rest_lengths = np.array([robot.rest_lengths(pose) for pose in poses]) if rigid is None else rigid
        self._at: np.ndarray | None = None

    def weighted(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " numbers"]:
        """What is left of each measured number, over its standard error."""
        return (self.residuals(x) / np.repeat(self.scatters, 3))[self.measurements.known]

    def weighted_slopes(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "numbers unknowns"]:
        """Derivative of ``weighted``."""
        return (self.slopes(x) / np.repeat(self.scatters, 3)[:, None])[self.measurements.known]

    def fitted_from(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
        """The least of the squares of ``weighted``, sought from ``x``.

        Raises:
            NotConverged: no equilibrium at some pose on the way.
        """
        if not self.unknowns:
            return x
        far = np.array([np.log(RANGE) if one.logarithmic else np.inf for one in self.unknowns])
        behind = [one.parameter == "winch_to_exit" for one in self.unknowns]  # which is 0 or more
        return least_squares(
            self.weighted,
            x,
            jac=self.weighted_slopes,  # pyright: ignore[reportArgumentType]
            bounds=(np.where(behind, [-one.start for one in self.unknowns], -far), far),
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
        ).x

    def prediction(self, x: Float[np.ndarray, " unknowns"]) -> float:
        """Root mean square error of rows that are left out, over their standard errors; see ``prediction_error``."""
        rows = np.nonzero(self.measurements.known)[0]
        return prediction_error(self.weighted_slopes(x), self.weighted(x), rows)

    def changed(self, x: Float[np.ndarray, " unknowns"]) -> tuple[Robot, Float[np.ndarray, "rows cables"]]:
        """The robot and its rest lengths with the unknowns at ``x``."""
        stiffness = self.robot.axial_stiffness.copy()
        center, mass, behind = self.robot.center_of_mass.copy(), self.robot.mass, 0.0
        rest = self.rest_lengths.copy()
        touched = set()
        for one, coordinate in zip(self.unknowns, x, strict=True):
            value, columns = _value(one, coordinate), list(one.columns)
            touched.add(one.parameter)
            if one.parameter == "axial_stiffness":
                stiffness[columns] = value
            elif one.parameter == "rest_lengths":
                rest[:, columns] += value
            elif one.parameter == "mass":
                mass = value
            elif one.parameter == "winch_to_exit":
                behind = value
            else:
                center[columns] = value
        new = {"axial_stiffness": stiffness, "mass": mass, "center_of_mass": center, "winch_to_exit": behind}
        return self.robot.replace(**{name: value for name, value in new.items() if name in touched}), rest

    def solve(self, x: Float[np.ndarray, " unknowns"]) -> None:
        """Equilibria at ``x``, kept until the next call."""
        if self._at is not None and np.array_equal(self._at, x):
            return
        self.now, self.rest = self.changed(x)
        if not self.rest.min() > 0:
            raise NotConverged("identify: the fit asked for rest lengths below 0")
        solved = newton.solve_many(self.now, self.positions, self.rest, rotations=self.rotations)
        if not solved.converged.all():
            row = int(np.argmin(solved.converged))
            raise NotConverged(
                f"identify: no equilibrium found for row {row + 1} of {self.measurements.source} while fitting "
                f"(residual {solved.residuals[row]:.1e} N)"
            )
        self.solved, self._at = solved, x.copy()

    def residuals(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "rows 6"]:
        """Six-vector of the equilibrium less the measured one; angles between −π and π."""
        self.solve(x)
        difference = np.hstack([self.solved.positions, self.solved.euler]) - self.measurements.measured
        difference[:, 3:] = (difference[:, 3:] + np.pi) % (2 * np.pi) - np.pi
        return difference

    def slopes(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "rows 6 unknowns"]:
        """Derivative of ``residuals``."""
        self.solve(x)
        free = self.now.free
        result, no_wrench = np.zeros((len(self.positions), 6, len(self.unknowns))), np.zeros(6)
        angles = self.solved.euler
        for row, (position, rotation) in enumerate(zip(self.solved.positions, self.solved.rotations, strict=True)):
            problem = Problem(self.now, self.poses[row], self.rest[row], no_wrench)
            state = forces.at(problem, position, rotation)
            slope = derivatives.wrench_slope(state)[np.ix_(free, free)]
            by_parameter = derivatives.wrench_by_parameter(state, [one.parameter for one in self.unknowns])
            wrench = np.zeros((6, len(self.unknowns)))
            for column, one in enumerate(self.unknowns):
                wrench[:, column] = by_parameter[one.parameter][:, list(one.columns)].sum(1)
            # Where nothing holds the platform, the least of all derivatives: the data do not see that direction.
            result[row, free] = -np.linalg.lstsq(slope, wrench[free], rcond=1e-12)[0]
            result[row, 3:] = _angle_rates(angles[row]) @ result[row, 3:]
        scale = [_value(one, at) if one.logarithmic else 1.0 for one, at in zip(self.unknowns, x, strict=True)]
        return result * np.array(scale)


def _angle_rates(angles: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """E⁻¹ with d(alpha, beta, gamma) = E⁻¹ omega, for a rotation vector omega in the base frame."""
    _, beta, gamma = angles
    s, c, sb, cb = np.sin(gamma), np.cos(gamma), np.sin(beta), np.cos(beta)
    return np.linalg.inv(np.array([[c * cb, -s, 0.0], [s * cb, c, 0.0], [-sb, 0.0, 1.0]]))


def _scanned(model: _Model) -> Float[np.ndarray, " unknowns"]:
    """The best of several stiffnesses to start from, all else as known."""
    start = np.zeros(len(model.unknowns))
    stiff = np.array([one.parameter == "axial_stiffness" for one in model.unknowns], dtype=bool)
    if not stiff.any():
        return start
    best, best_size = None, np.inf
    failure: NotConverged | None = None
    for factor in SCAN:
        tried = np.where(stiff, np.log(factor), start)
        try:
            size = float(np.sum(model.weighted(tried) ** 2))
        except NotConverged as error:
            failure = error
            continue
        if size < best_size:
            best, best_size = tried, size
    if best is None:
        assert failure is not None
        raise failure
    return best
