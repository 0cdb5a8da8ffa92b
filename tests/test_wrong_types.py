"""Values of a wrong type: one sentence of the package's own, whichever public function they are given to.

The other tests check shapes and types at run time, and would answer in the package's place: so this file is run as a
script, in a process of its own, where functions are as users have them.
"""

import inspect
import json
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import mujoco
import numpy as np

import cdpr_sim as cdpr

MOST_SECONDS = 300
"""Of the script; it takes 10 s of a processor where functions are compiled."""

ELSEWHERE = {"positions": "pose", "waypoints": "pose", "answer": "rest_lengths"}
"""What messages call one of several, or what a value stands for."""

NOTHING_TO_GIVE = {"list_robots"}

BUILT = (
    "Robot", "Move", "Sensors", "ElasticLengths", "HeldTensions", "LengthsAndTensions", "RigidLengths", "PoseFeedback",
)  # fmt: skip
"""Classes that users make objects of."""

MADE = ("Command.of", "Measurements.of", "Memory.fresh", "Problem.of", "Problems.of", "Problems.stack")
"""And those that are made by a method."""

ASKED = (
    "Check.across", "Clearances.free", "Reference.acceleration", "Reference.fractions", "Reference.pose",
    "Reference.poses",
    "Equilibria.nearest", "Front.thinned", "Identification.__getitem__", "Identification.intervals",
    "Identification.predict", "Measurements.check_robot", "Measurements.rows", "Measurements.with_errors",
    "Problem.same_as",
    "Robot.placed", "Robot.pose", "Robot.replace", "Robot.rest_lengths", "Rope.of", "Sensitivity.tilt",
)  # fmt: skip
"""Methods of results. Not among them: indices, which raise Python's and NumPy's own errors, as loops need; and methods
of controllers, which ``track`` calls."""


def public_functions() -> set[str]:
    """Names of the functions of the package, and the classes and methods of the lists above."""
    functions = {name for name in dir(cdpr) if inspect.isfunction(inspect.unwrap(getattr(cdpr, name)))}
    return functions - NOTHING_TO_GIVE | {*BUILT, *MADE, *ASKED}


def test_a_wrong_type_is_refused_in_one_sentence_that_names_it():
    """Each parameter of each public function is given each wrong value, and all others right ones."""
    script = subprocess.run(
        [sys.executable, __file__], capture_output=True, text=True, timeout=MOST_SECONDS, check=False
    )
    assert script.returncode == 0, script.stderr
    faults = json.loads(script.stdout.splitlines()[-1])
    assert set(faults) == public_functions()
    assert {name: wrong for name, wrong in faults.items() if wrong} == {}


def test_wrong_answers_would_be_noticed():
    """Negative control: a function that takes anything, one that fails with Python's words, one that names nothing."""

    def takes(mass: float) -> None:
        """Anything."""

    def fails(mass: float) -> float:
        return mass + 1

    def names_nothing(mass: float) -> None:
        raise cdpr.InvalidInput("wrong")

    for function, word in ((takes, "taken"), (fails, "TypeError"), (names_nothing, "not named")):
        faults = list(faults_of(function, {"mass": 1.0}))
        assert any(word in fault for fault in faults), faults


def faults_of(call: Callable, right: Mapping[str, object]) -> Iterator[str]:
    """Each answer to a wrong value of a single parameter that is not a sentence of the package's own."""
    for name, parameter in inspect.signature(call).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            continue
        names = name.rstrip("s"), ELSEWHERE.get(name, name), "unknown"
        for what, value in wrong_values(name, str(parameter.annotation), parameter.default):
            try:
                call(**{**right, name: value})
            except cdpr.CdprError as error:
                sentence = str(error)
                if "\n" in sentence or len(sentence) > 1000:
                    yield f"{name}: {what}: not a sentence: {sentence}"
                elif not any(one in sentence for one in names):
                    yield f"{name}: {what}: not named: {sentence}"
            except Exception as error:
                yield f"{name}: {what}: {type(error).__name__}: {error}"
            else:
                yield f"{name}: {what}: taken"


MEANS_NOTHING = {"poses", "positions", "tensions", "swivels", "frequencies", "rotations"}
"""Of which a row that is not a number has no answer, or was not measured: these are taken."""


ANY = {"least", "stiffness", "time", "times"}
"""Of which any number is taken, or any row of numbers."""


