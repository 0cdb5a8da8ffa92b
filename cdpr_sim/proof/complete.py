"""All equilibria of given cable lengths, with a proof that none is missing: branch and prune.

An equilibrium's forces balance the load, so that some cable is taut, and the platform lies in a known box
(``_domain``). Charts cover the rotations: the quaternion (1, v), |v_k| <= 1, after a half turn about an axis or none.
``search_kernel`` bisects these boxes; each part is excluded, or is proved to have exactly one equilibrium, or stays
undecided. Each equilibrium found is then proved again in balls (``certificate``), which adds its index and its digits
and identifies boxes with the same one; undecided boxes are covered by a larger ball of a proof where that is possible,
and are reported where it is not.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from cdpr_sim.core import extras
from cdpr_sim.core.cable import MOST_STRAIN, PROPERTIES
from cdpr_sim.core.checks import FLAG, checked_path, positive, refuse_unless, whole
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput, StoreError
from cdpr_sim.core.files import appearing, check_place, refuse_irregular
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import Pose, angle_between
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.progress import bar
from cdpr_sim.core.robot import Robot
from cdpr_sim.proof import certificate
from cdpr_sim.proof.balance import Balance
from cdpr_sim.proof.balls import BITS, Balls, arithmetic, exact, middle, solution
from cdpr_sim.proof.cables import Cable, largest_wheel, laws, slopes_of_law, wheels
from cdpr_sim.proof.certificate import Certificate, Enclosure

CHARTS = {"planar": (0, 2), "spatial": (0, 1, 2, 3)}
"""For each mobility, the half turns before the charts' rotations: none, or about x, y or z of the platform."""

SIGNS = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
"""Signs of the platform's axes after each half turn."""

SPARE = 1.01
"""Factor by which the domain is larger than the proved box: more than any rounding of it."""

NEWTON = {"planar": 0.03, "spatial": 0.1}
"""For each mobility, the fraction of the robot's size below which Krawczyk's test is tried. Five planar searches take
the least time from 0.01 to 0.03: a tenth less than at 0.1, with 21 % more boxes. Near an equilibrium of a spatial robot
the number of boxes is the same from 0.1 to 1."""

NEAR, LEAST = 1e-4, 1e-8
"""Fractions of the robot's size: widths below which a nearby equilibrium is searched for, and a box is undecided."""

CALL = 20_000
"""Boxes of one call of the kernel: after it, time and progress are updated. Half a second, for a spatial robot."""

MOST_LEFT = 1_000
"""Number of undecided boxes above which a search stops, since it has met a family of equilibria: folds and kinks leave
a few boxes, and a family as many as its length has of ``LEAST``."""

FOUND_ROOM, LEFT_ROOM, DEPTH = 500, MOST_LEFT + 1, 4_000
"""Rows of the kernel's tables."""

SAVED = 30.0
"""[s] Time between two writes of the store."""

AT_END = "a cable is strained just by the end of its law's range"
"""Reason of a region with one root of the equations, at which a nonlinear law may still hold or not."""

FAMILY = 1e3
"""Undecided boxes that form a region of this many times their size are a family of equilibria."""


@dataclass(frozen=True)
class Undecided:
    """Adjacent boxes in which there may be equilibria or none.

    Attributes:
        reason: kind of the region: a kink, a fold, a family; or that the search stopped.
        boxes: number of boxes.
        lower: lower bounds of (x, y, z, v) in the chart, (6,).
        upper: upper bounds, (6,).
        chart: index of the chart in ``CHARTS``.
    """

    reason: str
    boxes: int
    lower: Float[np.ndarray, "6"]
    upper: Float[np.ndarray, "6"]
    chart: int


