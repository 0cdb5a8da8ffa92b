"""Every figure of the package, of results that are made up, all of whose numbers are different."""

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import made_up
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
import compensation
import controller_comparison
import controllers
import fully_constrained
import lines
import machines
import paper_figures
import real_cables
import solvers
import tilt_condition
import two_cable
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problems
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.design.layout_equilibria import Cases
from cdpr_sim.drawing import maps, path_maps, still
from cdpr_sim.report import layout_pictures

UP = (0.0, 0.0, 1.0)


@contextlib.contextmanager
def changed(module: object, **values: object) -> Iterator[None]:
    """These names of the module, for as long as it is drawn."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in values.items():
            patch.setattr(module, name, value)
        yield


def rests(seed: int, robot: cdpr.Robot, commanded, slack=()) -> EquilibriumBatch:
    """Somewhere near each command, turned about y alone; ``slack``: (row, cable) of the cables that are."""
    random, commanded = np.random.default_rng(seed), np.asarray(commanded, dtype=float)
    rows = len(commanded)
    tensions = random.uniform(0.5, 2.0, (rows, robot.cables))
    for row, cable in slack:
        tensions[row, cable] = 0.0
    problems = Problems.of(robot, commanded)
    turns = Rotation.from_rotvec(random.uniform(0.05, 0.3, (rows, 1)) * [0, 1, 0])
    return EquilibriumBatch(
        problems=problems, positions=commanded + random.uniform(0.005, 0.02, (rows, 3)) * [1, 0, -1],
        rotations=turns.as_matrix(), lengths=problems.rest_lengths * np.where(tensions > 0, 1.001, 0.98),
        tensions=tensions, residuals=np.zeros(rows), iterations=np.zeros(rows, dtype=int),
        status=np.zeros(rows, dtype=int), source="made up", stiffness=np.sort(random.uniform(1e4, 5e5, (rows, len(
        robot.free)))),
    )  # fmt: skip


def a_line(seed: int, robot: cdpr.Robot, height: float, ends: tuple[float, float], rows: int, slack=()) -> lines.Line:
    """MuJoCo's points are every second row."""
    along = lines.along_x(robot, height, ends, rows)
    return lines.Line(rests(seed, robot, along, slack), rests(seed + 1, robot, along[::2]))


def in_pairs(equilibria: EquilibriumBatch) -> EquilibriumBatch:
    """Level, with equal tensions in each pair of cables."""
    level = np.broadcast_to(np.eye(3), equilibria.rotations.shape)
    tensions = np.repeat(equilibria.tensions[:, ::2], 2, axis=1)
    return dataclasses.replace(equilibria, rotations=level, tensions=tensions)


def width(name: str, slack=(), workspace=(), form: Callable = lambda equilibria: equilibria) -> lines.Width:
    """Of the robot's cables, some are slack at the first poses of the line of the first material."""
    robots = [cdpr.load_robot(name).replace(material=one) for one in ("vectran-0.7mm", "fishing-0.4mm")]
    y = robots[0].home[1]
    poses = [(0.2, y, 0.28), (0.5, y, 0.28), (0.6, y, 0.1)]
    across = (a_line(10 * i + 1, one, 0.1, (0.1, 0.7), 7, slack if i == 0 else ()) for i, one in enumerate(robots))
    both = tuple(lines.Line(form(one.static), form(one.settled)) for one in across)
    outline = np.array([(x, y, z) for x, z in workspace]).reshape(-1, 3)
    return lines.Width(form(rests(5, robots[1], poses, [(0, 0), (2, 1), (2, 2)] if slack else ())), both, outline)


def paper_lines() -> tuple[lines.Line, ...]:
    """Two layouts, two materials and two heights."""
    return tuple(
        a_line(100 * i + 10 * j + k, cdpr.load_robot(name).replace(material=material), height, (0.17, 0.63), 3)
        for i, name in enumerate(("parallel", "cogiro"))
        for j, material in enumerate(("vectran-0.7mm", "fishing-0.4mm"))
        for k, height in enumerate((0.1, 0.2))
    )


