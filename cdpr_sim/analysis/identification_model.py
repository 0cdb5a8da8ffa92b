"""What a robot's sensors show in equilibrium, as a function of unknowns, with its derivatives.

An unknown is a number of the robot (EA, mass, an exit), of its winches (an offset of a rest length) or of its sensors
(the gain of a load cell). With x(θ) the equilibrium, derivatives are by the implicit function theorem
(``statics.derivatives``); those of natural frequencies are central differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cdpr_sim.analysis.identifiability import prediction_error
from cdpr_sim.analysis.measurements import KINDS, Measurements
from cdpr_sim.analysis.modes import modes_of
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.cable_path import swivel_angles
from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import derivatives, forces, newton

OF_ALL_CABLES = {
    name: one.step
    for name, one in PROPERTIES.items()
    if one.step is not None and (one.shape == () or one.uniform) and name != "axial_stiffness"
}
"""Properties of which one number for all cables can be fitted, or for all that run over a wheel."""

POSITIVE = ("axial_stiffness", "mass", *(name for name, step in OF_ALL_CABLES.items() if step.path and not step.least))
"""Unknowns that are fitted by their logarithms."""

UNKNOWNS = (
    "axial_stiffness", "axial_stiffness_each", "rest_length_offsets", "rest_length_gains", "mass", "center_of_mass",
    "exits", "anchors", *OF_ALL_CABLES, "force_gains", "force_offsets", "angle_zeros", "yaw_zero", "swivel_zeros",
)  # fmt: skip
"""Unknowns that can be fitted: one EA for all cables, one each; rest lengths are gain times the given one plus offset;
mass, centre of mass, exits, anchors; one number for all cables of their other properties; a load cell shows gain times
tension plus offset; zeros of alpha, beta and gamma, of gamma alone, of the swivel angles."""

GROUPS = {"exit": "exits", "anchor": "anchors"}
"""Unknowns of which some alone can be fitted: "exit 3", all its coordinates, or "exit 3 x"."""

PERFECT = {
    "rest_lengths": 0.0, "rest_length_gains": 1.0, "force_gains": 1.0, "force_offsets": 0.0, "angle_zeros": 0.0,
    "swivel_zeros": 0.0,
}  # fmt: skip
"""Parameters of winches and sensors, which are not part of a robot, as they are where nothing is wrong."""

STEP = 1e-4
"""Step of central differences, in units of a positive unknown's logarithm, or of ``_Unknown.scale``."""

FINAL, ROUGH = 1e-12, 1e-7
"""Relative tolerances of the sum of squares: of a result, and of a fit that only gives weights or is compared."""

EVALUATIONS = 200
"""Largest number of steps of a fit; those of the tests and of measured data take less than 30, beside a bound 100."""

RANGE = 1e4
"""Positive unknowns are fitted within this factor of the robot's own."""

FREQUENCY = KINDS.index("frequency")


@dataclass(frozen=True)
class Unknown:
    """One number to fit: its derivative is the sum of those of ``columns`` of ``parameter``.

    What its standard error is compared with is its ``size``, with its name; inf where there is nothing. ``scale``
    is a small change of it [its unit], for differences; ``least`` the least value it can have.
    """

    name: str
    unit: str
    parameter: str
    columns: tuple[int, ...]
    start: float
    logarithmic: bool = False
    size: tuple[float, str] = (np.inf, "")
    scale: float = 1.0
    least: float = -np.inf

    def value(self, x: float) -> float:
        """Value from the fit's coordinate, 0 at the start: a logarithm, or a difference."""
        return self.start * float(np.exp(x)) if self.logarithmic else self.start + float(x)

    def coordinate(self, value: float) -> float:
        """The fit's coordinate of a value."""
        return float(np.log(value / self.start)) if self.logarithmic else value - self.start


