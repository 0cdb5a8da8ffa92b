"""One made-up result of each class, whose numbers are all different, so that none can stand in another's place.

``PLAIN`` and ``REAL`` are robots that differ in everything; the first has a name that is to be read, and not obeyed.
"""

import dataclasses
import math
from unittest.mock import Mock

import mujoco
import numpy as np
import xarray as xr
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.clearance import Clearances
from cdpr_sim.analysis.compensation import Compensation, CompensationOutcome
from cdpr_sim.analysis.equilibria import Equilibria, LoadPath
from cdpr_sim.analysis.identification import Identification, Outlier
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.core.equilibrium import Stability
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, EquilibriumPath
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import OUTCOMES, Check, Disagreement
from cdpr_sim.crosscheck.compare import Agreement, Verdict
from cdpr_sim.crosscheck.layout_validation import WATCHED, LayoutValidation, ValidatedRobot
from cdpr_sim.crosscheck.score import Outcome, Score
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.design.objectives import OBJECTIVES
from cdpr_sim.proof.certificate import Certificate
from cdpr_sim.proof.complete import CompleteEquilibria, Undecided
from cdpr_sim.report.robot_summary import RobotSummary, View

HOSTILE = '<img src=x onerror="alert(1)"> [bold]& [red]'

PLAIN = cdpr.Robot(
    exits=[[0.01, 0.02, 1.03], [0.04, 0.95, 1.06], [0.97, 0.88, 1.09], [0.91, 0.12, 1.13]],
    anchors=[[-0.05, -0.06, 0.07], [-0.08, 0.09, 0.051], [0.062, 0.073, 0.084], [0.095, -0.056, 0.067]],
    axial_stiffness=[1100.0, 1200.0, 1300.0, 1400.0], mass=1.7, center_of_mass=(0.001, 0.002, 0.003),
    force_min=[0.5, 0.6, 0.7, 0.8], force_max=[7.0, 8.0, 9.0, np.inf], breaking_load=[90.0, 80.0, 20.0, 60.0],
    platform_size=(0.21, 0.22, 0.23), name=HOSTILE, description="four cables", source="nowhere",
)  # fmt: skip

REAL = cdpr.Robot(
    exits=[[-2.1, -1.2, 3.3], [2.4, -1.5, 3.6], [0.7, 1.8, 3.9]], anchors=[[-0.2, -0.1, 0], [0.3, -0.1, 0], [0, 0.4,
    0]],
    axial_stiffness=[65e3, 75e3, 85e3], mass=23.0, pulley_radius=[0.04, 0.05, 0.06], pulley_axis=(0, 0, 1),
    linear_density=[0.064, 0.0, 0.128], winch_to_exit=1.5, reeving=[1, 2, 3], name="real", gravity=9.7,
)  # fmt: skip

POSES = {PLAIN: (0.4, 0.25, 0.2, 0.02, -0.03, 0.04), REAL: (0.1, 0.2, 1.3)}

SOURCES = ("mujoco", "newton", "seecr/fsolve", "seecr/least_squares", "proof")

SHIFT = np.array([0.011, 0.003, -0.007])
"""[m] From the commanded position, of the first source; each further one is 1, 2 and -3 mm farther."""

ANGLES = {source: (3.0 + n, 20.0 + n, 1.5 + n) for n, source in enumerate(SOURCES)}
"""[°] About x, y and z."""

TENSIONS = np.array([5.25, 0.0, 22.5, 3.75])