def bar() -> two_cable.TwoCableBar:
    robot, few = cdpr.load_robot("two-cable"), [(0.3, 0, 0.3), (0.5, 0, 0.2)]
    return two_cable.TwoCableBar(
        a_line(1, robot, 0.2, (0.2, 0.6), 5), rests(3, robot, few, [(0, 1)]), rests(4, robot, few)
    )


STIFFNESS = np.array([1000.0, 100.0, 50.0, 15.0])
"""[N] Of the bar that drifts."""


def manifold() -> two_cable.Manifold:
    robots = [cdpr.load_robot("two-cable").replace(axial_stiffness=EA) for EA in STIFFNESS]
    commanded = [[0.2, 0, 0.3], [0.5, 0, 0.15]]
    return two_cable.Manifold(
        tuple(rests(i, one, commanded) for i, one in enumerate(robots)),
        tuple(rests(10 + i, one, commanded) for i, one in enumerate(robots[::2])),
    )


def convergence() -> solvers.Convergence:
    methods, random = ("newton", "fsolve", "least_squares"), np.random.default_rng(1)
    solved, stable = (dict(zip(methods, np.array(some), strict=True)) for some in (
        [[10, 9], [8, 4], [7, 1]], [[6, 5], [4, 3], [3, 0]]))  # fmt: skip
    seconds = {method: random.uniform(1, 2, (2, 11)) * 10.0**-i for i, method in enumerate(methods)}
    robot, compiled = cdpr.load_robot("parallel"), np.array([1e-5, 2e-5])
    return solvers.Convergence(robot, np.array([1e2, 1e4]), 10, solved, stable, seconds, compiled)


def agreements(*verdicts: cdpr.Verdict) -> dict[str, list[cdpr.Agreement]]:
    """Of two robots; those of the second are all as they should be."""
    random = np.random.default_rng(2)
    return {
        name: [
            cdpr.Agreement(one, (), *(size * 10.0 ** random.uniform(-12, -9) for size in (1, 10, 100)), True, 0.0, 0.0)
            for one in some
        ]
        for name, some in {"first": verdicts, "second": [cdpr.Verdict.AGREE] * len(verdicts)}.items()
    }


AGREE, NEUTRAL, DISAGREE = cdpr.Verdict.AGREE, cdpr.Verdict.AGREE_EXCEPT_NEUTRAL, cdpr.Verdict.DISAGREE


def stretched() -> fully_constrained.Pretension:
    """Its largest tensions are as given; cables 5 and 6 are slack where it is drawn."""
    robot, random = cdpr.load_robot("ipanema-1"), np.random.default_rng(3)

    def some(seed: int, values: np.ndarray, largest: np.ndarray) -> fully_constrained.Series:
        both = []
        for step in (1, 2):
            count = len(values[::step])
            found = rests(seed + step, robot, np.tile(robot.home, (count, 1)), [(1, 3)])
            pulls = found.tensions * (largest[:count] / found.tensions.max(-1))[:, None]
            both.append(dataclasses.replace(found, tensions=pulls))
        return fully_constrained.Series(values, 2, *both)

    sizes, errors = np.array([80.0, 150.0, 300.0, 600.0]), np.linspace(-0.01, 0.01, 5)
    largest = np.array([1200.0, 700, 300, 400, 500])
    return fully_constrained.Pretension(
        some(10, sizes, sizes),
        {what: some(20 + 10 * i, sizes, sizes) for i, what in enumerate(fully_constrained.PUSHES)},
        dict(zip(fully_constrained.PUSHES, (110.0, 120.0, 130.0, 140.0, 160.0), strict=True)),
        {cable: some(90 + 10 * cable, errors, largest * (1 - cable / 10))
         for cable in (fully_constrained.ABOVE, fully_constrained.BELOW)},
        np.sort(random.uniform(1e3, 2e3, 6)), rests(4, robot, robot.home[None], [(0, 4), (0, 5)]),
    )  # fmt: skip


SAGS = np.linspace(0.003, 0.010, 8)
"""[m] Of ropes with mass."""


