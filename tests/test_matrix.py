"""Every answer of the package × mixtures of cable properties × robots, each cell judged by the oracle.

An answer is a row: a function of a case, which asks the package and returns a judge. The judge takes a rig (numbers of
a robot) and says how far the answer is from what the oracle finds with them, over its tolerance: less than 1 is right,
with the robot's own numbers; with one property 1 % wrong it must be more. A property is a column, a function that draws
its values. What a row refuses is listed with its sentence.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib.util
import inspect
import itertools
import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import mujoco
import numpy as np
import oracle
import pytest
import scipy.linalg
import scipy.optimize
from oracle import Rig
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr

SEED = 20261124

NEAR = 1e-8
"""[of the mean rest length, of the weight] Largest difference of a pose, a length and a tension from the oracle's: the
solvers stop at a residual of 1e-9 of the load. Measured in the cells: 6e-10 of the length (1.7e-9 m) and 6e-9 of the
weight; where statics are polished by a proof, 4e-16 and 1e-12."""

EIGENVALUES = 1e-6
"""Of the largest: differences of the oracle, and in MuJoCo; measured 6e-8 and 2.8e-7."""

SLOPES = 1e-6
"""Of the largest derivative of the pose by a parameter, a hundredth of that of tensions: differences of the oracle, of
which those of tensions cancel. Measured at most 0.7 of it."""

AT_REST = 1e-6
"""In place of ``NEAR`` where a simulation is stopped after a time."""


STRAIGHT = 1e-5
"""Strain from which a drawn massless cable is straight: the trace of weight by which slack ones hang, 1e-12 of EA, lets
it sag by 1e-12/8 over the strain, of its length."""

PROFILES = 1e-5
"""Of the mean rest length: how far drawn points of cables with mass lie from the oracle's curve."""


# Robots.


