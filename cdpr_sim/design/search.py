"""Layout optimisation: differential evolution over whole batches, then local refinement by gradients."""

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

from cdpr_sim.core.checks import FLAG, LONGEST_NAME, checked_path, listed, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing, check_place
from cdpr_sim.core.on_threads import checked_threads
from cdpr_sim.core.progress import saying
from cdpr_sim.core.robot import Robot
from cdpr_sim.design.constraints import Constraint, constraints_of
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria, solve_layouts
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.design.objectives import Limits, Objective
from cdpr_sim.design.polish import SMALLER, polished

LEG = 20
"""Generations per call to SciPy. The population is stored after each call, and each call has its own random numbers, so
that a resumed search gives the same result as an uninterrupted one."""

GENERATIONS = 200
POPULATION_PER_VARIABLE, LEAST_POPULATION = 10, 40
SPREAD = 1e-8
"""Relative spread of the population's objectives at which it has converged."""

ROUNDS, GAIN = 5, 1e-6
"""Largest number of rounds of local refinement, and the relative gain that is worth another one."""

CONSTRAINT_TOLERANCE = 1e-9
"""Allowed violation of a constraint, as a fraction of its limit: rounding, and the accuracy of the refinement."""

MOST_VIOLATION = 1e6
"""Constraint violations are clipped to this value."""

_FEASIBLE, _VIOLATED, _UNSOLVED = 1.0, 2.0, 4.0
"""Energies: -1 to 1 for feasible layouts, 2 to 3 if a constraint is violated, 3 to 4 without an equilibrium in some
case."""