@dataclass(frozen=True, eq=False)
class CompleteEquilibria(HtmlRepr):
    """Every equilibrium of one problem, stable or not, each with its certificate; lowest index first. Iterates.

    Attributes:
        problem: rest lengths and load; its pose has no effect.
        certificates: certificates of the equilibria, all different. Each is proved to lie within ``range``.
        undecided: where there may be more; empty if the list is proved complete.
        pending: number of boxes that were not examined when the search stopped; 0 if it ended.
        boxes: number of boxes that were examined.
        seconds: duration of the search, including a store's earlier runs.
    """

    problem: Problem
    certificates: tuple[Certificate, ...]
    undecided: tuple[Undecided, ...]
    pending: int
    boxes: int
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether it is proved that there is no other equilibrium within ``range``."""
        return not self.pending and not self.undecided

    @property
    def range(self) -> str:
        """Over which poses the list is complete, as text; "" if over all."""
        return range_of(self.problem.robot)

    @property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """The equilibria, by the midpoints of their enclosures."""
        return tuple(one.equilibrium for one in self.certificates)

    def __len__(self) -> int:
        return len(self.certificates)

    def __iter__(self) -> Iterator[Certificate]:
        return iter(self.certificates)

    def missing_from(self, found: Iterable[Equilibrium]) -> tuple[Certificate, ...]:
        """Equilibria that a list by any method does not contain within its tolerance.

        Args:
            found: equilibria of the same problem.

        Returns:
            Certificates without a counterpart. If two are close to each other, each matches at most one of ``found``.
        """
        near = certificate.NEAR
        left = list(found)
        lacking = []
        for one in self.certificates:
            mine = one.equilibrium
            arm = self.problem.robot.characteristic_length
            distances = [
                float(np.linalg.norm(mine.position - other.position))
                + arm * float(angle_between(mine.rotation_matrix, other.rotation_matrix))
                for other in left
            ]
            if distances and min(distances) < 10 * near:
                left.pop(int(np.argmin(distances)))
            else:
                lacking.append(one)
        return tuple(lacking)

    def __repr__(self) -> str:
        stable = sum(one.stable for one in self.certificates)
        words = "proved complete" if self.complete else "not proved complete"
        more = f", {self.pending} boxes pending" if self.pending else ""
        return (
            f"<CompleteEquilibria of {self.problem.robot.name!r}: {stable} stable, {len(self) - stable} unstable, "
            f"{words}{more}, {self.boxes} boxes>"
        )


def range_of(robot: Robot) -> str:
    """The poses at which the cables of a robot have a law and a path, as text; "" if all."""
    parts = []
    if not robot.cabling.linear:
        parts.append(f"nonlinear cables are strained by at most {MOST_STRAIN:.0%}, the range of their law")
    if robot.cabling.pulleys.any():
        parts.append("each anchor lies outside its pulley's wheel, further from its axis than the radius")
    return " and ".join(parts)


def quickly_complete(problem: Problem) -> bool:
    """Whether completeness is proved in a fraction of a second: a planar robot with massless cables, and a load."""
    return problem.robot.mobility == "planar" and problem.robot.cabling.massless and _pull(problem) > 0


def certify_all(
    robot: Robot | Problem,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    time_limit: float | None = None,
    threads: int = 1,
    store: str | Path | None = None,
    progress: bool = False,
) -> CompleteEquilibria:
    """Every equilibrium on these cable lengths, stable or not, with a proof that none is missing.

    With pulleys these are the equilibria at which each anchor lies outside its wheel and further from its pulley's axis
    than the radius; with nonlinear laws, those at which these cables are strained by at most 20 %, where the law ends
    (``CompleteEquilibria.range``). Planar robots take tens of milliseconds. Spatial ones with four cables take minutes,
    and with more cables as long as the time limit: boxes not examined by then are counted as pending, and a store
    continues the search.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        rest_lengths: unstretched cable lengths, (cables,) [m].
        external_wrench: force [N] and torque [N m] on the platform's origin, base frame, besides gravity.
        time_limit: [s] of the search, without compilation before the first, after which it stops; default: none.
        threads: number of threads.
        store: a file in which the search is stored and from which it is resumed.
        progress: whether to show a progress bar.

    Returns:
        The equilibria with their certificates, and whether they are proved to be all.

    Raises:
        InvalidInput: an invalid argument; cables with mass; a load of zero.
        StoreError: a store of another problem, or one that cannot be written.
        MissingExtra: python-flint is not installed.

    Source: branch and prune as in Neumaier, Complete search in continuous global optimization, Acta Numerica 2004.
    """
    refuse_unless(Robot | Problem, robot=robot)
    refuse_unless(FLAG, progress=progress)
    most = None if time_limit is None else positive("time_limit", time_limit, "s")
    whole("threads", threads, 1)
    path = None if store is None else checked_path("store", store)
    if path is not None and not path.exists():
        check_place(path, (path.suffix,))
    if isinstance(robot, Robot) and rest_lengths is None:
        raise InvalidInput("rest_lengths: found none, expected one per cable [m]")
    problem = Problem.of(robot, robot.home if isinstance(robot, Robot) else None, rest_lengths, external_wrench)
    refuse_unsearchable(problem)
    search = _Search(problem, path)
    started = time.monotonic()  # the limit is of the search, without the compilation before the first
    search.run(math.inf if most is None else started + most, threads, progress)
    with arithmetic(BITS):
        certificates, undecided = _proved(problem, search)
    before = search.seconds
    return CompleteEquilibria(
        problem, certificates, undecided, search.pending, int(search.counts[0]), before + time.monotonic() - started
    )


def refuse_unsearchable(problem: Problem) -> None:
    """Refuse what ``certify_all`` cannot search; to be called before work begins.

    Raises:
        InvalidInput: cables with mass or a memory; a load of zero.
        MissingExtra: python-flint is not installed.
    """
    extras.require("proof", "certify_all")
    problem.robot.cabling.refuse_memory()
    problem.robot.cabling.refuse_unknown("proof of completeness", "certify_all")
    if not _pull(problem) > 0:
        raise InvalidInput(
            "certify_all: found no load, expected weight or force: without load, any pose on slack "
            "cables is an equilibrium"
        )


class _Search:
    """The boxes of a search: pending, with one equilibrium, and undecided; by chart.

    Pending ones are of poses and tensions, (boxes, 6 + cables, 2), the others of poses.
    """

    def __init__(self, problem: Problem, store: Path | None) -> None:
        from cdpr_sim.proof import search_kernel as kernel

        self.kernel, self.problem, self.store = kernel.SEARCH.compiled, problem, store
        self.charts = CHARTS[problem.robot.mobility]
        with arithmetic(BITS):
            self.cables = [Cable(problem, index) for index in range(problem.robot.cables)]
        self.setups = _setups(kernel, problem, self.cables)
        self.found: list[list[np.ndarray]] = [[] for _ in self.charts]
        self.left: list[list[np.ndarray]] = [[] for _ in self.charts]
        self.counts, self.seconds = np.zeros(kernel.COUNTS, np.int64), 0.0
        box = np.concatenate([_domain(problem), [[0.0, 1e300]] * problem.robot.cables])
        self.waiting = [(chart, box[None]) for chart in range(len(self.charts))]
        self.volume = len(self.charts) * self._volume(box)
        self.running: dict[Future, tuple] = {}
        self.key = _key(problem)
        if store is not None and store.exists():
            self._resume(store)

    @property
    def pending(self) -> int:
        """Number of boxes that were not examined."""
        return sum(len(boxes) for _, boxes in self.waiting)

    def run(self, end: float, threads: int, progress: bool) -> None:
        """Search until everything is done, or the time is over, or too many boxes are undecided."""
        started, saved, done, examined = time.monotonic(), time.monotonic(), 0.0, False
        before = self.seconds

        def save() -> None:
            if self.store is not None:
                self._save(self.store, before + time.monotonic() - started)

        def begin(task: tuple) -> Future:
            if threads > 1:
                return pool.submit(self._examine, *task)
            result: Future = Future()  # without a thread, whose start takes longer than the search of a planar robot
            result.set_result(self._examine(*task))
            return result

        with bar("looking for equilibria", 1.0, show=progress) as advance, ThreadPoolExecutor(threads) as pool:
            try:
                while self.waiting or self.running:
                    if examined and (time.monotonic() > end or sum(map(len, self.left)) > MOST_LEFT):
                        break
                    while self.waiting and len(self.running) < threads:
                        # In this order Ctrl-C may leave boxes in two lists, but never in none.
                        self.running[begin(self.waiting[-1])] = self.waiting[-1]
                        self.waiting.pop()
                    ready, _ = wait(self.running, return_when=FIRST_COMPLETED)
                    for one in ready:
                        self._take(one.result(), len(self.running) - 1 + len(self.waiting) < threads)
                        del self.running[one]
                    examined = True
                    left = [*self.waiting, *self.running.values()]
                    part = 1 - sum(self._volume(box) for _, boxes in left for box in boxes) / self.volume
                    advance(max(part - done, 0.0))
                    done = max(part, done)
                    if time.monotonic() - saved > SAVED:
                        save()
                        saved = time.monotonic()
            finally:
                while self.running:  # each ends with its present call
                    self._take(self.running.popitem()[0].result(), False)
                save()

    def _examine(self, chart: int, boxes: np.ndarray) -> tuple:
        """One call of the kernel: boxes found and undecided, and boxes still to be examined."""
        stack, top = np.empty((DEPTH, *boxes.shape[1:])), len(boxes)
        stack[:top] = boxes
        found, left = np.empty((FOUND_ROOM, 6, 3)), np.empty((LEFT_ROOM, 6, 2))
        known = self.found[chart][: FOUND_ROOM // 2]
        before = len(known)
        found[:before] = np.reshape(known, (-1, 6, 3))
        counts = np.zeros_like(self.counts)
        top, nf, nl = self.kernel(*self.setups[chart], stack, top, found, before, left, 0, CALL, counts)
        return chart, stack[:top].copy(), found[before:nf].copy(), left[:nl].copy(), counts

    def _take(self, result: tuple, divide: bool) -> None:
        chart, boxes, found, left, counts = result
        self.found[chart] += list(found)
        self.left[chart] += list(left)
        self.counts += counts
        if divide and len(boxes) > 1:  # the largest lie at the bottom: every second one for each
            self.waiting += [(chart, boxes[1::2]), (chart, boxes[::2])]
        elif len(boxes):
            self.waiting.append((chart, boxes))

    def _volume(self, box: Float[np.ndarray, "unknowns 2"]) -> float:
        rows = self.problem.robot.free
        return float(np.prod(box[rows, 1] - box[rows, 0]))

    def _save(self, path: Path, seconds: float) -> None:
        """Write the file completely or not at all; boxes being examined count as pending."""
        parts: dict[str, np.ndarray] = {"key": np.array(self.key), "counts": self.counts}
        parts["seconds"] = np.array(seconds)
        for name, listed, columns in (("found", self.found, 3), ("left", self.left, 2)):
            for chart, boxes in enumerate(listed):
                parts[f"{name}_{chart}"] = np.array(boxes).reshape(-1, 6, columns)
        none = np.empty((0, 6 + self.problem.robot.cables, 2))
        for chart in range(len(self.setups)):
            tasks = (*self.waiting, *self.running.values())
            mine = np.concatenate([none, *(boxes for of, boxes in tasks if of == chart)])
            parts[f"boxes_{chart}"], parts[f"tensions_{chart}"] = mine[:, :6], mine[:, 6:]
        try:
            with appearing(path) as (temporary,), open(temporary, "wb") as file:
                np.savez(file, allow_pickle=False, **parts)  # type: ignore[arg-type]
        except InvalidInput as error:
            raise StoreError(str(error)) from None

    def _resume(self, path: Path) -> None:
        refuse_irregular(path)
        try:
            with np.load(path) as kept:
                if str(kept["key"]) != self.key:
                    raise StoreError(f"{path}: found the search of another problem, expected this one's, or no file")
                charts = range(len(self.setups))
                self.found = [list(kept[f"found_{chart}"]) for chart in charts]
                self.left = [list(kept[f"left_{chart}"]) for chart in charts]
                self.waiting = []
                for chart in charts:
                    boxes = np.concatenate([kept[f"boxes_{chart}"], kept[f"tensions_{chart}"]], axis=1)
                    for first in range(0, len(boxes), DEPTH // 2):
                        self.waiting.append((chart, boxes[first : first + DEPTH // 2]))
                self.counts, self.seconds = kept["counts"], float(kept["seconds"])
        except StoreError:
            raise
        except Exception as error:  # NumPy and zipfile raise many kinds for a damaged file
            raise StoreError(f"{path}: found no search that can be resumed ({error})") from None


def _key(problem: Problem) -> str:
    """A key that is different for every problem."""
    state, robot = hashlib.sha256(), problem.robot
    cables = (getattr(robot, name) for name, one in PROPERTIES.items() if one.image)
    rest = np.array([robot.mass, robot.gravity]), robot.center_of_mass, problem.rest_lengths, problem.external_wrench
    for part in (*cables, *rest):
        state.update(np.ascontiguousarray(part, dtype=float).tobytes() + b"\0")
    return f"{robot.mobility} {state.hexdigest()}"


def _setups(kernel, problem: Problem, cables: list[Cable]) -> list:
    """The problem in the form of the kernel, for each chart."""
    robot = problem.robot
    size, weight = _size(problem), robot.mass * robot.gravity
    setup = kernel.Setup(
        exits=np.array(robot.exits),
        anchors=robot.anchors,
        law=laws(problem, cables),
        wheels=wheels(cables),
        center_of_mass=robot.center_of_mass,
        weight=np.array([np.nextafter(weight, -np.inf), np.nextafter(weight, np.inf)]),
        wrench=problem.external_wrench.copy(),
        rows=np.array(robot.free, np.int64),
        scales=np.repeat([1.0, 2 * robot.characteristic_length], 3),
        newton=NEWTON[robot.mobility] * size,
        near=NEAR * size,
        least=LEAST * size,
    )
    return [
        setup._replace(anchors=robot.anchors * signs, center_of_mass=robot.center_of_mass * signs)
        for signs in SIGNS[list(CHARTS[robot.mobility])]
    ]


def _size(problem: Problem) -> float:
    """The largest extent of the exits, or the longest cable of exits at one point [m]."""
    return max(float(np.ptp(problem.robot.exits, axis=0).max()), float(problem.rest_lengths.max()) / 2)


def _pull(problem: Problem) -> float:
    """The load's force [N]."""
    return float(np.linalg.norm(problem.external_wrench[:3] - [0, 0, problem.robot.weight]))