def drawn(seed: int, cables: int, mobility: str = "spatial") -> cdpr.Robot:
    """A robot that differs from others in everything: sizes, masses, exits, anchors, stiffnesses, centre, gravity."""
    random = np.random.default_rng([SEED, seed])
    size, mass = 10 ** random.uniform(-0.2, 1), 10 ** random.uniform(-0.5, 2)
    angle = 2 * np.pi * (np.arange(cables) + random.uniform(-0.2, 0.2, cables)) / cables
    exits = size * np.stack([0.6 * np.cos(angle), 0.5 * np.sin(angle), random.uniform(0.9, 1.1, cables)], -1)
    anchors = size * np.stack(
        [0.09 * np.cos(angle + 0.4), 0.1 * np.sin(angle + 0.4), random.uniform(-0.05, 0.08, cables)], -1
    )
    centre = size * random.uniform(-0.02, 0.02, 3)
    workspace = size * np.array([[-0.1, -0.1, 0.2], [0.12, 0.1, 0.4]])
    if mobility == "planar":  # every other cable from below
        exits[:, 1], anchors[:, 1], centre[1], workspace[:, 1] = 0, 0, 0, 0
        exits[:, 0] = size * np.where(np.arange(cables) < cables / 2, -0.5, 0.6) * random.uniform(0.9, 1.1, cables)
        anchors[:, 0] = size * np.where(np.arange(cables) < cables / 2, -0.1, 0.09)
        exits[::2, 2], anchors[::2, 2] = size * random.uniform(-0.4, -0.3, (cables + 1) // 2), -0.06 * size
    return cdpr.Robot(
        exits, anchors, mass * 9.81 * 10 ** random.uniform(2.3, 3) * random.uniform(0.7, 1.3, cables), mass,
        center_of_mass=centre, gravity=random.uniform(3, 12), name=f"drawn {seed}", workspace=workspace,
        mobility=mobility, inertia=mass * size**2 * np.array([0.004, 0.005, 0.006]),
    )  # fmt: skip


ROBOTS = {
    "cogiro": lambda: cdpr.load_robot("cogiro"),  # suspended
    "ipanema-1": lambda: cdpr.load_robot("ipanema-1"),  # fully constrained
    "drawn, 3 cables": lambda: drawn(1, 3),  # under-actuated
    "drawn, planar": lambda: drawn(2, 4, "planar"),
    "drawn, 7 cables": lambda: drawn(3, 7),
}

CONTROLLED = "drawn, planar"
"""The robot of negative controls."""

MORE = 7
"""Cases of it that are asked besides, so that most properties are controlled in every row."""


# Properties.


@dataclasses.dataclass
class Draw:
    """What the properties of a robot's cables are drawn from."""

    robot: cdpr.Robot
    names: frozenset[str]
    random: np.random.Generator
    given: dict = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        self.n = self.robot.cables
        self.span = float(np.linalg.norm(self.robot.exits - self.robot.home - self.robot.anchors, axis=1).mean())
        self.load = self.robot.weight / self.n

    def some(self) -> np.ndarray:
        """Most cables, the first of them always."""
        return (self.random.random(self.n) < 0.7) | (np.arange(self.n) == 0)

    @property
    def last(self) -> np.ndarray:
        """The last cable, which has no nonlinear law, so that some cable of every mixture can have hysteresis."""
        return np.arange(self.n) == self.n - 1

    def between(self, low: float, high: float) -> np.ndarray:
        """A number for each cable, 0 for some."""
        return self.random.uniform(low, high, self.n) * self.some()


def pulley(d: Draw) -> dict:
    axis = d.random.normal(size=(d.n, 3)) * [0.1, 0.1 * (d.robot.mobility == "spatial"), 0]
    axis[:, 2] = d.random.choice([-1, 1], d.n)
    return {"pulley_radius": d.span * d.between(0.005, 0.02), "pulley_axis": axis}


def mass(d: Draw) -> dict:
    return {"linear_density": d.robot.mass / d.n / d.span * 10 ** d.random.uniform(-2.5, -1.3) * d.some()}


def law(d: Draw) -> dict:
    return {"stiffening": d.random.uniform([10, 0], [100, 1e4], (d.n, 2)) * (d.some() & ~d.last)[:, None]}


def frame(d: Draw) -> dict:
    """Up to half as soft as the cable, not in all directions; one number for all, for some robots."""
    soft = d.random.uniform(0, 0.5, (d.n, 3)) * (d.random.random((d.n, 3)) < 0.8)
    soft[0] += 0.1
    return {"exit_compliance": soft * d.some()[:, None] * (d.span / d.robot.axial_stiffness)[:, None]}


def friction(d: Draw) -> dict:
    line = {} if "drive line" in d.names else {"winch_to_exit": d.span * d.random.uniform(0.3, 1, d.n)}
    return line | {"pulley_friction": d.between(0.02, 0.06)}  # it acts through the rope behind the exit


def hysteresis(d: Draw) -> dict:
    def elements(EA: float) -> list:
        u = d.random.uniform
        return [(u(0.05, 0.15), u(0.2, 1) * d.load / EA), (u(0.05, 0.15), np.inf, u(0.1, 0.5))]

    mass, curved = (
        d.given.get("linear_density", np.zeros(d.n)) > 0,
        np.any(d.given.get("stiffening", np.zeros((d.n, 2))), 1),
    )
    some = (d.some() | d.last) & ~(mass & curved)  # refused together on one cable
    return {"hysteresis": [elements(EA) if one else [] for EA, one in zip(d.robot.axial_stiffness, some, strict=True)]}


def creep(d: Draw) -> dict:
    terms = [[(EA * d.random.uniform(2, 6), d.random.uniform(20, 200))] for EA in d.robot.axial_stiffness]
    return {"creep": [one if some else [] for one, some in zip(terms, d.some(), strict=True)]}


def limits(d: Draw) -> dict:
    return {
        "force_min": d.load * d.random.uniform(0, 0.05, d.n), "force_max": d.load * d.random.uniform(4, 9, d.n),
        "breaking_load": d.load * d.random.uniform(0.5, 2, d.n),
    }  # fmt: skip


COLUMNS: dict[str, tuple[Callable[[Draw], dict], tuple[str, ...]]] = {
    "pulley": (pulley, ("pulley_radius", "pulley_axis")),
    "mass": (mass, ("linear_density",)),
    "law": (law, ("stiffening",)),
    "drive line": (lambda d: {"winch_to_exit": d.span * d.between(0.3, 1)}, ("winch_to_exit",)),
    "reeving": (lambda d: {"reeving": d.random.integers(1, 4, d.n)}, ("reeving",)),
    "frame": (frame, ("exit_compliance",)),
    "limits": (limits, ("force_min", "force_max", "breaking_load")),
    "friction": (friction, ("pulley_friction",)),
    "hysteresis": (hysteresis, ("hysteresis",)),
    "creep": (creep, ("creep",)),
    "rigid": (lambda d: {"rigid_length": d.span * d.between(0.05, 0.2)}, ("rigid_length",)),
}  # fmt: skip
"""Of each property, what draws it, and the names of the robot's attributes that it is."""

LISTED = 3 + len(COLUMNS)
"""How many mixtures are not drawn."""

MEMORY = {"friction", "hysteresis", "creep"}
ELASTIC = frozenset(COLUMNS) - MEMORY

OF_EVERY_ROBOT = ("axial_stiffness", "exits", "anchors", "mass", "center_of_mass", "gravity")
"""Properties beside those of the columns that act at rest."""

EVERYTHING = {*COLUMNS, *OF_EVERY_ROBOT}

NOT_OF_CABLES = {
    "exits", "anchors", "axial_stiffness", "mass", "center_of_mass", "inertia", "mobility", "gravity", "name",
    "platform_size", "frame", "workspace", "material", "from_material", "description", "source", "notes", "pretension",
}  # fmt: skip
"""Arguments of ``Robot`` that every robot has, and which differ from robot to robot; names; sources; and what only
chooses rest lengths."""


def mixtures() -> list[frozenset[str]]:
    """None, all, each property alone; and drawn ones until each pair has occurred, of elastic ones without memory."""
    random = np.random.default_rng(SEED)
    found = [frozenset(), ELASTIC, frozenset(COLUMNS), *(frozenset([name]) for name in COLUMNS)]
    for names, within in ((sorted(ELASTIC), ELASTIC), (sorted(COLUMNS), frozenset(COLUMNS))):
        wanted = {frozenset(pair) for pair in itertools.combinations(names, 2)}
        wanted -= {pair for one in found[LISTED:] for pair in wanted if pair <= one}
        while wanted:
            one = frozenset(random.choice(names, random.integers(2, 1 + len(within) // 2 + 1), replace=False).tolist())
            if any(pair <= one for pair in wanted):
                found.append(one)
                wanted = {pair for pair in wanted if not pair <= one}
    return found


MIXTURES = mixtures()


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """A robot with a mixture of properties, and what is asked of it."""

    names: frozenset[str]
    robot: cdpr.Robot
    pose: np.ndarray
    rest: np.ndarray
    load: np.ndarray

    @functools.cached_property
    def problem(self) -> cdpr.Problem:
        return cdpr.Problem.of(self.robot, self.pose, self.rest, self.load)

    @functools.cached_property
    def solved(self) -> cdpr.Equilibrium:
        return cdpr.solve(self.problem)

    @functools.cached_property
    def rigid(self) -> cdpr.Equilibrium:
        """On the rigid lengths of the pose, under its weight alone."""
        return cdpr.solve(self.robot, self.pose)

    @functools.cached_property
    def rig(self) -> Rig:
        return Rig.of(self.robot)

    @property
    def size(self) -> float:
        return float(self.rest.mean())


@functools.cache
def case(robot: str, mixture: int) -> Case:
    """One cell's robot, commanded pose, rest lengths and load, drawn by the seed."""
    names, random = MIXTURES[mixture], np.random.default_rng([SEED, [*ROBOTS].index(robot), mixture])
    draw = Draw(ROBOTS[robot](), names, random)
    for name, (values, _) in COLUMNS.items():
        if name in names:
            draw.given |= values(draw)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = draw.robot.replace(**draw.given)
    spatial = made.mobility == "spatial"
    pose = np.zeros(6)
    pose[:3] = made.home + random.uniform(-0.15, 0.15, 3) * np.ptp(made.workspace, axis=0) * [1, spatial, 1]
    pose[3:] = random.uniform(-0.05, 0.05, 3) * [spatial, 1, spatial]
    load = random.uniform(-0.1, 0.1, 6) * made.weight * np.repeat([1, 0.1 * made.characteristic_length], 3)
    if not spatial:
        load[[1, 3, 5]] = 0
    stretch = draw.load / (made.reeving * made.axial_stiffness)
    rest = made.rest_lengths(pose) * (1 - stretch * random.uniform(0, 1, made.cables))
    return Case(names, made, pose, rest, load)


def cases_of(robot: str, row: Row | None = None) -> list[Case]:
    """Those of a robot that a row asks: all, none, and its part of the others; or only the first few of them."""
    k = [*ROBOTS].index(robot)
    mine = [1, 2, 0, *(i for i in range(3, len(MIXTURES)) if i % 5 in (k, (k + 2) % 5))]
    found = [case(robot, i) for i in mine]
    if row is None:
        return found
    few = row.few and row.few + MORE * (robot == CONTROLLED and row.few > 1)
    return [at for at in found if row.only(at)][:few]


# Judgements.


def apart(at: Case, rig: Rig, found, *, rest=None, load=None, state=None, seconds=0.0, scale=1.0, ended=None) -> float:
    """How far an equilibrium is from the oracle's beside it, with all that it says of itself, over the tolerances."""
    rest, load = at.rest if rest is None else rest, at.load if load is None else load
    ropes = oracle.Ropes(rig, rest, state, seconds)
    position, rotation, K, there = oracle.equilibrium(rig, found.position, found.rotation_matrix, ropes, load)
    if ended is not None:
        ended.append(ropes.after(there.at_exit))
    far = [
        np.abs(position - found.position).max() / at.size / NEAR,
        np.abs(rotation - found.rotation_matrix).max() * rig.size / at.size / NEAR,
    ]
    for name, size in (("tensions", at.robot.weight), ("lengths", at.size)):
        if hasattr(found, name):
            far.append(np.abs(getattr(there, name) - getattr(found, name)).max() / size / NEAR)
    if hasattr(found, "slack"):
        close = np.abs(there.lengths - rest) < NEAR * at.size  # neither slack nor taut within rounding
        far.append(0.0 if ((there.slack == found.slack) | close).all() else np.inf)
        far.append(0.0 if (found.overloaded == (there.tensions > at.robot.breaking_load)).all() else np.inf)
    values = getattr(found, "eigenvalues", None)
    if values is not None and np.isfinite(values).all():

        def off(K: np.ndarray) -> float:
            mine = np.linalg.eigvalsh((K + K.T) / 2)
            return np.abs(mine - values).max() / np.abs(mine).max() / EIGENVALUES

        if not off(K) < 1:  # within the difference an element may begin to yield
            K = oracle.stiffness(rig, position, rotation, ropes, load, there, step=0.1 * oracle.H)
        far.append(off(K))
    return float(np.max(far)) / scale


Judge = Callable[[Rig], float]


@dataclasses.dataclass(frozen=True)
class Row:
    """An answer.

    Attributes:
        ask: asks the package about a case, and returns the judge of the answer.
        of: public names that give it.
        refuses: by sets of properties, the sentence with which the package refuses a robot that has all of them.
        few: how many of a robot's cases are asked, the fullest ones first; None: all. Slow answers have few.
        robots: of which robots; None: of all.
        blind: properties of which 1 % does not change this answer, with the reason in the row's docstring.
    """

    ask: Callable[[Case], Judge]
    of: tuple[str, ...]
    refuses: dict[frozenset[str], str]
    few: int | None
    only: Callable[[Case], bool]
    blind: frozenset[str]


ROWS: dict[str, Row] = {}

NEW = ("friction", "creep")
"""What does not act at the first equilibrium of new ropes."""

NO_MEMORY = dict.fromkeys(MEMORY, "their memory is not taken into account here")


RIGID_EXITS = {"frame": "does not take it into account"}


def row(*of: str, refuses=None, few=None, only=lambda at: True, blind=()):
    """Make a function a row, named as it is."""

    def add(ask):
        assert ask.__doc__
        ROWS[ask.__name__.strip("_").replace("_", " ")] = Row(
            functools.cache(ask),
            of,
            {frozenset([k] if isinstance(k, str) else k): v for k, v in (refuses or {}).items()},
            few,
            only,
            frozenset(blind) | {"limits"},  # which do not change an equilibrium
        )
        return ask

    return add


def steppable(at: Case) -> bool:
    """Without mass: chains take long, and are unstable with some nonlinear laws (``docs/verification/limits.md``)."""
    return "mass" not in at.names


def light(at: Case) -> bool:
    """With mass only on three or four cables: chains of eight take seconds, and ``settle`` and ``drive`` have them."""
    return steppable(at) or at.robot.cables <= 4


def worst(*judges: Judge) -> Judge:
    """All of them."""
    return lambda rig: max(judge(rig) for judge in judges)


def near(at: Case, found, **given) -> Judge:
    """The judge of one equilibrium."""
    return lambda rig: apart(at, rig, found, **given)


# Equilibria.


@row("solve", blind=NEW)
def _solve(at: Case) -> Judge:
    """Newton's method."""
    return near(at, at.solved)


@row("solve", refuses=NO_MEMORY, few=6)
def _seecr(at: Case) -> Judge:
    """The paper's two solvers, where they converge."""
    judges = []
    for method in ("fsolve", "least_squares"):
        with contextlib.suppress(cdpr.NotConverged):
            judges.append(near(at, cdpr.solve(at.problem, method=method), scale=100.0))
    return worst(*judges, lambda rig: 0.0)


@row("solve_many", blind=NEW)
def _solve_many(at: Case) -> Judge:
    """Two poses at once, with two masses."""
    poses = at.pose + np.outer([0, 0.02], [at.size, 0, at.size, 0, 0, 0])
    masses = at.robot.mass * np.array([1.0, 1.1])
    if at.names & MEMORY:
        masses = at.robot.mass
    batch = cdpr.solve_many(at.robot, poses, at.rest, external_wrench=at.load, mass=masses)
    masses = np.broadcast_to(masses, 2) / at.robot.mass
    one, two = batch[0], batch[1]
    return lambda rig: max(
        apart(at, dataclasses.replace(rig, mass=rig.mass * m), found)
        for m, found in zip(masses, (one, two), strict=True)
    )


@row("solve_trajectory", blind=NEW)
def _solve_trajectory(at: Case) -> Judge:
    """The equilibria of the commands of a motion."""
    motion = cdpr.Trajectory.through(cdpr.solve_many(at.robot, np.array([at.pose, at.pose])), np.array([0.0, 1.0]))
    found = cdpr.solve_trajectory(motion)[1]
    return near(at, found, rest=at.robot.rest_lengths(at.pose), load=0.0)


@row("settle", "settle_trajectory", few=5, blind=NEW)
def _settle(at: Case) -> Judge:
    """In MuJoCo; and with the motion to it."""
    if at.names & (MEMORY | {"mass"}):
        return near(at, cdpr.settle(at.problem))
    found, motion = cdpr.settle_trajectory(at.problem)
    assert np.abs(motion.positions[-1] - found.position).max() < NEAR * at.size
    return near(at, found)


@row("settle_many", few=6, blind=NEW, only=light)
def _settle_many(at: Case) -> Judge:
    """On threads."""
    return near(at, cdpr.settle_many(cdpr.Problems.of(at.robot, at.pose[None], at.rest, at.load), threads=1)[0])


def along(at: Case, method) -> Judge:
    """There, on, and back, with time between, so that ropes with a memory have one."""
    poses = at.pose + np.outer([0, 1, 0.9, 0.1], [0.06 * at.size, 0, 0.03 * at.size, 0, 0, 0])
    times = np.array([0.0, 30.0, 30.0, 100.0])
    path = method(at.robot, poses, times=times, external_wrench=at.load)

    def judge(rig: Rig) -> float:
        states, far = [None], []
        for k, seconds in enumerate(np.diff(times, prepend=0.0)):
            found = path[k]
            far.append(apart(at, rig, found, rest=found.rest_lengths, state=states[-1], seconds=seconds, ended=states))
        remembered = path.memory
        new = np.isfinite(rig.pulley_friction) & (rig.pulley_friction > 0)
        for name, size in (("strains", 1e-3), ("beyond", at.size), ("creep", 1e-3)):
            mine, theirs = getattr(states[-1], name), getattr(remembered, name)
            if mine.size and (name != "beyond" or new.any()):
                where = new if name == "beyond" else slice(None)
                far.append(np.abs(mine - theirs)[where].max() / size / NEAR / 100)
        return max(far)

    return judge


@row("solve_path")
def _solve_path(at: Case) -> Judge:
    """Along a path, with the memory at its end."""
    return along(at, cdpr.solve_path)


@row(
    "settle_path",
    few=5,
    only=lambda at: len(at.names) < 9 and not {"mass", "law"} <= at.names,
)
def _settle_path(at: Case) -> Judge:
    """The same in MuJoCo."""
    return along(at, cdpr.settle_path)


@row("find_equilibria", refuses=NO_MEMORY, few=4)
def _find_equilibria(at: Case) -> Judge:
    """Each that is found is one."""
    force = at.load * [1, 1, 1, 0, 0, 0]
    found = cdpr.find_equilibria(cdpr.Problem.of(at.robot, at.pose, at.rest, force), starts=3).found
    assert found
    return worst(*(near(at, one, load=force) for one in found))


@row("follow_load", refuses=NO_MEMORY)
def _follow_load(at: Case) -> Judge:
    """At half the load and more, and at all of it."""
    path = cdpr.follow_load(at.problem)

    def judge(rig: Rig) -> float:
        steps = [(path.loads[k], path.equilibria[k]) for k in (np.searchsorted(path.loads, 0.5), -1)]
        return max(
            apart(at, dataclasses.replace(rig, gravity=f * rig.gravity), one, load=f * at.load) for f, one in steps
        )

    return judge


@row("grow_gravity", refuses=NO_MEMORY, few=2)
def _grow_gravity(at: Case) -> Judge:
    """In MuJoCo, the end of it."""
    problem = cdpr.Problem.of(at.robot, at.pose, at.rest)
    return near(at, cdpr.grow_gravity(problem, seconds=1.0), load=0.0)


@row("sweep", blind=NEW)
def _sweep(at: Case) -> Judge:
    """A pose as rows of a dataset."""
    data = cdpr.sweep(at.robot, poses=at.pose[None], external_wrench=at.load, chunk=None, quantities=[
        "position", "rotation_vector", "tensions", *(["eigenvalues"] if not at.names & MEMORY else []), "feasible",
    ])  # fmt: skip
    return tabled(at, data, "")


def tabled(at: Case, data, prefix: str) -> Judge:
    values = {name: data[prefix + name].values.ravel() for name in ("position", "rotation_vector", "tensions")}
    rest = at.robot.rest_lengths(at.pose)
    rotation = Rotation.from_rotvec(values["rotation_vector"]).as_matrix()

    def judge(rig: Rig) -> float:
        position, R, K, there = oracle.equilibrium(rig, values["position"], rotation, oracle.Ropes(rig, rest), at.load)
        far = [
            np.abs(position - values["position"]).max() / at.size,
            np.abs(there.tensions - values["tensions"]).max() / at.robot.weight,
        ]
        far = [max(far) / NEAR, np.abs(R - rotation).max() / NEAR]
        if prefix + "eigenvalues" in data:
            mine = np.linalg.eigvalsh((K + K.T) / 2)
            far.append(np.abs(mine - data[prefix + "eigenvalues"].values.ravel()).max() / mine.max() / EIGENVALUES)
        return max(far)

    return judge


# Analysis.


def quick(at: Case) -> bool:
    """With mass, a pose that cannot be held exactly takes seconds."""
    return steppable(at) or at.robot.cables == 8


@row("compensate", "verify_compensation", refuses=NO_MEMORY, few=6, only=quick)
def _compensate(at: Case) -> Judge:
    """At the commanded pose if that is said, with tensions within the limits; and in MuJoCo with the same lengths."""
    limits = None
    if {"mass", "limits"} <= at.names:  # less than what the weight alone gives is refused
        least = 2 * at.robot.cable_weights * at.rest / at.robot.reeving
        limits = np.maximum(at.robot.force_min, least), at.robot.force_max
    found = cdpr.compensate(at.problem, tensions=limits)
    one = found.equilibrium
    checked = cdpr.verify_compensation(found).settled_from_compensated if steppable(at) else one
    if found.exact:
        assert np.abs(one.position - at.pose[:3]).max() < NEAR * at.size
        assert (one.tensions >= found.tension_limits[0] - NEAR * at.robot.weight).all()
    assert (one.tensions <= found.tension_limits[1] + NEAR * at.robot.weight).all()
    return worst(*(near(at, each, rest=found.rest_lengths) for each in (one, checked)))


@row("rest_lengths", refuses=NO_MEMORY)
def _rest_lengths(at: Case) -> Judge:
    """Lengths for given tensions: those of an equilibrium at its pose."""
    one = at.solved
    where = cdpr.Problem.of(at.robot, one.pose).pose
    rest = at.robot.rest_lengths(where, one.tensions, external_wrench=at.load)

    def judge(rig: Rig) -> float:
        found = oracle.balance(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, rest), at.load)
        left = (found.wrench / np.repeat([1.0, rig.size], 3))[list(rig.free)]
        return max(np.abs(left).max(), np.abs(found.tensions - one.tensions).max()) / at.robot.weight / NEAR

    return judge


STEPS = dict.fromkeys(("rest_lengths", "exits", "anchors"), 1e-8)
STEPS |= {"pulley_radius": 2e-8, "center_of_mass": 1e-6, "winch_to_exit": 1e-6, "rigid_length": 1e-6}
"""Of differences by lengths, relative to the mean rest length; 1e-5 of other parameters, relative to the largest."""

SOME_CABLES = ("pulley_radius", "winch_to_exit", "rigid_length", "linear_density", "stiffening", "exit_compliance")
"""Parameters that some cables do not have."""


@row("sensitivity", refuses=NO_MEMORY)
def _sensitivity(at: Case) -> Judge:
    """Slopes of the oracle's equilibrium by some numbers of each parameter."""
    found = cdpr.sensitivity(at.problem)
    one = found.equilibrium

    def judge(rig: Rig) -> float:
        ropes = oracle.Ropes(rig, at.rest)
        position, rotation, K, there = oracle.equilibrium(rig, one.position, one.rotation_matrix, ropes, at.load)
        units, free, far = np.repeat([1.0, rig.size], 3), list(rig.free), []
        for name, slopes in found.pose.items():
            given = {"rest_lengths": at.rest, "external_wrench": at.load}
            value = np.array(given.get(name, getattr(rig, name, None)), float)
            have = (value.ravel() != 0) | (name not in SOME_CABLES)
            k = int(np.argmax(np.linalg.norm(slopes * units[:, None], axis=0) * have))
            scale = at.size if name in STEPS else np.abs(value).max() or at.robot.weight
            h = (1e-3 if name == "linear_density" else STEPS.get(name, 1e-5)) * scale

            def moved(by, along=0.0 * units, name=name, value=value, k=k, given=given):
                new = value.copy()
                new.flat[k] += by
                other = rig if name in given else dataclasses.replace(rig, **{name: new if value.ndim else float(new)})
                lengths, load = (new if one == name else given[one] for one in given)
                p, R = position + by * along[:3], oracle.turned(rotation, by * along[3:])
                return oracle.balance(other, p, R, oracle.Ropes(other, lengths), load, there)

            slope = np.zeros(6)
            wrench = (moved(h).wrench - moved(-h).wrench) / (2 * h) / units
            slope[free] = np.linalg.solve(K, wrench[free]) / units[free]
            tension = (moved(h, slope).tensions - moved(-h, slope).tensions) / (2 * h)
            size = max(np.abs(slopes * units[:, None]).max(), 1e-3 * at.size / scale)
            far.append(np.abs((slopes[:, k] - slope) * units).max() / size)
            size = max(np.abs(found.tensions[name]).max(), 1e-3 * at.robot.weight / scale)
            far.append(np.abs(found.tensions[name][:, k] - tension).max() / size / 100)
        return max(far) / SLOPES

    return judge


@row("natural_modes", refuses=NO_MEMORY)
def _natural_modes(at: Case) -> Judge:
    """Frequencies of stiffness and mass."""
    force = at.load * [1, 1, 1, 0, 0, 0]  # a torque has no potential energy
    found = cdpr.natural_modes(cdpr.Problem.of(at.robot, at.pose, at.rest, force))
    one = found.equilibrium

    def judge(rig: Rig) -> float:
        _, rotation, K, _ = oracle.equilibrium(
            rig, one.position, one.rotation_matrix, oracle.Ropes(rig, at.rest), force
        )
        squares = scipy.linalg.eigh((K + K.T) / 2, oracle.mass_matrix(rig, rotation), eigvals_only=True)
        mine = np.sqrt(np.maximum(squares, 0)) / (2 * np.pi)
        return np.abs(mine - found.frequencies).max() / mine.max() / EIGENVALUES

    return judge


@row("neutral_directions", refuses=NO_MEMORY, blind=EVERYTHING, few=4)
def _neutral_directions(at: Case) -> Judge:
    """As many as the stiffness has eigenvalues of zero: none here, whatever is changed by 1 %."""
    found = cdpr.neutral_directions(at.solved)

    def judge(rig: Rig) -> float:
        one = at.solved
        K = oracle.stiffness(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, at.rest), at.load)
        values = np.linalg.eigvalsh((K + K.T) / 2)
        return 0.0 if len(found) == (np.abs(values) < 1e-7 * values.max()).sum() else np.inf

    return judge


@row("cable_profiles", only=lambda at: not at.names & MEMORY)
def _cable_profiles(at: Case) -> Judge:
    """Straight where massless, taut and without a wheel; with mass as the oracle's (elastic: the manual says so)."""
    batch = cdpr.solve_many(at.robot, at.pose[None], at.rest, external_wrench=at.load)
    drawn, one = cdpr.cable_profiles(batch, 5)[0], batch[0]

    def judge(rig: Rig) -> float:
        far, some = [apart(at, rig, one)], at.robot.linear_density > 0
        if some.any():
            mine = oracle.shapes(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, at.rest), 200)
            for curve, points in zip(mine, drawn[some], strict=True):
                piece, rel = np.diff(curve, axis=0), points[1:, None] - curve[None, :-1]
                t = np.clip((rel * piece).sum(-1) / (piece**2).sum(-1), 0, 1)
                off = np.linalg.norm(rel - t[..., None] * piece, axis=-1).min(1).max()
                far.append(off / at.size / PROFILES)
        straight = ~some & (one.tensions > STRAIGHT * at.robot.axial_stiffness) & (at.robot.pulley_radius == 0)
        ends = one.position + at.robot.anchors @ one.rotation_matrix.T
        there = oracle.balance(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, at.rest))
        exits = rig.exits + rig.exit_compliance * there.leaves
        mine = exits[:, None] + np.linspace(0, 1, 5)[:, None] * (ends - exits)[:, None]
        far.append(np.abs(mine - drawn)[straight].max(initial=0) / at.size / NEAR)
        assert np.isnan(drawn[~some & (at.robot.pulley_radius > 0)]).all()
        return max(far)

    return judge


