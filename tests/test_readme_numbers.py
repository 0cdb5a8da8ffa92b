"""Every number in README is computed here, or printed by a block that test_manual.py runs."""

import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import cdpr_sim as cdpr
import measured_robot
from lines import PAPER_LINE
from measured_robot import FITTED, PREDICTED

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")

WORDS = {1: "one", 2: "two", 4: "four", 8: "eight"}

NAMES = "ICRA 2024", "Debian 12", "exit status is 0"
"""Names with a number: nothing to compute."""


def prose(text: str) -> str:
    """Without code, addresses and names of files, on one line."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return re.sub(r"\s+", " ", re.sub(r"`[^`]*`", "", text))


def end(name: str) -> cdpr.Equilibrium:
    """Of the paper's lower line, where README's example stands."""
    return cdpr.settle(cdpr.load_robot(name), (PAPER_LINE[0], 0.25, 0.1))


def taut_across(name: str) -> list[int]:
    """Numbers of taut cables from the left to the middle, each once."""
    robot = cdpr.load_robot(name)
    (left, _, _), _ = robot.workspace
    commanded = [(x, robot.home[1], 0.1) for x in np.linspace(left, robot.home[0], 61)]
    return list(dict.fromkeys((~cdpr.solve_many(robot, commanded).slack).sum(1).tolist()))


def the_two_layouts() -> list[str]:
    """Of the video's first frame, and of the table of robots."""
    level, tilted = end("cogiro"), end("parallel")
    assert np.degrees(level.tilt) < 0.01
    tilt, slack = f"{np.degrees(tilted.tilt):.0f}°", int(tilted.slack.sum())
    away = f"{1e3 * np.linalg.norm(tilted.deviation):.0f}"
    return [
        f"cogiro stays level; parallel tilts by {tilt}, deviates by {away} mm and hangs on "
        f"{WORDS[8 - slack]} of its {WORDS[len(tilted.slack)]} cables",
        f"DemoBot, {len(level.slack)} crossed cables: stays level",
        f"DemoBot, {len(tilted.slack)} cables in vertical parallelograms: tilts by {tilt} at the ends of the paper's "
        "line",
    ]


def the_planar_robots() -> list[str]:
    """Taut cables from the sides to the middle; no tilt anywhere."""
    at_the_sides, between, in_the_middle = taut_across("planar-vertical")
    level = cdpr.load_robot("planar-horizontal")
    (left, _, _), (right, _, _) = level.workspace
    commanded = [(x, level.home[1], 0.1) for x in np.linspace(left, right, 31)]
    assert np.abs(cdpr.solve_many(level, commanded).tilt).max() < 1e-9
    bar = cdpr.load_robot("two-cable")
    return [
        f"4 cables in vertical parallelograms: {in_the_middle} are taut in the middle, then {between}, and "
        f"{at_the_sides} at the sides",
        f"{level.cables} cables in horizontal parallelograms: never tilts",
        f"an under-actuated bar on {bar.cables} cables",
    ]


def the_measured_robot() -> list[str]:
    """Predictions of tensions at poses that no fit saw, and how far EA depends on what else is fitted."""
    fits = {
        one.name: one for one in measured_robot.fits(["rigid", "rigid, calibrated", "elastic", "elastic, calibrated"])
    }
    off = {name: f"{one.rms('tension', predicted=True):.0f} N" for name, one in fits.items()}
    stiffness = [
        one.found["axial_stiffness"][0] for name, one in fits.items() if name.startswith("elastic") and one.found
    ]
    rows = [len(cdpr.read_measurements(path).commanded) for path in (FITTED, PREDICTED)]
    return [
        f"{rows[0]} poses fitted, {rows[1]} predicted",
        f"elastic cables with {WORDS[fits['elastic'].unknowns]} fitted number predict tensions to {off['elastic']}, "
        f"calibrated to {off['elastic, calibrated']}; rigid cables to {off['rigid']}, calibrated to "
        f"{off['rigid, calibrated']}. EA itself remains uncertain by a factor of "
        f"{WORDS[round(max(stiffness) / min(stiffness))]}",
    ]


def the_widest_robot() -> list[str]:
    width = max(np.ptp(cdpr.load_robot(name).frame, axis=0).max() for name in cdpr.list_robots())
    return [f"a telescope in a frame {width:.0f} m wide"]


def the_oldest_python() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [f"Python {project['requires-python'].removeprefix('>=')} or later"]


CLAIMS: list[Callable[[], list[str]]] = [
    the_two_layouts, the_planar_robots, the_measured_robot, the_widest_robot, the_oldest_python
]  # fmt: skip
"""Each returns phrases of README, with numbers that it computed."""


def uncomputed(text: str, phrases: Sequence[str]) -> list[str]:
    """Numbers of a text that none of the phrases has, each with the words beside it."""
    for phrase in (*phrases, *NAMES):
        text = text.replace(phrase, "")
    return re.findall(r"[^ ]* ?[^ ]*\d[^ ]* ?[^ ]*", text)


@pytest.mark.timeout(300)  # the fits compile the solver for pulleys, once on a machine
def test_every_number_in_readme_is_computed():
    """Digit by digit, in the sentence in which it stands: neither times nor counts of iterations are left.

    Negative controls: one digit more, and a time.
    """
    text, phrases = prose(README), [phrase for claim in CLAIMS for phrase in claim()]
    assert [phrase for phrase in phrases if phrase not in text] == []
    assert uncomputed(text, phrases) == []
    assert uncomputed(text.replace("tilts by 26°", "tilts by 27°", 1), phrases) != []
    assert uncomputed(text + " It takes 2 µs.", phrases) == ["takes 2 µs."]
