"""Every number that is shown as MuJoCo's comes from MuJoCo's method, and every solver's from that solver.

The methods are replaced by recorders that make up numbers: those, and no others, are to be shown.
"""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim import RigidLengths
from cdpr_sim.cli import app
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck import compare as comparing
from cdpr_sim.crosscheck import layout_validation as proving
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.physics import sensing
from cdpr_sim.physics.release import Release

FIRST = {"mujoco": 1.0, "newton": 2.0, "fsolve": 3.0, "least_squares": 4.0}
"""Of each method's numbers the first digit."""

HEADS = {"mujoco": "MuJoCo", "newton": "Newton", "fsolve": "fsolve", "least_squares": "least_sq."}


class Recorder:
    """A method that answers with numbers of its own: another 0.01 m, 0.001 m, 1 N and 1 N/m with each call."""

    def __init__(self) -> None:
        self.told: list[cdpr.Equilibrium] = []

    def made_up(self, problem: cdpr.Problem, method: str) -> cdpr.Equilibrium:
        calls = len(self.told)
        first, cables = FIRST[method] + 0.01 * calls, problem.robot.cables
        turned = Rotation.from_euler("xy", [first, 10 * first], degrees=True)
        found = cdpr.Equilibrium(
            problem=problem,
            pose=RigidTransform.from_components([first, first + 0.1, first + 0.2], turned),
            tensions=100 * first + np.arange(cables) + calls,
            lengths=first + 0.001 * np.arange(cables),
            residual=first * 1e-9,
            eigenvalues=1000 * first + np.arange(6) + calls,
            iterations=int(100 * FIRST[method]) + calls,
            source={"mujoco": "mujoco", "newton": "newton"}.get(method, f"seecr/{method}"),
        )
        self.told.append(found)
        return found

    def settle(self, *asked, progress: bool = False, external_wrench=None) -> cdpr.Equilibrium:
        return self.made_up(cdpr.Problem.of(*asked, external_wrench=external_wrench), "mujoco")

    def solve(self, *asked, method: str = "newton", external_wrench=None) -> cdpr.Equilibrium:
        return self.made_up(cdpr.Problem.of(*asked, external_wrench=external_wrench), method)


@pytest.fixture
def methods(monkeypatch) -> Recorder:
    """Both methods, made up."""
    recorder = Recorder()
    monkeypatch.setattr(cdpr, "settle", recorder.settle)
    monkeypatch.setattr(cdpr, "solve", recorder.solve)
    return recorder


def run(*words: str):
    return CliRunner().invoke(app, list(words), env={"COLUMNS": "200"})


def cells(text: str, label: str, count: int) -> list[str]:
    """The last ``count`` cells of the row that begins with ``label``."""
    (line,) = (line for line in text.splitlines() if line.strip().startswith(label))
    return line.split()[-count:]


def is_told(shown: dict, found: cdpr.Equilibrium) -> None:
    """Whether a JSON's entry has the numbers of this result, and no others."""
    assert shown["source"] == found.source
    for name in ("position", "euler", "tensions", "lengths", "eigenvalues", "rest_lengths", "slack"):
        assert shown[name] == getattr(found, name).tolist(), name
    for name in ("tilt", "residual", "iterations"):
        assert shown[name] == getattr(found, name), name
    assert shown["stability"] == found.stability.name.lower()


def test_settle_shows_what_each_method_says(methods):
    """All four of them, in the table and in JSON; the verdict is about MuJoCo's and Newton's."""
    text = run("settle", "cogiro", "--all").stdout
    by_method = by_first(methods.told)
    assert [HEADS[method] for method in FIRST] == cells(text, "commanded", 4)
    for axis, name in enumerate("xyz"):
        assert cells(text, f"{name} [mm]", 4) == [f"{1e3 * one.position[axis]:.3f}" for one in by_method.values()]
    for cable in range(8):
        shown = [f"{one.tensions[cable]:.4f}" for one in by_method.values()]
        assert cells(text, f"tension {cable + 1} [N]", 4) == shown
    assert cells(text, "unbalanced [N]", 4) == [f"{one.residual:.1e}" for one in by_method.values()]
    assert cells(text, "iterations", 4) == [str(one.iterations) for one in by_method.values()]
    apart = np.linalg.norm(by_method["newton"].position - by_method["mujoco"].position)
    assert f"MuJoCo and Newton: the two methods disagree: position within {1e3 * apart:.1e} mm" in " ".join(
        text.split()
    )
    methods.told.clear()
    told = json.loads(run("settle", "cogiro", "--json").stdout)
    assert told["position_error"] == pytest.approx(apart)
    by_method = by_first(methods.told)
    assert told["tension_error"] == pytest.approx(
        np.abs(by_method["newton"].tensions - by_method["mujoco"].tensions).max()
    )
    for method, one in by_method.items():
        is_told(told["results"][method], one)


