"""Small cases with closed forms, random robots, and grids of poses, for all tests."""

import numpy as np
import oracle
from hypothesis import strategies as st
from oracle import Rig

import cdpr_sim as cdpr

VARIED = ("caroca", "cogiro", "grab-3", "ipanema-1", "planar-vertical", "two-cable")
"""Robots on massless cables that differ in mobility, number of cables, pulleys, constraint and limits."""


def hanging_mass(axial_stiffness: float = 100.0, mass: float = 2.0, rest_length: float = 1.5) -> cdpr.Problem:
    """A mass on one vertical cable: it stretches by m g l0 / EA, and hangs there."""
    robot = cdpr.Robot(
        exits=[[0, 0, 3.0]],
        anchors=[[0, 0, 0.1]],
        axial_stiffness=axial_stiffness,
        mass=mass,
        platform_size=(0.2, 0.2, 0.2),
        name="hanging mass",
    )
    return cdpr.Problem.of(robot, (0, 0, 3.0 - 0.1 - rest_length))


def symmetric_pair(angle: float = 0.5, axial_stiffness: float = 1e3, mass: float = 1.0) -> cdpr.Problem:
    """A planar point on two equal cables at ±``angle`` from the vertical: tau = m g / (2 cos), by symmetry."""
    span, height = np.sin(angle), np.cos(angle)
    robot = cdpr.Robot(
        exits=[[-span, 0, height], [span, 0, height]],
        anchors=[[0, 0, 0], [0, 0, 0]],
        axial_stiffness=axial_stiffness,
        mass=mass,
        mobility="planar",
        platform_size=(0.1, 0.1, 0.1),
        name="symmetric pair",
    )
    return cdpr.Problem.of(robot, (0, 0, 0))


def random_problem(seed: int, min_cables: int = 3, max_cables: int = 10, wrench: bool = True) -> cdpr.Problem:
    """A random suspended robot, soft or stiff, light or heavy, near-degenerate ones included, at a random pose.

    Often one that no lengths hold. Half are planar, in some two cables leave one point, half are pushed by a force.
    """
    rng = np.random.default_rng(seed)
    cables, planar = rng.integers(min_cables, max_cables + 1), rng.random() < 0.5
    exits = rng.uniform([-1, -1, 0.6], [1, 1, 1.5], (cables, 3))
    anchors = rng.uniform(-0.15, 0.15, (cables, 3))
    center_of_mass = rng.uniform(-0.05, 0.05, 3) * (rng.random() < 0.5)
    if rng.random() < 0.3:
        exits[-1] = exits[0]
    pose = np.concatenate([rng.uniform([-0.5, -0.5, -0.2], [0.5, 0.5, 0.4]), rng.uniform(-0.3, 0.3, 3)])
    force = np.concatenate([rng.normal(size=3), np.zeros(3)]) * (wrench & (rng.random() < 0.5))
    mass, stiffness = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(3, 7)
    if planar:
        exits[:, 1] = anchors[:, 1] = center_of_mass[1] = 0
        pose[[1, 3, 5]] = force[1] = 0
    robot = cdpr.Robot(
        exits=exits,
        anchors=anchors,
        axial_stiffness=stiffness * np.linalg.norm(exits - pose[:3] - anchors, axis=1),
        mass=mass,
        center_of_mass=center_of_mass,
        mobility="planar" if planar else "spatial",
        name=f"random {seed}",
    )
    return cdpr.Problem.of(robot, pose, external_wrench=0.3 * robot.weight * force)


def random_problems(min_cables: int = 3, max_cables: int = 10, wrench: bool = True) -> st.SearchStrategy[cdpr.Problem]:
    """All of them."""
    seeds = st.integers(0, 2**32 - 1)
    return seeds.map(lambda seed: random_problem(seed, min_cables, max_cables, wrench))


def grid(robot: cdpr.Robot, poses: int) -> np.ndarray:
    """About ``poses`` positions that fill the robot's workspace evenly, (n, 3) [m]."""
    lower, upper = robot.workspace
    extent = upper - lower
    wide = extent > 0
    step = (np.prod(extent[wide]) / poses) ** (1 / wide.sum())
    axes = [np.linspace(a, b, max(round((b - a) / step) + 1, 1)) for a, b in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def paper_line(robot: cdpr.Robot, points: int = 24) -> np.ndarray:
    """The paper's trajectories: x from 0.17 to 0.63 m at z = 0.1 and 0.2 m, midway in y, (2 points, 3) [m]."""
    y = 0.0 if robot.mobility == "planar" else 0.25
    return np.array([(x, y, z) for z in (0.1, 0.2) for x in np.linspace(0.17, 0.63, points)])


def random_robot(seed: int, stiffest: float = 1e7) -> tuple[cdpr.Robot, np.ndarray, np.random.Generator]:
    """3 to 10 cables from a box above, 1e3 N/m and more, 0.1 to 100 kg, 0.3 to 10 m; every fourth planar.

    And a position, and the generator, to go on with.
    """
    random = np.random.default_rng(seed)
    cables, size = int(random.integers(3, 11)), 10 ** random.uniform(-0.5, 1)
    exits = np.c_[random.uniform(-size, size, (cables, 2)), random.uniform(0.8 * size, 1.2 * size, cables)]
    anchors = random.normal(size=(cables, 3))
    anchors *= (
        size
        * random.uniform(0.05, 0.25)
        * random.uniform(0.3, 1, (cables, 1))
        / np.linalg.norm(anchors, axis=1)[:, None]
    )
    position = size * random.uniform([-0.5, -0.5, -0.2], [0.5, 0.5, 0.4])
    planar = seed % 4 == 0
    if planar:
        exits[:, 1] = anchors[:, 1] = position[1] = 0
    robot = cdpr.Robot(exits, anchors, 1.0, 10 ** random.uniform(-1, 2), mobility="planar" if planar else "spatial")
    stiffness = 10 ** random.uniform(3, np.log10(stiffest), cables if random.random() < 0.5 else 1)
    return robot.replace(axial_stiffness=stiffness * np.ones(cables) * robot.rest_lengths(position)), position, random


def garage_crane(**changes) -> cdpr.Robot:
    """``cogiro``, five times as wide and six times as high, with 20 kg on 4 mm steel rope of 0.064 kg/m."""
    small = cdpr.load_robot("cogiro")
    given = dict(axial_stiffness=6.5e5, mass=20.0, linear_density=0.064, name="garage") | changes
    return cdpr.Robot(small.exits * [5, 8, 6], small.anchors * 5, **given)


def unbalanced(one: cdpr.Equilibrium) -> float:
    """What the oracle finds wrong at an equilibrium, over the load: net force, torques over the size, tensions."""
    problem, rig = one.problem, Rig.of(one.problem.robot)
    there = oracle.balance(
        rig, one.position, one.rotation_matrix, oracle.Ropes(rig, problem.rest_lengths), problem.external_wrench
    )
    wrench = (there.wrench / problem.robot.units)[problem.robot.free]
    return float(max(np.abs(wrench).max(), np.abs(there.tensions - one.tensions).max()) / problem.load)
