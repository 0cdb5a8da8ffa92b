"""What robots, problems, statics and workspaces refuse: the call, and words of its sentence."""

import numpy as np
import pytest
from sample_problems import hanging_mass
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.robot_batch import RobotBatch

INF = np.inf
POSE = (0.3, 0.25, 0.1)
EXITS = [[-1, 0, 1], [1, 0, 1], [0, 1, 1.0]]
ANCHORS = [[-0.1, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]


def made(**changes) -> cdpr.Robot:
    """Of three cables."""
    return cdpr.Robot(**(dict(exits=EXITS, anchors=ANCHORS, axial_stiffness=1e3, mass=1.0) | changes))


def rope() -> cdpr.Robot:
    return made(axial_stiffness="material", linear_density="material", material="steel-rope-4mm")


def of(name: str, **changes) -> cdpr.Robot:
    """A robot of the catalogue, changed."""
    return cdpr.load_robot(name).replace(**changes)


def wirex() -> cdpr.Robot:
    """IPAnema 1 within 1 to 10 N."""
    return of("ipanema-1", gravity=0.0, force_min=1.0, force_max=10.0)


def asked(function, **first):
    """A call of a function with some arguments, over these."""
    return lambda **given: function(**(first | given))


def placed(function):
    """A call of a function whose first argument, here the robot, has another name."""
    return lambda robot, **given: function(robot, **given)


def problem(**given):
    return cdpr.Problem.of(**(dict(robot=of("parallel"), pose=POSE) | given))


def problems(**given):
    return cdpr.Problems.of(**(dict(robot=of("parallel"), poses=[POSE, POSE]) | given))


def tight() -> cdpr.Robot:
    """A planar robot that cables pull from both sides."""
    exits, anchors = ([[x, 0, z] for z in (b, -b) for x in (-a, a)] for a, b in ((1, 1), (0.1, -0.1)))
    return cdpr.Robot(exits=exits, anchors=anchors, axial_stiffness=1e4, mass=1.0, mobility="planar")


def several() -> cdpr.EquilibriumBatch:
    """Equilibria of two robots."""
    robots = [of("parallel"), of("parallel", exits=of("parallel").exits + np.array([0.02, 0, 0]))]
    rows = np.array([POSE]), np.array([np.eye(3)]), np.zeros((1, 6)), np.ones(1)
    return cdpr.solve_many(cdpr.Problems.of_robots(RobotBatch.of(robots), *rows))


def ended() -> dict:
    """Arguments of a path that goes on from one without an equilibrium at its end."""
    robot = of("cogiro", pulley_friction=0.05, winch_to_exit=0.5)
    up = cdpr.solve_path(robot, [(0.2, 0.25, 0.1), (0.2, 0.25, 0.6)])
    return dict(robot=robot, poses=[(0.2, 0.25, 0.1)], memory=up.memory)


def bars(**given):
    """The saddle of a robot, asked for its modes."""
    robot = of("planar-horizontal")
    (saddle,) = cdpr.find_equilibria(robot, robot.home, saddles=True, starts=50).unstable
    cdpr.natural_modes(saddle)


robot, replaced = made, asked(lambda robot, **changes: robot.replace(**changes), robot=made())
lengths = asked(lambda robot, pose, **given: robot.rest_lengths(pose, **given), robot=made())
ipanema = asked(lambda change, tensions: of("ipanema-1", **change).rest_lengths((0, 0, 1), tensions), change={})
limited = asked(lambda **limits: of("cogiro", **limits))
hull = asked(lambda robot, **given: cdpr.workspace_hull(robot(), **given), robot=wirex)
feasible = asked(cdpr.feasible, robot=of("parallel"), positions=of("parallel").home)
shortfall = asked(cdpr.shortfall, robot=of("parallel"), positions=of("parallel").home)
sensitivity, modes = placed(cdpr.sensitivity), placed(cdpr.natural_modes)
cogiro = dict(robot=of("cogiro"), pose=POSE)
two = dict(robot=of("two-cable"), pose=of("two-cable").home)
flat = "'two-cable' is planar: expected y = 0 and"
eight = r"axial_stiffness: found \(8,\), which could be one per cable or one"
beside = {"pose": POSE, "rest_lengths": np.ones(8), "external_wrench": np.zeros(6)}
single = (
    cdpr.solve, cdpr.settle, cdpr.settle_trajectory, cdpr.find_equilibria, cdpr.follow_load, cdpr.grow_gravity,
    sensitivity, modes,
)  # fmt: skip

REFUSED = [
    # A robot.
    (robot, dict(anchors=ANCHORS[:2]), r"anchors: found an array of shape \(2, 3\), expected shape \(3, 3\)"),
    (robot, dict(exits=np.empty((0, 3)), anchors=np.empty((0, 3))), "exits: found no cable"),
    (robot, dict(axial_stiffness=[1e3, 0, 1e3]), "axial_stiffness: found 0 N, expected more than 0"),
    (robot, dict(mass=0), "mass: found 0 kg, expected more than 0"),
    (robot, dict(inertia=[0.5, 2, 3]), "inertia: found principal moments"),
    (robot, dict(inertia=[1, 1, -1]), "inertia: found principal moments"),
    (robot, dict(inertia=[[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "inertia: found an unsymmetric matrix"),
    (robot, dict(platform_size=(1, 0, 1)), "platform_size: .*three positive edges"),
    (robot, dict(mobility="flat"), "unknown mobility 'flat': .*planar, spatial"),
    (robot, dict(mobility="planar"), r"exits of cable 3: found y = 1 m, expected 0: a planar robot"),
    (robot, dict(anchors=np.zeros((3, 3))), "platform_size: not given"),
    (robot, dict(pulley_radius=[0, 0, -0.1]), "pulley_radius: found -0.1 m in cable 3"),
    (robot, dict(pulley_radius=[0, 1e-7, 0]), "pulley_radius: found 1e-07 m in cable 2, expected 0, for a point"),
    (robot, dict(pulley_radius=0.02, pulley_axis=(0, 0, 0)), "pulley_axis: found an axis of length zero in cable 1"),
    (robot, dict(material="a\nb"), "material: found .*, expected printable characters only"),
    (robot, dict(linear_density="material"), "linear_density: found 'material' without a material"),
    # Laws whose tension falls before a strain of 20 %; test_robot.py has those that just rise.
    *[
        (robot, dict(stiffening=law), r"stiffening: .* tension falls before a strain of 20%")
        for law in ((0.0, -9.0), (-3.0, 0.0), (-13.0, 50.0), (-20.0, 132.0))
    ],
    # Changes of a robot.
    (replaced, dict(material="nylon"), "unknown material 'nylon'.*vectran-0.7mm"),
    (replaced, dict(materiel="x"), "unknown field of a robot 'materiel': did you mean material"),
    (replaced, dict(robot=rope(), material="vectran-0.7mm"), "density: found 'material', .* mass of vectran-0.7mm"),
    (replaced, dict(robot=rope(), diameter=0.004), "found it in replace, expected material='steel-rope-4mm'"),
    (replaced, dict(robot=rope(), material="steel-4mm"), r"'steel-4mm': did you mean steel-rope-4mm\?"),
    # Limits of force.
    (limited, dict(force_min=5, force_max=2), "force_min: found 5 N above force_max, 2 N, in cable 1; expected"),
    (limited, dict(force_min=[0] * 7 + [9], force_max=8), "found 9 N above force_max, 8 N, in cable 8"),
    (limited, dict(force_min=INF), "force_min: found inf, expected finite numbers"),
    (limited, dict(force_max=0), "force_max: found 0 N in cable 1, expected more than 0"),
    # A pose, and lengths for tensions.
    (lengths, dict(pose=(-0.9, 0, 1)), r"exit of cable 1 lies on its anchor"),
    (lengths, two | dict(pose=(0.4, 0.1, 0.2)), flat),
    (lengths, two | dict(pose=(0.4, 0, 0.2, 0.1, 0, 0)), flat),
    (lengths, two | dict(pose=(0.4, 0, 0.2, 0, 0.1, 0.1)), flat),
    (Pose.of, dict(pose=RigidTransform.from_translation([[1, 2, 3], [4, 5, 6]])), "stack of 2"),
    (ipanema, dict(tensions=[60.0] * 8), "leave 245 N unbalanced at the pose"),
    (ipanema, dict(tensions=50.0), "found -30.16 N in cable 5 where tensions nearest to 50 N balance"),
    (ipanema, dict(tensions=700.0), "found 780.2 N in cable 1 .* expected 0 to 720 N"),
    (ipanema, dict(change={"force_min": 40}, tensions=110.0), "found 29.84 N in cable 5 .* expected 40 to 720 N"),
    (ipanema, dict(change={"linear_density": 0.004}, tensions=50.0), "found -.* N in cable . where tensions nearest"),
    (ipanema, dict(change={"linear_density": 4.0}, tensions=100.0), "N in cable ., which weighs .* N, expected"),
    (ipanema, dict(change={"pretension": 20.0}, tensions=None), "pretension: found -60.16 N in cable 5"),
    (lengths, cogiro | dict(tensions=50.0), "tensions: found -"),
    (lengths, cogiro | dict(external_wrench=np.zeros(6)), "external_wrench: found one without tensions"),
    (lengths, dict(robot=of("two-cable"), pose=(0.3, 0, 0.1), tensions=5.0), "found none near 5 N that balance"),
    (lengths, cogiro | dict(robot=of("cogiro", linear_density=1e-3, pretension=50.0)), "pretension: found"),
    # A problem.
    (problem, dict(pose=None), r"pose: found none, expected \(x, y, z\), a six-vector or a RigidTransform"),
    (problem, dict(rest_lengths=[1] * 7 + [0]), "rest_lengths: found 0 m, expected more than 0"),
    (problem, two | dict(external_wrench=[0, 1, 0, 0, 0, 0]), "external_wrench: .*planar"),
    (problem, dict(pose=(0.4, 0.25, 2.0)), "falls since cables cannot push"),
    *[
        (ask, dict(robot=ready, **{field: value}), f"{field}: found one beside a Problem")
        for ready, asks in ((cdpr.Problem.of(**cogiro), single), (cdpr.solve(**cogiro), (sensitivity, modes)))
        for ask in asks
        for field, value in beside.items()
        if (ask, field) != (cdpr.grow_gravity, "external_wrench")  # its load is the weight
    ],
    (cdpr.find_equilibria, dict(robot=of("cogiro")), "pose: found none"),
    # Many problems.
    (problems, dict(poses=None), "poses: found none"),
    (problems, dict(poses=np.empty((0, 3))), "poses: found none"),
    (problems, dict(poses=[0.3, 0.25]), r"poses: found an array of shape \(2,\), expected \(..., 3\) or \(..., 6\)"),
    (problems, dict(rest_lengths=np.ones((3, 8))), r"do not fit one another: poses \(2,\), rest_lengths \(3,\)"),
    (problems, dict(rest_lengths=[0.0] + [1.0] * 7), "rest_lengths: found 0 m, expected more than 0"),
    (problems, dict(axial_stiffness=[1e3] * 3), r"axial_stiffness: found an array of shape \(3,\), expected"),
    (problems, dict(mass=[0.4, 0.0]), "mass: found 0 kg, expected more than 0"),
    (problems, dict(mass=[0.4] * 3), r"do not fit one another: poses \(2,\), .*mass \(3,\)"),
    (problems, dict(external_wrench=np.zeros((3, 6))), r"do not fit one another: poses \(2,\), .*wrench \(3,\)"),
    (problems, dict(rotations=2 * np.eye(3)), "rotations: found a matrix that is no rotation"),
    (problems, dict(rotations=[np.eye(3), np.diag([1, 1, -1])]), r"no rotation at \[1\], expected orthogonal ones"),
    (problems, dict(poses=RigidTransform.identity(2), rotations=np.eye(3)), "rotations: found them beside transforms"),
    # Eight values of EA on eight cables, wherever eight rows come from.
    *[
        (problems, dict(poses=POSE, axial_stiffness=np.full(8, 1e4)) | eight_rows, eight)
        for eight_rows in (
            dict(poses=np.tile(POSE, (5, 8, 1))), dict(external_wrench=np.zeros((8, 6))), dict(mass=np.full(8, 0.4)),
            dict(rest_lengths=np.ones((8, 8))), dict(rotations=np.tile(np.eye(3), (8, 1, 1))),
        )
    ],
    *[
        (many, dict(robot=of("parallel"), poses=np.tile(POSE, (8, 1)), axial_stiffness=np.full(8, 1e4)), eight)
        for many in (cdpr.solve_many, cdpr.settle_many)
    ],
    *[
        (many, dict(robot=problems(), **{name: 1.0}), f"{name}: found it beside Problems")
        for many in (cdpr.solve_many, cdpr.settle_many)
        for name in ("poses", "rest_lengths", "external_wrench", "rotations", "axial_stiffness")
    ],
    *[
        (many, dict(robot=of("two-cable"), poses=[(0.4, 0, 0.2, 0, 0.1, 0), six]), flat)
        for many in (cdpr.solve_many, cdpr.settle_many)
        for six in ((0.4, 0.1, 0.2, 0, 0, 0), (0.4, 0, 0.2, 0.1, 0, 0), (0.4, 0, 0.2, 0, 0, 0.1))
    ],
    *[
        (problems, dict(robot=of("two-cable"), **given), flat)
        for tilted in [RigidTransform.from_rotation(Rotation.from_euler("x", [[0], [0.1]]))]
        for given in (dict(poses=tilted), dict(poses=(0.4, 0, 0.2), rotations=tilted.rotation.as_matrix()))
    ],
    (cdpr.settle_many, dict(robot=problems(poses=[[POSE]])), r"found problems of shape \(1, 1\), expected rows"),
    (cdpr.Problems.stack, dict(problems=[problem(), problem(robot=of("parallel", mass=1.0))]), "another robot in"),
    *[
        (lambda rows, row: rows[row], dict(rows=rows, row=row), r"row: found .* of shape \(1, 2\), expected 2 indices")
        for rows in (problems(poses=[[POSE, POSE]]), cdpr.solve_many(of("parallel"), [[POSE, POSE]]))
        for row in (0, (0, 1, 0), ())
    ],
    *[
        (placed(question), dict(robot=several()), "equilibria: found those of several robots, expected of one")
        for question in (cdpr.cable_profiles, cdpr.clearances)
    ],
    *[
        (placed(many), dict(robot=of("cogiro"), threads=n, **{where: [POSE]}), f"threads: found {n}, expected 0 to 1")
        for n in (-1, 1025)
        for many, where in [
            (cdpr.solve_many, "poses"), *((f, "positions") for f in (cdpr.feasible, cdpr.shortfall, capacity_margin))
        ]
    ],
    # Cables shorter than rounding.
    (cdpr.solve, cogiro | dict(rest_lengths=[1.0] * 4 + [1e-13] + [1.0] * 3), "1.0e-13 m in cable 5"),
    # Several equilibria, and those that are no answer.
    (cdpr.find_equilibria, two | dict(starts=0), "starts: found 0"),
    (cdpr.find_equilibria, two | dict(external_wrench=[0, 0, 0, 0, 1, 0]), "found a torque"),
    (cdpr.find_equilibria, cogiro | dict(robot=of("cogiro", gravity=0)), "found no load"),
    (cdpr.follow_load, cogiro | dict(robot=of("cogiro", gravity=0)), "found no load"),
    (modes, cogiro | dict(external_wrench=[0, 0, 0, 0, 0.001, 0]), "under an external torque"),
    (bars, {}, "found an unstable equilibrium of 'planar-horizontal'"),
    (sensitivity, dict(robot=hanging_mass()), "found a neutral equilibrium of 'hanging mass'"),
    (cdpr.solve_path, ended, "memory: found that of a path without an equilibrium at its end"),
    (cdpr.compensate, dict(robot=tight(), pose=(0, 0, 0), prefer="stiffest", tension_limits=(1, INF)), "no upper"),
    (cdpr.compensate, cogiro | dict(tensions=(1, 5), tension_limits=(1, 5)), "tensions: found tension_limits beside"),
    # Memory of ropes; the rows of the matrix refuse it elsewhere.
    *[
        (call, {}, "found pulley_friction and hysteresis in cable 1, expected")
        for remembers in [of("cogiro", pulley_friction=0.05, winch_to_exit=0.5, hysteresis=[(0.15, 4e-5)])]
        for call in (
            lambda remembers=remembers: cdpr.certify_all(remembers, remembers.rest_lengths(remembers.home)),
            lambda remembers=remembers: cdpr.find_layout(remembers, [remembers.home], move="exits", within=0.01),
        )
    ],
    # Workspaces.
    (shortfall, dict(tension_limits=(2, 1)), "tau_min <= tau_max"),
    (feasible, dict(tension_limits=([0] * 7 + [2], 1)), "in cable 8"),
    (feasible, dict(tension_limits=(-1, 1)), "expected 0 or more"),
    (feasible, dict(tension_limits=(0, [1, 2, 3])), "one for each of the 8 cables"),
    (feasible, dict(wrenches=np.zeros((0, 6))), "expected at least one wrench"),
    (feasible, dict(robot=two["robot"], positions=two["pose"], wrenches=np.eye(6)[1]), "wrenches: found .*planar"),
    (hull, dict(center=(1.9, 1.4, 1.9)), "center: found .1.9, 1.4, 1.9. m, which is not feasible"),
    (hull, dict(center=(0, 0, 3)), "center: found .0, 0, 3. m, outside the robot's frame"),
    (hull, dict(reach=0), "reach: found 0 m, expected more than 0"),
    (hull, dict(depth=8), "depth: found 8, expected 0 to 7"),
    (hull, dict(tolerance=0.0), "tolerance: found 0 m"),
    (hull, dict(closed_form=True, tension_limits=(1, INF)), "found no largest tension in cable 1"),
    (hull, dict(tension_limits=(2, 1)), "tau_min <= tau_max"),
    (hull, dict(robot=lambda: of("planar-vertical")), "which is planar, expected a spatial one"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "given", "words"), REFUSED)
def test_what_cannot_be_right_is_refused_in_one_sentence(call, given, words) -> None:
    """It names the field, what was found and what is expected."""
    with pytest.raises((cdpr.InvalidInput, cdpr.UnknownName), match=words) as refused:
        call(**(given() if callable(given) else given))
    assert "\n" not in str(refused.value)