def by_first(told: list[cdpr.Equilibrium]) -> dict[str, cdpr.Equilibrium]:
    """One equilibrium of each method, by its name, in the order of the table's columns."""
    found = {one.source.rpartition("/")[2]: one for one in told}
    assert len(found) == len(told) == len(FIRST)
    return {method: found[method] for method in FIRST}


@pytest.mark.parametrize("method", ["newton", "fsolve", "least_squares"])
def test_solve_shows_the_solver_that_is_asked(methods, method):
    """Under its own name."""
    text = run("solve", "cogiro", "--method", method).stdout
    assert cells(text, "commanded", 1) == [HEADS[method]]
    assert cells(text, "x [mm]", 1) == [f"{1e3 * methods.told[0].position[0]:.3f}"]
    is_told(json.loads(run("solve", "cogiro", "--method", method, "--json").stdout), methods.told[1])


def test_compensate_shows_each_method_before_and_after(methods, monkeypatch):
    """Four columns; whether it is held is what MuJoCo's ``verify_compensation`` says, and not what statics says."""
    monkeypatch.setattr(cdpr, "verify_compensation", lambda found: CompensationCheck(found, None, None))
    result = run("compensate", "cogiro")
    assert result.exit_code == 1
    assert "The equilibrium found by statics is not held in MuJoCo" in result.stdout
    told = [methods.told[call] for call in (0, 2, 1, 3)]  # each method is asked before and after
    assert [one.source for one in told] == ["mujoco", "newton"] * 2
    home = cdpr.load_robot("cogiro").home
    for axis, name in enumerate("xyz"):
        shown = [f"{1e3 * (one.position[axis] - home[axis]):.6f}" for one in told]
        assert cells(result.stdout, f"error {name} [mm]", 4) == shown
    assert cells(result.stdout, "tension 8 [N]", 4) == [f"{one.tensions[7]:.3f}" for one in told]
    assert cells(result.stdout, "lowest stiffness [N/m]", 4) == [f"{one.eigenvalues[0]:.3g}" for one in told]
    rigid, cut = told[0].rest_lengths, told[2].rest_lengths
    np.testing.assert_array_equal(rigid, cdpr.load_robot("cogiro").rest_lengths(home))
    assert (cut < rigid).all()
    methods.told.clear()
    shown = json.loads(run("compensate", "cogiro", "--json").stdout)
    assert (shown["held"], shown["reached_from_commanded"]) == (False, False)
    told = [methods.told[call] for call in (0, 2, 1, 3)]
    for (when, method), one in zip(itertools.product(("before", "after"), ("mujoco", "newton")), told, strict=True):
        is_told(shown[when][method], one)
    assert shown["rest_lengths"] == told[2].rest_lengths.tolist()


def test_equilibria_shows_what_mujocos_platforms_do(monkeypatch):
    """Which of them stay, and to which one MuJoCo's comes while gravity grows."""
    found = cdpr.find_equilibria(cdpr.load_robot("two-cable"), (0.3, 0, 0.2), saddles=True, starts=20)
    assert len(found) == 2
    answers = [Release(largest_deviation, 1.0, 1.0) for largest_deviation in (10.0, 500.0)]
    said = itertools.cycle(answers)
    monkeypatch.setattr(cdpr, "release", lambda one, seconds: next(said))
    monkeypatch.setattr(cdpr, "grow_gravity", lambda problem: found[1])
    words = ["equilibria", "two-cable", "--pose", "0.3", "0", "0.2", "--saddles", "--starts", "20"]
    result = run(*words)
    rows = [line.split() for line in result.stdout.splitlines() if line.split()[:1] and line.split()[0].isdigit()]
    assert [row[-1] for row in rows[-2:]] == ["neither", "leaves"]
    assert "MuJoCo reaches 2 instead" in result.stdout
    assert result.exit_code == 1
    said = itertools.cycle([Release(1.0, 1.0, 1.0), answers[1]])
    told = json.loads(run(*words, "--json").stdout)
    assert [one["stays_in_mujoco"] for one in told["equilibria"]] == [True, False]
    assert (told["reached"], told["reached_in_mujoco"]) == (0, 1)


# --- whole workspaces ---------------------------------------------------------------------------------------------


def shifted(equilibria: EquilibriumBatch, by: float) -> EquilibriumBatch:
    """Every platform moved by 1, 2, ... times ``by`` [m] along x, every tension by as many N."""
    rows = by * np.arange(1, np.prod(equilibria.shape) + 1).reshape(*equilibria.shape, 1)
    return dataclasses.replace(
        equilibria, positions=equilibria.positions + rows * [1.0, 0, 0], tensions=equilibria.tensions + rows
    )