@row("clearances", blind=NEW)
def _clearances(at: Case) -> Judge:
    """The distance of each two taut cables without mass, by bounded least squares; at a pose on rigid lengths."""
    found = cdpr.clearances(at.robot, at.pose[None])
    one = found.equilibria[0]

    def judge(rig: Rig) -> float:
        rest = at.robot.rest_lengths(at.pose)
        far = [apart(at, rig, one, rest=rest, load=0.0)]
        ends = one.position + rig.anchors @ one.rotation_matrix.T
        there = oracle.balance(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, rest))
        _, s, u = oracle.over_wheel(rig, ends - rig.exits - rig.exit_compliance * there.leaves)
        plain = (rig.linear_density == 0) & ~one.slack
        for (a, b), distance in list(zip(found.pairs, found.cable_cable[0], strict=True))[::5]:
            if plain[a] and plain[b]:
                A = np.stack([u[a] * (s[a] - 2 * found.fitting), -u[b] * (s[b] - 2 * found.fitting)], 1)
                gap = (ends[a] - u[a] * (s[a] - found.fitting)) - (ends[b] - u[b] * (s[b] - found.fitting))
                mine = scipy.optimize.lsq_linear(A, -gap, (0, 1), tol=1e-14)
                far.append(abs(np.linalg.norm(A @ mine.x + gap) - distance) / at.size / 1e-6)
        return max(far)

    return judge


