"""Repeat the measurements that justify constants, and check that the constants are still valid.

    python scripts/dev/measure_constants.py

Each constant whose comment cites a measurement is listed here with the measurement. Exit status 1 if a constant is no
longer valid. The script takes about a minute, and twice as long if nothing is compiled yet.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import base64
import itertools
import re
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import mujoco
import numpy as np
from dask.config import set as configured
from rich.console import Console
from rich.markup import escape

import cdpr_sim as cdpr
from cdpr_sim.analysis import clearance, compensation, equilibria, identifiability, identification_model, tensions
from cdpr_sim.analysis.measurements import COORDINATES
from cdpr_sim.analysis.workspace import sweep
from cdpr_sim.analysis.workspace.feasibility import shortfall
from cdpr_sim.cli.analysis_commands import BYTES_PER_START
from cdpr_sim.control import pose_feedback
from cdpr_sim.core.pose import distance
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.core.status import ACCEPTABLE, NEUTRAL
from cdpr_sim.crosscheck.compare import CROSS_TOLERANCE, POSITION_TOLERANCE
from cdpr_sim.design import layout_equilibria
from cdpr_sim.physics import chains
from cdpr_sim.physics.release import STAYS
from cdpr_sim.physics.settle import residual_of
from cdpr_sim.report.html_page import VIDEO_RATE, VIDEO_SIZE
from cdpr_sim.report.table_style import new_table
from cdpr_sim.statics import balance_kernel, catenary
from cdpr_sim.statics.newton_kernel import MAX_ITERATIONS

sys.path.append(str(Path(__file__).parents[1] / "figures"))
from controller_comparison import SENSORS, believed

POSES = 30_000
"""Random poses in the workspace, for each layout and material."""

SEED = 0

LAYOUTS, MATERIALS = ("cogiro", "parallel"), ("vectran-0.7mm", "fishing-0.4mm")

FREE = 1e-9
"""Loads per characteristic length: a smaller stiffness is rounding, as the printed gap shows."""


class Row(NamedTuple):
    """A row of the table."""

    constant: str
    what: str
    measured: str
    holds: bool


def robots() -> list[cdpr.Robot]:
    """DemoBot's two spatial layouts with each of its cables."""
    return [cdpr.load_robot(name).replace(material=cables) for name in LAYOUTS for cables in MATERIALS]


def random_poses(robot: cdpr.Robot, count: int) -> np.ndarray:
    """Random positions, (count, 3) [m], uniform in the workspace."""
    low, high = robot.workspace
    return np.random.default_rng(SEED).uniform(low, high, (count, 3))


def bytes_of(call: Callable[[], object]) -> int:
    """Largest memory of a call [bytes]; a first call loads what is loaded only once."""
    tracemalloc.start()
    call()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


def equilibrium_constants() -> Iterator[Row]:
    """Stiffness of equilibria, iterations of the solver, and the distance between two solutions of one equilibrium."""
    most, nearer, farther = 0, 0.0, np.inf
    for robot in robots():
        of, arm, poses = f"{robot.name}, {robot.material}", robot.characteristic_length, random_poses(robot, POSES)
        found = cdpr.solve_many(robot, poses)
        most = max(most, int(found.iterations.max()))
        values = found.eigenvalues
        softest, ratio = values[:, 0] * arm / robot.weight, values[:, 0] / values[:, -1]
        free = softest < FREE
        few = int((softest[~free] < compensation.HELD).sum())
        yield Row(
            f"HELD = {compensation.HELD:g}", f"{of}: smallest stiffness of a constrained equilibrium; number below",
            f"{softest[~free].min():.1e}, {few}", few <= 3,
        )  # fmt: skip
        yield Row(
            f"LOOSE = {equilibria.LOOSE:g}", f"{of}: smallest over largest stiffness, constrained equilibria",
            f"{ratio[~free].min():.1e}", ratio[~free].min() > equilibria.LOOSE,
        )  # fmt: skip
        if free.any():
            yield Row(
                f"NEUTRAL = {NEUTRAL:g}", f"{of}: the same for neutral equilibria", f"{ratio[free].max():.1e}",
                np.abs(ratio[free]).max() < min(NEUTRAL, equilibria.LOOSE),
            )  # fmt: skip
            yield Row("the manual: 2 to 4 %", f"{of}: free", f"{100 * free.mean():.1f} %", 0.015 < free.mean() < 0.045)
        beside = poses + np.random.default_rng(SEED + 1).normal(size=poses.shape) * 0.002
        again = cdpr.solve_many(robot, beside, rest_lengths=found.rest_lengths)
        turned = np.asarray((found.poses.rotation.inv() * again.poses.rotation).magnitude())
        distances = np.hypot(np.linalg.norm(found.positions - again.positions, axis=1) / arm, turned)
        held = ~free & (again.eigenvalues[:, 0] * arm / robot.weight > FREE)
        nearer = max(nearer, distances[held & (distances < equilibria.SAME)].max())
        farther = min(farther, distances[held & (distances > equilibria.SAME)].min(initial=np.inf))
    same = f"equilibria.SAME = {equilibria.SAME:g}"
    yield Row(
        same, "two solutions of one constrained equilibrium, at most", f"{nearer:.0e}", nearer < equilibria.SAME / 1e3
    )
    yield Row(
        same,
        "two such equilibria with the same rest lengths, at least",
        f"{farther:.0e}",
        farther > 10 * equilibria.SAME,
    )
    yield Row(
        f"MAX_ITERATIONS = {MAX_ITERATIONS}", "of Newton's method at random poses, at most", f"{most}",
        10 * most <= MAX_ITERATIONS,
    )  # fmt: skip


