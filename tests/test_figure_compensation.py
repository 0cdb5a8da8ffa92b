import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest

import cdpr_sim as cdpr
from studies.compensated_line import CompensatedLine
from studies.compensation_figures import draw_compensation


def line_of(robot: cdpr.Robot) -> CompensatedLine:
    poses = [(x, 0.25, 0.1) for x in (0.2, 0.3, 0.4)]
    compensations = [cdpr.compensate(robot, pose) for pose in poses]
    before = [cdpr.solve(robot, pose) for pose in poses]
    after = [one.equilibrium for one in compensations]
    return CompensatedLine(robot.name, before, after, before, after, compensations)


def test_the_picture_shows_the_errors_it_was_given(catalogue):
    """A column per robot; the drawn points are the distances to the commanded poses; what is out of reach is shaded."""
    lines = [line_of(catalogue["cogiro"]), line_of(catalogue["parallel"])]
    figure = draw_compensation(lines)
    assert len(figure.axes) == 4
    for column, line in enumerate(lines):
        drawn = figure.axes[column].lines[0].get_ydata()
        given = [
            1e3 * np.linalg.norm(found.position - one.commanded.translation)
            for found, one in zip(line.before, line.compensations, strict=True)
        ]
        assert drawn == pytest.approx(np.array(given))
        assert len(figure.axes[column].patches) == sum(not one.exact for one in line.compensations)