def identified(at: Case, name: str, factor: float) -> Judge:
    poses = at.pose + np.array(
        [[0.0] * 6, [0.04 * at.size, 0, 0, 0, 0, 0], [-0.03 * at.size, 0, 0.03 * at.size, 0, 0, 0]]
    )
    measured = cdpr.solve_many(at.robot, poses)
    coordinates = ("x", "z") if at.robot.mobility == "planar" else ("x", "y", "z")
    columns = [("x", "y", "z").index(one) for one in coordinates]
    table = cdpr.Measurements.of(poses, measured.positions[:, columns], coordinates=coordinates)
    wrong = at.robot.replace(**{name: factor * getattr(at.robot, name)})
    found = cdpr.identify(wrong, table, (name,), position_error=1e-6).robot
    return lambda rig: max(
        np.abs(np.divide(getattr(found, name), getattr(rig, name)) - 1).max() / 1e-4,
        apart(at, rig, cdpr.solve(found, at.pose), rest=at.robot.rest_lengths(at.pose), load=0.0, scale=100.0),
    )


@row("identify", refuses=NO_MEMORY, few=4)
def _identify(at: Case) -> Judge:
    """The mass of the platform that was measured, from one that is 10 % heavier."""
    return identified(at, "mass", 1.1)


# Rigid cables.