ANY_TEXT = {"path", "store", "robot_file", "name", "material", "description", "source", "notes", "robot", "cables"}
"""Names of files and of what users make themselves."""


def wrong_values(name: str, annotation: str, default: object) -> Iterator[tuple[str, object]]:
    """Values that no parameter takes, and some that this one does not take, by its annotation."""
    yield "an object", object()
    yield "a complex number", 1j
    yield "a complex number without imaginary part", np.complex128(1)
    yield "complex numbers", np.array([1 + 1j, 2, 3])
    yield "a list of complex numbers", [1j, 2, 3]
    yield "bytes", b"bytes"
    yield "rows of unequal length", [[1], [1, 2]]
    if "Callable" not in annotation and "objective" not in annotation:
        yield "a class", cdpr.Robot
        yield "a function", wrong_values
    if "str" not in annotation and "Any" not in annotation:
        yield "text", "text"
        yield "a number as text", "3"
    if ("str" in annotation or "Literal" in annotation) and name not in ANY_TEXT:
        yield "an unknown name", "no such thing"
    if "None" not in annotation and default is not None:
        yield "None", None
    if "bool" not in annotation:
        yield "True", True
    if "float" in annotation or "Array" in annotation:
        yield "an array of three dimensions", np.ones((2, 5, 7))
        yield "infinity", -np.inf
        yield "not a number", np.nan
        if name not in MEANS_NOTHING:
            yield "rows that are not numbers", np.full((3, 3), np.nan)
        if name not in ANY:
            yield "eleven numbers", np.linspace(0.1, 0.9, 11)
            yield "rows of eleven numbers", np.ones((5, 11))
    if "float" in annotation or "int" in annotation:
        yield "a number of 400 digits", 10**400
        if name not in ANY:
            yield "minus a million", -1e6


