import copy
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from sample_problems import hanging_mass

import cdpr_sim as cdpr
from cdpr_sim.analysis import equilibria as searching
from cdpr_sim.analysis.equilibria import unstable_directions
from cdpr_sim.core.equilibrium import Stability
from cdpr_sim.statics import forces, roots_kernel
from cdpr_sim.statics.forces import mass_matrix

SAME = 1e-6
"""[m] Two equilibria, found twice: solutions scatter by 1e-10, MuJoCo's by 1e-8 where softly held."""


def tilted_up(equilibrium: cdpr.Equilibrium) -> float:
    """The vertical part of the platform's z axis: 1 upright, −1 turned over."""
    return float(equilibrium.rotation.as_matrix()[2, 2])


def test_cogiro_at_home_can_rest_at_seven_places(catalogue):
    """Upright, and six ways turned over: each stable, each its own, mirrored in pairs by the layout's half turn."""
    robot = catalogue["cogiro"]
    found = cdpr.find_equilibria(robot, robot.home)
    assert len(found) == 7
    assert all(one.stable for one in found)
    assert (np.diff(found.energies) >= 0).all()
    assert found.energies[1::2] == pytest.approx(found.energies[2::2], abs=1e-9)
    assert tilted_up(found[0]) == pytest.approx(1, abs=1e-9)
    assert all(tilted_up(one) < 0.2 for one in found.found[1:])
    again = cdpr.find_equilibria(robot, robot.home, seed=1)
    assert len(again) == len(found)
    assert all(found.nearest(one.pose)[1] < SAME for one in again)


@pytest.mark.parametrize("name", [pytest.param("cogiro", marks=pytest.mark.slow), "two-cable", "planar-horizontal"])
def test_mujoco_stays_at_every_stable_one_and_leaves_every_saddle(catalogue, name):
    """Undamped, displaced by a micrometre along its softest direction and let go; as many even as odd ones."""
    robot = catalogue[name].replace(material="fishing-0.4mm")
    found = cdpr.find_equilibria(robot, robot.home, saddles=True, starts=150)
    assert found.stable
    assert found.unstable
    assert found.imbalance == 0
    distinct = np.diff(found.energies, prepend=-np.inf) > 1e-9  # the others are mirror images
    for one in np.array(found.found, dtype=object)[distinct]:
        assert one.stability is not Stability.NEUTRAL
        went = cdpr.release(one, seconds=1.0 if one.stable else 30.0)
        assert (went.stays, went.leaves) == (one.stable, not one.stable), (one, went)
    for one in found.stable:
        assert cdpr.settle(robot, one.pose, one.rest_lengths).position == pytest.approx(one.position, abs=SAME)
    # Negative control of the count: whichever is left out, even and odd no longer balance.
    for left_out in range(len(found)):
        fewer = tuple(one for i, one in enumerate(found) if i != left_out)
        assert abs(replace(found, found=fewer).imbalance) == 1


def test_a_platform_that_is_let_go_meets_no_resistance_and_gravity_grows_evenly(catalogue, monkeypatch):
    """Neither air nor joints nor cables take energy out of its motion; all of gravity acts at the last step."""
    given, step, robot = [], mujoco.mj_step2, catalogue["cogiro"].replace(pulley_radius=0.01, pulley_axis=(0, 0, 1))
    monkeypatch.setattr(
        mujoco, "mj_step2", lambda model, *more, **named: (given.append(copy.copy(model)), step(model, *more, **named))
    )
    cdpr.release(cdpr.solve(robot, robot.home), seconds=0.1)
    assert given
    for model in given:
        assert model.opt.viscosity == model.opt.density == 0
        platform = model.dof_damping[:6]  # wheels face their cables before each step, and do not turn in it
        assert not np.concatenate([platform, model.tendon_damping, model.jnt_stiffness]).any()
    given.clear()
    cdpr.grow_gravity(robot, robot.home, seconds=0.2)
    growing = [model.opt.gravity[2] for model in given][1:]  # the first is computed before the motion
    assert len(growing) > 20
    assert growing == pytest.approx(-robot.gravity * np.arange(1, len(growing) + 1) / len(growing))


def test_a_pose_that_is_no_equilibrium_does_not_stay(catalogue):
    """Negative control of the release: half a millimetre off, where it swings about the equilibrium."""
    robot = catalogue["two-cable"]
    one = cdpr.solve(robot, robot.home)
    beside = cdpr.Equilibrium(**(vars(one) | {"pose": robot.pose(one.position + np.array([5e-4, 0, 0]))}))
    assert not cdpr.release(beside, seconds=1.0).stays


def test_the_lowest_energy_is_not_where_the_robot_goes(catalogue):
    """With a camera on top (centre of mass 15 mm up), turned over is lower, and both methods reach the upright one."""
    robot = catalogue["cogiro"].replace(center_of_mass=(0, 0, 0.015))
    found = cdpr.find_equilibria(robot, robot.home, starts=1000)
    assert tilted_up(found[0]) < 0
    followed = cdpr.follow_load(robot, robot.home)
    assert followed.jumps == ()
    index, distance = found.nearest(followed.reached.pose)
    assert distance < SAME
    assert tilted_up(found[index]) > 0.999
    assert found.energies[index] > found.energies[0] + 0.01
    by_mujoco = cdpr.grow_gravity(robot, robot.home)
    assert found.nearest(by_mujoco.pose) == (index, pytest.approx(0, abs=SAME))