def _domain(problem: Problem) -> Float[np.ndarray, "6 2"]:
    """A box outside which forces cannot balance; v within [−1, 1], and constant coordinates within [0, 0].

    With the load's force along d, cables pull against it. If all anchors are on one side of all exits across d, every
    pull has a component of one sign, and some pull is not zero. If all anchors are above all exits, against d, there is
    no pull up. And far below: each cable's pull along −d is at most the load, which bounds the drop of its length.
    """
    robot = problem.robot
    force = problem.external_wrench[:3] - np.array([0, 0, robot.weight])
    down = force / np.linalg.norm(force)
    # A cable pulls towards the point where it leaves its wheel, within a diameter of its exit.
    reach = SPARE * (float(np.linalg.norm(robot.anchors, axis=1).max()) + largest_wheel(robot)) + 1e-9
    if robot.mobility == "planar":
        across = np.array([[down[2], 0.0, -down[0]]])
        frame = np.stack([down, across[0]])
    else:
        frame = np.linalg.svd(down[None])[2]
        frame[0] = down
    at = robot.exits @ frame.T
    lower, upper = at.min(0) - reach, at.max(0) + reach
    wide = SPARE * float(np.linalg.norm(upper[1:] - lower[1:]))
    stiffnesses = robot.cabling.pulls(robot.axial_stiffness) * slopes_of_law(robot)[0]
    drops = []
    for cable, rest in enumerate(problem.rest_lengths):
        stiffness, drop = stiffnesses[cable], float(rest)
        stretches = rest + robot.cabling.added[cable]
        while not stiffness * (drop - rest) / stretches * drop / math.hypot(drop, wide) > SPARE * _pull(problem):
            drop *= 1.01
        drops.append(at[cable, 0] + reach + drop)
    upper[0] = max(min(drops), at[:, 0].max() + reach)
    lower[0] = at[:, 0].min() - reach
    corners = np.array(np.meshgrid(*np.stack([lower, upper], 1), indexing="ij")).reshape(len(frame), -1).T @ frame
    spare = 1e-9 * (1 + np.abs(corners).max())
    box = np.zeros((6, 2))
    box[:3, 0], box[:3, 1] = corners.min(0) - spare, corners.max(0) + spare
    box[3:] = [-1.0, 1.0]
    fixed = [k for k in range(6) if k not in robot.free]
    box[fixed] = 0.0
    return box


