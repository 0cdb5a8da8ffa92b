"""``cdpr_sim.jax.solve``: the equilibria of ``solve`` as a function of JAX, with the derivatives of ``sensitivity``."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.statics import forces
from cdpr_sim.statics.derivatives import parameters, wrench_slope

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what JAX itself imports
    jax = pytest.importorskip("jax")
    import cdpr_sim.jax as cj

EXACT = 1e-6
"""Of a derivative, relative to the largest entry. Differences of fourth order agree to 2e-7 and better; those between
results of ``solve`` to 4e-6 only, since it stops at a residual of 1e-9 of the load: it is taken out here."""

STEP = 1e-3
"""Of a directional difference, relative to a parameter's size (``directions``)."""

NEWTON = 3
"""Steps of Newton's method that take out the residual; one is enough."""

ROBOTS = {
    "cogiro": ({"material": "fishing-0.4mm"}, (0.25, 0.22, 0.15)),
    "planar-vertical": ({"material": "fishing-0.4mm"}, (0.25, 0.0, 0.15)),
    "parallel": (
        {"pulley_radius": 0.01, "winch_to_exit": 0.5, "reeving": 2, "stiffening": (3.0, 20.0), "axial_stiffness": 500},
        (0.25, 0.22, 0.15),
    ),
}
"""Changes of a robot, and a pose away from any change between slack and taut."""


@pytest.fixture(autouse=True)
def _double():
    before = jax.config.read("jax_enable_x64")
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def nominal(problem: cdpr.Problem) -> dict[str, np.ndarray]:
    """The parameters of a problem by name."""
    named = {name: getattr(problem.robot, name, None) for name in parameters(problem.robot)}
    named |= {"rest_lengths": problem.rest_lengths, "external_wrench": np.zeros(6)}
    return {name: np.asarray(value, dtype=float) for name, value in named.items()}


def directions(problem: cdpr.Problem) -> dict[str, np.ndarray]:
    """A random direction for each parameter, of a size that changes results; of planar robots in their plane."""
    random = np.random.default_rng(1)
    robot, found = problem.robot, {}
    sizes = {"axial_stiffness": robot.axial_stiffness.mean(), "mass": robot.mass, "external_wrench": robot.weight}
    sizes["stiffening"] = 5.0  # as its values
    for name, value in nominal(problem).items():
        step = random.standard_normal(value.shape) * sizes.get(name, 0.05)
        if robot.mobility == "planar" and name in ("exits", "anchors", "center_of_mass"):
            step[..., 1] = 0
        if name == "external_wrench":
            step *= 0.1 * np.array([1, 1, 1, *[robot.characteristic_length] * 3])
            step[[1, 3, 5]] *= robot.mobility == "spatial"
        found[name] = step
    return found


def refined(problem: cdpr.Problem) -> np.ndarray:
    """Position, rotation and tensions of an equilibrium, to rounding."""
    found, free = cdpr.solve(problem), problem.robot.free
    position, rotation = found.position, found.rotation
    for _ in range(NEWTON):
        state = forces.at(problem, position, rotation.as_matrix())
        step = np.zeros(6)
        step[free] = -np.linalg.solve(wrench_slope(state)[np.ix_(free, free)], state.net_wrench[free])
        position, rotation = position + step[:3], Rotation.from_rotvec(step[3:]) * rotation
    state = forces.at(problem, position, rotation.as_matrix())
    return np.concatenate([position, rotation.as_matrix().ravel(), state.tensions])


def flat(solution: cj.Solution) -> np.ndarray:
    return np.concatenate([np.asarray(part).ravel() for part in solution])


@pytest.mark.parametrize("name", ROBOTS)
def test_derivatives_are_those_of_the_solver(name, catalogue):
    """By every parameter, forward and reverse, along a random direction; those of a robot with other cables are not."""
    changes, pose = ROBOTS[name]
    problem = cdpr.Problem.of(catalogue[name].replace(**changes), pose)
    robot, values = problem.robot, nominal(problem)
    lengths = values["rest_lengths"]

    def solved(parameter, value, of=robot):
        return cj.solve(of, pose, **({"rest_lengths": lengths} | {parameter: value}))

    def changed(parameter, value):
        loads = {"rest_lengths": lengths} | (
            {parameter: value} if parameter in ("rest_lengths", "external_wrench") else {}
        )
        other = robot if parameter in loads else robot.replace(**{parameter: value})
        return refined(cdpr.Problem.of(other, pose, **loads))

    for parameter, direction in directions(problem).items():
        start = values[parameter]
        once, back, twice, further = (changed(parameter, start + by * STEP * direction) for by in (1, -1, 2, -2))
        differenced = (8 * (once - back) - (twice - further)) / (12 * STEP)

        def along(of, parameter=parameter, start=start, direction=direction):
            return jax.jvp(lambda value: solved(parameter, value, of), (start,), (direction,))

        found, tangents = along(robot)
        rounding = np.finfo(float).eps / STEP * np.array([1.0, 1.0, robot.axial_stiffness.max()])
        for exact, part, least in zip(tangents, np.split(differenced, [3, 12]), rounding, strict=True):
            np.testing.assert_allclose(np.ravel(exact), part, rtol=0, atol=least + EXACT * np.abs(part).max())
        weights = cj.Solution(*(np.random.default_rng(2).standard_normal(part.shape) for part in found))
        (gradient,) = jax.vjp(lambda value, parameter=parameter: solved(parameter, value), start)[1](weights)
        assert np.vdot(gradient, direction) == pytest.approx(flat(weights) @ flat(tangents), rel=1e-9)
        other = along(robot.replace(axial_stiffness=1.01 * robot.axial_stiffness))[1]
        off = np.abs(np.ravel(other.tensions) - differenced[12:]).max()
        assert parameter == "axial_stiffness" or off > EXACT * np.abs(differenced[12:]).max()


