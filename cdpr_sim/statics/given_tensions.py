"""Rest lengths under given tensions at a pose, of cables with any properties."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.any_cable import any_cables
from cdpr_sim.statics.derivatives import rest_lengths_under


def cut(
    robot: Robot,
    position: Float[np.ndarray, "*batch 3"],
    rotation: Float[np.ndarray, "*batch 3 3"],
    tensions: Float[np.ndarray, "*batch cables"],
    *,
    refuse: bool = True,
    field: str = "tensions",
) -> tuple[Float[np.ndarray, "*batch cables"], Float[np.ndarray, "*batch 6 cables"]]:
    """Rest lengths with which the ropes have these tensions at their anchors [m]; and the wrench matrix then.

    At a pose, or at many, each with its own tensions.

    A cable with mass pulls along its own end, whose direction depends on its tension.

    Without ``refuse``, rest lengths that do not exist are nan or too short. Messages begin with ``field``.

    Raises:
        InvalidInput: a tension below that which the cable's weight alone gives, or with which the rope between winch
            and exit stretches by more than the length of the cable.
    """
    cables = forces.geometry(robot, position, rotation)
    if robot.cabling.springs:
        rest = cable_law.rest_length_for(cables.lengths, tensions, robot.cabling.law, behind=robot.cabling.added)
        matrix = cables.wrench_matrix
    else:
        chords = position[..., None, :] + cables.arms - robot.exits
        rest = rest_lengths_under(robot, chords, tensions)
        pulls = any_cables(robot.cable_table(), chords, rest).pull
        sizes = np.linalg.norm(pulls, axis=-1, keepdims=True)  # without the rounding of rest lengths of stiff cables
        pulling = (tensions > 0)[..., None]  # of a massless cable without tension, the direction of its path
        directions = np.where(pulling, pulls / np.where(sizes > 0, sizes, 1.0), cables.directions)
        wrenches = np.concatenate([directions, np.cross(cables.arms, directions)], axis=-1)
        matrix = robot.cabling.pulls(np.swapaxes(wrenches, -1, -2))
    exists = rest > robot.cabling.least_lengths  # not if it is nan
    if refuse and not exists.all():
        row = np.unravel_index(np.argmin(exists), rest.shape)
        cable = int(row[-1])
        length, tension, stretched = cables.lengths[row], tensions[row], robot.cabling.added[cable]
        strain = cable_law.strain_at(tension, tuple(one[cable] for one in robot.cabling.law))
        if stretched * strain >= length:
            raise InvalidInput(
                f"{field}: found {tension:.4g} N in cable {cable + 1}, under which the rope between winch and "
                f"exit stretches by more than the {length:.4g} m from exit to anchor, expected a smaller one"
            )
        weight = robot.cable_weights[cable] * robot.cabling.ropes(cables.lengths)[row]
        raise InvalidInput(
            f"{field}: found {tension:.4g} N in cable {cable + 1}, which weighs {weight:.4g} N, expected at least what "
            "its weight alone gives"
        )
    return rest, matrix
