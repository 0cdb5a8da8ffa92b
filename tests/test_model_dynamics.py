"""Models in motion: their damping is the stated one, and winches with limits keep random controls finite."""

import mujoco
import numpy as np
import pytest
from sample_problems import VARIED
from test_winches import WITH_MASS

import cdpr_sim as cdpr

COGIRO = cdpr.load_robot("cogiro")
PLUMB = cdpr.Robot(
    name="plumb", exits=[(0, 0, 1)], anchors=[(0, 0, 0)], axial_stiffness=1e4, mass=1.0,
    platform_size=(0.1, 0.1, 0.1), workspace=[(-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)],
)  # fmt: skip
"""One cable, on which the platform oscillates at 100 rad/s."""

KINDS = pytest.mark.parametrize("winches", [False, "ratio", "speed"])


def model_of(robot: cdpr.Robot, **options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Written in the middle of its workspace."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, **options))
    return model, mujoco.MjData(model)


def advance(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))


# Damping.


def decrement(model: mujoco.MjModel, periods: int = 20) -> float:
    """Logarithmic decrement of the plumb platform's oscillation, released where its cable begins to be taut."""
    data, step = mujoco.MjData(model), model.opt.timestep
    deepest, period = PLUMB.weight / 1e4, 2 * np.pi / 100
    heights = []
    while data.time < periods * period:
        mujoco.mj_step(model, data)
        heights.append(data.body("platform").xpos[2] + deepest)
    one = int(period / step) + 1
    sizes = np.abs([heights[:one], heights[-one:]]).max(1)
    return float(np.log(sizes[0] / sizes[1]) / ((len(heights) - one) * step / period))


@pytest.mark.parametrize(
    ("winches", "density", "same", "still"),
    [(False, 0.0, 0.02, 1e-4), ("ratio", 0.0, 0.02, 1e-4), ("speed", 0.0, 0.02, 1e-4), (False, 1e-3, 0.03, 2e-3)],
)
def test_a_plumb_cable_has_the_stated_loss_factor(winches, density, same, still):
    """Its logarithmic decrement is pi times the loss factor, and zero without damping; a cable with mass as well.

    A step is a twentieth of a period, and the largest amplitude is read off the steps. Measured 0.013. A cable of a
    thousandth of the platform's mass leaves the frequency that of the platform.
    """
    robot = PLUMB.replace(linear_density=density)
    for factor in (0.02, 0.1):
        found = decrement(model_of(robot, damping=factor, winches=winches)[0])
        assert found == pytest.approx(np.pi * factor, rel=same)
    assert abs(decrement(model_of(robot, damping="none", winches=winches)[0])) < still


@KINDS
def test_a_platform_cut_loose_falls_as_in_vacuum_unless_it_settles(winches):
    """After half a second ``cogiro`` falls with 4.905 m/s, also with damped cables, but with 1.05 if it settles.

    Within a time step of 0.2 ms at 9.81 m/s², and rounding.
    """
    for damping, speed in (("none", 4.905), (0.02, 4.905), ("settle", 1.0545)):
        model, data = model_of(COGIRO, damping=damping, winches=winches)
        model.tendon_stiffness[:] = 0
        model.actuator_gainprm[:], model.actuator_biasprm[:] = 0, 0
        advance(model, data, 0.5)
        assert data.qvel[2] == pytest.approx(-speed, abs=0.005)


@KINDS
def test_a_slack_cable_never_pushes_with_a_loss_factor(winches):
    """However fast it slackens; the control is a damper that is no part of the clamped force, as a tendon's is."""
    model, data = model_of(COGIRO, damping=0.2, winches=winches)
    below = COGIRO.rest_lengths(COGIRO.home + np.array([0, 0, -0.03]))
    for height, speed in ((0.02, 20.0), (-0.02, 20.0), (0.02, 0.0)):
        cdpr.reset(model, data, COGIRO.home, rest_lengths=below)
        data.qpos[2] += height
        data.qvel[2] = speed
        mujoco.mj_forward(model, data)
        assert (data.actuator_force == 0).all()  # all are slack
    model.tendon_damping[:] = 1.0
    data.qvel[2] = 20.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[2] < -1  # such a damper brakes the platform by slack cables


# Winches with limits.


def random_run(robot: cdpr.Robot, winches: str, seconds: float, step: float = 0.0, **options) -> tuple[bool, float]:
    """Whether MuJoCo never warned, and the largest force: with new controls each step, or speeds each 0.2 s."""
    (model, data), random = model_of(robot, winches=winches, **options), np.random.default_rng(0)
    model.opt.timestep = step or model.opt.timestep
    held = 1 if winches == "ratio" else round(0.2 / model.opt.timestep)
    largest = 0.0
    for number in range(round(seconds / model.opt.timestep)):
        if number % held == 0:
            data.ctrl = random.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data)
        largest = max(largest, float(data.actuator_force.max()))
        if data.warning.number.any():
            return False, largest
    return bool(np.isfinite(data.qpos).all()), largest