def demand(at: Case, rig: Rig, pose: np.ndarray, limits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(W, load, lower, upper) of the first order in the cables' weight, torques over ``size``."""
    rotation = Rotation.from_euler("xyz", pose[3:]).as_matrix()
    arms = rig.anchors @ rotation.T
    _, s, u = oracle.over_wheel(rig, pose[:3] + arms - rig.exits)
    units, n = np.repeat([1.0, rig.size], 3), rig.reeving
    W = np.concatenate([-u, np.cross(arms, -u)], 1).T * n / units[:, None]
    down = np.array([0, 0, -1.0])
    rope = s - rig.rigid_length * (rig.linear_density > 0)
    half = (n * rig.linear_density * rig.gravity * rope**2 / s)[:, None] * down / 2  # its middle is not the cable's
    weight = rig.mass * rig.gravity * down
    load = np.concatenate(
        [weight + half.sum(0), np.cross(rotation @ rig.center_of_mass, weight) + np.cross(arms, half).sum(0)]
    )
    differs = np.abs(rig.linear_density * rig.gravity * rope * u[:, 2]) / 2
    lower, upper = (np.broadcast_to(limit, len(n)) for limit in limits)
    return W[list(rig.free)], (load / units)[list(rig.free)], lower + differs, upper - differs


@row(
    "shortfall",
    "feasible",
    "closed_form_feasible",
    blind={"axial_stiffness", "law", "drive line", "frame", "friction", "hysteresis", "creep"},
)
def _shortfall(at: Case) -> Judge:
    """What bounded least squares leave of the load; of rigid cables, which depend on no elasticity."""
    robot = at.robot
    pulls = robot.weight / robot.reeving / robot.cables
    tight = (0.6 * pulls, 1.2 * pulls)
    R = Rotation.from_euler("xyz", at.pose[3:]).as_matrix()
    found = [cdpr.shortfall(robot, at.pose[:3], rotations=R, tension_limits=limits) for limits in (tight, None)]
    says = cdpr.feasible(robot, at.pose[:3], rotations=R)
    assert says == (found[1] < 1e-9)

    def judge(rig: Rig) -> float:
        far = []
        for limits, one in zip((tight, (robot.force_min, robot.force_max)), found, strict=True):
            W, load, lower, upper = demand(at, rig, at.pose, limits)
            best = scipy.optimize.lsq_linear(W, -load, (lower, np.maximum(upper, lower + 1e-12)), tol=1e-15)
            far.append(abs(np.linalg.norm(W @ best.x + load) / np.linalg.norm(load) - one) / 1e-6)
        return max(far)

    return judge


@row("workspace_hull", blind=EVERYTHING, few=2, only=lambda at: holdable(at))
def _workspace_hull(at: Case) -> Judge:
    """Corners on the border: what is 0.1 % nearer to the centre is feasible, what is farther is not.

    The border moves less by 1 % of a wheel's radius.
    """
    limits = 0.1 * at.robot.weight / at.robot.cables, 10.0 * at.robot.weight
    if at.robot.mobility == "planar":
        with pytest.raises(cdpr.InvalidInput, match="planar"):
            cdpr.workspace_hull(at.robot, depth=0)
        return lambda rig: 0.0
    found = cdpr.workspace_hull(at.robot, depth=0, tension_limits=limits, reach=0.2 * at.size)

    def judge(rig: Rig) -> float:
        far = []
        for ray in found.vertices - found.center:
            for part in (0.999, 1.001):
                pose = np.concatenate([found.center + part * ray, np.zeros(3)])
                W, load, lower, upper = demand(at, rig, pose, limits)
                best = scipy.optimize.lsq_linear(W, -load, (lower, upper), tol=1e-15)
                holds = np.linalg.norm(W @ best.x + load) < 1e-7 * np.linalg.norm(load)
                border = np.linalg.norm(ray) < 0.199 * at.size
                far.append(0.0 if holds == (part < 1) or not (border or part < 1) else np.inf)
        return max(far)

    return judge


# Proofs.

UNPROVED = {"frame": "proof( of completeness)? does not take it into account"}


@row("certify", refuses=NO_MEMORY | UNPROVED, few=6)
def _certify(at: Case) -> Judge:
    """Proved; the oracle's equilibrium lies in the proved box, widened by the oracle's rounding."""
    proof = cdpr.certify(at.solved)
    assert proof.proved, proof.reasons
    assert proof.midpoint is not None
    return lambda rig: max(
        apart(at, rig, proof.midpoint), 0.0 if list(proof.slack) == at.solved.slack.tolist() else np.inf
    )


@row(
    "certify_all",
    refuses=NO_MEMORY | UNPROVED | {"mass": "proof of completeness does not take it into account"},
    few=8,
    only=lambda at: at.robot.mobility == "planar",
)
def _certify_all(at: Case) -> Judge:
    """Of a planar robot: each on the list is one, and that of ``solve`` is on it."""
    found = cdpr.certify_all(cdpr.Problem.of(at.robot, at.pose, at.rest))
    assert found.equilibria
    assert (
        min(np.abs(one.position - cdpr.solve(at.robot, at.pose, at.rest).position).max() for one in found.equilibria)
        < 1e-6 * at.size
    )
    return worst(*(near(at, one, load=0.0) for one in found.equilibria))


# Simulations that are stepped.


@row("to_mjcf", refuses=NO_MEMORY, few=4, only=steppable)
def _to_mjcf(at: Case) -> Judge:
    """A model that the user steps until it is at rest."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(cdpr.Problem.of(at.robot, at.pose, at.rest)))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=int(20 / model.opt.timestep))
    body = data.body("platform")
    found = SimpleNamespace(position=body.xpos.copy(), rotation_matrix=body.xmat.reshape(3, 3).copy())
    return near(at, found, load=0.0, scale=AT_REST / NEAR)


def balanced(at: Case, model: mujoco.MjModel, **given) -> Judge:
    """What MuJoCo leaves unbalanced where the oracle has the equilibrium, reset there."""
    start = cdpr.solve(at.robot, at.pose, at.rest)

    def judge(rig: Rig) -> float:
        p, R, _, _ = oracle.equilibrium(rig, start.position, start.rotation_matrix, oracle.Ropes(rig, at.rest))
        data = mujoco.MjData(model)
        cdpr.reset(model, data, RigidTransform.from_components(p, Rotation.from_matrix(R)), rest_lengths=at.rest)
        if given:
            data.ctrl = given["controls"]
        mujoco.mj_forward(model, data)
        left = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
        return np.abs(left[model.dof_bodyid == model.body("platform").id]).max() / at.robot.weight / NEAR

    return judge


@row(
    "winch_controls",
    "to_mjcf",
    refuses=NO_MEMORY | {("frame", "law"): "beside nonlinear cables, expected one of them"},
    few=6,
    only=steppable,
)
def _winch_controls(at: Case) -> Judge:
    """A model with winches that are given the controls of the rest lengths."""
    text = cdpr.to_mjcf(at.robot, at.robot.home, winches=True, winch_force=np.inf)
    controls = cdpr.winch_controls(at.robot, at.robot.home, at.rest)
    return balanced(at, mujoco.MjModel.from_xml_string(text), controls=controls)


@row("reset", "scene_mjcf", refuses=NO_MEMORY, few=6, only=steppable)
def _reset(at: Case) -> Judge:
    """A scene with a model, reset to the rest lengths."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "robot.xml").write_text(cdpr.to_mjcf(at.robot, at.pose))
        (Path(folder) / "scene.xml").write_text(cdpr.scene_mjcf(cdpr.Problem.of(at.robot, at.pose)))
        model = mujoco.MjModel.from_xml_path(str(Path(folder) / "scene.xml"))
    cdpr.reset(model, mujoco.MjData(model), at.pose, rest_lengths=at.rest)
    return balanced(at, model)


@row("drive", refuses=NO_MEMORY, few=3)
def _drive(at: Case) -> Judge:
    """The end of a small motion: what it leaves of oscillations is smaller."""
    poses = at.pose + np.outer([0, 1e-5], [at.size, 0, 0, 0, 0, 0])
    motion = cdpr.drive(at.robot, poses, seconds=4.0, states=2, external_wrench=at.load)
    return moved(at, motion, at.load)


def moved(at: Case, motion: cdpr.Trajectory, load) -> Judge:
    """The last state of a motion, at rest."""
    found = SimpleNamespace(
        position=motion.positions[-1], rotation_matrix=motion.rotations[-1], tensions=motion.tensions[-1],
        lengths=motion.lengths[-1],
    )  # fmt: skip
    return near(at, found, rest=motion.problems.rest_lengths[-1], load=load, scale=AT_REST / NEAR)


@row("release", refuses=NO_MEMORY, few=2, blind=EVERYTHING, only=light)
def _release(at: Case) -> Judge:
    """The platform stays at an equilibrium that is stable by the oracle, whatever is changed by 1 %."""
    one = cdpr.solve(at.robot, at.pose, at.rest)
    found = cdpr.release(one, seconds=0.05)

    def judge(rig: Rig) -> float:
        K = oracle.stiffness(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, at.rest))
        return 0.0 if found.stays == (np.linalg.eigvalsh((K + K.T) / 2)[0] > 0) else np.inf

    return judge