def test_a_batch_is_its_rows(catalogue):
    """By dimensions that broadcast, by ``vmap`` and within ``jit``; with robots that differ in each row as well."""
    robot = catalogue["cogiro"]
    poses = np.linspace((0.2, 0.25, 0.1), (0.6, 0.25, 0.1), 4)
    stiffness = np.array([[1e3], [1e4]]) * np.ones(8)
    exits = robot.exits + np.linspace(0, 0.01, 4)[:, None, None]
    rows = cdpr.solve_many(robot, poses, axial_stiffness=stiffness[:, None])
    batch = jax.jit(lambda ea: cj.solve(robot, poses, axial_stiffness=ea))(stiffness[:, None])
    np.testing.assert_array_equal(batch.position, rows.positions)
    np.testing.assert_array_equal(batch.tensions, rows.tensions)
    mapped = jax.vmap(lambda ea: jax.vmap(lambda p: cj.solve(robot, p, axial_stiffness=ea))(poses))(stiffness)
    np.testing.assert_array_equal(mapped.rotation, rows.rotations)

    def sag(ea, pose, points):
        return cj.solve(robot, pose, axial_stiffness=ea, exits=points).position[2]

    gradients = jax.vmap(jax.jit(jax.grad(sag, (0, 2))), (None, 0, 0))(1e3, poses, exits)
    for row in range(4):
        one = jax.grad(sag, (0, 2))(1e3, poses[row], exits[row])
        np.testing.assert_allclose(gradients[0][row], one[0], rtol=1e-9)
        np.testing.assert_allclose(gradients[1][row], one[1], rtol=1e-9, atol=1e-12)


def test_at_the_slack_kink_the_derivative_jumps_and_the_result_does_not(catalogue):
    """On either side of the length at which a cable becomes slack, it is that side's difference."""
    robot, pose = catalogue["parallel"], (0.3, 0.25, 0.15)
    rest = robot.rest_lengths(pose)

    def solved(longer):
        return cj.solve(robot, pose, rest + longer * np.eye(8)[cable])

    cable = int(np.argmax(cdpr.solve(robot, pose).tensions))
    taut, slack = 0.0, 0.02
    while slack - taut > 1e-12:
        middle = (taut + slack) / 2
        taut, slack = (middle, slack) if solved(middle).tensions[cable] > 0 else (taut, middle)
    here, there, step = taut - 1e-7, slack + 1e-7, 1e-8
    slopes = []
    for at in (here, there):
        ahead, behind = solved(at + step), solved(at - step)
        slopes.append(np.asarray(jax.jacfwd(solved)(at).position))
        np.testing.assert_allclose(slopes[-1], (ahead.position - behind.position) / (2 * step), rtol=1e-4, atol=1e-6)
    assert np.abs(slopes[0] - slopes[1]).max() > 0.1 * np.abs(slopes[0]).max()
    np.testing.assert_allclose(solved(here).position, solved(there).position, rtol=0, atol=1e-6)


def test_where_there_is_no_equilibrium_it_is_nan(catalogue):
    """A row of a batch with a stiffness, a number or a pose of which there is none; the others are not changed."""
    robot = catalogue["cogiro"]
    found = cj.solve(robot, [(0.4, 0.25, 0.1), (np.nan, 0.25, 0.1), (0.4, 0.25, 9.0)])
    np.testing.assert_array_equal(np.isnan(found.position).all(1), [False, True, True])
    found, slopes = jax.value_and_grad(lambda ea: cj.solve(robot, (0.4, 0.25, 0.1), axial_stiffness=ea).position[2])(
        -1.0
    )
    assert np.isnan([found, slopes]).all()
    np.testing.assert_array_equal(
        cj.solve(robot, (0.4, 0.25, 0.1)).position, cdpr.solve(robot, (0.4, 0.25, 0.1)).position
    )


def test_what_it_cannot_do_is_refused_in_a_sentence(catalogue):
    """Single precision, shapes, what the robot does not have, and a derivative by the pose."""
    robot, pose = catalogue["cogiro"], np.array([0.4, 0.25, 0.1])
    for given, words in (
        ({"mass": np.ones(3), "rest_lengths": np.ones((2, 8))}, r"do not fit one another: rest_lengths \(2,\), mass"),
        ({"exits": np.ones(3)}, r"exits: found an array of shape \(3,\), expected \(..., 8, 3\)"),
        ({"pulley_radius": 0.01}, "pulley_radius: found one for 'cogiro', which has none"),
    ):
        with pytest.raises(cdpr.InvalidInput, match=words):
            cj.solve(robot, pose, **given)
    with pytest.raises(cdpr.InvalidInput, match="pose: found a derivative"):
        jax.grad(lambda at: cj.solve(robot, at).position[2])(pose)
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(cdpr.InvalidInput, match="jax_enable_x64: found JAX in single precision"):
        cj.solve(robot, pose)