def equilibrium(source: str = "newton", robot: cdpr.Robot = PLAIN, **changes) -> cdpr.Equilibrium:
    """Of ``source``: one cable of four is slack, and one above its breaking load; of ``REAL``, none."""
    n = SOURCES.index(source)
    pose = np.array(POSES[robot])
    wrench = [1.25, -2.5, 3.75, 0.5, -0.75, 0.875] if robot is PLAIN else None
    problem = cdpr.Problem.of(robot, pose, 0.5 + 0.01 * np.arange(robot.cables), wrench)
    taut = TENSIONS[: robot.cables] > 0 if robot is PLAIN else np.ones(robot.cables, dtype=bool)
    tensions = np.where(taut, TENSIONS[: robot.cables] + 0.125 * n + (robot is REAL), 0.0)
    values = dict(
        problem=problem,
        pose=RigidTransform.from_components(
            pose[:3] + SHIFT + n * np.array([1e-3, 2e-3, -3e-3]), Rotation.from_euler("xyz", ANGLES[source],
            degrees=True)
        ),
        tensions=tensions, lengths=np.where(taut, 1.001 + 0.0001 * n, 0.98) * problem.rest_lengths,
        residual=1e-9 * 10.0**n, eigenvalues=np.array([12.5, 40.0, 90.0, 100.0, 110.0, 120.0]) + n,
        iterations=100 + n, source=source,
    )  # fmt: skip
    return cdpr.Equilibrium(**(values | changes))


def agreement(verdict: Verdict = Verdict.DISAGREE, **changes) -> Agreement:
    values = dict(
        verdict=verdict, reasons=("because of [this]",), position_error=2e-3, rotation_error=math.radians(3),
        tension_error=4.0, same_slack=False, static_in_mujoco=5.0, settled_in_statics=6.0,
    )  # fmt: skip
    return Agreement(**(values | changes))


MOTION_TIMES = 2.5 + 0.25 * np.arange(6)


def states(rows: int = 6) -> cdpr.Trajectory:
    """A motion of ``PLAIN`` that begins at 2.5 s; cables are slack in two of its states."""
    random = np.random.default_rng(21)
    commanded = random.uniform([0.2, 0.15, 0.1], [0.6, 0.35, 0.25], (rows, 3))
    problems = Problems.of(PLAIN, commanded)
    tensions = random.uniform(0.5, 6.0, (rows, 4))
    tensions[1, 2] = tensions[3, :2] = 0.0
    turns = Rotation.from_rotvec(random.uniform(-0.2, 0.2, (rows, 3)))
    poses = RigidTransform.from_components(commanded + random.uniform(-0.02, 0.02, (rows, 3)), turns)
    lengths = problems.rest_lengths * np.where(tensions > 0, 1.001, 0.98)
    return cdpr.Trajectory.of(problems, MOTION_TIMES[:rows], poses, lengths, tensions)


def batch(status=(0, 0, 0, 0, Status.STALLED, 0), source: str = "newton", factor: float = 1.0) -> EquilibriumBatch:
    """The states of that motion; the fifth is none. ``factor``: of tensions and residuals."""
    fields = {field.name: getattr(states(), field.name) for field in dataclasses.fields(EquilibriumBatch)}
    changes = {"status": np.array(status), "residuals": factor * 1e-9 * np.arange(1.0, 7.0), "source": source}
    return EquilibriumBatch(**(fields | {"tensions": factor * fields["tensions"]} | changes))


def path() -> EquilibriumPath:
    """The same rows, one after another."""
    rows = {field.name: getattr(batch(), field.name) for field in dataclasses.fields(EquilibriumBatch)}
    return EquilibriumPath(**rows, times=MOTION_TIMES, memory=cdpr.Memory.fresh(PLAIN))


def compensation(outcome: CompensationOutcome = CompensationOutcome.NEAREST, **changes) -> Compensation:
    values = dict(
        commanded=RigidTransform.from_translation(POSES[PLAIN][:3]), equilibrium=equilibrium(), outcome=outcome,
        distance=0.0123, arm=0.055, reasons=("so it is",), tension_limits=np.ones((2, 4)), reached=None,
    )  # fmt: skip
    return Compensation(**(values | changes))


EFFECTS = [Effect("exit 3 z", "exits", 8, "mm", 1.5, 2.5, 3.5), Effect("mass", "mass", 0, "g", 4.5, 5.5, 6.5)]


def sensitivity(margin: float = 4e-3) -> Sensitivity:
    return Sensitivity(equilibrium(), {"mass": np.arange(6.0)[:, None]}, {"mass": 10 + np.arange(4.0)[:, None]}, margin)


def modes() -> Modes:
    shapes = np.eye(6) + 0.25 * np.eye(6, k=2)
    return Modes(equilibrium(), 7.25 + np.arange(6.0), shapes)


