"""One cable with mass against Irvine's equations in sixty-digit arithmetic, and closed forms."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from cdpr_sim.statics.profiles import catenary, profile

ENDS_TOLERANCE = 4e-15
"""Of a cable's ends, per length of a cable that hangs plumb under its own weight: some ten roundings."""

CABLES = 20_000


def _hostile(count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Anchors (their exits at 0), rest lengths, EA and weights: slack and taut to 1e-15, level and plumb to 1e-14."""
    random = np.random.default_rng(seed)
    L0, EA = 10 ** random.uniform(-2, 2, count), 10 ** random.uniform(2, 9, count)
    w = 10 ** random.uniform(-9, 3, count)
    off = 10 ** random.uniform(-15, -0.5, count)
    ratios = [random.uniform(0.01, 1, count), 1 + off, 1 - off, 10 ** random.uniform(-6, 0, count)]
    chord = L0 * np.choose(random.integers(0, 4, count), ratios)
    slopes = [10 ** random.uniform(-14, 0, count), random.uniform(0, 1, count), np.zeros(count)]
    cosine = np.choose(random.choice(3, count, p=[0.45, 0.5, 0.05]), slopes)
    sine = np.sqrt((1 - cosine) * (1 + cosine)) * random.choice([-1, 1], count)
    heading = random.uniform(0, 2 * np.pi, count)
    B = chord[:, None] * np.stack([cosine * np.cos(heading), cosine * np.sin(heading), sine], axis=-1)
    return B, L0, EA, w


def _ends(pull: np.ndarray, L0: float, EA: float, w: float) -> tuple[Decimal, Decimal]:
    """Where a cable that pulls so on its anchor ends, horizontally and upwards (Irvine's two equations)."""

    def asinh(value: Decimal) -> Decimal:
        size = abs(value)
        return (size + (size * size + 1).sqrt()).ln().copy_sign(value)

    H = sum((Decimal(float(force)) ** 2 for force in pull[:2]), Decimal(0)).sqrt()
    top, L0, EA, w = -Decimal(float(pull[2])), Decimal(float(L0)), Decimal(float(EA)), Decimal(float(w))
    bottom = top - w * L0
    x = H * L0 / EA + (H / w * (asinh(top / H) - asinh(bottom / H)) if H else 0)
    rise = ((H * H + top * top).sqrt() - (H * H + bottom * bottom).sqrt()) / w
    return x, (top + bottom) / 2 * L0 / EA + rise


def test_no_cable_defeats_it() -> None:
    """Of 20,000 hostile cables each has a force, an energy and a convex energy's stiffness."""
    B, L0, EA, w = _hostile(CABLES)
    found = catenary(np.zeros(3), B, L0, EA, w)
    assert all(np.isfinite(value).all() for value in found)
    eigenvalues = np.linalg.eigvalsh(found.stiffness)
    plumb = np.hypot(B[:, 0], B[:, 1]) == 0
    assert (eigenvalues[plumb, 0] >= 0).all()
    assert (eigenvalues[~plumb, 0] > 0).all()


def test_the_ends_are_those_of_irvines_equations_in_sixty_digits() -> None:
    """The force that it computes is exactly that of a cable whose end lies a rounding away."""
    B, L0, EA, w = _hostile(3000, seed=2)
    found = catenary(np.zeros(3), B, L0, EA, w)
    size = np.maximum(L0 * (1 + 0.5 * w * L0 / EA), np.linalg.norm(B, axis=1))
    with localcontext() as context:
        context.prec = 60
        for i in range(len(B)):
            x, z = _ends(found.pull[i], L0[i], EA[i], w[i])
            wrong = abs(x - Decimal(float(np.hypot(B[i, 0], B[i, 1])))), abs(z - Decimal(float(B[i, 2])))
            assert max(wrong) <= ENDS_TOLERANCE * float(size[i]), (i, B[i], L0[i], EA[i], w[i])


def test_the_ends_of_a_spring_without_weight_and_of_a_light_cable_are_the_same() -> None:
    """Hooke's law where it is taut, and no push; as the weight goes to nothing; exit and anchor are w L0 apart."""
    random = np.random.default_rng(1)
    A, L0, EA = random.normal(size=(300, 3)), random.uniform(0.5, 2, 300), 10 ** random.uniform(2, 4, 300)
    direction = random.normal(size=(300, 3))
    chord = L0 * random.uniform(0.3, 1.1, 300)
    B = A + direction * (chord / np.linalg.norm(direction, axis=1))[:, None]
    tension = EA * np.maximum(chord / L0 - 1, 0)
    massless = catenary(A, B, L0, EA, 0.0)
    np.testing.assert_allclose(massless.anchor_tension, tension, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(massless.pull, (A - B) * (tension / chord)[:, None], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(massless.energy, 0.5 * L0 / EA * tension**2, rtol=1e-11, atol=1e-11)
    for w in (1e-9, 1e-100, 1e-200, 1e-307):
        light = catenary(A, B, L0, EA, w)
        np.testing.assert_allclose(light.pull, massless.pull, atol=20 * w + 1e-11)
        taut = chord > 1.001 * L0
        np.testing.assert_allclose(light.stiffness[taut], massless.stiffness[taut], rtol=1e-6, atol=1e-6)
    w = 10 ** random.uniform(-1, 2, 300)
    heavy, other = catenary(A, B, L0, EA, w), catenary(B, A, L0, EA, w)  # from the other end, it pulls on its exit
    at_exit = heavy.pull + (w * L0)[:, None] * np.array([0, 0, 1.0])
    np.testing.assert_allclose(heavy.exit_tension, np.linalg.norm(at_exit, axis=1), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(other.pull, -at_exit, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(other.energy, heavy.energy, rtol=1e-11, atol=1e-11)


def test_a_plumb_one_is_the_limit_of_those_beside_it() -> None:
    """Slack it is two plumb pieces, taut it is a spring that hangs; its energy does not jump."""
    for z in (-1.3, -0.7, 0.0, 0.6, 1.2):
        plumb = catenary(np.zeros(3), [0, 0, z], 1.0, 100.0, 5.0)
        beside = catenary(np.zeros(3), [1e-13, 0, z], 1.0, 100.0, 5.0)
        np.testing.assert_allclose(plumb.pull, beside.pull, atol=1e-11)
        np.testing.assert_allclose(plumb.energy, beside.energy, rtol=1e-12)
        np.testing.assert_allclose(plumb.stiffness[2, 2], beside.stiffness[2, 2], rtol=0.1)
        expected = 5 * z / (2 * (1 + 0.025)) if abs(z) <= 1.025 else 100 * (abs(z) - 1) * np.sign(z)
        assert plumb.pull[2] == pytest.approx(-(expected + 2.5), rel=1e-12)


@pytest.mark.parametrize("spoilt", range(5))
def test_what_is_not_finite_stays_unknown(spoilt) -> None:
    """Never a flattering zero."""
    given = [np.zeros(3), np.array([1.0, 0, 0]), 1.0, 100.0, 1.0]
    given[spoilt] = np.nan * np.asarray(given[spoilt])
    assert np.isnan(catenary(*given).pull).any()


@pytest.mark.parametrize("w", [0.0, 1e-12, 1.0, 1e3])
def test_every_cable_has_a_shape_of_its_length(w: float) -> None:
    """Plumb, level, slack, taut, or of no extent at all; from exit to anchor."""
    for B in ([0, 0, 0.0], [0, 0, 0.5], [0, 0, -0.5], [0, 0, -1.2], [0.3, 0, 0], [1.2, 0, 0], [1e-14, 0, 0.3]):
        hanging = profile(np.zeros(3), B, 1.0, 1e4, w, 501)
        assert np.isfinite(hanging).all()
        np.testing.assert_array_equal(hanging[-1], B)
        np.testing.assert_allclose(hanging[0], 0, atol=1e-15)
        step = np.linalg.norm(np.diff(hanging, axis=0), axis=1)
        assert step.max() < (1 + w / 1e4 + max(np.linalg.norm(B) - 1, 0)) / 500 * 1.01
        assert step.sum() > 0.99
