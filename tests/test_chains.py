"""Chains of cables with mass: how they are laid out between exit and anchor."""

import numpy as np

from cdpr_sim.physics.cable import Springs
from cdpr_sim.physics.chains import SEGMENTS, hang

POOREST = 1e4
"""Largest factor between the true pull and that with which a chain is begun to be laid out."""

CLOSE = 1e-9
"""Of extents, in lengths of the chain: 4e-12 measured."""


def test_hanging_chains_are_laid_out_from_any_pull(monkeypatch):
    """Chains built segment by segment from a known pull are found again from pulls of any size and direction.

    With Newton's method on the distances alone, seven in a hundred are not.
    """
    random = np.random.default_rng(0)
    shape = count, _ = 500, SEGMENTS
    rest = random.uniform(0.02, 0.3, shape)
    stiffness = 10 ** random.uniform(3, 6, (count, 1)) / rest
    weights = 10 ** random.uniform(-3, 0, (count, 1, 1)) * rest[..., None] * [0.0, 0.0, -1.0]
    weight = -weights[..., 2].sum(1)
    pulls = random.normal(size=(count, 3)) * (weight * 10 ** random.uniform(-1, 2, count))[:, None]
    # From exit to anchor: the pull on each segment is that on the anchor and the weights of all masses from there on.
    on_each = pulls[:, None] - weights[:, ::-1].cumsum(1)[:, ::-1]
    sizes = np.linalg.norm(on_each, axis=2)
    segments = on_each * (rest / sizes + 1 / stiffness)[..., None]
    nothing, systems, solve = np.zeros(shape), [], np.linalg.solve
    monkeypatch.setattr(np.linalg, "solve", lambda *given: systems.append(len(given[0])) or solve(*given))
    start = random.normal(size=(count, 3)) * (weight * POOREST ** random.uniform(-1, 1, count))[:, None]
    extents, found = hang(
        weights,
        rest,
        Springs(stiffness, nothing, nothing),
        np.zeros(count),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        start,
        segments.sum(1),
    )
    assert found.all()
    off = np.abs(extents - segments[:, :0:-1]).max((1, 2)) / rest.sum(1)
    assert off.max() <= CLOSE
    assert np.sum(systems) <= 25 * count  # 19 measured