def unseen(*unknowns: str) -> float:
    """Smallest over largest singular value of the sensitivities at 12 poses of ``cogiro``; columns of unit length."""
    robot = cdpr.load_robot("cogiro")
    poses = random_poses(robot, 12)
    solved = cdpr.solve_many(robot, poses)
    measured = cdpr.Measurements.of(poses, np.hstack([solved.positions, solved.euler]))
    wanted = identification_model.unknowns_of(robot, measured, unknowns)
    slope = identification_model.IdentificationModel(robot, measured, wanted).slopes(np.zeros(len(wanted)))[
        measured.known
    ]
    singular = np.linalg.svd(slope / np.linalg.norm(slope, axis=0), compute_uv=False)
    return float(singular[-1] / singular[0])


def identifications() -> Iterator[Row]:
    """What rounding leaves of unknowns that cannot be distinguished, and of those that can."""
    least, name = identifiability.UNSEEN, f"UNSEEN = {identifiability.UNSEEN:g}"
    same, distinct = (
        unseen("axial_stiffness", "mass"),
        unseen("axial_stiffness", "rest_length_offsets", "center_of_mass"),
    )
    yield Row(name, "EA and mass, which have the same effect", f"{same:.0e}", same < least / 10)
    yield Row(name, "EA, offsets and centre of mass", f"{distinct:.0e}", distinct > 100 * least)
    worse, name = identifiability.WORSE, f"WORSE = {identifiability.WORSE:g}"
    whole = max(predictions(6, COORDINATES, 2e-5, 10))
    yield Row(name, "9 unknowns by 36 numbers that determine them, at most", f"{whole:.2f}", whole < worse)
    heights = min(predictions(12, ("z",), 2e-4, 10))
    yield Row(name, "9 unknowns by 12 heights, which do not, at least", f"{heights:.2f}", heights > worse)


def predictions(poses: int, coordinates: Sequence[str], scatter: float, fits: int) -> list[float]:
    """By what factor EA and eight offsets, all 0, predict rows left out worse than the best of fewer unknowns."""
    robot = cdpr.load_robot("cogiro").replace(axial_stiffness=1e3)
    columns = [COORDINATES.index(name) for name in coordinates]
    rng, factors = np.random.default_rng(SEED), []
    for _ in range(fits):
        commanded = rng.uniform([0.15, 0.12, 0.05], [0.65, 0.38, 0.3], (poses, 3))
        solved = cdpr.solve_many(robot, commanded)
        noise = rng.normal(size=(poses, 6)) * scatter / np.repeat([1.0, robot.characteristic_length], 3)
        measured = (np.hstack([solved.positions, solved.euler]) + noise)[:, columns]
        rows = cdpr.Measurements.of(commanded, measured, coordinates=coordinates)
        asked, *fewer = cdpr.identify(robot, rows, ("axial_stiffness", "rest_length_offsets")).predictions.values()
        factors.append(asked / min(fewer))
    return factors