@dataclass(eq=False)
class LayoutEvaluator:
    """Evaluates layouts, and keeps the best.

    Attributes:
        space: space of layouts.
        cases: poses, loads and stiffnesses.
        objective: what is minimised or maximised.
        constraints: that every layout must satisfy.
        limits: tension limits, for objectives that use them.
        reach: limit of how far points move [m].
        threads: for the compiled solver.
        best: values of the variables of the best layout so far.
        energy: its energy.
        value: its objective; nan if no layout is feasible.
        layouts_evaluated: number of layouts evaluated.
        violations_of_best: its violation of each constraint, by name.
    """

    space: Space
    cases: Cases
    objective: Objective
    constraints: Sequence[Constraint]
    limits: Limits
    reach: float
    threads: int
    best: np.ndarray | None = None
    energy: float = np.inf
    value: float = np.nan
    layouts_evaluated: int = 0
    violations_of_best: dict[str, float] = field(default_factory=dict)

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
        threads: int,
    ) -> LayoutEvaluator:
        """Evaluator of the arguments of ``find_layout``.

        Raises:
            InvalidInput: an invalid argument.
            UnknownName: no such variable part, objective or constraint.
        """
        refuse_unless(Robot, robot=robot)
        robot.cabling.refuse_memory()
        robot.cabling.refuse_unknown("layout search", "find_layout")
        refuse_unless(FLAG, progress=progress)
        checked_threads(threads)
        moves = [move] if isinstance(move, (str, Move)) else listed("move", move, "names or Moves")
        space = Space.of(robot, [one if isinstance(one, Move) else Move(one, within) for one in moves], symmetry)
        wanted = Objective.of(objective)
        cases = Cases.of(robot, poses, external_wrench, stiffness)
        return cls(space, cases, wanted, *constraints_of(robot, subject_to), threads)

    def equilibria(self, values: Float[np.ndarray, "layouts variables"]) -> LayoutEquilibria:
        """Equilibria of these layouts."""
        return solve_layouts(self.space.layouts(values), self.cases, self.threads)

    def scores(self, equilibria: LayoutEquilibria, objective: Objective | None = None) -> Float[np.ndarray, " layouts"]:
        """Objective of each layout, in SI units; nan where a layout lacks an equilibrium that the objective needs.

        Raises:
            InvalidInput: an objective that is nan although all equilibria exist.
        """
        objective = self.objective if objective is None else objective
        whole_ones = equilibria.converged.all(-1) if objective.equilibria else np.ones(len(equilibria), dtype=bool)
        with np.errstate(invalid="ignore"):
            found = np.asarray(objective.score(equilibria, self.limits), dtype=float)
        bad = whole_ones & np.isnan(found)
        if bad.any():
            raise InvalidInput(
                f"objective: {objective.name} returned nan for {int(bad.sum())} of {len(found)} layouts with "
                "an equilibrium at every pose, expected numbers"
            )
        return np.where(whole_ones, found, np.nan)

    def energies(self, values: Float[np.ndarray, "layouts variables"]) -> Float[np.ndarray, " layouts"]:
        """Function minimised by the search: cases without equilibrium first, then constraints, then the objective."""
        equilibria = self.equilibria(values)
        scores = self.scores(equilibria)
        unsolved = np.isnan(scores)
        each = self.violations(equilibria, unsolved)
        violations = np.minimum(each.max(0, initial=0.0), MOST_VIOLATION)
        signed = np.nan_to_num(-scores if self.objective.largest else scores)
        energies = signed / (1 + np.abs(signed))
        violated = violations > CONSTRAINT_TOLERANCE
        energies[violated] = (_VIOLATED + violations / (1 + violations))[violated]
        energies[unsolved] = (_UNSOLVED - equilibria.converged.mean(-1))[unsolved]
        self.layouts_evaluated += len(equilibria)
        row = int(energies.argmin())
        if energies[row] < self.energy:
            self.energy, self.best = float(energies[row]), values[row].copy()
            self.value = float(scores[row]) if self.energy < _FEASIBLE else np.nan
            names = (one.name for one in self.constraints)
            self.violations_of_best = dict(zip(names, each[:, row].tolist(), strict=True))
        return energies

    def allows(self, equilibria: LayoutEquilibria, scores: Float[np.ndarray, "*"]) -> bool:
        """Whether one layout has an equilibrium in every case and satisfies all constraints."""
        unsolved = np.array([bool(np.isnan(scores).any())])
        return not unsolved[0] and float(self.violations(equilibria, unsolved).max(initial=0)) <= CONSTRAINT_TOLERANCE

    def violations(
        self, equilibria: LayoutEquilibria, unsolved: np.ndarray
    ) -> Float[np.ndarray, "constraints layouts"]:
        """Violation of each constraint; infinite for layouts without an equilibrium in some case."""
        found = np.zeros((len(self.constraints), len(equilibria)))
        with np.errstate(invalid="ignore"):
            for row, one in enumerate(self.constraints):
                found[row] = np.where(unsolved, np.inf, np.nan_to_num(one.violation(equilibria), nan=np.inf))
        return found

    def describe_best(self) -> str:
        """The best layout so far, in a phrase."""
        if self.energy < _FEASIBLE:
            return f"{self.objective.name} {self.objective.shown(self.value)}"
        if self.energy < _UNSOLVED - 1:
            return "no layout yet that satisfies all constraints"
        return "no layout yet with an equilibrium at every pose"


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
    threads: int = 0,
) -> LayoutResult:
    """Optimise the layout of ``robot`` for all of ``poses``.

    First global, by differential evolution (Storn and Price 1997, doi:10.1023/A:1008202821328; SciPy's, vectorised,
    over all cores); then local, if the objective has a gradient, by sequential quadratic programming with
    derivatives of the equilibria. The result holds for the given poses, loads and stiffnesses only;
    ``validate_layout`` verifies it in MuJoCo, also between the poses.

    Args:
        robot: the robot to start from.
        poses: commanded, as ``solve_many`` takes them; the winches command each by the rigid lengths of each layout.
        move: what may move: names of ``MOVABLE``, or ``Move`` objects with their own boxes, lines and cables.
        within: range of what is given by name (see ``Move``).
        symmetry: symmetry that couples points: "detected" for all that the robot has, "none", or "half-turn",
            "mirror-x" and "mirror-y" about the middle of the exits.
        objective: a name of ``OBJECTIVES``; or a function of the equilibria, of shape (layouts, cases), that returns
            (layouts,), to be minimised.
        subject_to: constraints at every pose: "tensions": (smallest, largest) [N]; "all taut": True; "stable": True;
            "clearance": least distance [m], see ``clearances``; or the name of an objective and its limit, in SI units.
        external_wrench: (6,) or several (loads, 6) [N, N m]: each pose is evaluated under each of them.
        stiffness: factors of the axial stiffness, one or several: each pose is evaluated with each of them.
        seed: of the random numbers: the same seed gives the same layout.
        generations: at most.
        population: layouts of each generation; default: ten for each variable, 40 at least.
        polish: whether to refine the result with gradients.
        store: an .npz file in which the search is stored after every ``LEG`` generations, and from which it is resumed.
        progress: whether to print the best layout so far on standard error.
        threads: of the compiled solver; 0 for one per processor.

    Returns:
        The best layout, or the given one if none is ``better``; after Ctrl-C the best so far, with a corresponding
        ``message``.

    Raises:
        InvalidInput: crossed bounds, a symmetry that the robot does not have, an objective that returns nan, poses that
            no layout can reach, or constraints that none satisfies: the message names the one violated most.
        UnknownName: no such variable part, objective or constraint.
    """
    evaluator = LayoutEvaluator.of(
        robot, poses, move, within, symmetry, objective, subject_to, external_wrench, stiffness, progress, threads
    )  # fmt: skip
    space, cases, wanted = evaluator.space, evaluator.cases, evaluator.objective
    refuse_unless(FLAG, polish=polish)
    whole("generations", generations, 1)
    equilibria_before = evaluator.equilibria(np.zeros((1, len(space))))
    before = float(evaluator.scores(equilibria_before)[0])

    history: list[tuple[float, float, float]] = []
    with saying(progress) as say:
        try:
            message = _evolve(evaluator, seed, generations, population, store, history, say)
        except KeyboardInterrupt:
            if evaluator.best is None:
                raise
            message = f"Interrupted after {len(history)} generations: this is the best layout so far."
        if evaluator.best is None or not evaluator.energy < _FEASIBLE:
            raise InvalidInput(_why_none(evaluator))
        if polish and wanted.smooth and "Interrupted" not in message:
            say(f"{evaluator.describe_best()}; refining")
            try:
                _refine(evaluator)
            except KeyboardInterrupt:
                message += " The local refinement was interrupted."
    best = evaluator.best
    equilibria = evaluator.equilibria(best[None])
    after, allowed = float(evaluator.scores(equilibria)[0]), evaluator.allows(equilibria_before, np.array([before]))
    better = not allowed or wanted.better(after, before)
    if not better:
        best, equilibria, after = np.zeros(len(space)), equilibria_before, before
    return LayoutResult(
        robot=named(equilibria.layouts.robot_at(0), wanted) if better else robot,
        given=robot,
        objective=wanted,
        before=before,
        after=after,
        cases=cases,
        limits=evaluator.limits,
        given_allowed=allowed,
        equilibria_before=equilibria_before,
        equilibria=equilibria,
        history=np.array(history).reshape(-1, 3),
        layouts_evaluated=evaluator.layouts_evaluated,
        message=message,
        values=best,
        variables=space.names,
    )


