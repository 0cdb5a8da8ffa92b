"""Derivatives of the net wrench on the platform by the pose, the tensions and every parameter of the robot.

Sensitivities, identification, compensation and the search for saddles are built on them. A step of the pose is
(translation, left-applied rotation vector), as in ``forces``. All are for the present set of taut cables. By properties
of the cables they are differences of the law in ``forces``, by the steps that ``core.cable`` declares.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import PROPERTIES, RIGID, WEIGHT
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.property import Step
from cdpr_sim.core.robot import Robot, beside
from cdpr_sim.statics import forces
from cdpr_sim.statics.any_cable import any_cables
from cdpr_sim.statics.forces import State, cross_matrix

Array = np.ndarray

_EYE = np.eye(3)

NEUTRAL = 1e-12
"""Below this fraction of the largest singular value of a slope, a direction is neutrally stable within rounding."""

LENGTH_STEPS, LENGTH_ROUNDING = 50, 1e-14
"""Newton steps to the rest length of a given tension, and the relative step that ends them."""

PARAMETERS = ("rest_lengths", "axial_stiffness", "exits", "anchors", "mass", "center_of_mass", "external_wrench")
"""Parameters of every equilibrium, by the names of ``Robot`` and ``Problem``."""


WRAPPED = Step(lambda robot, strain, length: length)
"""``Robot.wrapped_lengths``, which follow exits and anchors."""

STEP = 1e-3
"""Step of differences over the scale. Those of fourth order then miss 1e-12 of a derivative by curvature, and 1e-9 by
rounding of the length of a cable that is strained by 1e-4: ``test_derivatives.py`` finds the order of Taylor's
series."""

CENTRAL, FORWARD = (1 / 12, -2 / 3, 0.0, 2 / 3, -1 / 12), (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
"""Weights of differences at -2 to 2 steps; and at 0 to 4."""


def parameters(robot: Robot) -> tuple[str, ...]:
    """Parameters on which an equilibrium of ``robot`` depends; ``stiffening``: a2 and a3 of cable 1, of cable 2, ..."""
    own = (name for name, one in PROPERTIES.items() if one.step and robot.cabling.has(name).any())
    return tuple(dict.fromkeys([*PARAMETERS, *own]))


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
    taut, by_length = state.tensions > 0, pull_by_parameter(state, ["rest_lengths"])["rest_lengths"][..., 0]
    along = robot.cabling.tensions((state.pull_directions * by_length).sum(-1))
    pulls = by_length / np.where(taut, along, 1.0)[:, None]
    by_tension = np.where(taut, np.hstack([pulls, np.cross(state.geometry.arms, pulls)]).T, W)
    return wrench_slope(state) - (by_tension * taut) @ tension_by_pose(state), by_tension


def by_parameter(
    state: State, names: Collection[str]
) -> dict[str, tuple[Float[Array, "*batch 6 parameters"], Float[Array, "*batch cables parameters"]]]:
    """∂(net wrench)/∂(parameter) and ∂(tensions)/∂(parameter) at a fixed pose, or at many, for each of ``names``.

    Exits and anchors are in the order x, y, z of cable 1, x, y, z of cable 2, and so on.
    """
    robot, rotation, arms = state.problem.robot, state.rotation, state.geometry.arms
    center = rotation @ robot.center_of_mass
    weight, mass = np.array([0.0, 0.0, -robot.gravity]), np.asarray(state.problem.mass)[..., None, None]
    turned = -mass * cross_matrix(weight) @ rotation
    loads = {
        "mass": np.concatenate([np.broadcast_to(weight, center.shape), np.cross(center, weight)], axis=-1)[..., None],
        "center_of_mass": np.concatenate([np.zeros(turned.shape), turned], axis=-2),
        "external_wrench": np.zeros((*center.shape[:-1], 6, 6)) + np.eye(6),
    }
    shape = state.tensions.shape
    found = {name: (by, np.zeros((*shape, by.shape[-1]))) for name, by in loads.items() if name in names}
    for name, by in pull_by_parameter(state, names).items():
        torque = cross_matrix(arms) @ by
        if name == "anchors":  # which are the pulls' levers, too
            torque = torque - cross_matrix(state.pulls) @ rotation[..., None, :, :]
        both = np.swapaxes(np.concatenate([by, torque], axis=-2), -3, -2)
        along = (state.pull_directions[..., None, :] @ by)[..., 0, :]
        # A weight pulls in a slack massless cable as well, and nothing else does.
        along = np.where((state.tensions > 0)[..., None], along, np.linalg.norm(by, axis=-2))
        along = robot.cabling.tensions(along.swapaxes(-1, -2)).swapaxes(-1, -2)
        each = np.eye(robot.cables)[..., None] * along[..., :, None, :]
        found[name] = both.reshape(*both.shape[:-2], -1), each.reshape(*shape, -1)
    return found


def of_equilibria(
    state: State,
    wrench: Float[Array, "*batch 6 variables"],
    tensions: Float[Array, "*batch cables variables"],
) -> tuple[Float[Array, "*batch 6 variables"], Float[Array, "*batch cables variables"]]:
    """Derivatives of equilibria: of (translation [m], left-applied rotation vector [rad]) and of the tensions [N].

    By the implicit function theorem, with F(x, theta) = 0 the net wrench at the equilibrium x:
    dx/dtheta = -(dF/dx)^-1 dF/dtheta. Where nothing holds the platform, the least of all derivatives.

    Args:
        state: the forces in equilibrium.
        wrench: dF/dtheta at a fixed pose.
        tensions: derivatives of the tensions at a fixed pose.
    """
    free = state.problem.robot.free
    slope = wrench_slope(state)[..., free, :][..., free]
    pose = np.zeros(wrench.shape)
    pose[..., free, :] = -np.linalg.pinv(slope, rcond=NEUTRAL) @ wrench[..., free, :]
    return pose, tensions + tension_by_pose(state) @ pose


def along_changes(
    state: State, changes: Mapping[str, Float[Array, "*#batch parameters variables"]]
) -> tuple[Float[Array, "*batch 6 variables"], Float[Array, "*batch cables variables"]]:
    """∂(net wrench)/∂(variable) and ∂(tensions)/∂(variable) at a fixed pose, or at many.

    Args:
        state: the forces there.
        changes: ∂(parameter)/∂(variable), by the parameters' names; one or more.
    """
    by, found = by_parameter(state, changes), []
    for kind in (0, 1):
        # Where the changes are the same at all poses, one product of matrices for all of them is faster.
        products = (
            by[name][kind] @ change if change.ndim > 2 else np.tensordot(by[name][kind], change, 1)
            for name, change in changes.items()
        )
        found.append(sum(products))
    return found[0], found[1]


def tension_by_pose(state: State) -> Float[Array, "*batch cables 6"]:
    """∂(tensions)/∂(pose step): minus the pull's change along itself with the anchor's step, 1 and −[r]×."""
    along = (state.pull_directions[..., None, :] @ state.cable_stiffness)[..., 0, :]
    along = state.problem.robot.cabling.tensions(along.swapaxes(-1, -2)).swapaxes(-1, -2)
    return -np.concatenate([along, np.cross(state.geometry.arms, along)], axis=-1)


def pull_by_parameter(state: State, names: Collection[str]) -> dict[str, Float[Array, "*batch cables 3 parameters"]]:
    """∂(pull)/∂(parameter) of each cable on its anchor at a fixed pose, by its own parameters, for each of ``names``.

    By exits, anchors and rest lengths from the cables' stiffness; by the others by differences. Of a cable with mass,
    the length that lies on its wheel in the middle of the workspace follows the exit and the anchor.
    """
    robot, stiffness = state.problem.robot, state.cable_stiffness
    table = robot.cable_table(state.problem.axial_stiffness)
    by_exits, by_anchors = stiffness, -stiffness @ state.rotation[..., None, :, :]
    if {"exits", "anchors"} & {*names} and (robot.cabling.pulleys & robot.cabling.with_mass).any():
        wrapped = _differences(state, "wrapped_lengths", WRAPPED)
        wrapped = wrapped @ _wrapped_by_exit(robot)[:, None]
        by_exits, by_anchors = by_exits + wrapped, by_anchors - wrapped
    found = {"exits": by_exits, "anchors": by_anchors}
    found["rest_lengths"] = _pulls_by_length(table, state.pulls, stiffness)[..., None]
    for name in names:
        if name in PROPERTIES and (step := PROPERTIES[name].step):
            found[name] = _differences(state, name, step)
    return {name: by for name, by in found.items() if name in names}


def _differences(state: State, name: str, kind: Step) -> Float[Array, "*batch cables 3 numbers"]:
    """∂(pull)/∂(property) of each cable by differences of its law: all cables at once, as each has its own."""
    problem, robot = state.problem, state.problem.robot
    batch = tuple(range(state.tensions.ndim - 1))
    strain = state.tensions / problem.axial_stiffness
    strain = np.where(state.lengths > problem.rest_lengths, strain, 0.0).max(batch)
    length = np.broadcast_to(problem.rest_lengths, state.tensions.shape).mean(batch)
    value = np.asarray(problem.axial_stiffness if name == "axial_stiffness" else getattr(robot, name), dtype=float)
    scales = kind.scale(robot, strain, length)
    steps = STEP * scales.reshape(robot.cables, -1)
    from_zero = value.reshape(steps.shape) < 2 * steps if kind.least else np.zeros(steps.shape, dtype=bool)
    if batch and from_zero.any():  # of a cable without mass, the step depends on the strain of each state
        found = np.empty((*state.pulls.shape, steps.shape[1]))
        for row in np.ndindex(found.shape[: len(batch)]):
            own = problem[row] if isinstance(problem, Problems) else problem
            found[row] = _differences(forces.at(own, state.position[row], state.rotation[row]), name, kind)
        return found
    found = np.zeros((*state.pulls.shape, steps.shape[1]))
    for number, (step, forward) in enumerate(zip(steps.T, from_zero.T, strict=True)):
        for place in range(len(CENTRAL)):
            weights = np.where(forward, FORWARD[place], CENTRAL[place]) if kind.least else CENTRAL[place]
            if np.any(weights):
                change = np.zeros(steps.shape)
                change[:, number] = step * (np.where(forward, place, place - 2) if kind.least else place - 2)
                pulls = _pulls_beside(state, name, value + change.reshape(scales.shape), kind.path)
                found[..., number] += (weights / np.where(step > 0, step, np.inf))[:, None] * pulls
    return found


def _pulls_beside(state: State, name: str, value: Array, path: bool) -> Float[Array, "*batch cables 3"]:
    """Pulls with another value of a property, which is not checked.

    Where the path's length changes, the rest length changes as much, and the effect of that is subtracted.
    """
    problem, at = state.problem, (state.position, state.rotation)
    if name == "axial_stiffness" and isinstance(problem, Problems):
        return forces.at(dataclasses.replace(problem, axial_stiffness=value), *at).pulls
    other = dataclasses.replace(problem, robot=beside(problem.robot, name, value))
    if not path:
        return forces.at(other, *at).pulls
    longer = forces.geometry(other.robot, *at).lengths - forces.geometry(problem.robot, *at).lengths
    other = dataclasses.replace(other, rest_lengths=problem.rest_lengths + longer)
    table = problem.robot.cable_table(problem.axial_stiffness)
    return forces.at(other, *at).pulls - longer[..., None] * _pulls_by_length(table, state.pulls, state.cable_stiffness)


def _wrapped_by_exit(robot: Robot) -> Float[np.ndarray, "cables 3"]:
    """∂(wrapped length)/∂(exit) by central differences, at each cable's path in the middle of the workspace."""
    chords = robot.exits - robot.home - robot.anchors
    steps = STEP**2 * np.linalg.norm(chords, axis=1)[:, None, None] * np.eye(3)
    up, down = (
        cable_path.wrapped_lengths(robot.cabling, np.moveaxis(chords[:, None] + sign * steps, 1, 0)) for sign in (1, -1)
    )
    return np.moveaxis(up - down, 0, -1) / (2 * steps.diagonal(axis1=1, axis2=2))