def properties() -> real_cables.RealCables:
    """A platform 5 mm beside where its winches believe it to be; ropes that sag by 3 to 10 mm, the last one slack."""
    random, radii = np.random.default_rng(5), np.array([0.0, 0.01, 0.02])
    robots = ("DemoBot, crossed (cogiro)", "DemoBot, parallel", "crane of 15 m")
    effects = tuple(
        real_cables.CableEffect(robot, what, random.uniform(1e-3, 9e-3, 21), random.uniform(0, 1, 21), 1e-9, i)
        for i, robot in enumerate(robots)
        for what in real_cables.ROWS
    )
    growths = tuple(
        real_cables.Growth(title, axis, radii, np.outer(radii, random.uniform(0.5, 1.0, 5)), radii[::2],
                           np.outer(radii[::2], random.uniform(0.5, 1.0, 5)))
        for title, axis in (*((one, real_cables.BELOW) for one in robots), (robots[1], real_cables.ABOVE))
    )  # fmt: skip
    robot, at = cdpr.load_robot("cogiro"), [(0.3, 0.25, 0.1)]
    over = rests(1, robot.replace(pulley_radius=0.02, pulley_axis=UP), at)
    over = dataclasses.replace(over, positions=np.array([[0.303, 0.25, 0.096]]))
    return real_cables.RealCables(effects, growths, over, rests(2, robot.replace(linear_density=0.01), at, [(0, 7)]))


def profiles(of: EquilibriumBatch) -> np.ndarray:
    """Two straight pieces, whose corner in the middle hangs by ``SAGS``."""
    exits, anchors = of.robot.exits, of.positions[0] + of.robot.anchors @ of.rotations[0].T
    return np.stack([exits, (exits + anchors) / 2 - SAGS[:, None] * np.array(UP), anchors], axis=1)[None]


AWAY = {"before": (4e-3, 7e-3), "after": (1e-4, 3e-4), "settled_before": (5e-3, 8e-3), "settled_after": (2e-4, 6e-4),
        "position_only": (9e-3, 2e-3)}  # fmt: skip
"""[m] Of a line with and without compensation, at its two poses; ten times as many radians about y."""


def compensated(exact: bool) -> compensation.CompensatedLine:
    robot, poses = cdpr.load_robot("cogiro"), [(0.3, 0.25, 0.1), (0.4, 0.25, 0.1)]
    found = [cdpr.solve(robot, pose) for pose in poses]

    def shifted(kind: str) -> list[cdpr.Equilibrium]:
        moved = [
            Pose(np.array(pose) - np.array([0, 0, far]), Rotation.from_euler("y", 10 * far).as_matrix())
            for pose, far in zip(poses, AWAY[kind], strict=True)
        ]
        return [dataclasses.replace(one, pose=at) for one, at in zip(found, moved, strict=True)]

    each = [SimpleNamespace(commanded=one.problem.pose, exact=exact or n == 0) for n, one in enumerate(found)]
    kinds = list(AWAY)[: 4 if exact else 5]
    before, after, settled_before, settled_after, *only = map(shifted, kinds)
    return compensation.CompensatedLine(
        "exact" if exact else "not", before, after, settled_before, settled_after, each, *only
    )


def runs() -> list[controller_comparison.Run]:
    """Two schemes, of which the second lets the platform fall."""
    robot, found = cdpr.load_robot("cogiro"), []
    for i, layout in enumerate(("cogiro", "parallel")):
        for j, one in enumerate((("vectran-0.7mm", "line", 0.05), ("fishing-0.4mm", "circle", 0.5))):
            for k, scheme in enumerate((controller_comparison.TENSIONS, controller_comparison.RIGID)):
                equilibria = rests(100 * i + 10 * j + k, robot, np.tile(robot.home, (4, 1)), [(0, 1)] if k else ())
                trajectory = cdpr.Trajectory.through(equilibria, controller_comparison.PAUSE + np.arange(4.0))
                task = controller_comparison.TrackingTask(layout, *one)
                found.append(controller_comparison.Run(task, scheme, trajectory, k == 1))
    return found