def holdable(at: Case) -> bool:
    """Where elastic cables, which is what controllers plan with, hold the pose exactly."""
    return not at.names & (MEMORY | {"mass", "limits"}) and cdpr.compensate(at.robot, at.pose).exact


def tracked(at: Case, controller) -> Judge:
    """A platform that is held at rest, on the lengths that the winches have let out.

    Ropes that creep do it by up to 6e-5 of the weight in 0.02 s, before the platform has followed.
    """
    return moved(
        at, cdpr.track(at.robot, at.pose[None], controller, seconds=2e-4 if "creep" in at.names else 0.02), 0.0
    )


@row("track", "RigidLengths", few=6, blind=NEW, only=light)
def _track(at: Case) -> Judge:
    """Winches that hold the rigid lengths."""
    return tracked(at, cdpr.RigidLengths(at.robot))


@row("track", "ElasticLengths", "PoseFeedback", few=4, only=holdable)
def _track_elastic(at: Case) -> Judge:
    """Winches that hold compensated lengths, with feedback of the pose."""
    return tracked(at, cdpr.PoseFeedback(cdpr.ElasticLengths(at.robot)))


@row("track", "LengthsAndTensions", "HeldTensions", few=4, only=holdable)
def _track_tensions(at: Case) -> Judge:
    """Winches that hold tensions on some cables and lengths on the others, or tensions alone."""
    return worst(tracked(at, cdpr.LengthsAndTensions(at.robot)), tracked(at, cdpr.HeldTensions(at.robot)))


