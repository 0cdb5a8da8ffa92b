"""What simulation, analysis, design, comparison and proofs refuse: a call, and words of its one sentence."""

import functools
import inspect
import re

import mujoco
import numpy as np
import pytest
from sample_problems import hanging_mass
from test_settle_path import ELEMENTS
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin, feasible_by_linprog
from cdpr_sim.analysis.workspace.grids import as_grid, plane
from cdpr_sim.cli import app
from cdpr_sim.design.symmetry import group
from cdpr_sim.proof import complete
from cdpr_sim.robots.robot_file_text import as_toml
from cdpr_sim.statics import two_cable_closed_form

unchecked = inspect.unwrap
"""The function as users have it, without the annotations that conftest.py has checked."""

robot = functools.cache(cdpr.load_robot)
POSE, POSES, TURNED = (0.3, 0.25, 0.1), np.tile([0.4, 0.25, 0.2], (3, 1)), np.tile(np.eye(3), (2, 1, 1))
LINE = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 6)]


def compensate(**given):
    return lambda: cdpr.compensate(robot("cogiro"), **({"pose": POSE} | given))


def sweep(**given):
    return lambda: cdpr.sweep(**({"robots": "parallel", "grid": (2, 2, 2)} | given), compute=False)


def check(**given):
    return lambda: cdpr.check(**({"robots": "cogiro"} | given))


def layout(given="parallel", **asked):
    return lambda: cdpr.find_layout(robot(given), LINE, generations=2, **asked)


def grid(counts, *names):
    return lambda: as_grid(counts, [robot(name) for name in names or ["parallel"]])


def area(name, points=9, of="parallel"):
    return lambda: plane(name, None, points, [robot(of)])


def closed_form(of="two-cable", **changes):
    return lambda: two_cable_closed_form.equilibrium_rotations(robot(of).replace(**changes), (0.4, 0, 0.2))


def certify_all(rest=(0.5,) * 4, **changes):
    return lambda: cdpr.certify_all(robot("planar-vertical").replace(**changes), list(rest))


def beside(function, name, **given):
    problem = cdpr.Problem.of(robot("planar-vertical"), (0.4, 0, 0.1))
    return lambda: function(problem, **given), f"{name}: found one beside a Problem"


def compared(**changes):
    def ask():
        mine, pose = robot("parallel"), changes.get("pose", POSE)
        other = mine.replace(**{name: one for name, one in changes.items() if name not in ("pose", "wrench")})
        cdpr.compare(cdpr.solve(mine, POSE), cdpr.settle(other, pose, external_wrench=changes.get("wrench")))

    return ask


ABOVE = (0.3, 0.25, 0.15)
COGIRO = cdpr.load_robot("cogiro")
ROPES = COGIRO.replace(hysteresis=ELEMENTS)
SHORT = cdpr.Problem.of(COGIRO.replace(linear_density=5e-4, pulley_radius=0.03, pulley_axis=(0, 0, 1)), ABOVE)
WHEELS = COGIRO.replace(pulley_radius=0.05)
UNDER = WHEELS.exits[2] - WHEELS.anchors[2] + [0.01, 0.0, -0.3]
ON_A_WHEEL = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 1.0, pulley_radius=0.1, platform_size=(0.1, 0.1, 0.1))
LONG = cdpr.load_robot("ipanema-1").replace(axial_stiffness=1e4, winch_to_exit=500.0, force_max=np.inf)
TEXT = cdpr.to_mjcf(COGIRO, ABOVE)
FALLING = (0.0, -8.0)  # a law that ends at 13.6 N of 100 N
PLUMB = cdpr.Robot([[0, 0, 2]], [[0, 0, 0]], 100.0, 13.61 / 9.81, stiffening=FALLING, platform_size=(0.1, 0.1, 0.1))


def settled_in(text: str, robot: cdpr.Robot, **given) -> cdpr.Equilibrium:
    return cdpr.settle(robot, ABOVE, model=mujoco.MjModel.from_xml_string(text), **given)


HAS_MEMORY = "^robot: found hysteresis in cable 1, expected"
TOO_SHORT = r"^rest_lengths: found \S+ m in cable 1, with mass and over a pulley of 0\.03 m, expected at least 0\.\d+ m"
IS_UNDER = r"anchor of cable 3 inside or below its pulley.s wheel, 0.01 m from the pulley's"


