"""Identification from cable lengths alone: nobody measured where the platform was.

Each row has the unstretched lengths of all cables at a place that was not measured, and the tensions of those cables
that were pulled tight, if they are known. The pose of each row is an unknown besides those of the robot; where a
platform has fewer free directions than cables, lengths are left over. With p the pose, t the known tensions, and the
others those that balance the load,

    r = (l0(p, t; θ) − offset)/gain − y,    minimised over θ and all p, over the standard errors,

where l0 are the rest lengths that have these tensions (``statics.given_tensions``): all properties of the cables count,
and a new one needs no change here. Without any tension, lengths are those that the winches let out at a pose: rigid
ones, or those of the robot's pretension.

A step (Levenberg 1944; Marquardt 1963, doi:10.1137/0111030) eliminates the poses row by row: what is left of a row's
numbers are their components normal to the change with the pose (Golub and Pereyra 1973, doi:10.1137/0710036). The
statistics of ``identification`` are those of these components.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from cdpr_sim.analysis.identification_model import Unknown, parameters_at
from cdpr_sim.analysis.measurements import Measurements
from cdpr_sim.core.checks import one_of
from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pretension import commanded_lengths
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import forces, given_tensions

Array = np.ndarray

STEP = 1e-5
"""Of central differences, in the units of ``Unknown.scale`` times a hundred, and in metres and radians of poses."""

STEPS, CONVERGED = 60, 1e-6
"""Largest number of steps of a fit; and the step that ends it, over the standard errors of lengths."""

STARTS, ROUGH_STEPS = 4, 25
"""Starting points along each axis of the frame for a pose that is not known, and steps from each."""

SINGULAR = 1e-8
"""Below this fraction of the largest singular value, a change of the pose changes no length: rotation about anchors
that are one point."""

FAR = 2.0
"""Lengths beyond this many diagonals of the frame are not those of its cables."""

GROSS, MANY = 0.02, 5.0
"""Misfit of a row over the frame's diagonal, and over that of half the rows, with the robot as given: beyond both, its
lengths are wrong, and not the robot. Exits that are wrong by 20 mm in a frame of 3 m misfit by 0.004."""

NEAR = 0.2
"""Share of a misfit that is left if two lengths are exchanged, below which they are called exchanged."""

SMALLEST = 1e-9
"""[m] Least standard error of a length that is estimated."""


@dataclass
class LengthsModel:
    """What the lengths of all rows would be, as a function of the unknowns and of the poses.

    Attributes:
        robot: the known values.
        measurements: with ``lengths``.
        unknowns: the numbers to fit.
    """

    robot: Robot
    measurements: Measurements
    unknowns: Sequence[Unknown]

    def __post_init__(self) -> None:
        data = self.measurements
        assert data.lengths is not None
        self.lengths = data.lengths
        given = np.full(self.lengths.shape, np.nan) if data.tensions is None else data.tensions
        self.tensions, self.pulled = given, ~np.isnan(given)
        self.wrenches = np.zeros((len(self.lengths), 6)) if data.wrenches is None else data.wrenches
        self.free = np.array(self.robot.free)

    def shown(
        self, x: Float[Array, " unknowns"], positions: Float[Array, "rows 3"], rotations: Float[Array, "rows 3 3"],
        more: Float[Array, "*#rows cables"] | float = 0.0,
    ) -> Float[Array, "rows cables"]:  # fmt: skip
        """Lengths that would be read at these poses; under tensions that are larger by ``more``."""
        robot, whole = parameters_at(self.robot, self.unknowns, x)
        offsets, gains = whole["rest_lengths"], whole["rest_length_gains"]
        if not self.pulled.any():
            return (commanded_lengths(robot, positions, rotations) - offsets) / gains
        masses = self.measurements.masses
        mass = robot.mass if masses is None else np.where(np.isnan(masses), robot.mass, masses)
        shape = (len(self.lengths),)
        problems = Problems(
            robot, positions, rotations, self.lengths, self.wrenches, robot.axial_stiffness, np.asarray(mass), shape,
            np.array(False),
        )  # fmt: skip
        load = forces.load_wrench(problems, rotations)[..., self.free]
        matrix = forces.geometry(robot, positions, rotations).wrench_matrix
        rest = self.lengths
        for _ in range(1 if robot.cabling.springs else 3):  # a cable with mass turns with its tension
            tensions = self._balanced(matrix[..., self.free, :], load, np.nan_to_num(self.tensions) + more)
            rest, matrix = given_tensions.cut(robot, positions, rotations, tensions, refuse=False)
        return (rest - offsets) / gains

    def _balanced(
        self,
        matrix: Float[Array, "rows free cables"],
        load: Float[Array, "rows free"],
        known: Float[Array, "rows cables"],
    ) -> Float[Array, "rows cables"]:
        """All tensions: the known ones, and those that balance the rest of the load, the smallest."""
        units = self.robot.units[self.free][:, None]
        matrix, known = matrix / units, np.where(self.pulled, known, 0.0)
        left = load[..., None] / units + matrix @ known[..., None]
        others = -np.linalg.pinv(np.where(self.pulled[:, None], 0.0, matrix), rcond=SINGULAR) @ left
        return known + np.where(self.pulled, 0.0, others[..., 0])

    def by_pose(
        self, x: Float[Array, " unknowns"], positions: Float[Array, "rows 3"], rotations: Float[Array, "rows 3 3"]
    ) -> Float[Array, "rows cables free"]:
        """Derivatives by steps of the pose, in the scales of ``Robot.units``."""
        columns = []
        for k in self.free:
            step = np.zeros(6)
            step[k] = STEP / self.robot.units[k]
            up, down = (self.shown(x, *moved(positions, rotations, sign * step)) for sign in (1, -1))
            columns.append((up - down) / (2 * STEP))
        return np.stack(columns, axis=-1)

    def by_unknowns(
        self, x: Float[Array, " unknowns"], positions: Float[Array, "rows 3"], rotations: Float[Array, "rows 3 3"]
    ) -> Float[Array, "rows cables unknowns"]:
        """Derivatives by the unknowns' coordinates; to one side at the least value."""
        columns = []
        for k, one in enumerate(self.unknowns):
            step = np.zeros(len(x))
            step[k] = 1e-3 if one.logarithmic else 1e2 * STEP * one.scale
            lower = x if one.value(x[k] - step[k]) < one.least else x - step
            up, down = (self.shown(at, positions, rotations) for at in (x + step, lower))
            columns.append((up - down) / (x + step - lower)[k])
        return np.stack(columns, axis=-1) if columns else np.zeros((*self.lengths.shape, 0))

    def by_tensions(
        self, x: Float[Array, " unknowns"], positions: Float[Array, "rows 3"], rotations: Float[Array, "rows 3 3"]
    ) -> Float[Array, "rows cables cables"]:
        """Derivatives by the known tensions [m/N]; 0 by others."""
        if not self.pulled.any():
            return np.zeros((*self.lengths.shape, self.robot.cables))
        step = 1e-3 * max(float(np.nanmax(np.abs(self.tensions))), 1.0)
        columns = []
        for cable in np.eye(self.robot.cables):
            up, down = (self.shown(x, positions, rotations, sign * step * cable) for sign in (1, -1))
            columns.append((up - down) / (2 * step))
        return np.stack(columns, axis=-1) * self.pulled[:, None]


