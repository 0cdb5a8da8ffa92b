"""The comparison of control schemes: tasks are what they are called, and tables show what was measured."""

import dataclasses
import io

import numpy as np
import pytest
from rich.console import Console

from controller_comparison import (
    PAUSE,
    RIGID,
    RIGID_FEEDBACK,
    ROPES,
    SCHEMES,
    Run,
    TrackingTask,
    believed,
    held,
    rms,
    rope_tasks,
    run,
    tasks,
)
from controllers import ROWS, ropes_table, runs_table, summary_table

LINE = TrackingTask("cogiro", "fishing-0.4mm", "line", 0.5)
CIRCLE = TrackingTask("parallel", "vectran-0.7mm", "circle", 0.05)


@pytest.fixture(scope="module")
def found() -> tuple[Run, ...]:
    """Two runs, and the second one's motion as if it were of another task and scheme."""
    rigid, feedback = run(LINE, RIGID), run(LINE, RIGID_FEEDBACK)
    return rigid, feedback, dataclasses.replace(feedback, task=CIRCLE, scheme=RIGID)


def test_tasks_are_all_combinations_of_what_they_say():
    """Two layouts, two cables, two paths, two speeds; a fifth of the stiffness and 5 mm of one exit are wrong.

    The circle of 0.1 m about the middle is level; cables hold the platform of the crossed layout all along its line,
    that of the parallel one within some 80 mm of the middle: a third of 0.46 m.
    """
    assert len(set(tasks())) == 16
    assert list(ROWS) == list(SCHEMES)
    true, wrong = LINE.robot, believed(LINE.robot)
    np.testing.assert_allclose(wrong.axial_stiffness, 0.8 * true.axial_stiffness)
    np.testing.assert_allclose(np.linalg.norm(wrong.exits - true.exits, axis=1), [0.005, *np.zeros(7)], atol=1e-15)
    points = CIRCLE.waypoints
    np.testing.assert_allclose(points[0], points[-1], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(points[:, :2] - CIRCLE.robot.home[:2], axis=1), 0.1)
    assert np.ptp(points[:, 2]) == 0
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert length == pytest.approx(2 * np.pi * 0.1, rel=1e-3)
    assert 1.875 * length / CIRCLE.seconds == pytest.approx(0.05)
    assert held(LINE) == 1.0
    assert held(TrackingTask("parallel", "vectran-0.7mm", "line", 0.5)) == pytest.approx(0.16 / 0.46, abs=0.05)


def test_feedback_pays_and_the_pause_does_not_count(found):
    """Crossed layout, quick line; the speed at the fastest is 0.5 m/s."""
    rigid, feedback, _ = found
    assert rms(feedback.position_errors) < 0.8 * rms(rigid.position_errors)
    assert not feedback.fell
    motion = rigid.trajectory
    assert len(rigid.position_errors) == (motion.times >= PAUSE).sum() < len(motion)
    speeds = np.linalg.norm(np.diff(motion.commanded.translation, axis=0), axis=1) / np.diff(motion.times)
    assert speeds.max() == pytest.approx(0.5, rel=1e-3)
    shift = np.linalg.norm(motion.positions - motion.commanded.translation, axis=1)[motion.times >= PAUSE]
    assert rms(rigid.position_errors) == pytest.approx(np.sqrt((shift**2).mean()))


def test_the_tables_say_what_was_measured(found, snapshot):
    """A row per run under its task, in mm, degrees and newtons; a column for each kind of rope; who fell is said to."""
    ropes = [dataclasses.replace(found[0], task=rope_tasks()[2])]
    console = Console(width=120, file=io.StringIO(), record=True)
    fell = dataclasses.replace(found[1], fell=True)
    for table in (runs_table(found), summary_table(found), runs_table([found[0], fell]), ropes_table(ropes)):
        console.print(table)
    text = console.export_text()
    snapshot("controllers.txt", text, rel=1e-3)
    errors, tilts = 1e3 * found[0].position_errors, np.degrees(found[0].tilts)
    numbers = [rms(errors), errors.max(), rms(tilts), tilts.max(), found[0].lowest_tension, found[0].highest_tension]
    assert f"{RIGID} {' '.join(f'{number:.2f}' for number in numbers)}" in " ".join(text.split())
    assert f"{rms(errors):.3f}" in text


def test_ropes_with_a_memory_are_those_that_are_named():
    """Of all tasks; friction only where it is named."""
    assert [task.ropes for task in rope_tasks()] == list(ROPES)
    assert all(task.robot.cabling.has_memory.all() for task in rope_tasks())
    assert [float(task.robot.pulley_friction[0]) for task in rope_tasks()] == [0, 0.02, 0.05, 0, 0]
