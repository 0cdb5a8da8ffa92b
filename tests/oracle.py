"""Static balance of a cable robot from first principles: NumPy alone, and nothing of the package.

The witness of the tests. Written from the manual (``docs/concepts``), with other equations than the package's: tangents
of a wheel by complex numbers, cables with mass by quadrature and shooting, laws inverted by Newton's method, ropes with
a memory by one bracketed root, stiffness by differences. All parts of line are one cable here: n EA, n w, g/n.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

NODES, PARTS = np.polynomial.legendre.leggauss(40)
NODES, PARTS = (NODES + 1) / 2, PARTS / 2
H = 1e-8
UP = np.array([0.0, 0.0, 1.0])
STRAIGHT = 0.05
"""Ratio of a cable's own weight to its tension up to which its shape is integrated along its length."""

MOST_STRAIN = 0.2
"""End of the polynomial laws, beyond which they go on straight."""


@dataclass(frozen=True, eq=False)
class Rig:
    """Numbers of a robot, by the names and units of a robot file; each array has a row for every cable."""

    exits: np.ndarray
    anchors: np.ndarray
    axial_stiffness: np.ndarray
    linear_density: np.ndarray
    pulley_radius: np.ndarray
    pulley_axis: np.ndarray
    stiffening: np.ndarray
    winch_to_exit: np.ndarray
    rigid_length: np.ndarray
    exit_compliance: np.ndarray
    reeving: np.ndarray
    pulley_friction: np.ndarray
    hysteresis: np.ndarray  # (cables, elements, 3): share, yield strain, w
    creep: np.ndarray  # (cables, terms, 2): EA1, tau1
    mass: float
    center_of_mass: np.ndarray
    gravity: float
    home: np.ndarray  # the middle of the workspace
    inertia: np.ndarray  # about the centre of mass, in the platform's frame
    free: tuple[int, ...] = (0, 1, 2, 3, 4, 5)

    @classmethod
    def of(cls, robot, **changed) -> Rig:
        """From an object that has attributes of these names."""
        names = [field.name for field in dataclasses.fields(cls) if field.name != "free"]
        free = (0, 2, 4) if robot.mobility == "planar" else (0, 1, 2, 3, 4, 5)
        return cls(**({name: getattr(robot, name) for name in names} | {"free": free} | changed))

    def only(self, some: np.ndarray) -> Rig:
        """The rig with some of its cables."""
        cables = {f.name: getattr(self, f.name)[some] for f in dataclasses.fields(self)[:14]}
        return dataclasses.replace(self, **cables)

    @property
    def size(self) -> float:
        """Root mean square distance of the anchors from the origin: what makes rotations lengths."""
        return float(np.sqrt((np.asarray(self.anchors) ** 2).sum(1).mean())) or 1.0

    @property
    def wrapped(self) -> np.ndarray:
        """Length on each wheel with the platform level at home: the massless part of a cable with mass."""
        theta, _, _ = over_wheel(self, self.home + self.anchors - self.exits)
        return np.where(self.linear_density > 0, self.pulley_radius * theta, 0.0)


@dataclass(frozen=True, eq=False)
class State:
    """Memory of the ropes: strain of each element, unstretched length beyond the exit (nan: new), creep, tensions."""

    strains: np.ndarray
    beyond: np.ndarray
    creep: np.ndarray
    tensions: np.ndarray

    @classmethod
    def new(cls, rig: Rig) -> State:
        cables = len(rig.exits)
        return cls(
            np.zeros(rig.hysteresis.shape[:2]), np.full(cables, np.nan), np.zeros(rig.creep.shape[:2]), np.zeros(cables)
        )

    def only(self, some: np.ndarray) -> State:
        return State(*(getattr(self, field.name)[some] for field in dataclasses.fields(self)))