def compensations() -> Iterator[Row]:
    """Numerical errors of the nearest pose, and cutting planes for the stiffest tensions."""
    missed, off = [], []
    robot = cdpr.load_robot("parallel")
    for pose in [(0.17, 0.25, 0.1), (0.25, 0.25, 0.1), (0.25, 0.2, 0.15), (0.6, 0.3, 0.2)]:
        found = cdpr.compensate(robot, pose, arm=0)
        missed.append(found.distance)
        rest = found.equilibrium
        off.append(distance(rest.problem.pose, rest.pose, robot.characteristic_length))
    yield Row(
        f"LEAST_ARM = {compensation.LEAST_ARM:g}", "error of a position that can be held [m], at most",
        f"{max(missed):.0e}", max(missed) < 2e-8,
    )  # fmt: skip
    yield Row(
        f"_EQUAL = {compensation._EQUAL:g}", "from SLSQP's pose to the equilibrium of its rest lengths [m], at most",
        f"{max(off):.0e}", max(off) < 1e-12,
    )  # fmt: skip
    cuts = []
    for robot in robots():
        poses = random_poses(robot, 40)
        for pose in poses[cdpr.feasible(robot, poses)]:
            with patch.object(tensions.Demand, "cut", autospec=True, side_effect=tensions.Demand.cut) as cut:
                if cdpr.compensate(robot, pose, prefer="stiffest").exact:
                    cuts.append(cut.call_count)
    yield Row(
        f"CUTS = {tensions.CUTS}", f"cutting planes for DemoBot's stiffest tensions, {len(cuts)} poses, at most",
        f"{max(cuts)}", max(cuts) <= 4,
    )  # fmt: skip


def balances() -> Iterator[Row]:
    """Unbalanced part of a load that tensions balance, and a nanometre beyond the boundary."""
    within = []
    for name in ("cogiro", "parallel", "ipanema-1"):
        robot = cdpr.load_robot(name)
        left = shortfall(robot, random_poses(robot, 10_000))
        within.append(left[left < balance_kernel.BALANCED].max())
    robot = cdpr.load_robot("parallel")
    inside, outside = 0.4, 0.17
    while inside - outside > 1e-14:
        x = (inside + outside) / 2
        inside, outside = (x, outside) if shortfall(robot, (x, 0.25, 0.1)) < 1e-14 else (inside, x)
    beyond = float(shortfall(robot, (inside - 1e-9, 0.25, 0.1)))
    name = f"balance_kernel.BALANCED = {balance_kernel.BALANCED:g}"
    yield Row(name, "unbalanced part of a balanced load, at most", f"{max(within):.0e}", max(within) < 1e-14)
    yield Row(name, "a nanometre outside parallel's workspace", f"{beyond:.0e}", beyond > balance_kernel.BALANCED)


def methods() -> Iterator[Row]:
    """Deviation of MuJoCo's equilibria from statics, and MuJoCo's residual at static equilibria."""
    distances = []
    for robot in robots():
        poses = random_poses(robot, 1000)
        static, settled = cdpr.solve_many(robot, poses), cdpr.settle_many(robot, poses)
        held = static.eigenvalues[:, 0] * robot.characteristic_length / robot.weight > FREE
        distances.append(np.linalg.norm(static.positions - settled.positions, axis=1)[held].max())
    yield Row(
        f"POSITION_TOLERANCE = {POSITION_TOLERANCE:g}", "between the methods at 4,000 random poses [m], at most",
        f"{max(distances):.0e}", max(distances) < POSITION_TOLERANCE / 100,
    )  # fmt: skip
    solved = [cdpr.solve(robot, pose) for robot in robots() for pose in random_poses(robot, 10)]
    released = [cdpr.release(one, seconds=2.0) for one in solved if one.stable]
    largest_deviation = max(one.largest_deviation / one.displacement for one in released)
    yield Row(
        f"STAYS = {STAYS:g}",
        "largest deviation of stable platforms, in initial displacements",
        f"{largest_deviation:.2f}",
        largest_deviation < 1.01,
    )
    robot = cdpr.load_robot("cogiro")
    right, wrong = [], []
    for pose in random_poses(robot, 20):
        static = cdpr.solve(robot, pose)
        right.append(residual_of(static.problem, static.pose) / robot.weight)
        for cable in np.flatnonzero(~static.slack):
            model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, pose))
            model.tendon_stiffness[cable] *= 1.01
            wrong.append(residual_of(static.problem, static.pose, model=model) / robot.weight)
    name = f"CROSS_TOLERANCE = {CROSS_TOLERANCE:g}"
    yield Row(
        name, "MuJoCo's residual at static poses, at most", f"{max(right):.1e}",
        max(*right, ACCEPTABLE) < CROSS_TOLERANCE,
    )  # fmt: skip
    yield Row(
        name, "the same with one taut cable 1 % stiffer, at least", f"{min(wrong):.1e}", min(wrong) > CROSS_TOLERANCE
    )


