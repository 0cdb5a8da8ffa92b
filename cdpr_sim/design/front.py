"""Pareto front of layouts for two conflicting objectives, by NSGA-II."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core import extras
from cdpr_sim.core.checks import Frozen, listed, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.progress import saying
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.layout_equilibria import Cases
from cdpr_sim.design.layout_result import outside_frame
from cdpr_sim.design.moves import Move
from cdpr_sim.design.objectives import Objective
from cdpr_sim.design.search import CONSTRAINT_TOLERANCE, LayoutEvaluator, named

UNSOLVED = 10.0
"""Constraint violation assigned to a layout without an equilibrium in some case."""


@dataclass(frozen=True, eq=False)
class Front(Frozen, HtmlRepr):
    """Pareto front of layouts, ordered by the first objective, the best first.

    Attributes:
        given: the robot that the search started from.
        objectives: the two objectives.
        before: objectives of the given robot, (2,) in SI units; nan if it has no equilibrium at some pose.
        scores: objectives of each layout, (layouts, 2) in SI units.
        layouts: the robots.
        cases: poses, loads and stiffnesses that each layout was evaluated at.
        layouts_evaluated: number of layouts evaluated.
        given_allowed: whether the given layout has an equilibrium in every case and satisfies the constraints.
    """

    given: Robot
    objectives: tuple[Objective, Objective]
    before: Float[np.ndarray, "2"]
    scores: Float[np.ndarray, "layouts 2"]
    layouts: RobotBatch
    cases: Cases
    layouts_evaluated: int
    given_allowed: bool = True

    @property
    def better(self) -> bool:
        """Whether a layout is better than the given one by an objective, or since that violates a constraint."""
        pairs = [zip(self.objectives, row, self.before, strict=True) for row in self.scores]
        return not self.given_allowed or any(goal.better(*values) for row in pairs for goal, *values in row)

    @property
    def none_better(self) -> str:
        """That no layout is better, in a sentence."""
        goals = zip(self.objectives, self.before, strict=True)
        given = " and ".join(f"{goal.name} {goal.shown(value)}" for goal, value in goals)
        count = f"{self.layouts_evaluated:,} layouts evaluated"
        return f"{self.given.name}: {given} as given, and none of {count} is better by either."

    def __len__(self) -> int:
        return len(self.scores)

    def thinned(self, most: int) -> Front:
        """At most ``most`` layouts, evenly along the front.

        Returns:
            A front of ``most`` layouts or fewer.
        """
        if len(self) <= whole("most", most, 1):
            return self
        rows = np.linspace(0, len(self) - 1, most).round().astype(int)
        return dataclasses.replace(self, scores=self.scores[rows], layouts=self.layouts.take(rows))

    def robot(self, row: int) -> Robot:
        """The robot of one layout.

        Returns:
            The robot with the layout of that row of ``scores``.
        """
        return named(self.layouts.robot_at(row), *self.objectives)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons why some of these layouts can probably not be built, a sentence each."""
        outside = [row + 1 for row in range(len(self)) if outside_frame(self.layouts.robot_at(row), self.given).any()]
        if not outside:
            return ()
        return (f"{len(outside)} of {len(self)} layouts have exits outside the frame: {', '.join(map(str, outside))}.",)

    def __repr__(self) -> str:
        one, other = self.objectives
        found = f"{len(self)} layouts" if self.better else "no layout better than the given one"
        return f"<Front of {self.given.name!r}: {found}, {one.name} against {other.name}>"