# --- what was found, in balls


@dataclass(frozen=True)
class _Member:
    """An equilibrium of the list: its proved enclosure, and a box in which it is the only one."""

    balance: Balance
    enclosure: Enclosure
    chart: int
    box: Float[np.ndarray, "6 3"] | None


def _proved(problem: Problem, search: _Search) -> tuple[tuple[Certificate, ...], tuple[Undecided, ...]]:
    members: list[_Member] = []
    undecided: list[Undecided] = []
    for chart, boxes in enumerate(search.found):
        for box in boxes:
            member = _member(search, chart, box)
            if member is None:
                undecided.append(
                    _undecided("one equilibrium, of which no proof in balls is found", [box[:, :2]], chart)
                )
                continue
            beyond = _beyond_law(member)
            if beyond:  # the box holds no other root of the equations, which are continued there
                continue
            known = [_same(member, other) for other in members]
            if beyond is None:
                undecided.append(_undecided(AT_END, [box[:, :2]], chart))
            elif None in known:
                undecided.append(_undecided("an equilibrium that may be another's", [box[:, :2]], chart))
            elif True not in known:
                members.append(member)
    if sum(map(len, search.left)) > MOST_LEFT:
        for chart, boxes in enumerate(search.left):
            if boxes:
                reason = "a family of equilibria, or more boxes than are kept"
                undecided.append(_undecided(reason, boxes, chart))
    else:
        for chart, boxes in enumerate(search.left):
            for cluster in _joined(np.array(boxes).reshape(-1, 6, 2), search.setups[chart].least):
                undecided += _covered(search, chart, cluster, members)
    certificates = [certificate.certificate_of(None, one.balance, one.enclosure) for one in members]
    order = sorted(range(len(members)), key=lambda i: (certificates[i].index or 0, -certificates[i].position[0, 2]))
    return tuple(certificates[i] for i in order), tuple(undecided)