def unknowns_of(robot: Robot, measurements: Measurements, names: Sequence[str]) -> list[Unknown]:
    """The numbers to fit, for names of ``UNKNOWNS``.

    Raises:
        InvalidInput: an unknown that this robot or these measurements do not have.
    """
    axes = (0, 2) if robot.mobility == "planar" else (0, 1, 2)
    seen = np.any(measurements.known, axis=0)
    positive = {"logarithmic": True, "size": (1.0, "it")}
    place = {"size": (robot.characteristic_length, "the platform's size"), "scale": 1e-2}
    all_cables = [("", tuple(range(robot.cables)))]
    wheels = [("", tuple(np.flatnonzero(robot.cabling.pulleys).tolist()))] if robot.cabling.pulleys.any() else []
    each = [(f" {i + 1}", (i,)) for i in range(robot.cables)]
    points = [(f" {i + 1} {'xyz'[k]}", (3 * i + k,)) for i in range(robot.cables) for k in axes]
    angles = [(name, (i,)) for i, name in enumerate(("alpha_zero", "beta_zero", "yaw_zero")) if seen[3 + i]]
    cells, swivels = (
        [each[i] for i in np.flatnonzero(seen[measurements.kinds == KINDS.index(kind)])]
        for kind in ("tension", "swivel")
    )
    # Of each name: the unknowns' common name, their parameter, their units, their own names and columns, and the rest.
    table: dict[str, tuple[str, str, str, list[tuple[str, tuple[int, ...]]], dict[str, Any]]] = {
        "axial_stiffness": ("axial_stiffness", "axial_stiffness", "N", all_cables, positive),
        "axial_stiffness_each": ("axial_stiffness", "axial_stiffness", "N", each, positive),
        "rest_length_offsets": ("rest_length_offset", "rest_lengths", "m", each, {"scale": 1e-2}),
        "rest_length_gains": ("rest_length_gain", "rest_length_gains", "", each, {"size": (1.0, "it"), "scale": 1e-2}),
        "mass": ("mass", "mass", "kg", [("", (0,))], positive),
        "center_of_mass": ("center_of_mass", "center_of_mass", "m", [(f" {'xyz'[i]}", (i,)) for i in axes], place),
        "exits": ("exit", "exits", "m", points, place),
        "anchors": ("anchor", "anchors", "m", points, place),
        "force_gains": ("force_gain", "force_gains", "", cells, {"size": (1.0, "it")}),
        "force_offsets": ("force_offset", "force_offsets", "N", cells, {}),
        "angle_zeros": ("", "angle_zeros", "rad", angles, {}),
        "yaw_zero": ("", "angle_zeros", "rad", [one for one in angles if one[0] == "yaw_zero"], {}),
        "swivel_zeros": ("swivel_zero", "swivel_zeros", "rad", swivels, {}),
    }
    for name, step in OF_ALL_CABLES.items():
        those = wheels if step.path else all_cables
        further = positive if name in POSITIVE else {"scale": 1e-2, "least": 0.0}
        if PROPERTIES[name].uniform:
            spans = np.linalg.norm(robot.exits - robot.home - robot.anchors, axis=1)
            further = further | {"scale": 1e-2 * float(step.scale(robot, np.zeros(robot.cables), spans).mean())}
            those = [("", tuple(range(3 * robot.cables)))]
        table[name] = (name, name, PROPERTIES[name].unit, those, further)
    found: list[Unknown] = []
    for name in names:
        common, parameter, unit, numbers, further = table[GROUPS.get(name.partition(" ")[0], name)]
        numbers = [one for one in numbers if name in table or f"{common}{one[0]} ".startswith(f"{name} ")]
        if not numbers:
            lacking = "robot with pulleys" if name in OF_ALL_CABLES else "measurement that depends on it"
            raise InvalidInput(f"unknowns: found {name} without a {lacking}, expected one")
        for own, columns in numbers:
            start = PERFECT.get(parameter)
            if start is None:
                values = np.ravel(getattr(robot, parameter))[list(columns)]
                start = float(np.exp(np.log(values).mean()) if name == "axial_stiffness" else values.mean())
            start = max(start, further.get("least", start))
            found.append(Unknown(common + own, unit, parameter, columns, start, **further))
    return found


def parameters_at(
    robot: Robot, unknowns: Sequence[Unknown], x: Float[np.ndarray, " unknowns"]
) -> tuple[Robot, dict[str, np.ndarray]]:
    """The robot with the unknowns at ``x``; and parameters by name: those of ``PERFECT`` and the changed ones."""
    sizes = dict.fromkeys(PERFECT, robot.cables) | {"angle_zeros": 3}
    found = {name: np.full(sizes[name], value) for name, value in PERFECT.items()}
    for one, coordinate in zip(unknowns, x, strict=True):
        if one.parameter not in found:
            found[one.parameter] = np.array(getattr(robot, one.parameter), dtype=float, ndmin=1)
        found[one.parameter].flat[list(one.columns)] = one.value(coordinate)
    new = {name: value if name != "mass" else float(value[0]) for name, value in found.items() if name not in PERFECT}
    return robot.replace(**new), found