def find_front(
    robot: Robot,
    poses: Any,
    objectives: tuple[Any, Any] = ("points moved", "worst tilt"),
    *,
    move: str | Move | Sequence[str | Move] = "exits",
    within: ArrayLike | None = None,
    symmetry: str | Sequence[str] = "detected",
    subject_to: Mapping[str, Any] | None = None,
    external_wrench: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    seed: int = 0,
    generations: int = 200,
    population: int = 100,
    progress: bool = False,
    threads: int = 0,
) -> Front:
    """The Pareto front of two objectives, by pymoo's NSGA-II (Deb et al. 2002, doi:10.1109/4235.996017).

    Args:
        robot: the robot to start from.
        poses: as for ``find_layout``; so are all arguments without further explanation.
        objectives: two objectives of ``find_layout``.
        move: what may move.
        within: range of the displacements.
        symmetry: symmetry that couples points.
        subject_to: constraints.
        external_wrench: one load or several.
        stiffness: one factor or several.
        seed: of the random numbers.
        generations: number of generations.
        population: layouts of each generation, and at most of the front.
        progress: whether to print progress on standard error.
        threads: of the compiled solver; 0 for one per processor.

    Returns:
        The layouts of the front with their scores, (layouts, 2) in SI units; ``better`` says whether one is better than
        the given layout.

    Raises:
        InvalidInput: as ``find_layout``.
        MissingExtra: pymoo is not installed.
    """
    extras.require("design", "find_front")
    from pymoo.algorithms.moo.nsga2 import NSGA2  # pyright: ignore[reportMissingImports]
    from pymoo.core.callback import Callback  # pyright: ignore[reportMissingImports]
    from pymoo.core.problem import Problem  # pyright: ignore[reportMissingImports]
    from pymoo.optimize import minimize  # pyright: ignore[reportMissingImports]

    objectives = tuple(listed("objectives", objectives, "two"))
    if len(objectives) != 2:
        raise InvalidInput(f"objectives: found {len(objectives)}, expected two")
    evaluator = LayoutEvaluator.of(
        robot, poses, move, within, symmetry, objectives[0], subject_to, external_wrench, stiffness, progress, threads,
    )  # fmt: skip
    goals = (evaluator.objective, Objective.of(objectives[1]))
    whole("seed", seed, 0)
    space, free = evaluator.space, evaluator.space.free

    signs = np.array([-1.0 if goal.largest else 1.0 for goal in goals])

    class LayoutProblem(Problem):
        def __init__(self) -> None:
            super().__init__(
                n_var=int(free.sum()), n_obj=2, n_ieq_constr=len(evaluator.constraints) + 1, xl=space.lower[free],
                xu=space.upper[free],
            )  # fmt: skip

        def _evaluate(self, x, out, *args, **kwargs) -> None:
            equilibria = evaluator.equilibria(space.completed(x))
            scores = np.stack([evaluator.scores(equilibria, goal) for goal in goals], axis=1)
            unsolved = np.asarray(np.isnan(scores).any(1))
            violations = evaluator.violations(equilibria, unsolved)
            violations = np.minimum(np.vstack([violations, np.where(unsolved, UNSOLVED, 0)]), UNSOLVED).T
            evaluator.layouts_evaluated += len(x)
            out["F"], out["G"] = np.nan_to_num(scores * signs), violations - CONSTRAINT_TOLERANCE

    first = np.random.default_rng(seed).uniform(
        space.lower[free], space.upper[free], (whole("population", population, 5), int(free.sum()))
    )
    shrunk = np.linspace(0, 1, len(first))[:, None]
    first = space.given[free] + shrunk * (first - space.given[free])  # from the given robot to the whole range
    with saying(progress) as say:

        class Progress(Callback):
            def notify(self, algorithm) -> None:
                say(f"generation {algorithm.n_gen} of {generations}, {evaluator.layouts_evaluated:,} layouts")

        search = NSGA2(pop_size=len(first), sampling=first)  # pyright: ignore[reportArgumentType]  (takes arrays too)
        ended = "n_gen", whole("generations", generations, 1)
        result = minimize(LayoutProblem(), search, ended, seed=seed, callback=Progress())
    if result.X is None:
        raise InvalidInput(
            "subject_to: found no layout that satisfies all constraints and has an equilibrium at every pose among "
            f"{evaluator.layouts_evaluated:,} evaluated; find_layout reports the constraint violated most"
        )
    scores = signs * np.array(result.F, ndmin=2)
    order = np.argsort(signs[0] * scores[:, 0])
    layouts = space.layouts(space.completed(np.atleast_2d(result.X))[order])
    given = evaluator.equilibria(np.zeros((1, len(space))))
    before = np.array([evaluator.scores(given, goal)[0] for goal in goals])
    allowed = evaluator.allows(given, before)
    return Front(robot, goals, before, scores[order], layouts, evaluator.cases, evaluator.layouts_evaluated, allowed)
