"""The search for a better layout: differential evolution over whole batches, then a gradient to the bottom."""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, differential_evolution
from scipy.stats import qmc

from cdpr_sim.core.checks import FLAG, LONGEST_NAME, MOST_THREADS, checked_path, listed, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing, check_place
from cdpr_sim.core.progress import saying
from cdpr_sim.core.robot import Robot
from cdpr_sim.design.constraints import Constraint, constraints_of
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.design.objectives import Limits, Objective
from cdpr_sim.design.polish import polished
from cdpr_sim.design.robot_batch import Cases, LayoutEquilibria, rest

LEG = 20
"""Generations of one call to SciPy: after each the population can be stored, and each draws random numbers of its own,
so that a search that is gone on with finds what one in a single run finds."""

GENERATIONS = 200
POPULATION_PER_VARIABLE, LEAST_POPULATION = 10, 40
SPREAD = 1e-8
"""Relative spread of the population's objectives at which it has converged."""

HOLDS = 1e-9
"""A constraint may be missed by this fraction of what is asked: rounding, and what a gradient leaves."""

MOST_MISSING = 1e6
"""More than a million times what was asked is as bad as that."""

_FEASIBLE, _MISSING, _LOST = 0.0, 2.0, 4.0
"""Energies: -1 to 1 of layouts that hold all constraints, 2 to 3 of those that miss some, 3 to 4 without a rest."""


@dataclass(eq=False)
class LayoutEvaluator:
    """Scores layouts, and remembers the best.

    Attributes:
        space: of all layouts.
        cases: what each is asked.
        objective: what is made small or large.
        constraints: what must hold.
        limits: of tension, for the objectives that ask.
        reach: limit of displacement [m].
        threads: for the compiled solver.
    """

    space: Space
    cases: Cases
    objective: Objective
    constraints: Sequence[Constraint]
    limits: Limits
    reach: float
    threads: int | None
    best: np.ndarray | None = None
    energy: float = np.inf
    tried: int = 0
    least: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        robot: Robot,
        poses: Any,
        move: str | Move | Sequence[str | Move],
        within: ArrayLike | None,
        symmetry: str | Sequence[str],
        objective: Any,
        subject_to: Mapping[str, Any] | None,
        external_wrench: ArrayLike | None,
        stiffness: ArrayLike | None,
        progress: bool,
        threads: int | None,
    ) -> LayoutEvaluator:
        """Of a question as users ask it (``find_layout``).

        Raises:
            InvalidInput: something that cannot be right.
            UnknownName: nothing of that name moves, or is good, or must hold.
        """
        refuse_unless(Robot, robot=robot)
        refuse_unless(FLAG, progress=progress)
        if threads is not None:
            whole("threads", threads, 1, MOST_THREADS)
        moves = [move] if isinstance(move, (str, Move)) else listed("move", move, "names or Moves")
        space = Space.of(robot, [one if isinstance(one, Move) else Move(one, within) for one in moves], symmetry)
        wanted = Objective.of(objective)
        wanted.refuse_weight(robot)
        cases = Cases.of(robot, poses, external_wrench, stiffness)
        return cls(space, cases, wanted, *constraints_of(robot, subject_to), threads)

    def equilibria(self, values: Float[np.ndarray, "layouts variables"]) -> LayoutEquilibria:
        """Where the platforms of these layouts rest."""
        return rest(self.space.layouts(values), self.cases, self.threads)

    def scores(self, equilibria: LayoutEquilibria, objective: Objective | None = None) -> Float[np.ndarray, " layouts"]:
        """An objective, in SI units; nan where a layout has no rest in some case that the objective asks for.

        Raises:
            InvalidInput: an objective that is nan where all platforms rest.
        """
        objective = self.objective if objective is None else objective
        whole_ones = equilibria.converged.all(-1) if objective.equilibria else np.ones(len(equilibria), dtype=bool)
        with np.errstate(invalid="ignore"):
            found = np.asarray(objective.score(equilibria, self.limits), dtype=float)
        bad = whole_ones & np.isnan(found)
        if bad.any():
            raise InvalidInput(
                f"objective: {objective.name} returned nan for {int(bad.sum())} of {len(found)} layouts that rest "
                "at every pose, expected numbers"
            )
        return np.where(whole_ones, found, np.nan)

    def energies(self, values: Float[np.ndarray, "layouts variables"]) -> Float[np.ndarray, " layouts"]:
        """What the search makes small: first that all cases have a rest, then the constraints, then the objective."""
        equilibria = self.equilibria(values)
        scores = self.scores(equilibria)
        lost = np.isnan(scores)
        missing = np.minimum(self.missing(equilibria, lost).max(0, initial=0.0), MOST_MISSING)
        signed = np.nan_to_num(-scores if self.objective.largest else scores)
        found = _FEASIBLE + signed / (1 + np.abs(signed))
        broken = missing > HOLDS
        found[broken] = (_MISSING + missing / (1 + missing))[broken]
        found[lost] = (_LOST - equilibria.converged.mean(-1))[lost]
        self.tried += len(equilibria)
        row = int(found.argmin())
        if found[row] < self.energy:
            self.energy, self.best = float(found[row]), values[row].copy()
            each = self.missing(equilibria, lost)[:, row]
            self.least = {one.name: float(lack) for one, lack in zip(self.constraints, each, strict=True)}
        return found

    def missing(self, equilibria: LayoutEquilibria, lost: np.ndarray) -> Float[np.ndarray, "constraints layouts"]:
        """By how much each constraint is missed; by everything where there is no rest."""
        found = np.zeros((len(self.constraints), len(equilibria)))
        with np.errstate(invalid="ignore"):
            for row, one in enumerate(self.constraints):
                found[row] = np.where(lost, np.inf, np.nan_to_num(one.missing(equilibria), nan=np.inf))
        return found

    def told(self) -> str:
        """The best so far, in words."""
        if self.energy < _FEASIBLE + 1:
            return f"{self.objective.name} {self.objective.shown(self.value)}"
        if self.energy < _LOST - 1:
            return "no layout yet that holds all constraints"
        return "no layout yet that rests at every pose"

    @property
    def value(self) -> float:
        """The best objective so far; nan where no layout holds what it must."""
        if not self.energy < _FEASIBLE + 1:
            return np.nan
        signed = self.energy / (1 - abs(self.energy))
        return -signed if self.objective.largest else signed