@dataclass(frozen=True, eq=False)
class LengthsFit:
    """A fit: the unknowns' coordinates, the poses, and what is left of each row's numbers.

    Attributes:
        x: the unknowns' coordinates.
        positions, rotations: of the platform, found.
        residuals: what would be read less what was, (rows, cables) [m].
        normal: components of each row's whitened residuals in which no pose moves them, (rows, cables, cables): an
            orthonormal basis in the columns, 0 for those that a pose moves.
        left: the residuals in these components, over their standard errors, (rows, cables).
        slopes: their derivatives by x, (rows, cables, unknowns).
        whitening: from residuals [m] to numbers with unit covariance, (rows, cables, cables).
    """

    x: Float[Array, " unknowns"]
    positions: Float[Array, "rows 3"]
    rotations: Float[Array, "rows 3 3"]
    residuals: Float[Array, "rows cables"]
    normal: Float[Array, "rows cables cables"]
    left: Float[Array, "rows cables"]
    slopes: Float[Array, "rows cables unknowns"]
    whitening: Float[Array, "rows cables cables"]

    @property
    def counted(self) -> Bool[Array, "rows cables"]:
        """Which components are numbers left over: those that no pose moves."""
        return (self.normal**2).sum(1) > 0.5

    def misfits(self) -> tuple[Float[Array, "rows cables"], Float[Array, "rows cables"]]:
        """By how much each length differs from what the others of its row and the fit say: [m], and over its error."""
        across = np.swapaxes(self.whitening, 1, 2) @ self.normal
        spread = (across**2).sum(-1)  # Baarda's test of one number (1968)
        seen = spread > SINGULAR * np.diagonal(self.whitening, axis1=1, axis2=2) ** 2
        spread, along = np.where(seen, spread, np.inf), -(across @ self.left[..., None])[..., 0]
        return along / spread, along / np.sqrt(spread)