def _pulls_by_length(
    table: Float[np.ndarray, "*#batch columns"],
    pulls: Float[np.ndarray, "*batch 3"],
    stiffness: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch 3"]:
    """∂(pull)/∂(rest length): the last piece of rope, stretched by its tension, is more.

    By its weight, what is rigid behind it turns.

    Args:
        table: rows of ``Robot.cable_table``.
        pulls: forces on the anchors [N].
        stiffness: −∂pull/∂anchor [N/m].
    """
    size = np.linalg.norm(pulls, axis=-1)
    unstretched = cable_law.rest_length_for(1.0, size, cable_law.of_table(table))
    along = -pulls / np.where(size > 0, size, 1.0)[..., None]
    piece = along / unstretched[..., None]
    turned = table[..., RIGID] * table[..., WEIGHT] / np.where(size > 0, size, np.inf)
    piece = piece + turned[..., None] * (np.array([0.0, 0.0, 1.0]) - along[..., 2:] * along)
    by_length = (stiffness @ piece[..., None])[..., 0]
    by_length[..., 2] -= table[..., WEIGHT]
    return by_length


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
    pulls = cabling.pulls(tensions)
    lengths = cable_path.paths(cabling, cable_path.exit_moves(cabling, -chords, pulls) - chords)[0]
    rest = cable_law.rest_length_for(lengths, tensions, cabling.law, behind=cabling.added)
    rest = np.where(rest > cabling.least_lengths, rest, np.nan)
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