GIVEN = made_up.PLAIN.replace(name="given", breaking_load=np.inf)
MOVED = GIVEN.replace(
    exits=made_up.MOVED.exits, center_of_mass=(0.001, 0.0025, 0.003), axial_stiffness=[1100.0, 1500.0, 1300.0, 1400.0],
    anchors=GIVEN.anchors + np.diag([0, 0, 0.02, 0.01])[:, 1:],
)  # fmt: skip


def validation(objective: str = "worst tilt", robot: cdpr.Robot = MOVED, settled: bool = True) -> LayoutValidation:
    """Of three poses, of which the second is the worst before; MuJoCo settles at all but the first, or at none."""
    cases = Cases.of(GIVEN, [(0.4, 0.25, 0.2), (0.5, 0.25, 0.22), (0.45, 0.3, 0.24)])
    found = made_up.layout(given=GIVEN, robot=robot, objective=made_up.OBJECTIVES[objective], cases=cases)
    found.equilibria.layouts.displacements = np.array([0.0345])
    true, sides = made_up.validation(), []
    for n, side in enumerate((true.before, true.after)):
        rest = rests(n, (GIVEN, robot)[n], cases.positions, [(1, 0), (1, 2), (2, 1)] if n == 0 else [(1, 3)])
        status = np.where(np.arange(3) > (0 if settled or not n else 3), 0, int(cdpr.Status.STALLED))
        rest = dataclasses.replace(rest, status=status)
        values = dict(settled=rest, agrees=np.arange(3) < 1 + n, each=np.array([0.1, 0.3, np.nan]), score=0.2 + n / 10)
        sides.append(dataclasses.replace(side, robot=rest.robot, **values))
    return LayoutValidation(found, cases, *sides)


MAPS = np.radians([[1.0, 2.0, 3.0], [4.0, 5.0, np.nan]])
"""Over x and z, of the given robot; of the other, half of it."""

AXES = {"x": np.array([0.5, 1.5]), "y": np.zeros(1), "z": np.array([0.5, 1.5, 2.5])}


def picture(*args) -> Figure:
    values = lambda _, robot, __: MAPS / (1 + (robot is not GIVEN))  # noqa: E731
    with changed(layout_pictures, objective_map=values, plane=lambda *_: AXES):
        return layout_pictures.picture(validation(*args))


LEAST = np.array([[0.004, 0.012, 0.006], [0.0125, np.nan, 0.020]])
"""[m] Over y and z."""


def distances(enough: float) -> Figure:
    found = SimpleNamespace(
        least=LEAST[None], fitting=0.0, free=lambda enough: enough < LEAST, nearest=lambda index: str(index)
    )
    axes = {"x": np.zeros(1), "y": np.array([0.5, 1.5]), "z": np.array([0.5, 1.5, 2.5])}
    with changed(layout_pictures, plane=lambda *_: axes, clearances=lambda *_, **__: found):
        return layout_pictures.clearance_map(cdpr.load_robot("parallel"), "yz", None, enough, None)


@functools.cache
def swept(*robots: str, materials: tuple[str, ...] | None = None, margin: bool = True):
    """Made-up numbers at four by three poses in the x-z plane: the larger, the farther to the right and up."""
    plane = {"x": [0.2, 0.3, 0.4, 0.5], "z": [0.1, 0.2, 0.3]}
    quantities = maps.QUANTITIES if margin else [one for one in maps.QUANTITIES if one != "capacity_margin"]
    data = cdpr.sweep([*robots], plane, materials, quantities=quantities)
    for n, name in enumerate(("tilt", "distance", "slack_count", "feasible", "capacity_margin")):
        if name not in data:
            continue
        values = np.arange(data[name].size, dtype=float).reshape(data[name].shape) + 1
        if name == "slack_count":
            values %= 4
        elif name in ("feasible", "capacity_margin"):
            values = data["x"].values.reshape(-1, 1, 1) - 0.33 + 0.01 * np.arange(values.shape[0]).reshape(-1, 1, 1, 1)
            values = np.broadcast_to(values, data[name].shape)
        else:
            values *= 0.002 * (n + 1)
        if data[name].dtype.kind == "f" and name != "capacity_margin":
            values.flat[3] = np.nan
        data[name] = data[name].copy(data=values > 0 if name == "feasible" else values.astype(data[name].dtype))
    status = np.where(np.isnan(data["tilt"].values), int(cdpr.Status.STALLED), data["status"].values)
    return data.assign(status=data["status"].copy(data=status.astype(data["status"].dtype)))