def moved(
    positions: Float[Array, "rows 3"], rotations: Float[Array, "rows 3 3"], steps: Float[Array, "*#rows 6"]
) -> tuple[Float[Array, "rows 3"], Float[Array, "rows 3 3"]]:
    """Poses after steps (translation, left-applied rotation vector)."""
    if not steps[..., 3:].any():
        return positions + steps[..., :3], rotations
    turned = Rotation.from_rotvec(steps[..., 3:]).as_matrix() @ rotations
    return positions + steps[..., :3], turned


def fitted(
    model: LengthsModel,
    start: tuple[Float[Array, "rows 3"], Float[Array, "rows 3 3"]],
    length_errors: Float[Array, "rows cables"],
    tension_errors: Float[Array, "rows cables"],
    x: Float[Array, " unknowns"] | None = None,
    weights: Float[Array, " rows"] | None = None,
) -> LengthsFit:
    """The least squares over all unknowns and poses, by Marquardt's method.

    Raises:
        NotConverged: no step makes the residuals smaller, far from where they are least.
    """
    at = (np.zeros(len(model.unknowns)) if x is None else x, *start)
    whitening = _whitening(model.by_tensions(*at), length_errors, tension_errors)
    if weights is not None:
        whitening = whitening * weights[:, None, None]
    least = np.array([-np.inf if one.logarithmic else one.least - one.start for one in model.unknowns])

    def white(numbers: Array) -> Array:
        return whitening @ numbers

    residuals = model.shown(*at) - model.lengths
    damping, units = 1e-6, model.robot.units[model.free]
    for _ in range(STEPS):
        by_pose, by_unknowns = white(model.by_pose(*at)), white(model.by_unknowns(*at))
        r = white(residuals[..., None])[..., 0]
        cost = float((r**2).sum())
        back = np.linalg.pinv(by_pose, rcond=SINGULAR)
        left = r - (by_pose @ (back @ r[..., None]))[..., 0]
        slopes = (by_unknowns - by_pose @ (back @ by_unknowns)).reshape(-1, len(at[0]))
        while True:
            sizes = np.linalg.norm(slopes, axis=0)
            ridge = np.sqrt(damping) * np.diag(np.where(sizes > 0, sizes, 1.0))
            wanted = np.concatenate([-left.ravel(), np.zeros(len(at[0]))])
            step = np.linalg.lstsq(np.vstack([slopes, ridge]), wanted, rcond=None)[0] if len(at[0]) else np.zeros(0)
            step = np.maximum(at[0] + step, least) - at[0]
            pose = -(back @ (r + by_unknowns @ step)[..., None])[..., 0]
            whole = np.zeros((len(pose), 6))
            whole[:, model.free] = pose / units
            trial = (at[0] + step, *moved(*at[1:], whole))
            with np.errstate(all="ignore"):
                residuals_there = model.shown(*trial) - model.lengths
                after = float((white(residuals_there[..., None]) ** 2).sum())
            small = float(np.sqrt(((by_unknowns @ step + (by_pose @ pose[..., None])[..., 0]) ** 2).max()))
            if after <= cost * (1 + 1e-12) or small < CONVERGED:
                break
            damping *= 10
            if damping > 1e12:
                raise NotConverged("identify: no step of the fit to the lengths makes its residuals smaller")
        better = after <= cost
        if better:
            at, residuals, damping = trial, residuals_there, max(damping / 10, 1e-12)
        if small < CONVERGED or not better:
            break
    by_pose, by_unknowns = white(model.by_pose(*at)), white(model.by_unknowns(*at))
    u, s, _ = np.linalg.svd(by_pose)
    rank = (s > SINGULAR * s[:, :1]).sum(1)
    normal = u * (np.arange(u.shape[-1]) >= rank[:, None])[:, None]
    across = np.swapaxes(normal, 1, 2)
    left, slopes = (across @ white(residuals[..., None]))[..., 0], across @ by_unknowns
    return LengthsFit(*at, residuals, normal, left, slopes, whitening)