def named(robot: Robot, *objectives: Objective) -> Robot:
    """The robot with a name, description and source that state its origin."""
    of = " and ".join(one.name for one in objectives)
    return robot.replace(
        name=f"{robot.name[: LONGEST_NAME - 7]}-better",
        description=f"{robot.description or robot.name}, optimised for {of}",
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
    """Run the generations; return how the search ended, in a sentence."""
    space, free = evaluator.space, evaluator.space.free
    bounds = list(zip(space.lower[free], space.upper[free], strict=True))
    size = (
        max(LEAST_POPULATION, POPULATION_PER_VARIABLE * len(bounds))
        if population is None
        else whole("population", population, 5)
    )
    whole("seed", seed, 0)

    def energies(columns: np.ndarray) -> np.ndarray:
        return evaluator.energies(space.completed(columns.reshape(len(bounds), -1).T))

    identity = _identity(evaluator, seed, size)
    done, members = 0, None
    if store is not None:
        store = checked_path("store", store)
        if store.exists():
            done, members, earlier = _resumed(store, identity)
            history.extend(map(tuple, earlier))
            evaluator.layouts_evaluated = int(earlier[-1, 1]) if len(earlier) else 0
        else:
            check_place(store, (".npz",))
    if members is None:
        sampler = qmc.LatinHypercube(len(bounds), rng=np.random.default_rng([seed, 0]))
        members = qmc.scale(sampler.random(size), *np.array(bounds).T)
        members[0] = space.given[free]

    def after_each(intermediate_result: OptimizeResult) -> None:
        del intermediate_result
        count = evaluator.layouts_evaluated
        history.append((len(history) + 1, count, evaluator.value))
        say(f"generation {len(history)} of {generations}, {count:,} layouts: {evaluator.describe_best()}")

    if done >= generations:  # a finished search: only the best layout has to be determined again
        evaluator.energies(space.completed(members))
    while done < generations:
        length = min(LEG, generations - done)
        result = differential_evolution(
            energies, bounds, init=members, maxiter=length,  # pyright: ignore[reportArgumentType]
            tol=SPREAD, atol=0, vectorized=True, polish=False,
            updating="deferred", callback=after_each, rng=np.random.default_rng([seed, 1, done]),
        )  # fmt: skip
        done += length
        members, last = result.population, result.population_energies
        if store is not None:
            rows = np.array(history).reshape(-1, 3)
            with appearing(store) as (temporary,), open(temporary, "wb") as file:
                np.savez(file, identity=identity, done=done, members=members, history=rows)
        spread = float(np.std(last))
        if spread <= SPREAD * abs(float(np.mean(last))):
            return f"Converged after {len(history)} generations."
    return f"Stopped after {len(history)} generations, the given limit."


def _refine(evaluator: LayoutEvaluator) -> None:
    """Refine the best layout until a round of refinements, each from the result of the one before, gains nothing."""
    space, cases, objective, limits = evaluator.space, evaluator.cases, evaluator.objective, evaluator.limits
    for _ in range(ROUNDS):
        begun = evaluator.energy
        for smaller in SMALLER:
            assert evaluator.best is not None
            evaluator.energies(polished(evaluator.best, space, cases, objective, limits, evaluator.reach, smaller))
        if not evaluator.energy < begun - GAIN * abs(begun):
            return


def _why_none(evaluator: LayoutEvaluator) -> str:
    """Why there is no feasible layout, in a sentence."""
    assert evaluator.best is not None
    if evaluator.energy < _UNSOLVED - 1:
        violations = evaluator.violations_of_best
        name = max(violations, key=lambda one: violations[one])
        others = [one for one, value in violations.items() if value > CONSTRAINT_TOLERANCE and one != name]
        also = f" and also {', '.join(others)}" if others else ""
        return (
            f"subject_to: found no feasible layout among {evaluator.layouts_evaluated:,} evaluated; the closest "
            f"violates {name!r} the most, by {violations[name]:.2g} of its limit{also}; expected looser constraints or "
            "wider bounds"
        )
    equilibria = evaluator.equilibria(evaluator.best[None])
    unsolved = np.flatnonzero(~equilibria.converged[0])
    x, y, z = evaluator.cases.positions[unsolved[0]]
    return (
        f"poses: found no layout among {evaluator.layouts_evaluated:,} evaluated with an equilibrium at all of them; "
        f"the closest has none at {len(unsolved)} of {len(evaluator.cases)}, the first at ({x:g}, {y:g}, {z:g}) m; "
        "expected poses within reach, or wider bounds"
    )


def _identity(evaluator: LayoutEvaluator, seed: int, size: int) -> str:
    """Hash of the search: different for every change of its arguments."""
    space, cases = evaluator.space, evaluator.cases
    state = hashlib.sha256()
    arrays = [space.lower, space.upper]
    arrays += [space.by[name] for name in ("exits", "anchors", "center_of_mass", "axial_stiffness")]
    arrays += [space.robot.cabling.packed, space.robot.center_of_mass, np.array(space.robot.mass), space.robot.inertia]
    arrays += [cases.positions, cases.rotations, cases.wrench, cases.factors, *evaluator.limits]
    for array in arrays:
        state.update(np.ascontiguousarray(array, dtype=float).tobytes())
    for word in (evaluator.objective.name, *(one.name for one in evaluator.constraints), str(seed), str(size)):
        state.update(word.encode() + b"\0")
    return state.hexdigest()


def _resumed(store: Path, identity: str) -> tuple[int, np.ndarray, np.ndarray]:
    """(generations done, population, history) of a stored search.

    Raises:
        InvalidInput: no such file, or one of a search with other arguments.
    """
    if not store.is_file():
        raise InvalidInput(f"{store}: found a folder, a pipe or a device, expected the store of a search or a new name")
    try:
        with open(store, "rb") as file, np.load(file, allow_pickle=False) as kept:
            same, found = str(kept["identity"]), (int(kept["done"]), kept["members"], kept["history"])
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error):
        raise InvalidInput(f"{store}: found a file that is not the store of a search, or a damaged one") from None
    if same != identity:
        raise InvalidInput(
            f"{store}: holds a search with other arguments (robot, poses, bounds, objective or seed), expected the "
            "same arguments or a new file"
        )
    return found