def find_layout(
    robot: Robot,
    poses: Any,
    *,
    move: str | Move | Sequence[str | Move] = "exits",
    within: ArrayLike | None = None,
    symmetry: str | Sequence[str] = "detected",
    objective: str | Objective | Callable[[LayoutEquilibria], Any] = "worst tilt",
    subject_to: Mapping[str, Any] | None = None,
    external_wrench: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    seed: int = 0,
    generations: int = GENERATIONS,
    population: int | None = None,
    polish: bool = True,
    store: str | Path | None = None,
    progress: bool = False,
    threads: int | None = None,
) -> LayoutResult:
    """A better layout of ``robot``: one that moves a few of its numbers, and is good at all of ``poses``.

    Global first, by differential evolution (Storn and Price 1997, doi:10.1023/A:1008202821328; SciPy's, vectorised,
    over all cores), then exact: where the objective has a gradient, sequential quadratic programming with the exact
    derivatives of the rests. It promises no more than it was asked: the poses, loads and stiffnesses given here.
    ``validate_layout`` asks MuJoCo, and between the poses.

    Args:
        robot: the robot to begin with.
        poses: commanded, as ``solve_many`` takes them; the winches command each by the rigid lengths of each layout.
        move: what may move: names of ``MOVABLE``, or ``Move`` objects, which know boxes, lines and cables of their own.
        within: how far, for what is given by name (see ``Move``).
        symmetry: which ties points: "detected" for all that the robot has, "none", or "half-turn", "mirror-x" and
            "mirror-y" about the middle of the exits.
        objective: a name of ``OBJECTIVES``; or a function of the rests, of shape (layouts, cases), that returns
            (layouts,), to be made small.
        subject_to: what must hold at every pose: "tensions": (smallest, largest) [N]; "all taut": True; "stable": True;
            "clearance": least distance [m], see ``clearances``; or the name of an objective and its limit, in SI units.
        external_wrench: (6,) or several (loads, 6) [N, N m]: each pose is asked under each of them.
        stiffness: factors of the axial stiffness, one or several: each pose is asked with each of them.
        seed: of the random numbers: the same one finds the same layout.
        generations: at most.
        population: layouts of each generation; default: ten for each variable, 40 at least.
        polish: whether to go on with the gradient.
        store: an .npz file that the search is kept in after every ``LEG`` generations, and gone on with.
        progress: say the best so far on standard error.
        threads: of the compiled solver; default: one for each core.

    Returns:
        The best layout found; Ctrl-C returns the best so far, and its ``message`` says so.

    Raises:
        InvalidInput: bounds crossed, a symmetry that the robot has not got, an objective that returns nan, poses that
            no layout tried can reach, or constraints that none meets: the message says which is missed most.
        UnknownName: nothing of that name moves, or is good, or must hold.
    """
    evaluator = LayoutEvaluator.of(
        robot, poses, move, within, symmetry, objective, subject_to, external_wrench, stiffness, progress, threads
    )  # fmt: skip
    space, cases, wanted = evaluator.space, evaluator.cases, evaluator.objective
    refuse_unless(FLAG, polish=polish)
    whole("generations", generations, 1)
    still = np.zeros((1, len(space)))
    equilibria_before = rest(space.layouts(still), cases, threads)
    before = float(evaluator.scores(equilibria_before)[0])

    history: list[tuple[float, float, float]] = []
    with saying(progress) as say:
        try:
            message = _evolve(evaluator, seed, generations, population, store, history, say)
        except KeyboardInterrupt:
            if evaluator.best is None:
                raise
            message = f"Interrupted after {len(history)} generations: this is the best so far."
        if evaluator.best is None or not evaluator.energy < _FEASIBLE + 1:
            raise InvalidInput(_why_none(evaluator))
        if polish and wanted.smooth and robot.cabling.massless and "Interrupted" not in message:
            say(f"{evaluator.told()}; polishing")
            try:
                evaluator.energies(polished(evaluator.best, space, cases, wanted, evaluator.limits, evaluator.reach))
            except KeyboardInterrupt:
                message += " The polish was interrupted."
    equilibria = evaluator.equilibria(evaluator.best[None])
    return LayoutResult(
        robot=named(equilibria.layouts.robot_at(0), wanted),
        given=robot,
        objective=wanted,
        before=before,
        after=float(evaluator.scores(equilibria)[0]),
        cases=cases,
        equilibria_before=equilibria_before,
        equilibria=equilibria,
        history=np.array(history).reshape(-1, 3),
        tried=evaluator.tried,
        message=message,
        values=evaluator.best,
        variables=space.names,
    )