def _whitening(
    by_tensions: Float[Array, "rows cables cables"],
    length_errors: Float[Array, "rows cables"],
    tension_errors: Float[Array, "rows cables"],
) -> Float[Array, "rows cables cables"]:
    """C^(−1/2) of each row, with C the covariance of its lengths, by their own errors and by those of the tensions."""
    spread = by_tensions * tension_errors[:, None]
    covariance = spread @ np.swapaxes(spread, 1, 2)
    cables = np.arange(length_errors.shape[1])
    covariance[:, cables, cables] += length_errors**2
    values, vectors = np.linalg.eigh(covariance)
    return (vectors / np.sqrt(values)[:, None]) @ np.swapaxes(vectors, 1, 2)


# Poses, as far as the lengths say, with the robot as given; and rows that cannot be its lengths


def places(model: LengthsModel) -> tuple[Float[Array, "rows 3"], Float[Array, "rows 3 3"]]:
    """Where the platform was in each row, with the robot as given and rigid cables: the best of many starts.

    Raises:
        InvalidInput: a length that no cable of this robot can have, or a row that misfits far more than the others.
    """
    robot, data, source = model.robot, model.lengths, model.measurements.source
    diagonal = float(np.linalg.norm(np.ptp(np.vstack([robot.frame, robot.exits]), axis=0)))
    if data.max() > FAR * diagonal:
        row, cable = np.argwhere(data > FAR * diagonal)[0]
        guess = "; are these millimetres?" if np.median(data[row]) > FAR * diagonal else ""
        raise InvalidInput(
            f"{source}: row {row + 1}: found a length {cable + 1} of {data[row, cable]:.6g} m in a frame of "
            f"{diagonal:.3g} m, expected at most {FAR * diagonal:.3g} m{guess}"
        )
    positions, rotations, misfit = _rough(robot, data)
    gross = max(GROSS * diagonal, MANY * float(np.median(misfit)))
    pairs = list(combinations(range(robot.cables), 2))
    if np.median(misfit) > GROSS * diagonal:
        exchanged = [float(np.median(_rough(robot, _swapped(data, *pair))[2])) for pair in pairs]
        best = int(np.argmin(exchanged))
        if exchanged[best] < NEAR * np.median(misfit):
            i, j = pairs[best]
            raise InvalidInput(
                f"{source}: row 1: found lengths that misfit by {1e3 * misfit[0]:.3g} mm, as in most rows, and fit "
                f"where lengths {i + 1} and {j + 1} are exchanged; expected the columns in the order of the cables"
            )
    if (misfit > gross).any():
        row = int(misfit.argmax())
        exchanged = [float(_rough(robot, _swapped(data[row : row + 1], *pair))[2][0]) for pair in pairs]
        best = int(np.argmin(exchanged))
        i, j = pairs[best]
        why = "did a cable skip?"
        if exchanged[best] < max(NEAR * misfit[row], 2 * float(np.median(misfit))):
            why = f"they fit where lengths {i + 1} and {j + 1} are exchanged"
        elif np.median(data[row]) < 1e-2 * np.median(data):
            why = "are they in another unit than the others?"
        raise InvalidInput(
            f"{source}: row {row + 1}: found lengths that misfit by {1e3 * misfit[row]:.3g} mm, where half of the rows "
            f"misfit by less than {1e3 * np.median(misfit):.3g} mm: {why}"
        )
    if model.pulled.any():
        matrix = forces.geometry(robot, positions, rotations).wrench_matrix / robot.units[:, None]
        matrix = np.where(model.pulled[:, None], 0.0, matrix)[:, robot.free]
        lacking = (~model.pulled).sum(1) - np.linalg.matrix_rank(matrix, tol=1e-6)
        if (lacking > 0).any():
            row = int(np.argmax(lacking > 0))
            known = int(model.pulled[row].sum())
            raise InvalidInput(
                f"{source}: row {row + 1}: found the tensions of {known} cables, expected those of "
                f"{known + lacking[row]} or more, with which balance gives the others; or of none in any row"
            )
    return positions, rotations


def _swapped(data: Array, i: int, j: int) -> Array:
    order = np.arange(data.shape[1])
    order[[i, j]] = j, i
    return data[:, order]


