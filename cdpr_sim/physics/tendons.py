"""Model of a cable in MuJoCo: a spatial tendon whose spring pulls beyond its rest length and never pushes.

The tendon runs from its exit site to its anchor site, with ``stiffness`` EA/l0 and ``springlength="0 l0"``: MuJoCo's
spring has no force inside that dead band, so

    tau = EA/l0 (l - l0)  for l > l0,  else 0          (paper Eq. 10, 11)

A nonlinear cable has the two further coefficients of MuJoCo's polynomial (``cable``). The tendon of one over a pulley
begins before the pulley (``pulleys``) and is longer by that entry.

Three attributes of tendons are left out on purpose. ``range`` would add a constraint that stops the cable
stretching; ``damping`` ignores the dead band, so that a slack cable would push, and it turns off the drawing of a
slack cable as a hanging chain; ``frictionloss`` would hold the platform away from its equilibrium.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.core.problem import Problem
from cdpr_sim.physics import pulleys, winches
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.number_format import add

NOTHING = 1e-200
"""[N/m] Stiffness of a drawn twin. MuJoCo draws hanging chains only where there is a spring: this one changes no force,
not even by rounding."""


def add_tendons(
    root: ET.Element,
    problem: Problem,
    step: float | None,
    *,
    wound: bool,
    nodes: int | None,
    uneven: Float[np.ndarray, " cables"],
) -> ET.Element:
    """The tendons ``cable_1``, ... with the problem's rest lengths; returns the element of all tendons.

    Args:
        root: the model.
        problem: the robot with its rest lengths.
        step: the time step [s] of an integrator that does not know springs, for which they are damped; None without.
        wound: whether the actuators of winches replace springs, except those of nonlinear cables, which begin at a
            drum; ``rope_1``, ... are then drawn in their place (``winches.hang``).
        nodes: number of masses through which the tendon of a cable with mass runs; None where ``chains`` make all its
            tendons.
        uneven: by how much cables stretch further than under their mean tension [m].
    """
    robot, cabling, rest_lengths = problem.robot, problem.robot.cabling, problem.rest_lengths
    tendons = ET.SubElement(root, "tendon")
    law = Law.of(cabling)
    springs = law.springs(rest_lengths)
    further = springs.polynomial
    lengths = rest_lengths + uneven + (winches.behind(robot) if wound else pulleys.entries(cabling))
    for i, (stiffness, length) in enumerate(zip(springs.stiffness, lengths, strict=True), start=1):
        heavy = cabling.with_mass[i - 1]
        if heavy and nodes is None:
            continue
        parts, behind, rigid = float(law.parts[i - 1]), law.behind[i - 1], law.rigid[i - 1]
        properties = [parts, behind, uneven[i - 1] * heavy, rigid][: 4 if rigid > 0 else 3 if heavy else 2]
        told = parts > 1 or behind > 0 or heavy or rigid > 0
        nonlinear = cabling.nonlinear[i - 1]
        spring = nonlinear or not wound
        cable = add(
            tendons,
            "spatial",
            {"name": f"cable_{i}", "class": "cable"},
            user=properties if told else None,  # ``reset`` cannot read it elsewhere
            stiffness=[stiffness, *(further[i - 1] if nonlinear else [])] if spring else None,
            springlength=[0, length] if spring else None,
            damping=None if step is None else step * stiffness,
            group=winches.HIDDEN if heavy else None,  # its segments are drawn
        )
        if nonlinear and wound:
            add(cable, "site", site=f"drum_{i}")
        elif cabling.pulleys[i - 1]:
            add(cable, "site", site=f"entry_{i}")
        if cabling.pulleys[i - 1]:
            pulleys.add_way(cable, i)
        else:
            add(cable, "site", site=f"exit_{i}")
        for k in range(1, 1 + (nodes or 0) * heavy):
            add(cable, "site", site=f"node_{i}_{k}")
        add(cable, "site", site=f"anchor_{i}")
        if wound and not (cabling.pulleys[i - 1] or heavy):
            add_twin(tendons, f"rope_{i}", i, rest_lengths[i - 1], group=winches.HIDDEN)
    return tendons


class Jacobian:
    """Rates of a model's tendons' lengths by velocities, from MuJoCo's sparse ``ten_J``."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._shape = model.ntendon, model.nv
        self._places = np.repeat(np.arange(model.ntendon) * model.nv, model.ten_J_rownnz) + model.ten_J_colind

    def of(self, entries: Float[np.ndarray, "*rows entries"]) -> Float[np.ndarray, "*rows tendons dofs"]:
        """The rates with these ``ten_J``."""
        whole = np.zeros((*entries.shape[:-1], self._shape[0] * self._shape[1]))
        whole[..., self._places] = entries
        return whole.reshape(*entries.shape[:-1], *self._shape)


def add_twin(tendons: ET.Element, name: str, cable: int, length: float, group: int | None = None) -> None:
    """A tendon along ``cable`` (from 1 on) without force, which is drawn hanging where it is below ``length`` [m]."""
    names = {"name": name, "class": "cable"}
    twin = add(tendons, "spatial", names, group=group, stiffness=NOTHING, springlength=[0, length])
    for end in ("exit", "anchor"):
        add(twin, "site", site=f"{end}_{cable}")
