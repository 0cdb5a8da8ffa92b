"""Every number that is shown as MuJoCo's comes from MuJoCo's method, and every solver's from that solver.

The methods are replaced by recorders that make up numbers: those, and no others, are to be shown. How they are printed,
``test_shown_text.py`` says.
"""

import dataclasses
import itertools
import json
from pathlib import Path

import made_up
import numpy as np
import pytest
from inputs import row, run
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim import RigidLengths
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck import compare as comparing
from cdpr_sim.crosscheck import layout_validation as proving
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.physics.motion import Motion
from cdpr_sim.physics.release import Release
from cdpr_sim.physics.simulations import Observation
from cdpr_sim.report import robot_summary

FIRST = {"mujoco": 1.0, "newton": 2.0, "fsolve": 3.0, "least_squares": 4.0}
"""Of each method's numbers the first digit."""


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
    """Both methods, made up; of a compensation MuJoCo says nothing."""
    recorder = Recorder()
    monkeypatch.setattr(cdpr, "settle", recorder.settle)
    monkeypatch.setattr(cdpr, "solve", recorder.solve)
    monkeypatch.setattr(cdpr, "verify_compensation", lambda found: CompensationCheck(found, None, None))
    return recorder


BOTH = ["mujoco", "newton"]

SHOWN = {  # a command: of each entry in its JSON, which method's call it is
    "settle cogiro": {"results.mujoco": ("mujoco", 0), "results.newton": ("newton", 0),
                      "results.fsolve": ("fsolve", 0), "results.least_squares": ("least_squares", 0)},
    **{f"solve cogiro --method {method}": {"": (method, 0)} for method in ("newton", "fsolve", "least_squares")},
    "compensate cogiro": {f"{when}.{method}": (method, n) for n, when in enumerate(("before", "after"))
                          for method in BOTH},
}  # fmt: skip


@pytest.mark.parametrize("command", SHOWN)
def test_each_entry_of_json_is_of_the_method_under_whose_name_it_is(methods, command):
    """All of its numbers, and no others; a verdict is about MuJoCo's and Newton's."""
    shown = json.loads(run(*command.split(), "--json").stdout)
    for path, (method, call) in SHOWN[command].items():
        one = shown
        for key in filter(None, path.split(".")):
            one = one[key]
        found = [told for told in methods.told if told.source.rpartition("/")[2] == method][call]
        assert one["source"] == found.source
        for name in ("position", "euler", "tensions", "lengths", "eigenvalues", "rest_lengths", "slack"):
            assert one[name] == getattr(found, name).tolist(), name
        for name in ("tilt", "residual", "iterations"):
            assert one[name] == getattr(found, name), name
        assert one["stability"] == found.stability.name.lower()
    if command.startswith("settle"):
        mujoco, newton = (next(one for one in methods.told if one.source == name) for name in BOTH)
        assert shown["position_error"] == pytest.approx(np.linalg.norm(newton.position - mujoco.position))
        assert shown["tension_error"] == pytest.approx(np.abs(newton.tensions - mujoco.tensions).max())
    if command.startswith("compensate"):  # what is held is what MuJoCo says, and not what statics says
        assert (shown["held"], shown["reached_from_commanded"]) == (False, False)
        assert (np.array(shown["rest_lengths"]) < shown["before"]["mujoco"]["rest_lengths"]).all()
        text, asked = run(*command.split(), columns=200).stdout, methods.told[-4:]
        assert "The equilibrium found by statics is not held in MuJoCo" in text
        in_columns = [asked[call] for call in (0, 2, 1, 3)]  # each method is asked before and after
        assert row(text, "tension 8 [N]")[-4:] == [f"{one.tensions[7]:.3f}" for one in in_columns]


def test_equilibria_shows_what_mujocos_platforms_do(monkeypatch):
    """Which of them stay, for 2 s where it is stable and 20 s else; and to which MuJoCo's comes as gravity grows."""
    found = cdpr.find_equilibria(cdpr.load_robot("two-cable"), (0.3, 0, 0.2), saddles=True, starts=20)
    assert len(found) == 2
    deviations, asked = itertools.cycle((10.0, 500.0, 1.0, 500.0)), []

    def release(one, seconds):
        asked.append((one.stable, seconds))
        return Release(next(deviations), 1.0, 1.0)

    monkeypatch.setattr(cdpr, "release", release)
    monkeypatch.setattr(cdpr, "grow_gravity", lambda problem: found[1])
    words = ["equilibria", "two-cable", "--pose", "0.3", "0", "0.2", "--saddles", "--starts", "20"]
    result = run(*words, columns=200)
    rows = [line.split() for line in result.stdout.splitlines() if line.split()[:1] and line.split()[0].isdigit()]
    assert [row[-1] for row in rows[-2:]] == ["neither", "leaves"]
    assert (result.exit_code, "MuJoCo reaches 2 instead" in result.stdout) == (1, True)
    monkeypatch.setattr(cdpr, "certify_all", lambda problem, time_limit: made_up.complete(made_up.UNDECIDED))
    told = json.loads(run(*words, "--certify", "--json").stdout)
    assert (told["proved_complete"], len(told["proved"]), len(told["undecided"])) == (False, 2, 1)
    assert [one["stays_in_mujoco"] for one in told["equilibria"]] == [True, False]
    assert (told["reached"], told["reached_in_mujoco"]) == (0, 1)
    assert set(asked) == {(True, 2.0), (False, 20.0)}