def _member(search: _Search, chart: int, box: Float[np.ndarray, "6 3"]) -> _Member | None:
    """The one equilibrium of a box (6, 3), its lower and upper bounds and a point nearby, proved to lie in the box."""
    for start in (box[:, 2], box[:, :2].mean(1), box[:, 0], box[:, 1]):  # at a kink the first may lie far off
        member = _near(search, chart, start, box)
        if member is not None and _in_box(member, chart, box):
            return member
    return None


def _near(search: _Search, chart: int, at: Float[np.ndarray, "6"], box: np.ndarray | None) -> _Member | None:
    balance = _balance(search, chart, at)
    found, _ = certificate.enclose(balance)
    return None if found is None else _Member(balance, found, chart, box)


def _balance(search: _Search, chart: int, at: Float[np.ndarray, "6"]) -> Balance:
    """The equations about a pose of a chart."""
    turn = Rotation.from_quat([*at[3:], 1.0]).as_matrix() * SIGNS[search.charts[chart]]
    return Balance(search.problem, Pose(at[:3].copy(), turn), search.cables)


def _half_turned(q: Balls, axis: int) -> Balls:
    """A quaternion (w, x, y, z) after a half turn about an axis of the platform, 1 to 3, or none, 0; up to its sign."""
    w, x, y, z = q
    return np.array([(w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)][axis])


