"""Do the two methods agree? The differences, the cross residuals, and a verdict with its reasons."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import positive, refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import angle_between
from cdpr_sim.physics.settle import residual_of
from cdpr_sim.statics import forces

POSITION_TOLERANCE = 1e-6
"""[m] A thousandth of a millimetre. DemoBot's settled poses are 1e-9 m from the solver's at most
(``scripts/measure_constants.py``), where a residual of 1e-9 of the weight meets the softest stiffness (a few N/m)."""

ROTATION_TOLERANCE = 1e-5
"""[rad]"""

TENSION_TOLERANCE = 1e-3
"""[N]"""

CROSS_TOLERANCE = 1e-5
"""Largest unbalanced force that either method may find at the other's pose, as a fraction of the load (without load, of
``Problem.force_scale``). MuJoCo calls a platform at rest at 1e-6; a model that is wrong by 1 % in one taut cable leaves
8e-5 or more (``scripts/measure_constants.py``)."""

REST_LENGTH_TOLERANCE = 1e-7
"""[m] A cable this close to its rest length counts as taut or as slack, whichever the other method says."""


LEVEL = 1e-8
"""Energies between two equilibria of one family differ by less than this fraction of load times characteristic length:
less than lifting DemoBot's platform by a nanometre."""


class Verdict(enum.Enum):
    """What comparing the two methods came to."""

    AGREE = "the two methods agree"
    AGREE_BUT_FREE = "the two methods agree in all that the cables hold, and differ where nothing holds the platform"
    DIFFERENT_EQUILIBRIA = "the two methods rest at different equilibria, each of which the other confirms"
    DISAGREE = "the two methods disagree"


@dataclass(frozen=True)
class Agreement(HtmlRepr):
    """Static and physical equilibrium of one problem, side by side.

    Attributes:
        verdict: what the comparison came to.
        reasons: what the verdict rests on, a sentence each; empty when they simply agree.
        position_error: distance between the platform's origins [m].
        rotation_error: angle between the platforms [rad].
        tension_error: largest difference in a cable [N].
        same_slack: whether the same cables are slack; one within 1e-7 m of its rest length counts as either.
        static_in_mujoco: unbalanced force that MuJoCo finds at the static pose [N].
        settled_in_statics: unbalanced force that statics finds at the settled pose [N].
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    position_error: float
    rotation_error: float
    tension_error: float
    same_slack: bool
    static_in_mujoco: float
    settled_in_statics: float

    @property
    def agrees(self) -> bool:
        """Whether the two methods agree."""
        return self.verdict in (Verdict.AGREE, Verdict.AGREE_BUT_FREE)

    def __repr__(self) -> str:
        return (
            f"<Agreement: {self.verdict.value}: {1e3 * self.position_error:.1e} mm, "
            f"{np.degrees(self.rotation_error):.1e}° and {self.tension_error:.1e} N apart, "
            f"{'the same' if self.same_slack else 'other'} cables slack>"
        )


def compare(
    static: Equilibrium,
    settled: Equilibrium,
    *,
    position_tolerance: float = POSITION_TOLERANCE,
    rotation_tolerance: float = ROTATION_TOLERANCE,
    tension_tolerance: float = TENSION_TOLERANCE,
) -> Agreement:
    """Compare an equilibrium found by statics with one that MuJoCo settled at.

    Args:
        static: from ``solve``.
        settled: from ``settle``, of the same robot, rest lengths and load.
        position_tolerance: [m].
        rotation_tolerance: [rad].
        tension_tolerance: [N].

    Returns:
        The verdict with its reasons, and how far the two are apart [m, rad, N].

    Raises:
        InvalidInput: the two answer different problems, or a tolerance that is not above 0.
    """
    refuse_unless(Equilibrium, static=static, settled=settled)
    position_tolerance = positive("position_tolerance", position_tolerance, "m")
    rotation_tolerance = positive("rotation_tolerance", rotation_tolerance, "rad")
    tension_tolerance = positive("tension_tolerance", tension_tolerance, "N")
    problem = static.problem
    if not problem.same_as(settled.problem):
        raise InvalidInput("compare: found equilibria of two problems, expected the same robot, rest lengths and load")
    differences = {
        "position": (np.linalg.norm(static.position - settled.position), position_tolerance, "m"),
        "rotation": (angle_between(static.rotation_matrix, settled.rotation_matrix), rotation_tolerance, "rad"),
        "tension": (np.abs(static.tensions - settled.tensions).max(), tension_tolerance, "N"),
    }
    cross = {
        "MuJoCo at the static pose": residual_of(problem, static.at),
        "statics at the settled pose": float(forces.at(problem, settled.position, settled.rotation_matrix).residual),
    }
    slack_differs = (static.slack != settled.slack) & ~(_at_rest_length(static) | _at_rest_length(settled))

    apart = [
        f"{name} differs by {error:.1e} {unit} (tolerance {tolerance:.0e})"
        for name, (error, tolerance, unit) in differences.items()
        if not error <= tolerance
    ]
    if slack_differs.any():
        cables = ", ".join(str(i + 1) for i in np.flatnonzero(slack_differs))
        apart.append(f"cable {cables} is slack on one method only")
    unbalanced = [
        f"{where} finds {force:.1e} N unbalanced (tolerance {CROSS_TOLERANCE * problem.force_scale:.0e})"
        for where, force in cross.items()
        if not force <= CROSS_TOLERANCE * problem.force_scale
    ]
    if unbalanced:
        verdict = Verdict.DISAGREE
    elif not apart:
        verdict = Verdict.AGREE
    elif not slack_differs.any() and differences["tension"][0] <= tension_tolerance and _connected(static, settled):
        verdict = Verdict.AGREE_BUT_FREE
        apart.append("the energy is level in between: the platform moves freely from the one pose to the other")
    else:
        verdict = Verdict.DIFFERENT_EQUILIBRIA
        apart += [
            f"the equilibrium by {one.source} is {one.stability.name.lower()}"
            for one in (static, settled)
            if not one.stable
        ]
    return Agreement(
        verdict=verdict,
        reasons=tuple(unbalanced + apart),
        position_error=float(differences["position"][0]),
        rotation_error=float(differences["rotation"][0]),
        tension_error=float(differences["tension"][0]),
        same_slack=not slack_differs.any(),
        static_in_mujoco=cross["MuJoCo at the static pose"],
        settled_in_statics=cross["statics at the settled pose"],
    )


def _at_rest_length(equilibrium: Equilibrium) -> Bool[np.ndarray, " cables"]:
    return np.abs(equilibrium.lengths - equilibrium.rest_lengths) <= REST_LENGTH_TOLERANCE


def _connected(static: Equilibrium, settled: Equilibrium) -> bool:
    """Whether the two belong to one family of equilibria: the energy stays level along the screw motion between them.

    The energy and not the forces: rounding of the two ends, times a stiff cable, is a force in between, but no energy.
    """
    problem = static.problem
    between = (static.pose.inv() * settled.pose).as_exp_coords()
    fractions = np.linspace(0, 1, 17)
    poses = static.pose * RigidTransform.from_exp_coords(fractions[:, None] * between)
    turn = (settled.rotation * static.rotation.inv()).as_rotvec()
    work = fractions * (turn @ problem.external_wrench[3:])
    energies = forces.at(problem, poses.translation, poses.rotation.as_matrix()).energy - work
    level = LEVEL * problem.force_scale * problem.robot.characteristic_length
    return bool(np.ptp(energies) <= level)
