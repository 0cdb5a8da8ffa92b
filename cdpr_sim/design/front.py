"""Two goals that pull apart: the layouts none of which is better in both (a Pareto front), by NSGA-II."""

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
from cdpr_sim.design.layout_result import outside_frame
from cdpr_sim.design.moves import Move
from cdpr_sim.design.objectives import Objective
from cdpr_sim.design.robot_batch import Cases, RobotBatch
from cdpr_sim.design.search import HOLDS, LayoutEvaluator, named

LOST = 10.0
"""By how much a layout without a rest in some case counts as missing a constraint."""


@dataclass(frozen=True, eq=False)
class Front(Frozen, HtmlRepr):
    """Layouts none of which is better in both goals, the best in the first goal first.

    Attributes:
        given: the robot that the search began with.
        objectives: the two goals.
        before: of the robot as given, (2,) in SI units; nan where it does not rest at every pose.
        scores: (layouts, 2) in SI units.
        layouts: the robots' numbers.
        cases: what each was asked.
        tried: how many layouts were.
    """

    given: Robot
    objectives: tuple[Objective, Objective]
    before: Float[np.ndarray, "2"]
    scores: Float[np.ndarray, "layouts 2"]
    layouts: RobotBatch
    cases: Cases
    tried: int

    def __post_init__(self) -> None:
        self._freeze()

    def __len__(self) -> int:
        return len(self.scores)

    def thinned(self, most: int) -> Front:
        """At most so many of them, evenly along the front.

        Returns:
            A front of ``most`` layouts or fewer.
        """
        if len(self) <= whole("most", most, 1):
            return self
        rows = np.linspace(0, len(self) - 1, most).round().astype(int)
        return dataclasses.replace(self, scores=self.scores[rows], layouts=self.layouts.take(rows))

    def robot(self, row: int) -> Robot:
        """One of them.

        Returns:
            The robot with the layout of that row of ``scores``.
        """
        return named(self.layouts.robot_at(row), *self.objectives)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes it unlikely that some of these layouts can be built, a sentence each."""
        outside = [row + 1 for row in range(len(self)) if outside_frame(self.layouts.robot_at(row), self.given).any()]
        if not outside:
            return ()
        return (f"{len(outside)} of {len(self)} layouts have exits outside the frame: {', '.join(map(str, outside))}.",)

    def __repr__(self) -> str:
        one, other = self.objectives
        return f"<Front of {self.given.name!r}: {len(self)} layouts, {one.name} against {other.name}>"


def find_front(
    robot: Robot,
    poses: Any,
    objectives: tuple[Any, Any] = ("displacement", "worst tilt"),
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
    threads: int | None = None,
) -> Front:
    """The trade-off between two goals, by NSGA-II (Deb et al. 2002, doi:10.1109/4235.996017; pymoo's).

    Args:
        robot: the robot to begin with.
        poses: as ``find_layout``, like all that is not said here.
        objectives: two of what ``find_layout`` takes for one.
        move: what may move.
        within: how far.
        symmetry: which ties points.
        subject_to: what must hold.
        external_wrench: one load or several.
        stiffness: one factor or several.
        seed: of the random numbers.
        generations: how many.
        population: layouts of each generation, and of the front at most.
        progress: say how far it is on standard error.
        threads: of the compiled solver; default: one for each core.

    Returns:
        The layouts of the front with their scores, (layouts, 2) in SI units.

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
    goals[1].refuse_weight(robot)
    whole("seed", seed, 0)
    space = evaluator.space
    free = space.upper > space.lower

    def full(values: np.ndarray) -> np.ndarray:
        whole_rows = np.tile(space.given, (len(values), 1))
        whole_rows[:, free] = values
        return whole_rows

    def scored(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        equilibria = evaluator.equilibria(values)
        scores = np.stack([evaluator.scores(equilibria, goal) for goal in goals], axis=1)
        lost = np.asarray(np.isnan(scores).any(1))
        missing = evaluator.missing(equilibria, lost)
        missing = np.minimum(np.vstack([missing, np.where(lost, LOST, 0)]), LOST).T
        evaluator.tried += len(values)
        return scores, missing

    signs = np.array([-1.0 if goal.largest else 1.0 for goal in goals])

    class Question(Problem):
        def __init__(self) -> None:
            super().__init__(
                n_var=int(free.sum()), n_obj=2, n_ieq_constr=len(evaluator.constraints) + 1, xl=space.lower[free],
                xu=space.upper[free],
            )  # fmt: skip

        def _evaluate(self, x, out, *args, **kwargs) -> None:
            scores, missing = scored(full(x))
            out["F"], out["G"] = np.nan_to_num(scores * signs), missing - HOLDS

    first = np.random.default_rng(seed).uniform(
        space.lower[free], space.upper[free], (whole("population", population, 5), int(free.sum()))
    )
    shrunk = np.linspace(0, 1, len(first))[:, None]
    first = space.given[free] + shrunk * (first - space.given[free])  # from the robot as given outwards
    with saying(progress) as say:

        class Told(Callback):
            def notify(self, algorithm) -> None:
                say(f"generation {algorithm.n_gen} of {generations}, {evaluator.tried:,} layouts")

        search = NSGA2(pop_size=len(first), sampling=first)  # pyright: ignore[reportArgumentType]  (takes arrays too)
        ended = "n_gen", whole("generations", generations, 1)
        result = minimize(Question(), search, ended, seed=seed, callback=Told())
    if result.X is None:
        raise InvalidInput(
            f"subject_to: found no layout that holds everything and rests at every pose among "
            f"{evaluator.tried:,} tried; "
            "find_layout says what is missed the most"
        )
    values = full(np.atleast_2d(result.X))
    scores, _ = scored(values)
    order = np.argsort(signs[0] * scores[:, 0])
    layouts = space.layouts(values[order])
    given = evaluator.equilibria(np.zeros((1, len(space))))
    before = np.array([evaluator.scores(given, goal)[0] for goal in goals])
    return Front(robot, goals, before, scores[order], layouts, evaluator.cases, evaluator.tried)