def shifted(equilibria: EquilibriumBatch, by: float) -> EquilibriumBatch:
    """Every platform moved by 1, 2, ... times ``by`` [m] along x, every tension by as many N."""
    rows = by * np.arange(1, np.prod(equilibria.shape) + 1).reshape(*equilibria.shape, 1)
    return dataclasses.replace(
        equilibria, positions=equilibria.positions + rows * [1.0, 0, 0], tensions=equilibria.tensions + rows
    )


def test_compare_asks_each_method_about_the_other(monkeypatch):
    """MuJoCo's recorder is asked about the static pose, and its number is what is said of it."""
    robot, asked = cdpr.load_robot("cogiro"), []
    static, settled = cdpr.solve(robot, (0.3, 0.25, 0.1)), cdpr.settle(robot, (0.3, 0.25, 0.1))
    monkeypatch.setattr(comparing, "residuals_of", lambda problems, poses, threads: asked.append(poses) or 123.0)
    agreement = cdpr.compare(static, settled)
    assert agreement.static_in_mujoco == 123.0
    assert len(asked) == 1
    np.testing.assert_array_equal(asked[0].translation[0], static.position)
    assert agreement.settled_in_statics < 1e-6
    assert any("MuJoCo at the static pose has a residual of 1.2e+02 N" in reason for reason in agreement.reasons)


def test_the_proof_of_a_layout_is_mujocos(monkeypatch):
    """Its score is that of where MuJoCo's platforms rest, and not of where the solver has them; else it is unknown."""
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

    def restless(problems):
        settled = settle(problems)
        status = np.where(np.arange(len(settled)) == 1, Status.ITERATION_LIMIT, settled.status)
        return dataclasses.replace(settled, status=status)

    monkeypatch.setattr(proving, "settle_many", restless)
    assert np.isnan(cdpr.validate_layout(found).after.score)


def test_a_video_is_of_mujocos_motion_with_the_solvers_outline(monkeypatch, tmp_path):
    """What is filmed is what ``drive`` returns; what is outlined, what ``solve_trajectory`` says of it."""
    motions, outlines, filmed = {}, [], {}
    cdpr_drive, cdpr_solve = cdpr.drive, cdpr.solve_trajectory

    def drive(robot, *args, **options):  # on threads, in any order
        motions[robot.name] = shifted(cdpr_drive(robot, *args, **options), 1e-3)
        return motions[robot.name]

    def solve(motion):
        outlines.append(shifted(cdpr_solve(motion), -1e-3))
        return outlines[-1]

    def film(path, trajectories, static, **options):
        filmed.update(trajectories=trajectories, static=static, path=path)
        return path

    monkeypatch.setattr(cdpr, "drive", drive)
    monkeypatch.setattr(robot_summary, "solve_trajectory", solve)
    monkeypatch.setattr(robot_summary, "write_video", film)
    words = "video cogiro parallel --path 0.4 0.401 --drive-seconds 0.1 --seconds 0.2 --fps 10 -o"
    told = run(*words.split(), tmp_path / "v.gif")
    assert told.exit_code == 0, told.output
    assert filmed["path"] == Path(tmp_path / "v.gif")
    both = zip(
        filmed["trajectories"], [motions["cogiro"], motions["parallel"]], outlines, filmed["static"], strict=True
    )
    for shown, motion, outline, static in both:
        assert shown is motion
        np.testing.assert_array_equal(static.translation, outline.positions)


def test_a_tracked_trajectory_is_what_mujoco_says(monkeypatch):
    """Poses, lengths and tensions; what the controller commands shows in the rest lengths alone."""
    lengths, tensions = 10.0 + np.arange(8), 20.0 + np.arange(8)
    read = Observation(np.array([[1.0, 2.0, 3.0]]), np.eye(3)[None], lengths[None], tensions[None])
    monkeypatch.setattr(Motion, "look", lambda self: read)
    robot = cdpr.load_robot("cogiro")
    tracked = cdpr.track(robot, [robot.home], RigidLengths(robot), seconds=0.03)
    assert tracked.source == "mujoco"
    for name, value in {"positions": read.positions, "lengths": lengths, "tensions": tensions}.items():
        assert (getattr(tracked, name) == value).all()
    np.testing.assert_allclose(tracked.rest_lengths, np.tile(robot.rest_lengths(robot.home), (4, 1)), rtol=1e-12)