def missed_by(division: chains.ChainDivision, level: np.ndarray, bend: float) -> float:
    """Largest distance between the ends of a chain and of the catenary with the same force, over the length.

    The chains are horizontal at ``level``; their horizontal force is ``bend`` weights. See ``chains.divisions``.
    """
    down = 1 - np.cumsum(division.masses[:, ::-1], axis=1)[:, ::-1] - level[:, None]
    pull = np.hypot(bend, down)
    across, along = ((division.lengths * part / pull).sum(1) for part in (bend, down))
    first, last = -level / bend, (1 - level) / bend
    across -= bend * (np.arcsinh(last) - np.arcsinh(first))
    along -= bend * (np.hypot(1, last) - np.hypot(1, first))
    return float(np.hypot(across, along).max())


def curves() -> Iterator[Row]:
    """Errors of the approximations of sagging cables: MuJoCo's chains, and the straight segments of clearances."""
    level = np.linspace(-2, 3, 501)
    for bend in (chains.STRAIGHT, 1.0):
        missed = missed_by(chains.straight(np.array([False])), level, bend)
        yield Row(
            f"SEGMENTS = {chains.SEGMENTS}", f"end of a chain with a horizontal force of {bend:g} weights, per length",
            f"{missed:.0e}", missed < (1e-11 if bend == chains.STRAIGHT else 2e-8),
        )  # fmt: skip
    bends = np.geomspace(chains.SHARPEST, chains.STRAIGHT, 30, endpoint=False)
    for wheel, where in ((False, "slack and subdivided again"), (True, "over a wheel")):
        over = np.full(len(level), wheel)
        missed = max(missed_by(chains.divisions(level, np.full(len(level), bend), over), level, bend) for bend in bends)
        accurate = missed < (2e-5 if wheel else 1e-6)
        yield Row(f"SHARPEST = {chains.SHARPEST:g}", f"the same, {where}", f"{missed:.0e}", accurate)
    pieces, finer = clearance.POINTS - 1, 40
    hung = catenary.profile(np.zeros(3), np.array([1.0, 0, 0]), 1.001, 1e4, 1.0, finer * pieces + 1)
    knots = np.arange(0, len(hung), finer)
    straight = np.stack([np.interp(np.arange(len(hung)), knots, hung[knots, axis]) for axis in range(3)], axis=1)
    part = np.ptp(hung[:, 2]) / np.linalg.norm(hung - straight, axis=1).max()
    yield Row(
        f"clearance.POINTS = {clearance.POINTS}", "sag of a shallow cable over its distance from its segments",
        f"{part:.0f}", part > 550,
    )  # fmt: skip


def feedback() -> Iterator[Row]:
    """Oscillation of the integral feedback of the pose in 20 s with the softer cables."""
    for name, gain in itertools.product(LAYOUTS, (pose_feedback.GAIN, 2.0)):
        robot = cdpr.load_robot(name).replace(material="fishing-0.4mm")
        controller = cdpr.PoseFeedback(cdpr.RigidLengths(believed(robot)), gain)
        sensors = cdpr.Sensors(period=SENSORS.period, delay=SENSORS.delay)
        off = cdpr.track(robot, [(0.4, 0.25, 0.1)], controller, seconds=25, sensors=sensors).deviation
        parts = np.array_split(np.linalg.norm(off, axis=1), 5)
        early, late = 1e3 * parts[1].max(), 1e3 * parts[-1].max()
        yield Row(
            f"GAIN = {pose_feedback.GAIN:g}", f"{name}, softer cables, gain {gain:g}: error after 5 and 20 s [mm]",
            f"{early:.2g}, {late:.2g}", late < early if name == "cogiro" else late > early,
        )  # fmt: skip