@row(
    "gym",
    refuses=NO_MEMORY | RIGID_EXITS | {"mass": "linear_density", "law": "nonlinear"},
    few=8,
)
def _gym(at: Case) -> Judge:
    """Where an environment's episode begins, as it is observed."""
    environment = gymnasium.make("cdpr_sim.learning:cdpr_sim/Track-v0", robot=at.robot, winch_force=np.inf)
    seen, _ = environment.reset(seed=1)
    n = at.robot.cables
    found = SimpleNamespace(
        position=seen[:3].astype(float),
        rotation_matrix=Rotation.from_rotvec(seen[3:6]).as_matrix(),
        tensions=seen[12 : 12 + n],
    )
    return near(at, found, rest=seen[12 + n : 12 + 2 * n].astype(float), load=0.0, scale=AT_REST / NEAR)


@row("jax", few=6, blind=NEW, refuses=NO_MEMORY, only=lambda at: importlib.util.find_spec("jax") is not None)
def _jax(at: Case) -> Judge:
    """The equilibrium as a function of JAX, where JAX is installed; its derivatives are those of ``sensitivity``."""
    import jax

    from cdpr_sim import jax as differentiable

    with jax.enable_x64(True):
        found = differentiable.solve(at.robot, at.pose, at.rest, external_wrench=at.load)
        numbers = {name: np.asarray(getattr(found, name)) for name in ("position", "rotation", "tensions")}
    return near(at, SimpleNamespace(rotation_matrix=numbers.pop("rotation"), **numbers))


# Files.


@row("load_robot", "write_robot", few=8, blind=NEW)
def _load_robot(at: Case) -> Judge:
    """A robot written to a file and read again; its equilibrium."""
    with tempfile.TemporaryDirectory() as folder:
        read = cdpr.load_robot(cdpr.write_robot(Path(folder) / "robot.toml", at.robot))
    return near(at, cdpr.solve(read, at.pose, at.rest, external_wrench=at.load))


READ_FROM_MODELS = NO_MEMORY | {
    "pulley": "expected a single rigid platform|expected two sites and no wheel or pulley",
    "law": "found a stiffness with further coefficients",
    "mass": "expected a single rigid platform|expected two sites and no wheel or pulley",
    "frame": "expected a single rigid platform|expected two sites and no wheel or pulley",
}  # fmt: skip