def thin(at: float = 0.3):
    """An under-actuated robot: only the poses at this x [m] are feasible, and beside them no tensions balance."""
    data = swept("cogiro").copy()
    held = np.broadcast_to((data["x"].values == at)[:, None, None], data["feasible"].shape[-3:])
    data["feasible"] = data["feasible"].copy(data=held.reshape(data["feasible"].shape))
    margins = np.where(held, 2.0, -np.inf).reshape(data["capacity_margin"].shape)
    data["capacity_margin"] = data["capacity_margin"].copy(data=margins)
    return data


def pretensioned():
    """With forces that some poses can resist, and a fully_constrained."""
    data = swept("cogiro", margin=False)
    return data.assign(wrench_feasible=~data["feasible"]).assign_coords(pretension=("robot", [120.0]))


def checked():
    """Four outcomes at (x, z), and differences of up to 1.5e-6 mm."""
    data = cdpr.check("cogiro", {"x": [0.3, 0.5], "z": [0.1, 0.2]}).dataset
    code = {name: i for i, name in enumerate(data["outcome"].attrs["flag_meanings"].split())}
    outcomes = [code[one] for one in ("agree", "refused", "disagree", "agree_except_neutral")]
    data["outcome"][:] = np.reshape(outcomes, data["outcome"].shape)
    data["position_error"][:] = np.reshape([1.5e-9, np.nan, 0.0, 4e-15], data["position_error"].shape)
    return data


def along_a_path():
    """Of two robots, at five poses."""
    poses = np.linspace([0.3, 0.25, 0.1], [0.5, 0.25, 0.2], 5)
    data = cdpr.sweep(["cogiro", "parallel"], poses=poses)
    for n, name in enumerate(("tilt", "distance")):
        data[name] = data[name].copy(data=0.01 * (n + 1) * (1 + np.arange(data[name].size)).reshape(data[name].shape))
    data["slack_count"] = data["slack_count"].copy(data=np.arange(10).reshape(data["slack_count"].shape) % 4)
    data["feasible"] = data["feasible"].copy(data=np.arange(10).reshape(data["feasible"].shape) % 3 == 0)
    return data


TURNED = cdpr.Robot(
    exits=[[1, 0, 1], [-1, 0, 1], [0, 1, 1]], anchors=[[0, -0.1, 0], [0, 0.1, 0], [0.1, 0, 0.05]],
    axial_stiffness=1e3, mass=1, platform_size=(0.2, 0.2, 0.1), center_of_mass=(0.02, 0.01, -0.03), name="$turned$",
)  # fmt: skip


def sheet() -> Figure:
    robots = [cdpr.load_robot("parallel"), cdpr.load_robot("two-cable")]
    return still.sheet([robot.replace(mass=1234.5, frame=[(0, 0, 0), (3, 2 * (i == 0), 1)])
                        for i, robot in enumerate(robots)])  # fmt: skip


def front() -> Figure:
    one, confirmed = np.array([[2.0, 10.0], [1.0, 30.0]]), np.array([[2.1, 11.0], [1.1, 31.0]])
    both = [("first", one), ("second", one + 1)]
    return layout_pictures.draw_front(both, ("tilt [°]", "size [mm]"), "title", "caption", (5.0, 50.0), confirmed)


def machine_answers() -> Figure:
    """Of both machines, over a map of three by two poses, one of which is not held, and for two pretensions."""
    values, found = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, np.nan]]), []
    for machine in machines.MACHINES:
        positions = np.zeros((2, 3, 3))
        positions[..., list(machine.axes)] = np.stack(np.meshgrid([-0.3, 0.1, 0.5], [0.2, 0.9]), axis=-1)
        curves = 1e-3 * np.array([[0.4, 0.2, np.nan], [0.6, 0.5, 0.1]])
        tensions = np.array([0.0, 10.0, 20.0])
        found.append(
            machines.Answers(
                machine, positions, 1e-3 * np.stack([values, 2 * values]), 1e3 * values, tensions, curves, curves + 1e-5
            )
        )
    return machines.draw_machines(found)