def over_wheel(rig: Rig, span: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(angle on the wheel, straight piece, its direction) of massless cables.

    In the wheel's plane the cable arrives along i at 0, and the centre is at r. After an angle theta it leaves at
    r − r exp(−i theta) along i exp(−i theta): so the anchor is at r + exp(−i theta) (i s − r).
    """
    axis, r = rig.pulley_axis, rig.pulley_radius
    along = (span * axis).sum(-1)
    across = span - along[..., None] * axis
    far = np.linalg.norm(across, axis=-1)
    from_centre = far - r + 1j * along
    s = np.sqrt(np.abs(from_centre) ** 2 - r**2)
    turned = from_centre / (1j * s - r)
    theta = np.where(r > 0, np.mod(-np.angle(turned), 2 * np.pi), 0.0)
    outward = across / np.where(far > 0, far, 1.0)[..., None]
    leaving = np.where(far > 0, (1j * turned).real, 0)[..., None] * outward + (1j * turned).imag[..., None] * axis
    return theta, s, np.where((r > 0)[:, None], leaving, span / np.linalg.norm(span, axis=-1)[..., None])


class Ropes:
    """Law of all cables of a rig in one step of a path, without their mass.

    Args:
        rig: the robot.
        rest: rest lengths from exit to anchor, with what is rigid, (cables,) [m].
        state: memory at the last equilibrium; new ropes by default.
        seconds: since then.
    """

    def __init__(self, rig: Rig, rest: np.ndarray, state: State | None = None, seconds: float = 0.0) -> None:
        n = rig.reeving
        self.rig, self.full, self.old, self.seconds = rig, rest, state or State.new(rig), seconds
        self.rest = rest = rest - rig.rigid_length
        self.EA, self.behind, (self.a2, self.a3) = n * rig.axial_stiffness, rig.winch_to_exit / n, rig.stiffening.T
        self.whole = rest + self.behind
        self.end = 1 + 2 * self.a2 * MOST_STRAIN + 3 * self.a3 * MOST_STRAIN**2
        self.plain = not (
            rig.pulley_friction.any() or (rig.hysteresis[..., 0] > 0).any() or np.isfinite(rig.creep[..., 0]).any()
        )
        self.ratio = (1 + rig.pulley_friction / 2) / (1 - rig.pulley_friction / 2)
        rubbed = np.isfinite(self.old.beyond) & (rig.pulley_friction > 0)
        limits = (self.EA / (rest + self.behind / self.ratio) + self.EA / (rest + self.behind * self.ratio)) / 2
        self.rubbed, self.limits, self.slope = rubbed, limits, np.where(rubbed, limits, self.EA / self.whole)
        # Creep under a tension that is linear in time: exp(−x) z0 + (p − exp(−x)) T0/EA1 + (1 − p) T/EA1.
        (EA1, tau), T0 = np.moveaxis(rig.creep, -1, 0), self.old.tensions[:, None]
        x = seconds / tau
        p = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1), 1.0)
        self.crept = np.exp(-x) * self.old.creep + (p - np.exp(-x)) * T0 / EA1
        self.softer = (1 - p) / (n[:, None] * EA1)

    def force(self, strain: np.ndarray) -> np.ndarray:
        e = np.clip(strain, 0, MOST_STRAIN)
        return self.EA * (e + self.a2 * e**2 + self.a3 * e**3 + self.end * np.maximum(strain - MOST_STRAIN, 0))

    def strain(self, force: np.ndarray) -> np.ndarray:
        """Inverse of the law, by Newton's method."""
        y = e = force / self.EA
        for _ in range(30 if self.rig.stiffening.any() else 0):
            c = np.minimum(e, MOST_STRAIN)
            step = (self.force(e) / self.EA - y) / (1 + 2 * self.a2 * c + 3 * self.a3 * c**2)
            e = e - step
            if not (np.abs(step) > 1e-15 * np.abs(e)).any():
                break
        return e

    def parts(self, strain: np.ndarray) -> tuple[np.ndarray, ...]:
        """By the strain of the first loading: (stretch, force, stretch without creep, behind the exit, of elements)."""
        F, e = self.force(strain), self.whole * strain
        behind = self.behind * strain
        if self.rubbed.any():  # the rope behind the exit holds what it has, between the limits of the ratio of tensions
            lower, upper = self.behind * self.strain(F / self.ratio), self.behind * self.strain(F * self.ratio)
            behind = np.where(self.rubbed, np.clip(self.old.beyond - self.full, lower, upper), behind)
            e = self.rest * strain + behind
        share, most, w = np.moveaxis(self.rig.hysteresis, -1, 0)
        L = self.whole[:, None]
        bound = np.minimum(most * L, w * e[..., None])
        sprung = np.clip(e[..., None] - self.old.strains * L, -bound, bound)
        T = F - self.slope * (share * (e[..., None] - sprung)).sum(-1)
        return e + self.whole * (self.crept + self.softer * T[..., None]).sum(-1), T, e, behind, sprung

    def reached(self, part: int, value: np.ndarray) -> np.ndarray:
        """Strain of the first loading at which the stretch (0) or force (1) has a value: regula falsi (Illinois)."""
        low, high = np.zeros(np.shape(value)), np.full(np.shape(value), 1e-3)
        while (self.parts(high)[part] < value).any():
            high *= 4
        below, above = self.parts(low)[part] - value, self.parts(high)[part] - value
        solvable, side = below < 0, 0  # the others are not stretched
        for _ in range(100):
            gap = np.where(above > below, above - below, np.inf)
            middle = np.clip(low + (high - low) * -below / gap, low, high)
            miss = self.parts(middle)[part] - value
            if (~solvable | (np.abs(miss) <= 1e-15 * value)).all():
                break
            left = miss < 0
            above, below = np.where(left & (side > 0), above / 2, above), np.where(~left & (side < 0), below / 2, below)
            low, below = np.where(left, middle, low), np.where(left, miss, below)
            high, above = np.where(left, high, middle), np.where(left, above, miss)
            side = np.where(left, 1, -1)
        return middle

    def pulling(self, stretch: np.ndarray) -> np.ndarray:
        """Force of a massless cable under a stretch."""
        if self.plain:
            return self.force(stretch / self.whole)
        return np.where(stretch > self.parts(0.0 * self.rest)[0], self.parts(self.reached(0, stretch))[1], 0.0)

    def stretched(self, force: np.ndarray) -> np.ndarray:
        """Stretch under a force at the exit."""
        return self.whole * self.strain(force) if self.plain else self.parts(self.reached(1, force))[0]

    def after(self, force: np.ndarray) -> State:
        """Memory after an equilibrium with these forces at the exits."""
        _, T, e, _, sprung = self.parts(np.where(force > 0, self.reached(1, force), 0.0))
        # The next step begins with the same tension, and with the mean slope at the limits of friction.
        held = T + self.limits * (self.rig.hysteresis[..., 0] * (e[:, None] - sprung)).sum(-1)
        return State(
            strains=(e[:, None] - sprung) / self.whole[:, None], beyond=self.full + e - self.rest * self.strain(held),
            creep=self.crept + self.softer * force[:, None], tensions=force / self.rig.reeving,
        )  # fmt: skip


def hanging(ropes: Ropes, span: np.ndarray, near: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(tension vectors at the exit, at the anchor) of cables with mass that end at their anchors, by shooting.

    The span is that from the exit before the frame gives way, by the tension at the exit.
    """
    rig, rest = ropes.rig, ropes.rest
    r, axis, weight, wrapped = (
        rig.pulley_radius,
        rig.pulley_axis,
        rig.reeving * rig.linear_density * rig.gravity,
        rig.wrapped,
    )
    free, rigid = rest - wrapped, np.asarray(rig.rigid_length)[:, None]

    def missed(f: np.ndarray) -> np.ndarray:
        """Where cables end that leave their wheels under these tensions, less where they should."""
        T = np.linalg.norm(f, axis=-1)
        u = f / T[..., None]
        cosine = (u * axis).sum(-1)
        n = u - cosine[..., None] * axis
        sine = np.linalg.norm(n, axis=-1)
        n = n / np.where(sine > 0, sine, 1)[..., None]
        angle = np.where(r > 0, np.arctan2(sine, cosine), 0.0)
        strain = ropes.strain(T)
        straight = wrapped * (1 + strain) + ropes.stretched(T) - rest * strain - r * angle
        end = r[:, None] * ((1 - cosine)[..., None] * n + sine[..., None] * axis) + straight[..., None] * u
        end = end + rig.exit_compliance * f
        # dr = (1 + eps) f/|f| dS with f = f0 + w S up: along S where nearly straight, else along q with f_z = H sinh q.
        H, below = np.maximum(np.hypot(f[..., 0], f[..., 1]), 1e-9 * weight * free), f[..., 2]
        q0, q1 = np.arcsinh(below / H), np.arcsinh((below + weight * free) / H)
        bent = (weight * free > STRAIGHT * T)[..., None]
        q = q0[..., None] + (q1 - q0)[..., None] * NODES
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            S = np.where(bent, (H[..., None] * np.sinh(q) - below[..., None]) / weight[:, None], free[:, None] * NODES)
            dS = np.where(bent, (H / weight * (q1 - q0))[..., None] * np.cosh(q), free[:, None]) * PARTS
        along = f[..., None, :] + (weight[:, None] * S)[..., None] * UP
        tension = np.linalg.norm(along, axis=-1)
        stretch = np.moveaxis(1 + ropes.strain(np.moveaxis(tension, -1, 0)), 0, -1)
        last = f + (weight * free)[:, None] * UP
        end = end + rigid * last / np.linalg.norm(last, axis=-1)[..., None]
        return end + (along * (stretch / tension * dS)[..., None]).sum(-2) - span

    # First a taut cable with half its weight at each end, or an inextensible catenary (Jonkman's guess).
    theta, s, leaving = over_wheel(rig, span)
    flat, rise = np.hypot(span[..., 0], span[..., 1]), span[..., 2]
    chord = np.hypot(flat, rise)
    excess = (ropes.full / (r * theta + s)) ** 2 - 1
    bow = np.sqrt(np.maximum(3 * (rest**2 - rise**2) / np.maximum(flat, 1e-3 * chord) ** 2 - 3, 0.04))
    hung = span * (weight / (2 * bow))[..., None]
    hung[..., 2] = weight / 2 * (rise / np.tanh(bow) - rest)
    taut = (
        np.maximum(ropes.pulling(r * theta + s - ropes.full), 1e-2 * weight * rest)[..., None] * leaving
        - (weight * free / 2)[..., None] * UP
    )
    f = np.where((excess > 1e-4)[..., None], hung, taut)
    f = f if near is None else np.broadcast_to(near, f.shape)
    miss = missed(f)
    for _ in range(100):
        h = 1e-6 * np.linalg.norm(f, axis=-1)
        sides = [f + sign * h[..., None] * e for e in np.eye(3) for sign in (1, -1)]
        ends = missed(np.stack(sides))
        jacobian = np.moveaxis((ends[::2] - ends[1::2]) / (2 * h[..., None]), 0, -1)
        step = np.linalg.solve(jacobian, -miss[..., None])[..., 0]
        now = np.linalg.norm(miss, axis=-1)
        if (now < 1e-10 * rest).all():  # the last step, whose error is that of the differences
            f = f + step
            break
        scale = np.ones(now.shape)
        for _ in range(40):
            tried = missed(f + scale[..., None] * step)
            worse = ~(np.linalg.norm(tried, axis=-1) < now) & (now > 1e-13 * rest)
            if not worse.any():
                break
            scale = np.where(worse, scale / 2, scale)
        f, miss = f + scale[..., None] * step, tried
    else:
        raise AssertionError("the oracle found no cable that ends at its anchor")
    return f, f + (weight * free)[..., None] * UP


@dataclass(frozen=True, eq=False)
class Answer:
    """Balance at some poses: net wrench (..., 6); of each cable the rope's tension, length, pull, force at the exit."""

    wrench: np.ndarray
    tensions: np.ndarray
    lengths: np.ndarray
    pulls: np.ndarray
    at_exit: np.ndarray
    slack: np.ndarray
    leaves: np.ndarray


def balance(
    rig: Rig,
    position: np.ndarray,
    rotation: np.ndarray,
    ropes: Ropes,
    load: np.ndarray | float = 0.0,
    near: Answer | None = None,
) -> Answer:
    """Net force and torque about the platform's origin at poses (..., 3), (..., 3, 3), and what the cables do.

    ``near`` is the balance at a pose nearby, where shooting starts.
    """
    arms = np.asarray(rig.anchors) @ np.swapaxes(rotation, -1, -2)
    span = position[..., None, :] + arms - rig.exits
    some = np.asarray(rig.linear_density) > 0

    moves, start = exit_moves(rig, ropes, span), None if near is None else near.leaves[..., some, :]
    lengths, leaves = without_mass(rig, ropes, span - moves)
    pulls = -leaves
    if some.any():
        part = Ropes(rig.only(some), ropes.full[some], ropes.old.only(some), ropes.seconds)
        leaves[..., some, :], ends = hanging(part, span[..., some, :], start)
        pulls[..., some, :] = -ends
        lengths, _ = without_mass(rig, ropes, span - np.where(some[:, None], rig.exit_compliance * leaves, moves))
    at_exit = np.linalg.norm(leaves, axis=-1)
    tensions = np.linalg.norm(pulls, axis=-1) / rig.reeving
    weight = -rig.mass * rig.gravity * UP
    wrench = np.concatenate(
        [pulls.sum(-2) + weight, np.cross(arms, pulls).sum(-2) + np.cross(rotation @ rig.center_of_mass, weight)], -1
    )
    slack = lengths <= ropes.full
    own = rig.reeving * rig.linear_density * rig.gravity * ropes.rest
    slack &= rig.reeving * tensions <= np.maximum(own, 0.01 * rig.mass * rig.gravity)
    return Answer(wrench + load, tensions, lengths, pulls, at_exit, np.where(some, slack, tensions <= 0), leaves)


def without_mass(rig: Rig, ropes: Ropes, span: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(length, tension vector at the exit) of massless cables."""
    theta, s, leaving = over_wheel(rig, span)
    lengths = rig.pulley_radius * theta + s
    return lengths, ropes.pulling(lengths - ropes.full)[..., None] * leaving


def exit_moves(rig: Rig, ropes: Ropes, span: np.ndarray) -> np.ndarray:
    """How the frame gives way under massless cables, whose tension vectors that changes: Newton's method."""
    moves, h, size = np.zeros(span.shape), 1e-6 * np.linalg.norm(span, axis=-1).max(), np.abs(span).max()
    soft = np.where(np.asarray(rig.linear_density)[:, None] > 0, 0.0, rig.exit_compliance)
    asked = np.concatenate([np.zeros((1, 3)), h * np.eye(3), -h * np.eye(3)]).reshape(
        (7,) + (1,) * (span.ndim - 1) + (3,)
    )
    for _ in range(30 if soft.any() else 0):
        leaves = without_mass(rig, ropes, span - moves - asked)[1]
        slopes = np.moveaxis(leaves[1:4] - leaves[4:], 0, -1) / (2 * h)
        by_move = np.eye(3) - soft[..., None] * slopes
        step = np.linalg.solve(by_move, (soft * leaves[0] - moves)[..., None])[..., 0]
        moves = moves + step
        if np.abs(step).max() < 1e-15 * size:
            break
    else:
        assert not soft.any() or np.abs(step).max() < 1e-12 * size
    return moves


def turned(rotation: np.ndarray, by: np.ndarray) -> np.ndarray:
    """A rotation after a rotation vector in the base frame (Rodrigues)."""
    angle = np.linalg.norm(by, axis=-1)[..., None, None]
    k = np.cross(np.eye(3), by[..., None, :])
    a = np.where(angle > 0, np.sin(angle) / np.where(angle > 0, angle, 1), 1.0)
    b = np.where(angle > 0, 2 * (np.sin(angle / 2) / np.where(angle > 0, angle, 1)) ** 2, 0.5)
    return (np.eye(3) + a * k + b * k @ k) @ rotation


def stiffness(rig: Rig, position, rotation, ropes: Ropes, load=0.0, near: Answer | None = None, step=H) -> np.ndarray:
    """Minus the change of the net wrench with the pose on the free directions, rotations times ``size`` [N/m]."""
    units = np.repeat([1.0, rig.size], 3)
    h = step * float(np.abs(ropes.rest).mean())
    moves = np.array([sign * h * np.eye(6)[k] / units for k in rig.free for sign in (1, -1)])
    moved = balance(rig, position + moves[:, :3], turned(rotation, moves[:, 3:]), ropes, load, near).wrench / units
    return -((moved[::2] - moved[1::2]) / (2 * h))[:, list(rig.free)].T


def equilibrium(
    rig: Rig, position, rotation, ropes: Ropes, load=0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Answer]:
    """(position, rotation, stiffness, balance) of the equilibrium near a pose, by Newton's method."""
    units, free, EA = np.repeat([1.0, rig.size], 3), list(rig.free), float((rig.reeving * rig.axial_stiffness).max())
    position, rotation, at = np.array(position, float), np.array(rotation, float), None
    for _ in range(20):
        at = balance(rig, position, rotation, ropes, load, at)
        K = stiffness(rig, position, rotation, ropes, load, at)
        step = np.zeros(6)
        step[free] = np.linalg.solve(K, (at.wrench / units)[free]) / units[free]
        if np.abs(at.wrench / units)[free].max() < 1e-14 * EA or np.abs(step * units).max() < 1e-13 * rig.size:
            return position, rotation, K, at
        position, rotation = position + step[:3], turned(rotation, step[3:])
    raise AssertionError("the oracle found no equilibrium near this pose")


def mass_matrix(rig: Rig, rotation: np.ndarray) -> np.ndarray:
    """Of the platform about its origin on the free directions, rotations times ``size`` [kg]."""
    c, J = rotation @ rig.center_of_mass, rotation @ rig.inertia @ rotation.T
    cross = np.cross(np.eye(3), c)
    M = np.block([[rig.mass * np.eye(3), -rig.mass * cross], [rig.mass * cross, J - rig.mass * cross @ cross]])
    units = np.repeat([1.0, rig.size], 3)[list(rig.free)]
    return M[np.ix_(rig.free, rig.free)] / np.outer(units, units)


def shapes(rig: Rig, position: np.ndarray, rotation: np.ndarray, ropes: Ropes, points: int) -> np.ndarray:
    """Points of cables with mass, equally spaced on what is free of them without stretch; from the anchor backwards."""
    some = np.asarray(rig.linear_density) > 0
    there = balance(rig, position, rotation, ropes)
    part, weight = rig.only(some), (rig.reeving * rig.linear_density * rig.gravity)[some]
    piece = (ropes.rest - rig.wrapped)[some] / (points - 1)
    S = piece[:, None, None] * (np.arange(points - 1)[:, None] + NODES)
    along = there.leaves[some, None, None, :] + (weight[:, None, None] * S)[..., None] * UP
    T = np.linalg.norm(along, axis=-1)
    stretch = 1 + np.moveaxis(Ropes(part, ropes.full[some]).strain(np.moveaxis(T, 0, -1)), -1, 0)
    pieces = (along * (stretch / T * PARTS * piece[:, None, None])[..., None]).sum(-2)
    ends, pulls = position + part.anchors @ rotation.T, there.pulls[some]
    rope = ends + part.rigid_length[:, None] * pulls / np.linalg.norm(pulls, axis=1)[:, None]
    return np.concatenate([rope[:, None] - np.cumsum(pieces[:, ::-1], 1)[:, ::-1], ends[:, None]], 1)