@row("import_robot", "to_mjcf", refuses=READ_FROM_MODELS, few=8)
def _import_robot(at: Case) -> Judge:
    """A robot written as a model with these rest lengths and imported: its pose; parts of line are one cable there."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        file.write_text(cdpr.to_mjcf(cdpr.Problem.of(at.robot, at.pose, at.rest)))
        read = cdpr.solve(cdpr.import_robot(file), at.pose, at.rest, external_wrench=at.load)
    return near(at, SimpleNamespace(position=read.position, rotation_matrix=read.rotation_matrix))


# Both methods.


@row("check", "compare", few=3, blind=NEW, only=light)
def _check(at: Case) -> Judge:
    """Statics and simulation agree; where statics says."""
    found = cdpr.check(at.robot, poses=at.pose[None], threads=1)
    assert found.agrees
    settled = cdpr.settle(at.robot, at.pose)
    assert cdpr.compare(at.rigid, settled).agrees
    off = RigidTransform.from_translation([2e-6, 0, 0]) * settled.pose
    assert not cdpr.compare(at.rigid, dataclasses.replace(settled, pose=off)).agrees
    return near(at, at.rigid, rest=at.robot.rest_lengths(at.pose), load=0.0)


@row("find_front", refuses=NO_MEMORY | RIGID_EXITS, few=1)
def _find_front(at: Case) -> Judge:
    """The tilt of the first layout of a short search."""
    found = cdpr.find_front(at.robot, [at.pose], within=0.01 * at.size, generations=1, population=5, threads=1)
    robot, tilt = found.robot(0), found.scores[0, [one.name for one in found.objectives].index("worst tilt")]
    one, rest = cdpr.solve(robot, at.pose), robot.rest_lengths(at.pose)

    def judge(rig: Rig) -> float:
        rig = dataclasses.replace(rig, exits=robot.exits, anchors=robot.anchors)
        _, R, _, _ = oracle.equilibrium(rig, one.position, one.rotation_matrix, oracle.Ropes(rig, rest))
        return abs(np.arccos(np.clip(R[2, 2], -1, 1)) - tilt) / 1e-7

    return judge


@row("find_layout", "validate_layout", refuses=NO_MEMORY | RIGID_EXITS, few=1)
def _find_layout(at: Case) -> Judge:
    """The equilibria of the layout that a short search ends with."""
    found = cdpr.find_layout(
        at.robot, [at.pose], within=0.01 * at.size, generations=1, population=5, polish=False, threads=1
    )
    given = dataclasses.replace(at, robot=found.robot)
    one = cdpr.validate_layout(found).after.settled[0]

    def judge(rig: Rig) -> float:
        rig = dataclasses.replace(rig, exits=found.robot.exits, anchors=found.robot.anchors)
        return apart(given, rig, one, rest=one.rest_lengths, load=0.0)

    return judge


# Tests.

NOT_ANSWERS = {
    "open_sweep": "reads a file", "read_measurements": "reads a file",
    "draw": "a picture", "show": "a picture", "write_video": "pictures",
    "write_report": "a page of answers", "list_robots": "names",
    **dict.fromkeys(("diagnose_model", "holding_controls", "settle_model", "tendon_tensions"), "of any MuJoCo model"),
}  # fmt: skip
"""Public functions that compute nothing of a robot, with the reason."""


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", ROWS)
def test_every_answer_is_the_oracles_for_every_mixture(name, robot) -> None:
    """With the robot's own numbers; or it is refused in the sentence of the row."""
    row, wrong = ROWS[name], []
    for at in cases_of(robot, row):
        sentences = [sentence for names, sentence in row.refuses.items() if names <= at.names]
        if sentences:
            with pytest.raises(cdpr.InvalidInput) as refused:
                row.ask(at)
            assert "\n" not in str(refused.value)
            assert any(re.search(one, str(refused.value)) for one in sentences), (sorted(at.names), str(refused.value))
        elif not (far := row.ask(at)(at.rig)) < 1:
            wrong.append((sorted(at.names), far))
    assert not wrong


def one_percent_wrong(rig: Rig, name: str) -> Rig:
    """A rig with 1 % more of a property; the first of points is beside its place by 1 % of the platform's size."""
    if name in ("exits", "anchors", "center_of_mass"):
        beside = np.array(getattr(rig, name))
        beside[(0,) * (beside.ndim - 1)] += 0.01 * rig.size * np.array([1.0, 0, 0.5])
        return dataclasses.replace(rig, **{name: beside})
    if name == "pulley_axis":
        axis = rig.pulley_axis + 0.01 * np.array([1.0, 0, 0])
        return dataclasses.replace(rig, pulley_axis=axis / np.linalg.norm(axis, axis=1, keepdims=True))
    more = 1.01 * getattr(rig, name)
    if name == "hysteresis":  # of the shares
        more[..., 1:] = rig.hysteresis[..., 1:]
    return dataclasses.replace(rig, **{name: more})


@pytest.mark.parametrize("name", ROWS)
def test_one_percent_of_each_property_fails_the_judgement(name) -> None:
    """Negative control: the answer for the robot is not that for one with 1 % more, in some case at least."""
    row = ROWS[name]
    asked = [at for at in cases_of(CONTROLLED, row) if not any(names <= at.names for names in row.refuses)]
    asked.sort(key=lambda at: len(at.names))  # the quickest first
    judge = functools.cache(lambda case: row.ask(asked[case]))
    every = {column: names for column, (_, names) in COLUMNS.items()} | {one: (one,) for one in OF_EVERY_ROBOT}
    for column, attributes in every.items():
        with_it = [k for k, at in enumerate(asked) if column in {*at.names, *OF_EVERY_ROBOT}]
        for attribute in attributes if with_it and column not in row.blind else ():
            assert any(judge(k)(one_percent_wrong(asked[k].rig, attribute)) > 1 for k in with_it), attribute


def test_the_oracle_imports_nothing_of_the_package() -> None:
    """NumPy alone, and what Python has."""
    imported = re.findall(r"^\s*(?:from|import) (\w+)", Path(oracle.__file__).read_text(), re.MULTILINE)
    assert set(imported) == {"__future__", "dataclasses", "numpy"}


def test_every_public_function_has_a_row() -> None:
    """Or is no answer, for a reason."""
    public = {name for name in cdpr.__all__ if inspect.isfunction(getattr(cdpr, name))}
    controllers = {name for name in cdpr.__all__ if hasattr(getattr(cdpr, name), "command")} - {"Controller"}
    named = {name for row in ROWS.values() for name in row.of}
    assert public | controllers <= named | set(NOT_ANSWERS)
    assert not named & set(NOT_ANSWERS)
    assert set(NOT_ANSWERS) <= public


def test_every_property_of_a_cable_has_a_column() -> None:
    """All arguments of ``Robot`` but those that every robot has; the oracle has a field for each but the limits."""
    columns = {name for _, names in COLUMNS.values() for name in names}
    assert set(inspect.signature(cdpr.Robot).parameters) == columns | NOT_OF_CABLES
    assert columns - {"force_min", "force_max", "breaking_load"} <= {field.name for field in dataclasses.fields(Rig)}


def test_each_property_occurs_alone_and_in_pairs_and_all_together() -> None:
    """Pairs without a memory also among mixtures without one, since many answers refuse memory."""
    assert {frozenset(), ELASTIC, frozenset(COLUMNS), *(frozenset([name]) for name in COLUMNS)} <= set(MIXTURES)
    small = MIXTURES[LISTED:]
    for within in (ELASTIC, frozenset(COLUMNS)):
        for pair in itertools.combinations(sorted(within), 2):
            assert any(set(pair) <= one <= within for one in small), pair