class IdentificationModel:
    """The equilibria at measured poses as a function of the unknowns, and what the sensors show there.

    ``rest_lengths`` are the given ones, (rows, cables); ``errors`` are the standard errors of all numbers, (rows,
    numbers); ``weights`` factors of their residuals, for robust fits; ``corrections`` the likeliest errors of the rest
    lengths, 0 where they are exact. After ``solve``, ``now`` and ``rest`` are robot
    and rest lengths with the unknowns, ``solved`` the equilibria.
    """

    def __init__(
        self,
        robot: Robot,
        measurements: Measurements,
        unknowns: Sequence[Unknown],
        errors: Float[np.ndarray, "rows numbers"] | None = None,
    ) -> None:
        self.robot, self.measurements, self.unknowns = robot, measurements, list(unknowns)
        self.positions = measurements.commanded[:, :3]
        self.rotations = Rotation.from_euler("xyz", measurements.commanded[:, 3:]).as_matrix()
        given, rigid = measurements.rest_lengths, map(robot.rest_lengths, measurements.commanded)
        self.rest_lengths = np.array([*rigid]) if given is None else given
        known = measurements.known
        self.errors = np.ones(known.shape) if errors is None else errors
        self.weights = np.ones(int(known.sum()))
        parts = [part.reshape(len(known), -1) for part in measurements.inputs if part is not None]
        same = np.unique(np.nan_to_num(np.concatenate(parts, axis=1)), axis=0, return_inverse=True)[1].ravel()
        self.places: Int[np.ndarray, " measured"] = same[np.nonzero(known)[0]]
        self.kinds: Int[np.ndarray, " measured"] = np.broadcast_to(measurements.kinds, known.shape)[known]
        wrenches = measurements.wrenches
        self.wrenches = np.zeros((len(known), 6)) if wrenches is None else wrenches
        self._at: np.ndarray | None = None
        self._slopes: tuple[np.ndarray, np.ndarray] | None = None
        self._whitening: list[np.ndarray] | None = None
        self.corrections: Float[np.ndarray, "rows cables"] = np.zeros(self.rest_lengths.shape)
        self._effects: np.ndarray | float = 0.0

    # Fit

    def whiten(self, x: Float[np.ndarray, " unknowns"]) -> None:
        """Take the errors of the rest lengths into account, as they act at ``x``; without any, nothing.

        With S the derivatives of a row's numbers by its rest lengths, and r its residuals, the likeliest corrections d
        of the lengths are −Σ S' C⁻¹ (r − S d) with C = σ² + S Σ S'. The model is evaluated at the corrected lengths,
        and its residuals r − S d have the covariance C (Britt and Luecke, Technometrics 15, 1973).
        """
        lengths = self.measurements.rest_length_errors
        if lengths is None:
            return
        cables = range(self.robot.cables)
        by_length = self._slopes_by(x, [Unknown(f"{i}", "m", "rest_lengths", (i,), 0.0) for i in cables])
        by_length = by_length * self._of["rest_length_gains"]
        left, found = self.residuals(x), []
        corrections, effects = np.zeros_like(self.corrections), np.zeros(left.shape)
        for row, known in enumerate(self.measurements.known):
            slope = by_length[row, known]
            spread = slope * lengths[row]
            values, vectors = np.linalg.eigh(np.diag(self.errors[row, known] ** 2) + spread @ spread.T)
            found.append((vectors / np.sqrt(values)) @ vectors.T)
            rest = left[row, known] - slope @ self.corrections[row]
            corrections[row] = -(lengths[row, :, None] * spread.T) @ (found[-1] @ (found[-1] @ rest)).ravel()
            effects[row, known] = slope @ corrections[row]
        self._whitening, self.corrections, self._effects = found, corrections, effects
        self._at = self._slopes = None

    def _white(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers of all rows over their standard errors, as independent numbers, times the weights."""
        known = self.measurements.known
        if self._whitening is None:
            white = numbers[known] / self.errors[known].reshape(-1, *[1] * (numbers.ndim - 2))
        else:
            white = np.concatenate([w @ own[k] for w, own, k in zip(self._whitening, numbers, known, strict=True)])
        return white * self.weights.reshape(-1, *[1] * (numbers.ndim - 2))

    def log_determinant(self) -> float:
        """Of the covariance of all measured numbers, for a likelihood."""
        if self._whitening is None:
            return 2 * float(np.log(self.errors[self.measurements.known]).sum())
        return -2 * float(sum(np.linalg.slogdet(one)[1] for one in self._whitening))

    def weighted(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " measured"]:
        """Residuals of what was measured, over their standard errors."""
        return self._white(self.residuals(x) - self._effects)

    def weighted_slopes(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "measured unknowns"]:
        """Derivative of ``weighted``."""
        return self._white(self.slopes(x))

    def fitted_from(
        self, x: Float[np.ndarray, " unknowns"], tolerance: float = FINAL
    ) -> Float[np.ndarray, " unknowns"]:
        """The least of the squares of ``weighted``, sought from ``x``; ``tolerance`` is that of the sum of squares.

        Raises:
            NotConverged: no equilibrium at some pose on the way.
        """
        if not self.unknowns:
            return x
        far = np.array([np.log(RANGE) if one.logarithmic else np.inf for one in self.unknowns])
        least = np.array([-np.inf if one.logarithmic else one.least - one.start for one in self.unknowns])
        lower = np.maximum(least, -far)
        return least_squares(
            self.weighted,
            np.maximum(x, lower),
            jac=self.weighted_slopes,  # pyright: ignore[reportArgumentType]
            bounds=(lower, far),
            x_scale="jac",
            xtol=1e2 * tolerance,
            ftol=tolerance,
            gtol=tolerance,
            max_nfev=EVALUATIONS,
        ).x

    def prediction(self, x: Float[np.ndarray, " unknowns"]) -> float:
        """Root mean square error of rows that are left out, over their standard errors; see ``prediction_error``.

        All rows with the same inputs at once: another reading at the same place would predict one that is left out.
        """
        return prediction_error(self.weighted_slopes(x), self.weighted(x), self.places)

    # Equilibria

    def changed(self, x: Float[np.ndarray, " unknowns"]) -> tuple[Robot, Float[np.ndarray, "rows cables"]]:
        """The robot and its rest lengths with the unknowns at ``x``."""
        robot, self._of = parameters_at(self.robot, self.unknowns, x)
        given = self.rest_lengths + self.corrections
        return robot, self._of["rest_length_gains"] * given + self._of["rest_lengths"]

    def solve(self, x: Float[np.ndarray, " unknowns"]) -> None:
        """Equilibria at ``x``, kept until the next call.

        Raises:
            NotConverged: at some row there is none, or a rest length below 0.
        """
        if self._at is not None and np.array_equal(self._at, x):
            return
        self.now, self.rest = self.changed(x)
        if not self.rest.min() > 0:
            raise NotConverged("identify: the fit needs rest lengths below 0")
        given = self.measurements.masses
        masses = None if given is None else np.where(np.isnan(given), self.now.mass, given)
        solved = newton.solve_many(
            self.now, self.positions, self.rest, rotations=self.rotations, external_wrench=self.wrenches,
            mass=masses,
        )  # fmt: skip
        if not solved.converged.all():
            row = int(np.argmin(solved.converged))
            raise NotConverged(
                f"identify: no equilibrium found for row {row + 1} of {self.measurements.source} while fitting "
                f"(residual {solved.residuals[row]:.1e} N)"
            )
        self.solved, self._at = solved, x.copy()

    def shown(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "rows numbers"]:
        """What the sensors show in the equilibria at ``x``; the columns of ``Measurements.values``."""
        self.solve(x)
        solved, data = self.solved, self.measurements
        parts = [solved.positions, solved.euler + self._of["angle_zeros"]]
        if data.tensions is not None:
            parts.append(self._of["force_gains"] * solved.tensions + self._of["force_offsets"])
        if data.swivels is not None:
            self.now.cabling.refuse_unknown("swivel angles", "swivels")
            angles, _ = swivel_angles(self.now.cabling, solved.positions, solved.rotations)
            parts.append(angles + self._of["swivel_zeros"])
        if data.frequencies is not None:
            states = map(forces.at, solved.problems, solved.positions, solved.rotations)
            parts.append(np.array([modes_of(state)[0][: data.frequencies.shape[1]] for state in states]))
        return np.hstack(parts)

    def residuals(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "rows numbers"]:
        """What the sensors would show less what they did, nan where not measured; angles between −π and π."""
        difference = self.shown(x) - self.measurements.values
        angles = np.isin(self.measurements.kinds, [KINDS.index("rotation"), KINDS.index("swivel")])
        difference[:, angles] = (difference[:, angles] + np.pi) % (2 * np.pi) - np.pi
        return difference

    # Derivatives

    def slopes(self, x: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, "rows numbers unknowns"]:
        """Derivative of ``residuals`` by the fit's coordinates; the last one is kept."""
        if self._slopes is not None and np.array_equal(self._slopes[0], x):
            return self._slopes[1]
        scales = [one.value(at) if one.logarithmic else 1.0 for one, at in zip(self.unknowns, x, strict=True)]
        found = self._slopes_by(x, self.unknowns) * np.array(scales)
        frequencies = self.measurements.kinds == FREQUENCY
        for k, one in enumerate(self.unknowns):
            if frequencies.any() and one.parameter not in SENSORS:
                found[:, frequencies, k] = self._differences(x, k)[:, frequencies]
        self._slopes = x.copy(), found
        return found

    def _differences(self, x: Float[np.ndarray, " unknowns"], k: int) -> Float[np.ndarray, "rows numbers"]:
        """Central differences by unknown ``k``; from its least value, one-sided."""
        one, step = self.unknowns[k], np.zeros(len(x))
        step[k] = STEP * (1.0 if one.logarithmic else one.scale)
        lower = x if one.value(x[k] - step[k]) < one.least else x - step
        return (self.shown(x + step) - self.shown(lower)) / (step[k] + (x - lower)[k])

    def _slopes_by(
        self, x: Float[np.ndarray, " fitted"], unknowns: Sequence[Unknown]
    ) -> Float[np.ndarray, "rows numbers unknowns"]:
        """Derivatives of what sensors show, by these unknowns; 0 for frequencies."""
        self.solve(x)
        data, cables, rows = self.measurements, self.now.cables, len(self.positions)
        state = forces.at(self.solved.problems, self.solved.positions, self.solved.rotations)
        changes = self._changes(unknowns)
        step, tensions = derivatives.of_equilibria(state, *derivatives.along_changes(state, changes))
        parts = [step[:, :3], _angle_rates(self.solved.euler) @ step[:, 3:]]
        if data.tensions is not None:
            parts.append(self._of["force_gains"][:, None] * tensions)
        if data.swivels is not None:
            _, turning = swivel_angles(self.now.cabling, state.position, state.rotation)
            moved = step[:, None, :3] - forces.cross_matrix(state.geometry.arms) @ step[:, None, 3:]
            if "anchors" in changes:
                moved = moved + state.rotation[:, None] @ changes["anchors"].reshape(cables, 3, -1)
            if "exits" in changes:
                moved = moved - changes["exits"].reshape(cables, 3, -1)
            by = (turning[..., None, :] @ moved)[..., 0, :]
            parts.append(np.where(self.now.cabling.pulleys[:, None], by, 0.0))
        if data.frequencies is not None:
            parts.append(np.zeros((rows, data.frequencies.shape[1], len(unknowns))))
        result = np.concatenate(parts, axis=1)
        for k, one in enumerate(unknowns):
            if one.parameter in SENSORS:
                columns = np.flatnonzero(data.kinds == KINDS.index(SENSORS[one.parameter]))[list(one.columns)]
                shown = self.solved.tensions[:, list(one.columns)] if one.parameter == "force_gains" else 1.0
                result[:, columns, k] = shown
        return result

    def _changes(self, unknowns: Sequence[Unknown]) -> dict[str, Float[np.ndarray, "*rows parameters unknowns"]]:
        """Derivatives of the parameters of the equilibria by these unknowns."""
        cables, count, masses = self.robot.cables, len(unknowns), self.measurements.masses
        changes = {name: np.zeros((cables, count)) for name in ("rest_lengths", "rest_length_gains")}
        for k, one in enumerate(unknowns):
            if one.parameter in SENSORS:
                continue
            if one.parameter not in changes:
                changes[one.parameter] = np.zeros((np.size(getattr(self.robot, one.parameter)), count))
            changes[one.parameter][list(one.columns), k] = 1.0
        gains = changes.pop("rest_length_gains")
        if gains.any():
            changes["rest_lengths"] = (
                changes["rest_lengths"] + (self.rest_lengths + self.corrections)[..., None] * gains
            )
        if "mass" in changes and masses is not None:
            changes["mass"] = np.isnan(masses)[:, None, None] * changes["mass"]
        return changes


SENSORS = {
    "force_gains": "tension", "force_offsets": "tension", "angle_zeros": "rotation", "swivel_zeros": "swivel"
}  # fmt: skip
"""Parameters of sensors, and what these measure."""


def _angle_rates(angles: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3 3"]:
    """E⁻¹ with d(alpha, beta, gamma) = E⁻¹ omega, for a rotation vector omega in the base frame."""
    _, beta, gamma = angles.T
    s, c, sb, cb = np.sin(gamma), np.cos(gamma), np.sin(beta), np.cos(beta)
    zero = np.zeros(len(angles))
    rows = [[c * cb, -s, zero], [s * cb, c, zero], [-sb, zero, zero + 1.0]]
    return np.linalg.inv(np.moveaxis(np.array(rows), -1, 0))
