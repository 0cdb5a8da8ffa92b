"""Derivatives of the net wrench on the platform by the pose, the tensions and every parameter of the robot.

Sensitivities, identification, compensation and the search for saddles are built on them. A step of the pose is
(translation, left-applied rotation vector), as in ``forces``. All are exact for the present set of taut cables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import AXIS, BEHIND, RADIUS, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.any_cable import NODES, WEIGHTS, any_cables
from cdpr_sim.statics.forces import State, cross_matrix
from cdpr_sim.statics.profiles import TRACE

Array = np.ndarray

_EYE = np.eye(3)

SAGS = 0.1
"""Weight of a cable over its tension above which integrals along it are those of catenaries; below, Gauss's rule is
exact to rounding, and they would cancel."""

LENGTH_STEPS, LENGTH_ROUNDING = 50, 1e-14
"""Newton steps to the rest length of a given tension, and the relative step that ends them."""

PARAMETERS = ("rest_lengths", "axial_stiffness", "exits", "anchors", "mass", "center_of_mass", "external_wrench")
"""Parameters of every equilibrium, by the names of ``Robot`` and ``Problem``."""


def parameters(robot: Robot) -> tuple[str, ...]:
    """Parameters on which an equilibrium of ``robot`` depends; ``stiffening``: a2 and a3 of cable 1, of cable 2, ..."""
    cabling = robot.cabling
    further = {
        "pulley_radius": cabling.pulleys.any(), "winch_to_exit": robot.winch_to_exit.any(),
        "linear_density": not cabling.massless, "stiffening": not cabling.linear,
    }  # fmt: skip
    return *PARAMETERS, *(name for name, present in further.items() if present)


def wrench_slope(state: State) -> Float[Array, "*batch 6 6"]:
    """∂(net wrench)/∂(pose step) [N/m, N, N m], at any pose, in equilibrium or not.

    It is minus the stiffness matrix, except for one term: the Hessian in a rotation vector is symmetric, but the torque
    turns with the platform. With m the torque of cables and weight without the external wrench, the term is −½ [m]×
    in the rotations' block. It vanishes at an equilibrium without an external torque.
    """
    slope = -state.stiffness_matrix
    torque = state.net_wrench[..., 3:] - state.problem.external_wrench[..., 3:]
    slope[..., 3:, 3:] -= 0.5 * cross_matrix(torque)
    return slope


def wrench_under_tensions(state: State) -> tuple[Float[Array, "6 6"], Float[Array, "6 cables"]]:
    """∂(net wrench)/∂(pose step), and ∂(net wrench)/∂(tensions), where rest lengths follow the tensions.

    ``state`` is of a single pose. A cable with mass turns as its tension at the anchor changes.
    """
    robot, W = state.problem.robot, state.wrench_matrix
    if state.hanging is None:  # pulls keep their sizes
        arms, turning = state.geometry.arms, state.pull_sizes[:, None, None] * state.geometry.length_hessians
        D = np.empty((*arms.shape, 6))
        D[..., :3], D[..., 3:] = _EYE, -cross_matrix(arms)
        slope = -D.reshape(-1, 6).T @ (turning @ D).reshape(-1, 6)
        center = state.rotation @ robot.center_of_mass
        moments = state.pulls.T @ arms
        moments[2] -= state.problem.mass * robot.gravity * center
        slope[3:, 3:] += moments.T - moments.trace() * _EYE
        return slope, W
    taut, by_length = state.tensions > 0, pull_by_parameter(state)["rest_lengths"][..., 0]
    along = (state.pull_directions * by_length).sum(-1) / robot.reeving
    pulls = by_length / np.where(taut, along, 1.0)[:, None]
    by_tension = np.where(taut, np.hstack([pulls, np.cross(state.geometry.arms, pulls)]).T, W)
    return wrench_slope(state) - (by_tension * taut) @ tension_by_pose(state), by_tension


def wrench_by_parameter(state: State, names: Sequence[str] = ()) -> dict[str, Float[Array, "*batch 6 parameters"]]:
    """∂(net wrench)/∂(parameter) at a fixed pose, or at many, for each of ``names``.

    By default for each of ``parameters``. Exits and anchors are in the order x, y, z of cable 1, x, y, z of cable 2,
    and so on.
    """
    robot, rotation, arms = state.problem.robot, state.rotation, state.geometry.arms
    center = rotation @ robot.center_of_mass
    weight, mass = np.array([0.0, 0.0, -robot.gravity]), np.asarray(state.problem.mass)[..., None, None]
    turned = -mass * cross_matrix(weight) @ rotation
    found = {
        "mass": np.concatenate([np.broadcast_to(weight, center.shape), np.cross(center, weight)], axis=-1)[..., None],
        "center_of_mass": np.concatenate([np.zeros(turned.shape), turned], axis=-2),
        "external_wrench": np.zeros((*center.shape[:-1], 6, 6)) + np.eye(6),
    }
    wanted = names or parameters(robot)
    for name, by in pull_by_parameter(state).items():
        if name not in wanted:
            continue
        torque = cross_matrix(arms) @ by
        if name == "anchors":  # which are the pulls' levers, too
            torque = torque - cross_matrix(state.pulls) @ rotation[..., None, :, :]
        both = np.swapaxes(np.concatenate([by, torque], axis=-2), -3, -2)
        found[name] = both.reshape(*both.shape[:-2], -1)
    return {name: by for name, by in found.items() if name in wanted}


def tension_by_parameter(
    state: State, names: Sequence[str] = ()
) -> dict[str, Float[Array, "*batch cables parameters"]]:
    """∂(tensions)/∂(parameter) at a fixed pose, or at many, for each of ``names``; by default of ``parameters``."""
    robot, directions = state.problem.robot, state.pull_directions
    shape, wanted = state.tensions.shape, names or parameters(robot)
    found = {
        "mass": np.zeros((*shape, 1)), "center_of_mass": np.zeros((*shape, 3)), "external_wrench": np.zeros((*shape, 6))
    }  # fmt: skip
    for name, by in pull_by_parameter(state).items():
        if name not in wanted:
            continue
        along = (directions[..., None, :] @ by)[..., 0, :]
        if name == "linear_density":  # which pulls in a slack massless cable as well
            along = np.where((state.tensions > 0)[..., None], along, np.linalg.norm(by, axis=-2))
        along = along / robot.reeving[:, None]
        found[name] = (np.eye(robot.cables)[..., None] * along[..., :, None, :]).reshape(*shape, -1)
    return {name: by for name, by in found.items() if name in wanted}


def along_changes(
    state: State, changes: Mapping[str, Float[Array, "*#batch parameters variables"]]
) -> tuple[Float[Array, "*batch 6 variables"], Float[Array, "*batch cables variables"]]:
    """∂(net wrench)/∂(variable) and ∂(tensions)/∂(variable) at a fixed pose, or at many.

    Args:
        state: the forces there.
        changes: ∂(parameter)/∂(variable), by the parameters' names; one or more.
    """
    found = []
    for by in (wrench_by_parameter(state, [*changes]), tension_by_parameter(state, [*changes])):
        # Where the changes are the same at all poses, one product of matrices for all of them is faster.
        products = (
            by[name] @ change if change.ndim > 2 else np.tensordot(by[name], change, 1)
            for name, change in changes.items()
        )
        found.append(sum(products))
    return found[0], found[1]


def tension_by_pose(state: State) -> Float[Array, "*batch cables 6"]:
    """∂(tensions)/∂(pose step): minus the pull's change along itself with the anchor's step, 1 and −[r]×."""
    along = (state.pull_directions[..., None, :] @ state.cable_stiffness)[..., 0, :]
    along = along / state.problem.robot.reeving[:, None]
    return -np.concatenate([along, np.cross(state.geometry.arms, along)], axis=-1)


def pull_by_parameter(state: State) -> dict[str, Float[Array, "*batch cables 3 parameters"]]:
    """∂(pull)/∂(parameter) of each cable on its anchor at a fixed pose, by its own parameters.

    The law is a function of the strain n (l − l0)/(n l0 + g), so that the changes dl0 of the rest length and dg of the
    rope between winch and exit act like the change −(1 + eps) dl0 − eps dg/n of the length.
    """
    robot = state.problem.robot
    found = {"exits": state.cable_stiffness, "anchors": -state.cable_stiffness @ state.rotation[..., None, :, :]}
    table, rest_lengths = robot.cable_table(state.problem.axial_stiffness), state.problem.rest_lengths
    by = _pull_slopes(table, rest_lengths, state.pulls, state.cable_stiffness)
    if (robot.cabling.pulleys & (robot.linear_density > 0)).any():
        by[..., 2] += by[..., 7] * _wrapped_by_radius(robot)[:, None]
    n, idle = robot.reeving[:, None, None], state.tensions == 0
    if idle.any() and not robot.cabling.massless:  # by its weight's last trace
        light = TRACE * table[..., STIFFNESS] / rest_lengths
        table = np.array(np.broadcast_to(table, (*light.shape, table.shape[-1])))
        table[..., WEIGHT] = light
        chords = state.position[..., None, :] + state.geometry.arms - robot.exits
        by[idle, :, 4] = (any_cables(table, chords, rest_lengths).pull / light[..., None])[idle]
    return found | {
        "rest_lengths": by[..., :1], "axial_stiffness": n * by[..., 1:2], "pulley_radius": by[..., 2:3],
        "winch_to_exit": by[..., 3:4] / n, "linear_density": n * robot.gravity * by[..., 4:5],
        "stiffening": by[..., 5:7],
    }  # fmt: skip


def _pull_slopes(
    table: Float[np.ndarray, "*#batch columns"],
    rest_lengths: Float[np.ndarray, "*#batch"],
    pulls: Float[np.ndarray, "*batch 3"],
    stiffness: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 3 8"]:
    """Derivatives of cables' pulls at fixed ends, of all parts of line together; formulas in ``any_cable``.

    By rest length, axial stiffness, wheel radius, length behind the exit, weight per length, a2, a3 and the length that
    counts as wrapped, which the others hold fixed. With t_B = t + w L up the tension vector at the anchor, the pull is
    −t_B, and t changes by −K ∂(∂Psi/∂t)/∂q at fixed t.

    Args:
        table: rows of ``Robot.cable_table``.
        rest_lengths: [m].
        pulls: forces on the anchors [N].
        stiffness: −∂pull/∂anchor [N/m].
    """
    law, r, w = cable_law.of_table(table), table[..., RADIUS], table[..., WEIGHT]
    axis, L, up = table[..., AXIS : AXIS + 3], rest_lengths - table[..., WRAPPED], np.array([0.0, 0.0, 1.0])

    def along(v):
        """(tension, unit vector, strain, slope of strain) under the tension vector v."""
        T = np.linalg.norm(v, axis=-1)
        strain = cable_law.strain_at(T, law)
        slope, _ = cable_law.tangent(strain, 1.0, law)
        return T, v / np.where(T > 0, T, 1.0)[..., None], strain, 1 / slope

    def by_law(T, u, strain, slope):
        """Of the stretch along u by EA, a2 and a3."""
        EA, _, _ = law
        by = [T / EA, EA * strain**2, EA * strain**3]
        return np.stack([(-slope * one)[..., None] * u for one in by], axis=-1)

    t = -pulls - (w * L)[..., None] * up
    T, u, strain, slope = along(t)
    end = np.linalg.norm(pulls, axis=-1)
    stretched = (table[..., WRAPPED] + table[..., BEHIND])[..., None, None] * by_law(T, u, strain, slope)
    # Where a cable sags, the line that touches the law at the exit, 1 + eps = mu + slope T, has a closed integral, and
    # Gauss's rule sums what is left; a cable that does not is left to Gauss's rule.
    sags = w * L > SAGS * T
    mu = np.where(sags, 1 + strain - T * slope, 0.0)
    line = np.where(sags, slope, 0.0)
    by_weight = _turned_by_weight(t, T, np.where(sags, end, 1.0), L, np.where(sags, w, 1.0))
    by_weight = mu[..., None] * by_weight + (line * L * L / 2)[..., None] * up
    # Where no cable has mass, tension is the same along it, and one node does.
    nodes, parts = (NODES, WEIGHTS) if w.any() else ([0.5], [1.0])
    for node, part in zip(nodes, parts, strict=True):
        there, v, e, k = along(t + (node * w * L)[..., None] * up)
        stretched = stretched + (part * L)[..., None, None] * by_law(there, v, e, k)
        across = ((1 + e - mu - there * line) / np.where(there > 0, there, 1.0))[..., None] * (up - v[..., 2:] * v)
        by_weight = by_weight + (part * node * L * L)[..., None] * ((k - line)[..., None] * v[..., 2:] * v + across)
    cosine = (u * axis).sum(-1)[..., None]
    n = u - cosine * axis
    sine = np.linalg.norm(n, axis=-1, keepdims=True)
    radius = (1 - cosine) * n / np.where(sine > 0, sine, 1.0) + sine * axis - np.arctan2(sine, cosine) * u
    by = [stretched[..., 0], radius * (r > 0)[..., None], strain[..., None] * u, by_weight]
    _, last, strain_there, _ = along(-pulls)
    wrapped = (1 + strain)[..., None] * u - (1 + strain_there)[..., None] * last  # massless length in place of the last
    turned = stiffness @ np.stack([*np.broadcast_arrays(*by), stretched[..., 1], stretched[..., 2], wrapped], axis=-1)
    turned[..., 2, 3] -= L
    turned[..., 2, 6] += w
    return np.concatenate([_pulls_by_length(table, pulls, stiffness)[..., None], turned], axis=-1)


def _wrapped_by_radius(robot: Robot) -> Float[np.ndarray, " cables"]:
    """∂(wrapped length)/∂(radius of the wheel) of each cable, at its path in the middle of the workspace.

    With d from the wheel's centre to the anchor, s² = d² − r², and z, rho along and across the axis: the wrapped angle
    is atan2(z, r − rho) − atan2(s, r).
    """
    span, r = robot.home + robot.anchors - robot.exits, robot.pulley_radius
    z = (span * robot.pulley_axis).sum(-1)
    rho = np.linalg.norm(span - z[:, None] * robot.pulley_axis, axis=-1)
    d2 = (rho - r) ** 2 + z**2
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.sqrt(d2 - r**2)
        by_radius = robot.wrapped_lengths / r + r * (s + r * rho / s - z) / d2
    return np.where((r > 0) & (robot.wrapped_lengths > 0), by_radius, 0.0)


def _pulls_by_length(
    table: Float[np.ndarray, "*#batch columns"],
    pulls: Float[np.ndarray, "*batch 3"],
    stiffness: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 3"]:
    """The first of ``_pull_slopes``: the last piece of cable at the anchor, stretched by its tension, is more."""
    size = np.linalg.norm(pulls, axis=-1)
    unstretched = cable_law.rest_length_for(1.0, size, cable_law.of_table(table))
    piece = -pulls / (np.where(size > 0, size, 1.0) * unstretched)[..., None]
    by_length = (stiffness @ piece[..., None])[..., 0]
    by_length[..., 2] -= table[..., WEIGHT]
    return by_length


def _turned_by_weight(
    t: Float[np.ndarray, "*batch 3"],
    T: Float[np.ndarray, "*batch"],
    end: Float[np.ndarray, "*batch"],
    L: Float[np.ndarray, "*batch"],
    w: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch 3"]:
    """d/dw of the span of an inextensible cable without its wheel, at the fixed tension vector t where it begins."""
    H, top = np.hypot(t[..., 0], t[..., 1]), t[..., 2] + w * L
    level = np.where(H > 0, H, 1.0)
    turned = np.arcsinh(top / level) - np.arcsinh(t[..., 2] / level)
    sideways = t[..., :2] * ((L / end - turned / w) / w)[..., None]
    return np.concatenate([sideways, ((L * top / end - (end - T) / w) / w)[..., None]], axis=-1)


def rest_lengths_under(
    robot: Robot, chords: Float[np.ndarray, "*batch cables 3"], tensions: Float[np.ndarray, "*batch cables"]
) -> Float[np.ndarray, "*batch cables"]:
    """Rest lengths with which cables have these tensions at their anchors [m]; nan below what their weight alone gives.

    Tension falls as the rest length grows, and is convex: Newton's method from the massless length, which is too short.
    Where a cable sags so much that tension rises with more length, there is no smaller one.

    Args:
        robot: of these cables.
        chords: from exits to anchors, base frame, (..., cables, 3) [m].
        tensions: of the ropes, (..., cables) [N].
    """
    cabling, table = robot.cabling, robot.cable_table()
    rest = cable_law.rest_length_for(
        cable_path.paths(cabling, -chords)[0], tensions, cabling.law, behind=cabling.behind
    )
    rest = np.where(rest > 0, rest, np.nan)
    pulls = cabling.reeving * tensions
    done = np.zeros(rest.shape, bool)
    idle = (tensions == 0) & (robot.cable_weights == 0)  # its length is its rest length
    for _ in range(LENGTH_STEPS):
        found = any_cables(table, chords, rest)
        by_length = _pulls_by_length(table, found.pull, found.stiffness)
        beyond = found.anchor_tension - pulls
        with np.errstate(all="ignore"):
            slope = (found.pull * by_length).sum(-1) / found.anchor_tension
            step = np.where((beyond == 0) | (tensions == 0), 0.0, beyond / slope)
            rest = np.where((slope < 0) | idle, rest - step, np.nan)
            done = np.abs(step) <= LENGTH_ROUNDING * rest
        if (done | np.isnan(rest)).all():
            break
    return np.where(done, rest, np.nan)