def test_following_says_where_an_equilibrium_ceases_to_be(catalogue):
    """Turned over on soft cables, the platform falls out of its place at some load; MuJoCo falls to the same one.

    Equilibria depend on load over stiffness alone, so that cables half as stiff lose it at half the load.
    """
    stiff = catalogue["cogiro"]
    rest = stiff.rest_lengths(stiff.home)
    start = cdpr.find_equilibria(stiff, stiff.home, starts=1000)[3].pose
    loads = []
    for softness in (100.0, 50.0):
        robot = stiff.replace(axial_stiffness=softness)
        followed = cdpr.follow_load(robot, start, rest)
        (load,) = followed.jumps
        loads.append(load)
        assert tilted_up(followed.equilibria[0]) == pytest.approx(0.06, abs=0.01)
        reached = cdpr.grow_gravity(robot, start, rest)
        assert reached.position == pytest.approx(followed.reached.position, abs=SAME)
        assert tilted_up(reached) < -0.1
    assert loads[0] == pytest.approx(2 * loads[1], abs=4e-4)  # the shortest step, twice


def test_indices_count_unstable_directions(catalogue):
    """0 at rest and 1 at the saddle that a bar turns over by; 2 of a mass balanced on a cable, which falls any way."""
    robot = catalogue["planar-horizontal"]
    found = cdpr.find_equilibria(robot, robot.home, saddles=True, starts=300)
    assert [unstable_directions(one) for one in found] == [0, 1]
    problem = hanging_mass()
    family = cdpr.find_equilibria(problem, saddles=True, starts=100)  # its rotations about the cable are one
    assert (len(family.stable), family[0].stability, family.imbalance) == (1, Stability.NEUTRAL, None)
    robot = problem.robot.replace(center_of_mass=(0, 0, 0.2))  # above its anchor
    top = problem.pose.translation - [0, 0, robot.weight * problem.rest_lengths[0] / robot.axial_stiffness[0]]
    balanced = forces.equilibrium_at(cdpr.Problem.of(robot, problem.pose), robot.pose(top), iterations=0, source="hand")
    assert balanced.residual < 1e-9
    assert unstable_directions(balanced) == 2


def test_a_step_of_the_search_is_no_longer_than_allowed_and_is_newtons_where_shorter():
    """On the free directions, also where some are held."""
    normal, damped, x = np.diag([4.0, 1.0, 1.0, 1.0, 1.0, 2.0]), np.empty((6, 6)), np.empty(6)
    free, scale = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0]), 0.5
    longest = roots_kernel.LONGEST * scale
    for gradient in (np.full(6, 0.1 * longest), np.full(6, 1e3 * longest)):
        roots_kernel.fill_step(SimpleNamespace(free=free, scale=scale), normal, gradient, 0.0, damped, x)
        newton = -free * gradient / normal.diagonal()
        np.testing.assert_allclose(x, newton * min(1.0, longest / np.linalg.norm(newton)), rtol=1e-12)


def test_the_search_for_saddles_goes_on_until_none_is_known_to_be_missing(catalogue, monkeypatch):
    """The first search misses the saddle: the count of the known equilibria says so, and another search finds it."""
    search, starts = searching._stiffened_roots, []

    def first_misses(problem, positions, rotations):
        starts.append(len(positions))
        roots = search(problem, positions, rotations)
        return roots if len(starts) == 2 else tuple(part[:0] for part in roots)

    monkeypatch.setattr(searching, "_stiffened_roots", first_misses)
    robot = catalogue["planar-horizontal"]
    found = cdpr.find_equilibria(robot, robot.home, saddles=True, starts=20)
    assert starts == [21, 21]  # with one where there is no pair of equilibria to start between
    assert found.starts == 42
    assert found.imbalance == 0
    assert (len(found.stable), len(found.unstable)) == (1, 1)


def test_shapes_have_unit_kinetic_energy_and_diagonalise_the_stiffness(catalogue):
    """½ q̇ᵀ M q̇ = 1 for each shape at 1/s, and no two share energy; without the centre of mass they do."""
    robot = catalogue["cogiro"].replace(center_of_mass=(0.01, 0.005, -0.02))
    modes = cdpr.natural_modes(robot, (0.3, 0.2, 0.1))
    rotation = modes.equilibrium.rotation.as_matrix()
    mass = mass_matrix(modes.equilibrium.problem, rotation)
    assert 0.5 * modes.shapes @ mass @ modes.shapes.T == pytest.approx(np.eye(6), abs=1e-9)
    centred = mass_matrix(cdpr.Problem.of(robot.replace(center_of_mass=(0, 0, 0)), (0.3, 0.2, 0.1)), rotation)
    assert np.abs(0.5 * modes.shapes @ centred @ modes.shapes.T - np.eye(6)).max() > 1e-3