@pytest.mark.parametrize("winches", ["ratio", "speed"])
@pytest.mark.parametrize("name", [*VARIED, "with mass"])
def test_random_controls_stay_finite(name, winches):
    """Over the whole range of controls, for two seconds; a script runs 60 s on the whole catalogue."""
    robot = WITH_MASS["mixed"][0].replace(stiffening=(0, 0)) if name == "with mass" else cdpr.load_robot(name)
    finite, largest = random_run(robot, winches, 2.0)
    assert finite
    limit = np.minimum(robot.force_max, robot.cabling.breaking_load).max()
    known = limit if np.isfinite(limit) else max(0.015 * robot.axial_stiffness.max(), 10 * robot.weight)
    assert largest <= (1 + 1e-12) * known * robot.reeving.max()


def test_without_limits_or_in_longer_steps_random_controls_blow_up():
    """Negative controls: unlimited winches end within 0.2 s, at more than 1e6 N on 0.4 kg; ``segesta`` spins away.

    It does with steps of 2 ms, twice its own, at the same forces.
    """
    finite, largest = random_run(COGIRO, "ratio", 0.2, winch_force=np.inf)
    assert not finite
    assert largest > 1e6
    robot = cdpr.load_robot("segesta")
    assert model_of(robot, winches=True)[0].opt.timestep == 0.001
    assert not random_run(robot, "ratio", 2.0, step=0.002)[0]


def test_a_winch_at_its_limit_slips():
    """Its cable pulls with ``winch_force``, not more, and by the law below; one number or one per cable.

    A nonlinear cable has no limit; the linear ones beside it keep theirs.
    """
    limits = np.linspace(5, 40, 8)
    (model, data), (free, other) = (model_of(COGIRO, winches=True, winch_force=force) for force in (limits, np.inf))
    for control in (0.001, 0.003, 0.1):
        data.ctrl[:] = other.ctrl[:] = control
        mujoco.mj_forward(model, data)
        mujoco.mj_forward(free, other)
        np.testing.assert_array_equal(data.actuator_force, np.minimum(other.actuator_force, limits))
    mixed, limits = COGIRO.replace(stiffening=[(0.0, 0.0)] * 7 + [(100.0, 2e4)]), np.r_[np.full(7, 40.0), np.inf]
    model, _ = model_of(mixed, winches=True, winch_force=limits)
    np.testing.assert_array_equal(model.actuator_forcerange[:7, 1], 40.0)


@pytest.mark.parametrize("robot", [COGIRO, COGIRO.replace(winch_to_exit=0.8, reeving=2)], ids=["direct", "drive line"])
def test_winches_by_speed_follow_the_law_and_their_limits(robot):
    """No rope runs faster than ``winch_speed`` over the whole range, the longest one so fast; l0 = L/(1 + w/L)."""
    (model, data), line = model_of(robot, winches="speed", winch_speed=0.7), robot.winch_to_exit / robot.reeving
    written = robot.rest_lengths(robot.home) + line
    low, high = model.actuator_actrange.T
    lengths = written / (1 + np.linspace(low, high, 200) / written)
    speeds = model.actuator_ctrlrange[:, 1] * (lengths / written) ** 2  # |d l0/dt| at the largest dw/dt
    assert speeds.max(0) == pytest.approx(0.7, rel=1e-9)
    data.ctrl[:] = 1e3  # clamped
    before = data.act.copy()
    mujoco.mj_step(model, data, 10)
    np.testing.assert_allclose(data.act - before, 10 * model.opt.timestep * model.actuator_ctrlrange[:, 1], rtol=1e-9)
    cdpr.reset(model, data, robot.home, rest_lengths=0.995 * robot.rest_lengths(robot.home))
    tension = robot.axial_stiffness * 0.005 * (written - line) / (0.995 * (written - line) + line)
    np.testing.assert_allclose(data.actuator_force, robot.reeving * tension, rtol=1e-9)


def test_drums_of_nonlinear_cables_are_wound_at_their_speed():
    """A drum draws in its cable by the integral of the control."""
    model, data = model_of(COGIRO.replace(stiffening=(50, 100)), winches="speed", winch_speed=0.5)
    data.ctrl[:] = -9
    mujoco.mj_step(model, data, 100)
    np.testing.assert_allclose(data.act, -0.5 * data.time, rtol=1e-9)
    drums = [data.joint(f"drum_{i}").qpos[0] for i in range(1, 9)]
    np.testing.assert_allclose(drums, data.act, rtol=0, atol=0.5 * 0.02)  # the servo lags by its time constant, twice


# Contact.


@KINDS
@pytest.mark.parametrize("name", ["cogiro", "planar-vertical"])
def test_with_contact_a_platform_rests_on_a_table(name, winches):
    """Its box lies on a table of another world, within a tenth of a millimetre; without contact it passes through."""
    robot, top = cdpr.load_robot(name), 0.1
    for contact in (True, False):
        part = mujoco.MjSpec.from_string(cdpr.to_mjcf(robot, robot.home, winches=winches, contact=contact))
        part.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.3, 0.05], pos=[0.4, 0.25, top - 0.05])
        model = part.compile()
        data, below = mujoco.MjData(model), robot.home * [1, 1, 0] + [0, 0, 0.05]
        cdpr.reset(model, data, robot.home, rest_lengths=robot.rest_lengths(below))  # they would lay it into the table
        advance(model, data, 3)
        assert not data.warning.number.any()
        height, resting = data.body("platform").xpos[2], top + robot.platform_size[2] / 2
        assert (height == pytest.approx(resting, abs=2e-4)) == (data.ncon >= 1) == contact
        assert contact or height < top - 0.03