def equilibria(saddles: bool = True) -> Equilibria:
    """Three stable ones and a saddle."""
    found = [
        *(equilibrium(source) for source in SOURCES[:3]),
        equilibrium(SOURCES[3], eigenvalues=np.array([-3.0, 41.0])),
    ]
    return Equilibria(found[0].problem, tuple(found), np.array([0.0125, 0.25, 0.375, 0.5]), 10, saddles=saddles)


def load_path(jumps=(0.25, 0.625)) -> LoadPath:
    return LoadPath(np.ones(1), (equilibrium(),), jumps)


def certificate(source: str = "newton", **changes) -> Certificate:
    one = equilibrium(source)
    near = np.array([[-1e-12], [2e-12]])
    values = dict(
        equilibrium=one, exists=True, index=0, slack=(False, True, False, None),
        position=one.position + near, rotation=np.stack([one.rotation_matrix] * 2), tensions=one.tensions + near,
        digits=11.0, decimals={"position": ("0.1", "0.2", "0.3")}, radius=5.67e-4, position_error=1.23e-9,
        rotation_error=2.34e-8, tension_error=3.45e-7, reasons=(),
    )  # fmt: skip
    return Certificate(**(values | changes))


def no_certificate() -> Certificate:
    nothing = dict(exists=False, index=None, slack=(None,) * 4, digits=0.0, radius=math.nan, position_error=math.inf)
    return certificate("mujoco", **nothing, rotation_error=math.inf, tension_error=math.inf, reasons=("too [flat]",))


def complete(*undecided: Undecided, pending: int = 0) -> CompleteEquilibria:
    found = (certificate(), certificate("mujoco", index=2))
    return CompleteEquilibria(found[0].equilibrium.problem, found, undecided, pending, 1234, 5.5)


UNDECIDED = Undecided("a fold", 7, np.arange(6.0), 10 + np.arange(6.0), 1)


def clearances() -> Clearances:
    random, rows = np.random.default_rng(5), batch()
    distances = [random.uniform(0.002, 0.2, (6, n)) for n in (6, 4, 4)]
    for one in distances:
        one[4] = np.nan
    return Clearances(rows, 0.01, np.zeros((6, 4, 2, 3)), *distances)


def identification(robot: cdpr.Robot = PLAIN, **changes) -> Identification:
    values = dict(
        robot=robot,
        names=("axial_stiffness", "rest_length_offset 3", "mass"), units=("N", "m", "kg"),
        values=np.array([1234.5, 0.0021, 0.4]), standard_errors=np.array([6.7, 0.00031, np.inf]),
        correlations=np.eye(3), residuals=np.array([[3e-3, 4e-3, np.nan, np.radians(2), np.nan, np.nan, 3.5]]),
        spread=1.5, scatters={"position": 5e-3, "rotation": math.radians(6), "tension": 3.0},
        repeats=np.zeros(1, dtype=bool), estimated=("position", "rotation"), reasons=("mass is unknown",),
        predictions={("axial_stiffness", "mass"): 3.4567, ("mass",): np.inf, ("axial_stiffness",): 1.2345},
        degrees_of_freedom=1, deviance=10.0, outliers=(Outlier(1, "tension 1", -4.56),),
        kinds=np.array([0, 0, 0, 1, 1, 1, 2]), given=robot, requested=("axial_stiffness", "mass"),
    )  # fmt: skip
    return Identification(**(values | changes))


MOVED = PLAIN.replace(
    exits=PLAIN.exits + np.diag([0.01, 0.02, -1.5, 0])[:, :3], center_of_mass=(0.001, 0.0025, 0.003),
    axial_stiffness=[1100.0, 1500.0, 1300.0, 1400.0], linear_density=[0, 0, 0, 0.002],
)  # fmt: skip


def layout(**changes) -> LayoutResult:
    """Two exits, the centre of mass, a stiffness and a mass per length changed."""
    cases = Cases.of(PLAIN, [POSES[PLAIN][:3], (0.5, 0.26, 0.21)])
    found = Mock(spec=LayoutEquilibria)
    found.layouts.displacements = np.array([0.0345])
    values = dict(
        robot=MOVED, given=PLAIN.replace(linear_density=[0, 0, 0, 0.001]), objective=OBJECTIVES["worst tilt"],
        before=0.5, after=0.125, cases=cases,
        limits=(np.zeros(4), np.full(4, 9.5)), given_allowed=True, equilibria_before=found, equilibria=found,
        history=np.arange(21.0).reshape(7, 3), layouts_evaluated=1440, message="It ended.", values=np.arange(3.0),
        variables=("one", "two", "three"),
    )  # fmt: skip
    return LayoutResult(**(values | changes))