def _in_chart(member: _Member, chart: int) -> Balls:
    """The enclosure's (x, y, z, v) in a chart: R(v) is the rotation, after the chart's half turn is undone."""
    balance, image = member.balance, member.enclosure.image
    q = _half_turned(balance.quaternion_at(image), _charts(member)[chart])
    return np.concatenate([balance.position(image), q[1:] / q[0]])


def _charts(member: _Member) -> tuple[int, ...]:
    return CHARTS[member.balance.problem.robot.mobility]


def _in_box(member: _Member, chart: int, box: Float[np.ndarray, "6 3"]) -> bool:
    rows = member.balance.problem.robot.free
    low, high = exact(box[:, 0]), exact(box[:, 1])
    at = _in_chart(member, chart)
    return bool((at >= low)[rows].all() and (at <= high)[rows].all())


def _same(one: _Member, other: _Member) -> bool | None:
    """Whether both are one equilibrium; None if neither is proved."""
    if other.box is not None and _in_box(one, other.chart, other.box):
        return True
    if one.box is not None and _in_box(other, one.chart, one.box):
        return True
    mine, theirs = ([*m.balance.position(m.enclosure.image), *m.enclosure.state.rotation.ravel()] for m in (one, other))
    return None if all(a.overlaps(b) for a, b in zip(mine, theirs, strict=True)) else False