def _rough(
    robot: Robot, data: Float[Array, "rows cables"]
) -> tuple[Float[Array, "rows 3"], Float[Array, "rows 3 3"], Float[Array, " rows"]]:
    """(positions, rotations, root mean square misfit [m]) of rigid cables: Levenberg's method from a grid of starts."""
    free, units = robot.free, robot.units[robot.free]
    lower, upper = np.vstack([robot.frame, robot.exits]).min(0), np.vstack([robot.frame, robot.exits]).max(0)
    axes = [
        np.linspace(a, b, STARTS + 2)[1:-1] if k in free else [0.0]
        for k, (a, b) in enumerate(zip(lower, upper, strict=True))
    ]
    grid = np.array([*product(*axes)])
    positions = np.repeat(grid, len(data), axis=0)
    rotations, wanted = np.tile(np.eye(3), (len(positions), 1, 1)), np.tile(data, (len(grid), 1))
    damping, trial = np.full(len(positions), 1e-2), (positions, rotations)
    best, off = np.full(len(positions), np.inf), np.zeros(wanted.shape)
    slope = np.zeros((*wanted.shape, len(free)))
    for _ in range(ROUGH_STEPS):
        with np.errstate(all="ignore"):
            cables = forces.geometry(robot, *trial)
        there = np.nan_to_num(cables.lengths - wanted, nan=1e3)
        cost = (there**2).sum(1)
        good, by = cost <= best, np.swapaxes(-robot.cabling.tensions(cables.wrench_matrix), 1, 2)[..., free] / units
        positions = np.where(good[:, None], trial[0], positions)
        rotations = np.where(good[:, None, None], trial[1], rotations)
        best, off = np.where(good, cost, best), np.where(good[:, None], there, off)
        slope = np.where(good[:, None, None], by, slope)
        damping = np.where(good, damping / 5, damping * 5).clip(1e-12, 1e6)
        normal = np.swapaxes(slope, 1, 2) @ slope + damping[:, None, None] * np.eye(len(free))
        step = -np.linalg.solve(normal, np.swapaxes(slope, 1, 2) @ off[..., None])[..., 0] / units
        whole = np.zeros((len(step), 6))
        whole[:, free] = step
        trial = moved(positions, rotations, whole)
    costs = best.reshape(len(grid), len(data))
    chosen = costs.argmin(0) * len(data) + np.arange(len(data))
    return positions[chosen], rotations[chosen], np.sqrt(best[chosen] / robot.cables)


# Gauge


def gauge_of(robot: Robot, unknowns: Sequence[Unknown], given: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the unknown coordinates of exits that are held, since no length tells where the frame stands.

    Those ``given``; by default all coordinates of the exit nearest to the base frame's origin, and heights of others,
    the farthest first, as many as there are rigid motions that move unknown coordinates alone.
    """
    exits = [one for one in unknowns if one.parameter == "exits"]
    if given is not None:
        for name in given:
            one_of("gauge", name, [one.name for one in exits])
        return tuple(given)
    axes = [0, 2] if robot.mobility == "planar" else [0, 1, 2]
    motions = np.zeros((robot.cables, 3, 6))
    motions[..., :3] = np.eye(3)
    motions[..., 3:] = -forces.cross_matrix(robot.exits)
    motions = motions.reshape(-1, 6)[:, robot.free]
    unknown = np.array([one.columns[0] for one in exits], dtype=int)
    known = np.setdiff1d([3 * i + k for i in range(robot.cables) for k in axes], unknown)
    _, s, rows = np.linalg.svd(motions[known] if len(known) else np.zeros((1, motions.shape[1])))
    s = np.append(s, np.zeros(len(rows) - len(s)))
    loose = rows[s <= SINGULAR * max(s[0], 1.0)].T  # motions that leave the known coordinates where they are
    nearest = int(np.argmin(np.linalg.norm(robot.exits, axis=1)))
    away = np.linalg.norm((robot.exits - robot.exits[nearest])[:, :2], axis=1)
    order = sorted(exits, key=lambda one: _first(one, nearest, away))
    held: list[str] = []
    chosen = np.zeros((0, loose.shape[1]))
    for one in order:
        more = np.vstack([chosen, motions[one.columns[0]] @ loose])
        if np.linalg.matrix_rank(more, tol=1e-3) > len(chosen):
            held, chosen = [*held, one.name], more
    return tuple(held)


def _first(one: Unknown, nearest: int, away: Float[Array, " cables"]) -> tuple[int, float]:
    """Order in which coordinates are held."""
    cable, axis = divmod(one.columns[0], 3)
    return (0, axis) if cable == nearest else (1 if axis == 2 else 2, -float(away[cable]))