def right_values(folder: Path) -> dict[str, tuple[Callable, Mapping[str, object]]]:
    """Each function with arguments that it takes; what is not given has a default."""
    from cdpr_sim.core.pose_path import PosePath as Along

    robot, pose = cdpr.load_robot("cogiro"), (0.4, 0.25, 0.2)
    poses = np.add(pose, np.linspace(0, 0.02, 3)[:, None] * [1, 0, 0])
    found, equilibria, problem = cdpr.solve(robot, pose), cdpr.solve_many(robot, poses), cdpr.Problem.of(robot, pose)
    trajectory = cdpr.Trajectory.through(equilibria, np.linspace(0, 0.2, 3))
    measurements = cdpr.Measurements.of(poses, equilibria.positions, coordinates="xyz")
    reference = cdpr.Reference(Along(robot, [robot.pose(pose) for pose in poses]), 1.0)
    asked, searched = dict(robot=robot, pose=pose), dict(within=0.01, generations=1, population=5)
    of_many, film = dict(robot=robot, positions=poses), dict(seconds=0.2, fps=10, size=(320, 240))
    moved, limits = dict(robot=robot, waypoints=poses, seconds=0.05), dict(tension_limits=(0, 10))
    identified = cdpr.identify(robot, measurements)
    bar, model = cdpr.load_robot("two-cable"), mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, pose))
    along = ("clearances", "settle_many", "settle_path", "solve_many", "solve_path", "Problems.of")
    at = ("compensate", "draw", "follow_load", "settle", "settle_trajectory", "solve", "to_mjcf", "Problem.of")
    of_robot = ("ElasticLengths", "LengthsAndTensions", "RigidLengths", "Memory.fresh", "scene_mjcf")
    of_found = ("certify", "natural_modes", "neutral_directions", "sensitivity")
    given: dict[str, Mapping[str, object]] = {
        **dict.fromkeys(at, asked),
        **{key: dict(robot=robot, poses=poses) for key in along},
        **{key: dict(robot=robot) for key in of_robot},
        **{key: dict(equilibrium=found) for key in of_found},
        **dict.fromkeys(("feasible", "shortfall"), of_many),
        **{key: {} for key in ("validate_layout", "Sensors")},
        "cable_profiles": dict(equilibria=equilibria),
        "check": dict(robots="two-cable", grid=(1, 1, 1)),
        "certify_all": dict(robot=bar, rest_lengths=bar.rest_lengths(bar.home), time_limit=1e-3),
        "closed_form_feasible": of_many | limits,
        "compare": dict(static=found, settled=cdpr.settle(robot, pose)),
        "verify_compensation": dict(compensation=cdpr.compensate(robot, pose)),
        "drive": moved | dict(states=3),
        "find_equilibria": asked | dict(starts=1),
        "find_front": dict(robot=robot, poses=poses) | searched,
        "find_layout": dict(robot=robot, poses=poses, polish=False) | searched,
        "grow_gravity": asked | dict(seconds=0.1),
        "identify": dict(robot=robot, measurements=measurements),
        "import_robot": dict(path="nowhere.xml"),
        "load_robot": dict(name="cogiro"),
        "open_sweep": dict(store="nowhere.nc"),
        "read_measurements": dict(path="nowhere.csv"),
        "release": dict(equilibrium=found, seconds=0.01),
        **{key: dict(model=model) for key in ("diagnose_model", "settle_model")},
        "holding_controls": dict(model=model, qpos=model.qpos0),
        "tendon_tensions": dict(model=model, data=mujoco.MjData(model)),
        "reset": dict(model=model, data=mujoco.MjData(model), pose=pose),
        "show": dict(trajectories=trajectory) | film,
        "solve_trajectory": dict(trajectory=trajectory),
        "sweep": dict(robots=robot, grid=(1, 1, 1), chunk=None),
        "track": moved | dict(controller=cdpr.RigidLengths(robot), rate=40),
        "winch_controls": asked | dict(rest_lengths=found.rest_lengths),
        "workspace_hull": dict(robot=robot, depth=0, tolerance=0.1),
        "write_robot": dict(path=folder / "robot.toml", robot=robot),
        "write_report": dict(path=folder / "page.html", robot=robot, grid=(1, 1, 1), video=False),
        "write_video": dict(path=folder / "film.mp4", trajectories=trajectory) | film,
        "Command.of": dict(answer=found.rest_lengths, cables=8),
        "HeldTensions": dict(robot=robot) | limits,
        "Measurements.of": dict(commanded=poses, measured=poses, coordinates="xyz"),
        "Move": dict(what="exits", within=0.1),
        "PoseFeedback": dict(inner=cdpr.RigidLengths(robot)),
        "Problems.stack": dict(problems=[problem]),
        "Robot": dict(exits=robot.exits, anchors=robot.anchors, axial_stiffness=1e4, mass=1.0),
    }
    methods: dict[str, tuple[object, Mapping[str, object]]] = {
        **dict.fromkeys(("Robot.placed", "Robot.pose", "Robot.rest_lengths"), (robot, dict(pose=pose))),
        **dict.fromkeys(("Reference.fractions", "Reference.poses"), (reference, dict(times=0.5))),
        **dict.fromkeys(("Reference.acceleration", "Reference.pose"), (reference, dict(time=0.5))),
        "Check.across": (cdpr.check("two-cable", (1, 1, 1)), {}),
        "Clearances.free": (cdpr.clearances(equilibria), {}),
        "Equilibria.nearest": (cdpr.find_equilibria(robot, pose, starts=1), dict(pose=pose)),
        "Front.thinned": (cdpr.find_front(robot, poses, within=0.01, generations=1, population=5), dict(most=2)),
        "Identification.__getitem__": (identified, dict(name="axial_stiffness")),
        "Identification.intervals": (identified, dict(coverage=0.9)),
        "Identification.predict": (identified, dict(measurements=measurements)),
        "Measurements.check_robot": (measurements, dict(robot=robot)),
        "Measurements.rows": (measurements, dict(chosen=[0])),
        "Measurements.with_errors": (measurements, dict(errors={"position": 1e-3})),
        "Problem.same_as": (problem, dict(other=problem)),
        "Robot.replace": (robot, {}),
        "Rope.of": (cdpr.ROPES["dyneema"], dict(diameter=0.002)),
        "Sensitivity.tilt": (cdpr.sensitivity(found), dict(parameter="mass")),
    }
    calls = {name: (getattr(cdpr, name), right) for name, right in given.items() if "." not in name}
    for name in MADE:
        kind, _, method = name.partition(".")
        calls[name] = getattr(getattr(cdpr, kind), method), given[name]
    return calls | {name: (getattr(of, name.partition(".")[2]), right) for name, (of, right) in methods.items()}


if __name__ == "__main__":
    warnings.simplefilter("error")  # NumPy's, of complex numbers that are stripped
    with tempfile.TemporaryDirectory() as place:
        print(  # noqa: T201
            json.dumps({name: list(faults_of(*one)) for name, one in right_values(Path(place)).items()})
        )