def _joined(boxes: Float[np.ndarray, "boxes 6 2"], least: float) -> list[np.ndarray]:
    """Groups of boxes that touch each other up to the least width."""
    gaps = (boxes[:, None, :, 0] - boxes[:, :, 1]).max(-1)  # of one box above the other, in any coordinate
    _, labels = connected_components(np.maximum(gaps, gaps.T) <= 4 * least, directed=False)
    return [boxes[labels == label] for label in dict.fromkeys(labels[::-1].tolist())]


def _covered(search: _Search, chart: int, cluster: np.ndarray, members: list[_Member]) -> list[Undecided]:
    """Prove one equilibrium in a box of balls that covers a cluster, and add it if it is new; else report it."""
    whole_box = np.stack([cluster[:, :, 0].min(0), cluster[:, :, 1].max(0)], 1)
    member = _near(search, chart, whole_box.mean(1), None)
    if member is not None and all(_in_balls(member, chart, box) for box in cluster):
        beyond = _beyond_law(member)
        if beyond is None:
            return [_undecided(AT_END, list(cluster), chart)]
        if not beyond and not any(_same(member, other) or _covers(other, member) for other in members):
            members.append(member)
        return []
    setup = search.setups[chart]
    extent = ((whole_box[:, 1] - whole_box[:, 0]) * setup.scales).max()
    if extent > FAMILY * setup.least:
        reason = "a family of equilibria: a direction is neutral"
    elif _at_kink(search, chart, whole_box.mean(1)):
        reason = "a kink: a cable is just at its rest length"
    else:
        reason = "a fold: equilibria meet there, or nearly so"
    return [_undecided(reason, list(cluster), chart)]


def _beyond_law(member: _Member) -> bool | None:
    """Whether a cable is strained beyond the range of its law there; None if undecided."""
    return certificate.beyond_law(member.balance, member.enclosure)[0]


def _covers(member: _Member, other: _Member) -> bool:
    """Whether the other's enclosure lies in the box of balls in which this one is unique."""
    balance, image = other.balance, other.enclosure.image
    return _unique_at(member, balance.position(image), balance.quaternion_at(image))


def _in_balls(member: _Member, chart: int, box: Float[np.ndarray, "6 2"]) -> bool:
    """Whether a box of a chart lies in the box of balls in which the member is unique."""
    at = np.array([low.union(high) for low, high in exact(box)])
    return _unique_at(member, at[:3], _half_turned(np.array([exact(1), *at[3:]]), _charts(member)[chart]))


def _unique_at(member: _Member, position: Balls, q: Balls) -> bool:
    """Whether a pose lies in the box of balls in which the member is unique: q is a multiple of q₀ + E δ."""
    balance = member.balance
    parts = [0, 2] if len(balance.axes) == 2 else [0, 1, 2, 3]
    columns = np.stack([balance.quaternion, *balance.tangents], axis=1)
    scale, *deltas = solution(columns[parts], q[parts])
    coordinates = [*position[balance.axes], *(delta / scale for delta in deltas)]
    return all(b.contains(c) for b, c in zip(member.enclosure.box, coordinates, strict=True))


def _at_kink(search: _Search, chart: int, at: Float[np.ndarray, "6"]) -> bool:
    balance = _balance(search, chart, at)
    stretches = [abs(middle(pull.stretch)) for pull in balance.at(balance.start).pulls]
    return min(stretches) < 1e-6 * search.problem.robot.characteristic_length


def _undecided(reason: str, boxes: Sequence[np.ndarray], chart: int) -> Undecided:
    every = np.array(boxes)
    return Undecided(reason, len(boxes), every[:, :, 0].min(0), every[:, :, 1].max(0), chart)