def sizes() -> Iterator[Row]:
    """Memory, time and file sizes."""
    robot, each = cdpr.load_robot("parallel"), sweep.CHUNK
    count = round((sweep.TASKS * each) ** (1 / 3))  # along each axis: as many chunks as a small sweep is split into
    with configured(scheduler="synchronous"):
        cdpr.sweep(robot, (8, 5, 4))
        start = time.process_time()
        result = cdpr.sweep(robot, (count, count, count))
        seconds = (time.process_time() - start) * each / count**3
        beyond = bytes_of(lambda: cdpr.sweep(robot, (count, count, count))) - result.nbytes
    yield Row(f"CHUNK = {each}", "processor time for a chunk [s]", f"{seconds:.1f}", 0.1 < seconds < 2)
    yield Row(f"CHUNK = {each}", "memory during computation [MB]", f"{beyond / 1e6:.0f}", beyond < 40e6)
    rows, points = clearance.ROWS, clearance.POINTS
    cdpr.clearances(robot, random_poses(robot, 1))
    most = bytes_of(lambda: cdpr.clearances(robot, random_poses(robot, rows)))
    yield Row(f"clearance.ROWS = {rows}", "memory for the distances [MB]", f"{most / 1e6:.0f}", most < 80e6)
    solved = cdpr.solve_many(robot, random_poses(robot, 5000))
    most = bytes_of(lambda: clearance.cable_curves(solved, 0.03, points))
    most /= solved.positions.size / 3 * robot.cables * points
    name = f"BYTES_PER_POINT = {clearance.BYTES_PER_POINT}"
    yield Row(name, "of 5,000 poses", f"{most:.0f}", most < clearance.BYTES_PER_POINT)
    cdpr.find_equilibria(robot, robot.home, starts=100)
    most = bytes_of(lambda: cdpr.find_equilibria(robot, robot.home, starts=1000)) / 1000
    yield Row(f"BYTES_PER_START = {BYTES_PER_START}", "of 1,000 starts", f"{most:.0f}", most < BYTES_PER_START)
    for name in ("parallel", "planar-vertical"):
        robot = cdpr.load_robot(name)
        cases = layout_equilibria.Cases.of(robot, random_poses(robot, 2000))
        asked = RobotBatch.of([robot] * 20)
        most = (
            bytes_of(lambda asked=asked, cases=cases: layout_equilibria.solve_layouts(asked, cases).tilt)
            / 40_000
            / robot.cables
        )
        yield Row(
            f"BYTES_PER_CABLE = {layout_equilibria.BYTES_PER_CABLE}", f"of 40,000 equilibria of {name}", f"{most:.0f}",
            most < layout_equilibria.BYTES_PER_CABLE,
        )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        cdpr.write_report(page, cdpr.load_robot("parallel"), grid=(2, 2, 2))
        film = re.search(r"data:video/mp4;base64,([^\"]+)", page.read_text(encoding="utf-8"))
        most = len(base64.b64decode(film[1])) if film else np.inf
    name = f"VIDEO_SIZE, VIDEO_RATE = {VIDEO_SIZE[0]} × {VIDEO_SIZE[1]}, {VIDEO_RATE:g}"
    yield Row(name, "video in the report of parallel [MB]", f"{most / 1e6:.2f}", most < 0.5e6)


FAMILIES = (equilibrium_constants, identifications, compensations, balances, methods, curves, feedback, sizes)


def main() -> int:
    table = new_table("", "constant", "measured quantity", "measured", "holds", text_columns=2)
    rows = [row for family in FAMILIES for row in family()]
    for *cells, holds in rows:
        table.add_row(*map(escape, cells), "yes" if holds else "[red]no[/]")
    Console().print(table)
    return int(not all(row.holds for row in rows))


if __name__ == "__main__":
    sys.exit(main())