STUDIES: dict[str, Callable] = {
    "two-cable-manifold": manifold,
    "two-cable-poses": bar,
    "two-cable-closed-form": bar,
    "layouts": lambda: [
        rests(i, robot, robot.home[None])
        for i, robot in enumerate(map(cdpr.load_robot, ("planar-vertical", "planar-horizontal", "parallel", "cogiro")))
    ],
    "planar-vertical": lambda: width("planar-vertical", [(0, 0), (1, 0), (2, 0), (0, 1)]),
    "planar-horizontal": lambda: width("planar-horizontal", form=in_pairs),
    "tilt-condition": tilt_condition.moment_balances,
    "cogiro": lambda: width("cogiro"),
    "parallel": lambda: width(
        "parallel", [(0, 0), (1, 0), (0, 1), (0, 2)], [(0.15, 0.1), (0.2, 0.3), (0.6, 0.3), (0.65, 0.1)]
    ),
    "paper-line": paper_lines,
    "convergence": convergence,
    "agreement": lambda: agreements(AGREE, AGREE, AGREE, NEUTRAL),
    "real-cables": properties,
    "fully-constrained": stretched,
}
"""Made-up results of every study."""

made = functools.cache(lambda name: STUDIES[name]())


DRAWN = {name: picture.draw for name, picture in paper_figures.PICTURES.items()} | {
    "real-cables": real_cables.draw_real_cables, "fully-constrained": fully_constrained.draw_pretension,
}  # fmt: skip


def in_gallery(name: str) -> Figure:
    with changed(two_cable, SURFACE=(10, 7)), changed(real_cables, cable_profiles=profiles):
        return DRAWN[name](made(name))


FIGURES: dict[str, Callable[[], Figure]] = {
    **{name: functools.partial(in_gallery, name) for name in STUDIES},
    "agreement where they disagree": lambda: solvers.draw_agreement(agreements(NEUTRAL, DISAGREE, AGREE)),
    "agreement where they agree": lambda: solvers.draw_agreement(agreements(AGREE, AGREE)),
    "agreement where some disagree": lambda: solvers.draw_agreement(agreements(AGREE, DISAGREE)),
    "compensation": lambda: compensation.draw_compensation([compensated(True), compensated(False)]),
    "controllers": lambda: controllers.controllers(runs()),
    "better layout": picture,
    "better layout of exits alone": lambda: picture("worst deviation", GIVEN.replace(exits=MOVED.exits)),
    "distances": lambda: distances(0.005),
    "distances of which none is too small": lambda: distances(0.0),
    "front": front,
    "front of a design": lambda: layout_pictures.pareto_picture(made_up.front()),
    "maps": lambda: maps.draw_elastic_map(swept("parallel", "cogiro", materials=("vectran-0.7mm", "fishing-0.4mm"))),
    "maps of one robot": lambda: maps.draw_elastic_map(swept("cogiro", margin=False)),
    "maps of a line": lambda: maps.draw_elastic_map(thin()),
    "maps of nothing": lambda: maps.draw_elastic_map(thin(0.9), names=["feasible"]),
    "maps of pretension": lambda: maps.draw_elastic_map(pretensioned(), names=["wrench_feasible", "slack_count"]),
    "maps of agreement": lambda: maps.draw_agreement_map(checked()),
    "maps along a path": lambda: path_maps.draw_path_map(along_a_path(), [(0.0, "A"), (0.4, "B"), (1.0, "C")]),
    "machines": machine_answers,
    "a robot": lambda: still.draw(TURNED, (0, 0, 0.2, 0, 0, math.pi / 2)),
    "a planar robot": lambda: still.draw(cdpr.load_robot("planar-vertical").replace(pulley_radius=0.01)),
    "robots": sheet,
}

figure = functools.cache(lambda name: FIGURES[name]())