REFUSED = [
    # Of simulation, and of cables that cannot be.
    (lambda: cdpr.settle_many(cdpr.Problems.of(COGIRO, [ABOVE] * 2, mass=[0.4, 0.5])), "mass: found one per problem"),
    (
        lambda: settled_in(TEXT.replace('<body name="origin" />', ""), COGIRO, external_wrench=[1, 0, 0, 0, 0, 0]),
        "origin",
    ),
    (lambda: cdpr.to_mjcf(SHORT, rest_lengths=np.ones(8)), "rest_lengths: found one beside a Problem"),
    (lambda: cdpr.settle(COGIRO.replace(linear_density=1e-15), ABOVE), "linear_density: found 1e-15 kg/m in cable 1"),
    (lambda: cdpr.release(cdpr.settle(ROPES, ABOVE)), HAS_MEMORY),
    (lambda: settled_in(TEXT, ROPES), HAS_MEMORY),
    (lambda: cdpr.settle(SHORT), TOO_SHORT),
    (lambda: cdpr.to_mjcf(SHORT), TOO_SHORT),
    (lambda: cdpr.settle_trajectory(SHORT), TOO_SHORT),
    (lambda: cdpr.solve(WHEELS, UNDER), IS_UNDER),
    (lambda: cdpr.settle(WHEELS, UNDER), IS_UNDER),
    (lambda: cdpr.shortfall(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.feasible(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.closed_form_feasible(WHEELS, UNDER, tension_limits=(0, 9)), IS_UNDER),
    (lambda: capacity_margin(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.solve(ON_A_WHEEL, (0.1, 0, 0.95)), "anchor of cable 1 inside its pulley's wheel"),
    (lambda: cdpr.solve(ON_A_WHEEL, (0.05, 0, 0.2)), "anchor of cable 1 inside or below its pulley's wheel"),
    (
        lambda: PLUMB.rest_lengths((0, 0, 1), [PLUMB.weight]),
        "tensions: found 13.61 N in cable 1, expected at most 13.6 N",
    ),
    (
        lambda: cdpr.compensate(COGIRO.replace(axial_stiffness=20.0, stiffening=FALLING), ABOVE, tensions=(3.0, 9.0)),
        "tensions: found a smallest tension of 3 N in cable 1, .* 2.72 N",
    ),
    (
        lambda: LONG.rest_lengths(LONG.home, tensions=700.0),
        r"tensions: found .* N in cable \d, under which the rope between",
    ),
    *(
        (lambda change=change: COGIRO.replace(**change), words)
        for change, words in [
            ({"winch_to_exit": 1e9}, "winch_to_exit: found 1e"),
            ({"reeving": 1.5}, "reeving: found 1.5 parts of line in cable 1, expected a whole number from 1 to 100"),
            ({"reeving": [1, 0] + [1] * 6}, "reeving: found 0 parts of line in cable 2, expected a whole number"),
            ({"reeving": 1000}, "reeving: found 1000 parts"),
        ]
    ),
    # Of analysis, workspaces, design, comparison and proofs.
    (compensate(tension_limits=(-1, 1)), "found a smallest tension of -1 N"),
    (compensate(tension_limits=(0, np.nan)), "above the largest, nan N"),
    (compensate(tension_limits=(0, [1, 2])), "expected \\(smallest, largest\\)"),
    beside(cdpr.compensate, "pose", pose=POSE),
    beside(cdpr.compensate, "external_wrench", external_wrench=np.zeros(6)),
    pytest.param(  # one cable cannot carry 20 N with 50 N, wherever the platform goes
        lambda: cdpr.compensate(hanging_mass().robot, (0, 0, 1), tension_limits=(50, 60)),
        "found no pose near the commanded one",
        marks=pytest.mark.slow,
    ),
    (
        lambda: cdpr.compensate(robot("cogiro-crane").replace(linear_density=20.0), (1, 1, 2), tensions=(0.0, 1e6)),
        r"N in cable 1, which weighs \S+ N, expected at least what its weight alone gives",
    ),
    (sweep(robots=[]), "robots: found none"),
    (sweep(materials=[]), "expected at least one"),
    (sweep(materials=["fishing-0.4mm"] * 2), "none twice"),
    (sweep(materials="fishing-0.4mm"), "expected a list"),
    (sweep(materials={"rubber": -1.0}), "more than 0"),
    (sweep(tension_limits=(2, 1)), "tau_min <= tau_max"),
    (sweep(chunk=0), "chunk"),
    (lambda: cdpr.sweep("cogiro", poses=[POSE], store="new.nc"), "poses: found them with a store"),
    (lambda: cdpr.sweep("cogiro", (2, 2, 2), poses=[POSE]), "poses: found them besides a grid"),
    (check(materials=[]), "at least one"),
    (check(poses=[]), "poses: found none"),
    (lambda: cdpr.check("cogiro", poses=[POSE]).across(), "axis: found a check of single poses"),
    (compared(pose=(0.31, 0.25, 0.1)), "two problems"),
    (compared(wrench=[0, 0, 0.1, 0, 0, 0]), "two problems"),
    (compared(mass=0.41), "two problems"),
    (compared(axial_stiffness=1.001e4), "two problems"),
    (compared(center_of_mass=(0, 0, 0.001)), "two problems"),
    (grid((0, 2, 2)), "at least 1"),
    (grid((-3, 2, 2)), "at least 1"),
    (grid((2.5, 2, 2)), "whole numbers"),
    (grid((2, 2)), r"expected shape \(3,\)"),
    (grid((np.nan, 2, 2)), "finite"),
    (grid((10**5, 10**5, 10**5)), "positions, expected"),
    (grid({"x": []}), "expected a list of numbers"),
    (grid({"x": [0.1, 0.1]}), "expected them to ascend"),
    (grid({"x": [0.1, np.inf]}), "finite"),
    (grid({"w": [0.1]}), "found an axis 'w'"),
    (grid("many"), "expected numbers"),
    (grid({"y": [0.1]}, "two-cable"), "planar"),
    (grid((2, 2, 2), "parallel", "planar-vertical"), "different workspaces"),
    (area("q"), "expected"),
    (area("xyz"), "expected"),
    (area("xy", of="two-cable"), "expected a plane with an area"),
    (closed_form("planar-vertical"), "expected a planar bar on two cables"),
    (closed_form("parallel"), "expected a planar bar on two cables"),
    (closed_form(center_of_mass=(0, 0, 0.01)), "expected a planar bar on two cables"),
    (
        closed_form(exits=robot("two-cable").exits[::-1], anchors=robot("two-cable").anchors[::-1]),
        "expected a planar bar on two cables",
    ),
    (closed_form(pulley_radius=0.01), "two-cable closed form: found pulley_radius in cable 1"),
    (closed_form(linear_density=0.01), "two-cable closed form: found linear_density in cable 1"),
    (certify_all(linear_density=0.01), "found linear_density in cable 1"),
    (certify_all(gravity=0), "no load"),
    beside(cdpr.certify_all, "rest_lengths", rest_lengths=[0.5] * 4),
    beside(cdpr.certify_all, "external_wrench", external_wrench=np.zeros(6)),
    (layout(within=[[0, 0, 0.4], [0.3, 0.5, 0.5]]), "within: found bounds crossed for x of exits"),
    (layout(), "within: found none for exits"),
    (layout(within=0.0), "within: found no point that can move"),
    (layout(move="pulleys", within=0.1), "move: found 'pulleys', but 'parallel' has none"),
    (layout(move=["exits", "exits"], within=0.1), "move: found exits of cable 1 twice"),
    (layout(move="diameter", within=0.5), "within: found a factor of 0.5"),
    (lambda: layout(move=cdpr.Move("exits", 0.1, cables=(9,)))(), "cables: found cable 9, expected 1 to 8"),
    (layout(within=0.1, stiffness=0), "stiffness: found 0"),
    (layout(within=0.05, objective=lambda found: np.full(len(found), np.nan)), "returned nan"),
    (layout(within=0.05, objective=lambda found: 1.0), r"returned shape \(\)"),
    (layout(within=0.05, objective=lambda found: "no"), "expected numbers"),
    (
        layout(within=0.02, subject_to={"tensions": (0.0, 1.5), "lowest tension": 100.0}),
        "violates 'lowest tension at least 100 N' the most.*and also tensions from 0 to 1.5 N",
    ),
    (  # above every exit
        lambda: cdpr.find_layout(robot("parallel"), [(0.4, 0.25, 0.1), (0.4, 0.25, 0.9)], within=0.05, generations=2),
        r"equilibrium at all of them.*at 1 of 2, the first at \(0.4, 0.25, 0.9\) m",
    ),
    (
        lambda: group(robot("parallel").replace(axial_stiffness=[1e4] * 7 + [2e4]), "half-turn"),
        "has other properties than its image",
    ),
    *(
        (ask, "found|do not fit one another")
        for ask in (
            lambda: cdpr.feasible(robot("cogiro"), POSES, rotations=TURNED),
            lambda: feasible_by_linprog(robot("cogiro"), [1, 2]),
            lambda: unchecked(cdpr.find_equilibria)(robot("cogiro"), POSES[0], starts=2.5),
            lambda: cdpr.find_equilibria(robot("cogiro"), POSES[0], seed=-1),
            lambda: unchecked(cdpr.drive)(robot("cogiro"), POSES, states=2.5),
            lambda: unchecked(cdpr.drive)(robot("cogiro"), 3),
            lambda: cdpr.grow_gravity(robot("cogiro"), POSES[0], seconds=0),
            lambda: cdpr.grow_gravity(robot("cogiro"), POSES[0], seconds=1e300),
            lambda: cdpr.release(cdpr.solve(robot("cogiro"), POSES[0]), seconds=1e300),
            lambda: cdpr.clearances(robot("cogiro"), POSES).free(np.nan),
            lambda: cdpr.Measurements.of(POSES, np.ones((3, 2)), coordinates=("x", "x")),
            lambda: cdpr.Measurements.of(POSES, np.ones((3, 0)), coordinates=()),
        )
    ),
]


@pytest.mark.parametrize(("ask", "words"), REFUSED, ids=map(str, range(len(REFUSED))))
def test_what_cannot_be_right_gets_one_sentence(ask, words):
    """It names the field, what was found and what is expected: not NumPy's words for shapes, nor a TypeError."""
    with pytest.raises(cdpr.CdprError, match=words) as caught:
        ask()
    assert "\n" not in str(caught.value)


def test_what_cannot_be_searched_or_stored_is_refused_before_the_search(monkeypatch, tmp_path):
    """A place that cannot be written; on the command line also cables with mass, before other equilibria are found."""
    monkeypatch.setattr(complete._Search, "run", lambda *_: pytest.fail("it searches"))
    monkeypatch.setattr(cdpr, "find_equilibria", lambda *_, **__: pytest.fail("it searches"))
    with pytest.raises(cdpr.InvalidInput, match="cannot be written"):
        cdpr.certify_all(robot("planar-horizontal"), [0.5] * 4, store="/proc/search.npz")
    file = tmp_path / "heavy.toml"
    file.write_text(as_toml(robot("two-cable").replace(linear_density=5e-4)))
    told = CliRunner().invoke(app, ["equilibria", str(file), "--certify"])
    assert told.exit_code == 2
    assert "found linear_density in cable 1" in told.stderr


def test_what_is_refused_of_one_problem_is_a_status_of_many_or_no_refusal_elsewhere():
    """A chain too short for its wheel is no obstacle to statics; a picture has no forces."""
    found = cdpr.settle_many(cdpr.Problems.stack([SHORT, SHORT]))
    assert (found.status == cdpr.Status.TOO_SHORT).all()
    assert np.isnan(found.positions).all()
    assert cdpr.solve(SHORT).stable
    assert cdpr.draw(ROPES).axes
    beside = COGIRO.replace(
        axial_stiffness=[2.0] * 7 + [1e3], linear_density=[0] * 7 + [5e-3], stiffening=[(8.0, -20.0)] * 7 + [(0, 0)]
    )
    with pytest.raises(cdpr.NotSettled, match=r"beyond the range of its nonlinear law \(cables 1, 4\)"):
        cdpr.settle(beside, (0.3, 0.25, 0.1))


@pytest.mark.parametrize("rigid", [0.0, 0.05])
def test_a_chain_may_be_as_short_as_its_refusal_says(rigid):
    """A cable with mass over a wheel, with and without a rigid end: 2 % less is refused, 2 % more is not."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=0.05, pulley_radius=0.01, rigid_length=rigid)
    rest = robot.rest_lengths(robot.home)
    short = np.where(np.arange(8) == 2, 0.1, rest)
    with pytest.raises(cdpr.InvalidInput, match="its chain's first mass could touch the wheel") as refused:
        cdpr.to_mjcf(robot, robot.home, short)
    found = re.search(r"in cable 3, .* expected at least (\S+) m", str(refused.value))
    assert found is not None
    least = float(found[1])
    with pytest.raises(cdpr.InvalidInput, match="could touch the wheel"):
        cdpr.to_mjcf(robot, robot.home, np.where(np.arange(8) == 2, 0.98 * least, rest))
    assert cdpr.to_mjcf(robot, robot.home, np.where(np.arange(8) == 2, 1.02 * least, rest))
