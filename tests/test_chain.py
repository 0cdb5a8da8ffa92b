"""A cable as a finite chain: its own balance, node by node, and the catenary to which it tends."""

from __future__ import annotations

import numpy as np
import pytest
from chain_reference import Chain, Division, _balance, chain, equilibrium_of_chains, gauss, uniform
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.problem import Problem
from cdpr_sim.statics.profiles import catenary

PLACES = [(0.4, 0.1, -0.7), (0.9, -0.3, 0.2), (0.2, 0.1, 0.1), (0.6, 0.5, 0.75), (0.1, 0.0, -0.99)]
"""Anchors from an exit at 0, of a cable of length 1: slack, nearly taut and taut ones."""

EA, WEIGHT = 2000.0, 3.0


def _chain(anchor: np.ndarray, division: Division) -> Chain:
    return chain(np.zeros(3), np.asarray(anchor), division.lengths, division.weights * WEIGHT, EA)


@pytest.mark.parametrize("anchor", PLACES)
@pytest.mark.parametrize("division", [uniform(1), uniform(7), gauss(6), gauss(12)])
def test_every_node_is_in_balance(anchor: tuple[float, float, float], division: Division) -> None:
    """Springs that only pull, as far apart as the nodes lie, carry each node's weight and pull on the anchor."""
    found = _chain(np.array(anchor), division)
    np.testing.assert_allclose(found.nodes[-1], anchor, atol=1e-12)
    span = np.diff(found.nodes, axis=0)
    length = np.linalg.norm(span, axis=1)
    tension = EA * np.maximum(length / division.lengths - 1, 0)
    along = tension[:, None] * span / length[:, None]
    weights = division.weights[:, None] * [0, 0, WEIGHT]
    tolerance = 1e-12 * EA / division.lengths.min()
    np.testing.assert_allclose(along[1:] - along[:-1], weights[1:-1], atol=tolerance)
    np.testing.assert_allclose(found.pull, -along[-1] - weights[-1], atol=tolerance)
    stretched = 0.5 * (tension**2 * division.lengths).sum() / EA
    assert found.energy == pytest.approx(stretched + (weights[:, 2] * found.nodes[:, 2]).sum(), abs=1e-10)


@pytest.mark.parametrize("anchor", PLACES)
def test_energy_pull_and_stiffness_are_slopes_of_each_other(anchor: tuple[float, float, float]) -> None:
    """By central differences."""
    division, h = gauss(6), 1e-5
    found = _chain(np.array(anchor), division)
    around = [[_chain(np.array(anchor) + step * axis, division) for step in (h, -h)] for axis in np.eye(3)]
    slope = [(forward.energy - back.energy) / (2 * h) for forward, back in around]
    np.testing.assert_allclose(found.pull, -np.array(slope), atol=1e-5 * np.linalg.norm(found.pull))
    bend = np.array([(forward.pull - back.pull) / (2 * h) for forward, back in around])
    np.testing.assert_allclose(found.stiffness, -bend, atol=1e-4 * np.linalg.norm(found.stiffness))


@pytest.mark.parametrize("anchor", PLACES)
def test_its_error_falls_by_four_when_its_equal_pieces_are_doubled(anchor: tuple[float, float, float]) -> None:
    """Against the catenary; twelve of Gauss and Legendre's pieces are better still where it does not bend sharply."""
    pull = catenary(np.zeros(3), np.array(anchor), 1.0, EA, WEIGHT).pull
    errors = [np.linalg.norm(_chain(np.array(anchor), uniform(n)).pull - pull) for n in (64, 128, 256)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)
    if np.linalg.norm(anchor) > 0.95:
        assert np.linalg.norm(_chain(np.array(anchor), gauss(12)).pull - pull) < errors[2]


@pytest.mark.parametrize("pieces", [1, 2, 3, 8])
@pytest.mark.parametrize(
    "anchor", [(0, 0, 0.0), (0, 0, 0.4), (0, 0, -0.6), (0.01, 0, 0.0), (0, 0, -1.2), (0.02, 0, 0.5)]
)
def test_pieces_without_tension_lie_between_plumb_ones(anchor: tuple[float, float, float], pieces: int) -> None:
    """A plumb chain, and one whose middle piece hangs loose, have a rest as well."""
    found = _chain(np.array(anchor), uniform(pieces))
    np.testing.assert_allclose(found.nodes[-1], anchor, atol=1e-9)
    span = np.linalg.norm(np.diff(found.nodes, axis=0), axis=1)
    assert span.max() < (1 + WEIGHT / EA + max(0, np.linalg.norm(anchor) - 1) + 1e-9) / pieces
    assert np.linalg.eigvalsh(found.stiffness).min() > -1e-9


def test_without_weight_it_is_one_spring() -> None:
    """Taut, and slack."""
    taut = chain(np.zeros(3), np.array([0.6, 0, 0.9]), np.full(4, 0.25), np.zeros(5), EA)
    length = np.hypot(0.6, 0.9)
    np.testing.assert_allclose(taut.pull, EA * (1 - length) / length * np.array([0.6, 0, 0.9]), rtol=1e-10)
    slack = chain(np.zeros(3), np.array([0.6, 0, 0.3]), np.full(4, 0.25), np.zeros(5), EA)
    np.testing.assert_array_equal(slack.pull, 0)
    np.testing.assert_array_equal(slack.stiffness, 0)


def test_the_stiffness_that_finds_the_rest_is_the_slope_of_the_forces() -> None:
    """At the rest, by central differences; the centre of mass off the origin, so that every arm counts."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=5e-3, center_of_mass=(0.01, 0.02, -0.015))
    problem = Problem.of(robot, (0.35, 0.22, 0.15))
    weights = problem.rest_lengths * robot.cabling.linear_density * robot.gravity
    division, start = gauss(6), cdpr.solve(problem)
    chains = np.outer(problem.rest_lengths, division.lengths), np.outer(weights, division.weights)
    position, rotation, _ = equilibrium_of_chains(problem, *chains, start.position, start.rotation.as_matrix())

    def forces(step: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(step[3:] / robot.characteristic_length).as_matrix() @ rotation
        return _balance(problem, *chains, position + step[:3], turned)[0]

    h = 1e-7
    slope = np.array([(forces(-step) - forces(step)) / (2 * h) for step in h * np.eye(6)])
    stiffness = _balance(problem, *chains, position, rotation)[1]
    np.testing.assert_allclose(stiffness, (slope + slope.T) / 2, atol=1e-6 * np.abs(slope).max())


def test_platforms_on_chains_rest_where_those_on_catenaries_do() -> None:
    """Up to an error that falls by four when equal pieces are doubled, and to 1e-9 m with eight by quadrature."""
    robot = cdpr.load_robot("parallel").replace(linear_density=5e-3)
    problem = Problem.of(robot, (0.3, 0.22, 0.15))
    rest = cdpr.solve(problem)

    def on(division: Division) -> float:
        weights = problem.rest_lengths * robot.cabling.linear_density * robot.gravity
        position, _, residual = equilibrium_of_chains(
            problem, np.outer(problem.rest_lengths, division.lengths), np.outer(weights, division.weights),
            rest.position, rest.rotation.as_matrix(),
        )  # fmt: skip
        assert residual < 1e-9
        return float(np.linalg.norm(position - rest.position))

    errors = [on(uniform(n)) for n in (8, 16, 32)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)
    assert on(gauss(8)) < 1e-9