def named(robot: Robot, *objectives: Objective) -> Robot:
    """Under a name of its own, which says where the numbers come from."""
    of = " and ".join(one.name for one in objectives)
    return robot.replace(
        name=f"{robot.name[: LONGEST_NAME - 7]}-better",
        description=f"{robot.description or robot.name}, laid out anew for {of}",
        source=f"find_layout of cdpr_sim, from {robot.source or robot.name}",
    )


def _evolve(
    evaluator: LayoutEvaluator,
    seed: int,
    generations: int,
    population: int | None,
    store: str | Path | None,
    history: list[tuple[float, float, float]],
    say: Callable[[str], None],
) -> str:
    """Generations in legs; how it ended, in a sentence."""
    space = evaluator.space
    free = space.upper > space.lower
    bounds = list(zip(space.lower[free], space.upper[free], strict=True))
    size = (
        max(LEAST_POPULATION, POPULATION_PER_VARIABLE * len(bounds))
        if population is None
        else whole("population", population, 5)
    )
    whole("seed", seed, 0)

    def full(columns: Float[np.ndarray, "free layouts"]) -> Float[np.ndarray, "layouts variables"]:
        values = np.tile(space.given, (columns.shape[1], 1))
        values[:, free] = columns.T
        return values

    def energies(columns: np.ndarray) -> np.ndarray:
        columns = columns.reshape(len(bounds), -1)
        return evaluator.energies(full(columns))

    identity = _identity(evaluator, seed, size)
    done, crowd = 0, None
    if store is not None:
        store = checked_path("store", store)
        if store.exists():
            done, crowd, told = _resumed(store, identity)
            history.extend(map(tuple, told))
            evaluator.tried = int(told[-1, 1]) if len(told) else 0
        else:
            check_place(store, (".npz",))
    if crowd is None:
        sampler = qmc.LatinHypercube(len(bounds), rng=np.random.default_rng([seed, 0]))
        crowd = qmc.scale(sampler.random(size), *np.array(bounds).T)
        crowd[0] = space.given[free]

    def after_each(intermediate_result: OptimizeResult) -> None:
        del intermediate_result
        history.append((len(history) + 1, evaluator.tried, evaluator.value))
        say(f"generation {len(history)} of {generations}, {evaluator.tried:,} layouts: {evaluator.told()}")

    if done >= generations:  # all is done: only the best has to be found again
        evaluator.energies(full(crowd.T))
    while done < generations:
        length = min(LEG, generations - done)
        result = differential_evolution(
            energies, bounds, init=crowd, maxiter=length,  # pyright: ignore[reportArgumentType]
            tol=SPREAD, atol=0, vectorized=True, polish=False,
            updating="deferred", callback=after_each, rng=np.random.default_rng([seed, 1, done]),
        )  # fmt: skip
        done += length
        crowd, last = result.population, result.population_energies
        if store is not None:
            _keep(store, identity, done, crowd, np.array(history).reshape(-1, 3))
        spread = float(np.std(last))
        if spread <= SPREAD * abs(float(np.mean(last))):
            return f"Converged after {len(history)} generations."
    return f"Stopped after {len(history)} generations, as asked."


