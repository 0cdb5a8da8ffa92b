"""Optional extras: what a solve and a settle do without, and the sentence of what needs one."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.extras import LIBRARIES
from cdpr_sim.core.problem import Problem
from cdpr_sim.physics.viewer import open_viewer

CORE = """
import sys
for name in {names!r}:
    sys.modules[name] = None
import cdpr_sim as cdpr
from cdpr_sim.__main__ import main
robot, pose = cdpr.load_robot("parallel"), (0.3, 0.25, 0.1)
found = [cdpr.solve(robot, pose, method=method) for method in ("newton", "fsolve", "least_squares")]
assert cdpr.compare(found[0], cdpr.settle(robot, pose)).agrees
cdpr.solve_many(robot, [pose] * 80)
assert "numba" not in sys.modules
robot._repr_html_()
assert "numba" in sys.modules  # of the ray caster
sys.argv = ["cdpr-sim", "settle", "parallel"]
main()
"""
"""Python without the libraries ``names``."""


def imported(module: str) -> None:
    """Import a module anew, and leave the one that there was."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(sys.modules, module, raising=False)
        importlib.import_module(module)


CALLS = {
    "sweep": [lambda robot, path: cdpr.sweep(robot, (2, 2, 2)), lambda robot, path: cdpr.check(robot, (2, 2, 2)),
              lambda robot, path: cdpr.open_sweep(path / "s.zarr")],
    "report": [lambda robot, path: cdpr.write_report(path / "r.html", robot, video=False)],
    "view": [lambda robot, path: open_viewer(Problem.of(robot, robot.home))],
    "video": [lambda robot, path: cdpr.write_video(
        path / "v.mp4", cdpr.drive(robot, [(0.3, 0.25, 0.1)] * 2, seconds=0.1)
    )],
    "design": [lambda robot, path: cdpr.find_front(robot, [(0.3, 0.25, 0.1)], within=0.1)],
    "proof": [lambda robot, path: cdpr.certify(cdpr.solve(robot, (0.3, 0.25, 0.1)))],
    "gym": [lambda robot, path: imported("cdpr_sim.learning")],
    "jax": [lambda robot, path: imported("cdpr_sim.jax")],
}  # fmt: skip
"""What needs each extra."""


def test_solve_and_settle_need_no_extra_and_first_answers_no_numba():
    """In Python, in a notebook and on the command line; the first poses are there before Numba would be imported.

    A robot's picture is ray-cast by compiled code, and waits for it.
    """
    names = [name for several in LIBRARIES.values() for name in several] + ["IPython", "pandas"]
    done = subprocess.run([sys.executable, "-c", CORE.format(names=names)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "agree" in done.stdout


@pytest.mark.parametrize("extra", LIBRARIES)
def test_what_needs_an_extra_says_which_and_writes_nothing(extra, tmp_path, monkeypatch):
    """Whichever of its libraries is missing."""
    robot = cdpr.load_robot("parallel")
    for name in LIBRARIES[extra]:
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, name, None)
            for call in CALLS[extra]:
                with pytest.raises(
                    cdpr.MissingExtra,
                    match=re.escape(f'{name}, expected it installed: pip install "cdpr-sim[{extra}]"'),
                ):
                    call(robot, tmp_path)
    assert not list(tmp_path.iterdir())


def test_each_library_is_in_its_extra():
    """As pyproject.toml has it; a video is drawn without OpenGL where there is none."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())["project"]

    def libraries(extra: str) -> set[str]:
        found = set()
        for one in project["optional-dependencies"][extra]:
            name, within = re.fullmatch(r"([\w-]+)(?:\[(\w+)\])?(?:[<>].*)?", one).groups()
            if name == "cdpr-sim":
                found |= libraries(within)
            elif within == "rendering":
                found |= {"glfw", "OpenGL"}  # as MuJoCo's distribution has it
            else:
                found.add(name.replace("-", "_").removeprefix("python_"))
        return found

    for extra, names in LIBRARIES.items():
        assert set(names) == libraries(extra) - ({"glfw", "OpenGL"} if extra == "video" else set())