def validation(score: float = 0.25, agree: int = 6, **changes) -> LayoutValidation:
    """Before 0.75 in MuJoCo; ``score`` after; the methods agree at so many of six cases."""
    watched = {name: 0.05 + 0.01 * n for n, name in enumerate(WATCHED)}
    errors = {"position_error": 1.5e-9, "rotation_error": math.radians(2.5e-8), "tension_error": 3.5e-7}
    sides = [
        ValidatedRobot(
            robot, batch(), batch([0] * 6, "mujoco"), errors, np.arange(6) < agreed, 1, worth, np.arange(6.0),
            {name: one * (1 + n * (worth != 0.75)) for n, (name, one) in enumerate(watched.items())},
        )
        for robot, agreed, worth in ((PLAIN, 6, 0.75), (MOVED, agree, score))
    ]  # fmt: skip
    found = layout(**changes)
    return LayoutValidation(found, found.cases, *sides)


def front() -> Front:
    goals = tuple(OBJECTIVES[name] for name in ("worst tilt", "worst deviation"))
    scores = np.array([[0.1, 0.02], [0.2, 0.01]])
    found = Mock(spec=RobotBatch)
    return Front(PLAIN, goals, np.array([0.3, 0.03]), scores, found, layout().cases, 99)


HULL = Hull(np.zeros(3), np.array([(0, 0, 0), (2, 0, 0), (0, 3, 0), (0, 0, 5.0)]), np.array([(0, 2, 1), (0, 1, 3), (0,
    3, 2), (1, 2, 3)]))  # fmt: skip
"""A tetrahedron: 2 · 3 · 5/6 m³."""


def over_x(**variables) -> xr.Dataset:
    """Numbers at four poses along x, of one robot."""
    data = {name: (("x", "y", "z"), np.array(values).reshape(4, 1, 1)) for name, values in variables.items()}
    coordinates = {"x": [0.1, 0.2, 0.3, 0.4], "y": [0.25], "z": [0.1], "robot": HOSTILE, "material": "rope"}
    return xr.Dataset(data, coords=coordinates)


def swept() -> xr.Dataset:
    fine, bad = Status.CONVERGED, Status.STALLED
    return over_x(
        status=[fine, fine, fine, bad], tilt=[*np.radians([1.0, 2.0, 6.0]), np.nan],
        distance=[0.010, 0.020, 0.050, np.nan], slack_count=[0, 1, 2, 3], feasible=[True, False, False, False],
    )  # fmt: skip


def checked() -> Check:
    agree, apart = OUTCOMES.index("agree"), OUTCOMES.index("disagree")
    dataset = over_x(
        outcome=[agree, agree, agree, apart], position_error=[1e-9, 2e-9, 3e-9, 1.0],
        rotation_error=np.radians([1e-7, 4e-7, 2e-7, 90.0]), tension_error=[5e-8, 1e-8, 2e-8, 9.0],
        static_in_mujoco=[0.0] * 4, settled_in_statics=[0.0] * 4, proved=[True, True, False, False],
    )  # fmt: skip
    return Check(dataset, (Disagreement(HOSTILE, "rope", (0.4, 0.25, 0.1), "disagree", ("too far",)),))


def scores() -> list[Score]:
    answers = [
        ("lower", True, 9.5, True),
        ("lower", True, 3.25, True),
        ("lower", False, 0.0, False),
        ("higher", True, 12.0, False),
    ]
    outcomes = tuple(
        Outcome(f"p{n}", level, n, claimed, digits, stable, 0.001 * (n + 1) ** 2)
        for n, (level, claimed, digits, stable) in enumerate(answers)
    )
    return [Score("first", outcomes), Score("second", outcomes[:1])]