def test_compare_asks_each_method_about_the_other(monkeypatch):
    """MuJoCo's recorder is asked about the static pose, and its number is what is said of it."""
    robot = cdpr.load_robot("cogiro")
    static, settled = cdpr.solve(robot, (0.3, 0.25, 0.1)), cdpr.settle(robot, (0.3, 0.25, 0.1))
    asked = []
    recorder = lambda problems, poses, threads: asked.append(poses) or 123.0  # noqa: E731
    monkeypatch.setattr(comparing, "residuals_of", recorder)
    agreement = cdpr.compare(static, settled)
    assert agreement.static_in_mujoco == 123.0
    assert len(asked) == 1
    np.testing.assert_array_equal(asked[0].translation[0], static.position)
    assert agreement.settled_in_statics < 1e-6
    assert any("MuJoCo at the static pose has a residual of 1.2e+02 N" in reason for reason in agreement.reasons)


def test_the_proof_of_a_layout_is_mujocos(monkeypatch):
    """Its score is that of where MuJoCo's platforms rest, and not of where the solver has them."""
    found = cdpr.find_layout(
        cdpr.load_robot("parallel"), [(0.3, 0.25, 0.1), (0.5, 0.25, 0.1)], move=[cdpr.Move("exits", 0.01)],
        objective="worst deviation", generations=1,
    )  # fmt: skip
    settle = proving.settle_many
    monkeypatch.setattr(proving, "settle_many", lambda problems: shifted(settle(problems), 1.0))
    proof = cdpr.validate_layout(found)
    for side in (proof.before, proof.after):
        assert side.score == pytest.approx(np.linalg.norm(side.settled.deviation, axis=-1).max())
        assert side.score > 2.9
        apart = np.linalg.norm(side.settled.positions - side.solved.positions, axis=-1)
        assert side.errors["position_error"] == pytest.approx(apart.max())
    assert not proof.agrees
    monkeypatch.setattr(proving, "settle_many", settle)
    proof = cdpr.validate_layout(found)
    assert f"within {1e3 * proof.after.errors['position_error']:.1e} mm" in " ".join(proof.sentences)

    def restless(problems):
        settled = settle(problems)
        status = np.where(np.arange(len(settled)) == 1, Status.ITERATION_LIMIT, settled.status)
        return dataclasses.replace(settled, status=status)

    monkeypatch.setattr(proving, "settle_many", restless)
    assert np.isnan(cdpr.validate_layout(found).after.score)


# --- pictures and motions -----------------------------------------------------------------------------------------


def test_a_video_is_of_mujocos_motion_with_the_solvers_outline(monkeypatch, tmp_path):
    """What is filmed is what ``drive`` returns; what is outlined, what ``solve_trajectory`` says of it."""
    motions, outlines, filmed = {}, [], {}

    def drive(robot, *args, **options):  # on threads, in any order
        motions[robot.name] = shifted(cdpr_drive(robot, *args, **options), 1e-3)
        return motions[robot.name]

    def solve(motion):
        outlines.append(shifted(cdpr_solve(motion), -1e-3))
        return outlines[-1]

    def film(path, trajectories, static, **options):
        filmed.update(trajectories=trajectories, static=static, path=path)
        return path

    cdpr_drive, cdpr_solve = cdpr.drive, cdpr.solve_trajectory
    monkeypatch.setattr(cdpr, "drive", drive)
    monkeypatch.setattr("cdpr_sim.studies.robot_summary.solve_trajectory", solve)
    monkeypatch.setattr("cdpr_sim.studies.robot_summary.write_video", film)
    words = [
        "--path",
        "0.4",
        "0.401",
        "--drive-seconds",
        "0.1",
        "--seconds",
        "0.2",
        "--fps",
        "10",
        "-o",
        str(tmp_path / "v.gif"),
    ]
    told = run("video", "cogiro", "parallel", *words)
    assert told.exit_code == 0, told.output
    assert filmed["path"] == Path(tmp_path / "v.gif")
    in_order = [motions["cogiro"], motions["parallel"]]
    for shown, motion, outline, static in zip(
        filmed["trajectories"], in_order, outlines, filmed["static"], strict=True
    ):
        assert shown is motion
        np.testing.assert_array_equal(static.translation, outline.positions)


def test_a_tracked_trajectory_is_what_mujocos_sensors_say(monkeypatch):
    """Poses, lengths and tensions; what the controller commands shows in the rest lengths alone."""
    read = np.array([1.0, 2.0, 3.0, 1.0, 0, 0, 0]), 10.0 + np.arange(8), 20.0 + np.arange(8)
    monkeypatch.setattr(sensing.Readings, "of", lambda self, sensed: read)
    robot = cdpr.load_robot("cogiro")
    tracked = cdpr.track(robot, [robot.home], RigidLengths(robot), seconds=0.03)
    assert tracked.source == "mujoco"
    assert (tracked.positions == [1.0, 2.0, 3.0]).all()
    assert (tracked.lengths == 10.0 + np.arange(8)).all()
    assert (tracked.tensions == 20.0 + np.arange(8)).all()
    np.testing.assert_allclose(tracked.rest_lengths, np.tile(robot.rest_lengths(robot.home), (4, 1)), rtol=1e-12)