def _why_none(evaluator: LayoutEvaluator) -> str:
    """Why no layout will do, in a sentence."""
    assert evaluator.best is not None
    if evaluator.energy < _LOST - 1:
        name = max(evaluator.least, key=lambda one: evaluator.least[one])
        others = [one for one, lack in evaluator.least.items() if lack > HOLDS and one != name]
        also = f" and also {', '.join(others)}" if others else ""
        return (
            f"subject_to: found no layout that holds everything among {evaluator.tried:,} tried; the nearest misses "
            f"{name!r} the most, by {evaluator.least[name]:.2g} of what is asked{also}; expected looser constraints or "
            "wider bounds"
        )
    equilibria = evaluator.equilibria(evaluator.best[None])
    lost = np.flatnonzero(~equilibria.converged[0])
    x, y, z = evaluator.cases.positions[lost[0]]
    return (
        f"poses: found no layout among {evaluator.tried:,} tried whose platform rests at all of them; "
        f"the nearest has no "
        f"rest at {len(lost)} of {len(evaluator.cases)}, the first at ({x:g}, {y:g}, {z:g}) m; expected poses within "
        "reach, or wider bounds"
    )


def _identity(evaluator: LayoutEvaluator, seed: int, size: int) -> str:
    """Of what is searched: another for every change of the question."""
    space, cases = evaluator.space, evaluator.cases
    state = hashlib.sha256()
    arrays = [getattr(space, name) for name in ("lower", "upper", "exits", "anchors", "center", "log_stiffness")]
    arrays += [space.robot.cabling.packed, space.robot.center_of_mass, np.array(space.robot.mass), space.robot.inertia]
    arrays += [cases.positions, cases.rotations, cases.wrench, cases.factors, *evaluator.limits]
    for array in arrays:
        state.update(np.ascontiguousarray(array, dtype=float).tobytes())
    for word in (evaluator.objective.name, *(one.name for one in evaluator.constraints), str(seed), str(size)):
        state.update(word.encode() + b"\0")
    return state.hexdigest()


def _keep(store: Path, identity: str, done: int, crowd: np.ndarray, history: np.ndarray) -> None:
    with appearing(store) as (temporary,), open(temporary, "wb") as file:
        np.savez(file, identity=identity, done=done, crowd=crowd, history=history)


def _resumed(store: Path, identity: str) -> tuple[int, np.ndarray, np.ndarray]:
    """(generations done, population, history) of a search that was begun.

    Raises:
        InvalidInput: no such file, or that of another question.
    """
    if not store.is_file():
        raise InvalidInput(f"{store}: found a folder, a pipe or a device, expected the store of a search or a new name")
    try:
        with open(store, "rb") as file, np.load(file, allow_pickle=False) as kept:
            same, found = str(kept["identity"]), (int(kept["done"]), kept["crowd"], kept["history"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        raise InvalidInput(f"{store}: found a file that is not the store of a search, or a damaged one") from None
    if same != identity:
        raise InvalidInput(
            f"{store}: holds the search of another question (robot, poses, bounds, objective or seed), expected the "
            "same or a new file"
        )
    return found