def view(n: int = 0, **changes) -> View:
    """Both methods at one commanded pose, each ``n`` cm farther along x; they disagree."""
    pose = RigidTransform.from_translation([0.01 * n, 0, 0])
    settled, solved = (
        dataclasses.replace(
            one, pose=pose * one.pose, problem=dataclasses.replace(one.problem, pose=pose * one.problem.pose)
        )
        for one in (equilibrium("mujoco"), equilibrium("newton"))
    )
    values = dict(problem=settled.problem, settled=settled, solved=solved, agreement=agreement(), shapes=None)
    return View(**(values | changes))


def summary(**changes) -> RobotSummary:
    """Of ``PLAIN``: a first pose, and two worst ones; without maps."""
    lost = cdpr.NotSettled("it did not come to rest", view(2).settled)
    values = dict(
        robot=PLAIN, first=view(), worst=(view(1), view(2, settled=lost, agreement=None)), most=(0.0678, 0.456),
        check=checked(), plane=None, modes=modes(), motion=None, missing=("No maps: of [course].",),
    )  # fmt: skip
    return RobotSummary(**(values | changes))


MODEL = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.004"/><worldbody>
  <body><freejoint name="[box]"/><geom size=".1"/></body><body><joint name="ball" type="ball"/><geom size=".1"/></body>
  <body><joint name="lift" type="slide"/><geom size=".1"/></body><body><joint/><geom size=".1"/></body>
</worldbody></mujoco>""")
"""A joint of each kind, the last without a name."""


def tendons() -> cdpr.TendonTensions:
    """One pulls, one is slack, one pushes; no friction anywhere."""
    parts = [[8.0, 0, -7], [1.5, 0, -1], [0.25, 0, -0.5], [0.0, 0, 0], [0.125, 0, -0.25], [2.0, 0, -3]]
    own = np.sum(parts, axis=0)
    arrays = (np.array([True, True, False]), np.array([1.1, 1.2, 1.3]), own, *map(np.array, parts), own == 0)
    return cdpr.TendonTensions(("rope", "[loose]", "2"), *arrays)


def model_rest(**changes) -> cdpr.ModelEquilibrium:
    """Of ``MODEL``, with friction; the ways disagree."""
    turned = [np.cos(0.1), 0.0, np.sin(0.1), 0.0]
    values = dict(
        qpos=np.array([0.1, 0.2, 0.3, *turned, *turned, 0.05, 0.3]), act=np.array([0.6]), ctrl=np.array([0.7, 0.8]),
        tendon_tensions=tendons(), residual=1.2e-9, unbalanced=np.zeros(11), friction=np.zeros(11), creep=0.0034,
        contact_forces=(
            cdpr.ContactForce(("world", "[box]"), np.array([1.0, 2.0, 3.0]), 11.0, 4.0, 0.75),
            cdpr.ContactForce(("[box]", "lift"), np.array([4.0, 5.0, 6.0]), 12.0, 3e-5, 1 + 1e-12),
        ),
        friction_share=0.75, stiffness_eigenvalues=np.array([-0.1, 0.0, 2.0]), growth=-0.3, neutral=("[box]", "ball"),
        stability=Stability.NEUTRAL, iterations={"steps": 21, "newton": 4}, way="motion",
        agreement=cdpr.ModelAgreement(False, "start", 0.01, 0.02, 0.03, ("[bodies] differ", "so do tensions")),
        notes=("a [note]",),
    )  # fmt: skip
    return cdpr.ModelEquilibrium(**(values | changes))


def diagnosis(**changes) -> cdpr.ModelDiagnosis:
    findings = [
        cdpr.ModelFinding(kind, f"tendon '[{name}]'", f"problem of {name}", f"remedy of {name}")
        for kind, name in ((cdpr.FindingKind.SPRING_PUSHES, "one"), (cdpr.FindingKind.TIME_STEP, "two"))
    ]
    values = dict(
        findings=tuple(findings), equilibrium=None, fastest_period=0.0123, notes=("not [judged]",),
        stable_time_steps={"Euler": 0.0021, "implicitfast": np.inf, "RK4": 0.0043},
    )  # fmt: skip
    return cdpr.ModelDiagnosis(**(values | changes))
