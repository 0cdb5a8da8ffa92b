"""The page to hand on: one file, whose numbers are MuJoCo's and the solver's, and which a browser shows as it is."""

import base64
import dataclasses
import itertools
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import made_up
import mediapy
import numpy as np
import pytest
from drawn_figures import swept
from made_up import HOSTILE
from page_reader import Page
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.report import html_page, robot_summary

DASH = 1e-3
"""[pixel] A canvas keeps offsets of dashes in single precision: 3e-5 measured; a pattern is 6 long."""

ALONG = 1e-5
"""Fraction by which MuJoCo stops elsewhere along the direction in which the corners are neutrally stable (stiffness
2e-10 of the largest): 2e-6 measured between corners that symmetry makes equal. The next poses are half as far away."""


@pytest.fixture(scope="module")
def found() -> robot_summary.RobotSummary:
    """Made up, with everything that a page can have."""
    worst = (made_up.view(1), made_up.view(2))
    return made_up.summary(worst=worst, plane=swept("cogiro"), motion=made_up.states(), missing=())


@pytest.fixture(scope="module")
def text(found) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html_page, "VIDEO_SIZE", (320, 240))
        return html_page.html_page(found)


@pytest.fixture
def without_pictures(monkeypatch) -> None:
    """Maps are drawn and not encoded, which takes most of a page's time."""
    monkeypatch.setattr("cdpr_sim.drawing.figures.encoded", lambda *_: b"")


def test_the_page_is_one_file_that_asks_for_nothing(text):
    """Everything is within; a browser is told to fetch nothing; and names are read, not obeyed."""
    read = Page(text)
    for _, values in read.tags:
        assert not any(name.startswith("on") for name in values)
        for name in ("src", "href"):
            assert values.get(name, "data:").startswith(("data:", "#")), values
    assert not re.search(r"url\(|@import|https?://", re.sub(r'"data:[^"]*"', "", text))
    policy = next(values["content"] for _, values in read.tags if values.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert HOSTILE in read.words
    assert not any(values.get("src") == "x" for _, values in read.tags)


def test_the_film_has_a_frame_of_every_state(text):
    """Twelve a second, of the size asked for."""
    film = base64.b64decode(re.search(r'data:video/mp4;base64,([^"]+)', text)[1])  # type: ignore[index]
    assert np.asarray(mediapy.decompress_video(film)).shape == (len(made_up.states()), 240, 320, 3)


def shown_page(summary) -> str:
    """The page's text without its style, its script and its maps; the data of its picture, a number a line."""
    text = html_page.html_page(summary)
    data = json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', text)[1])  # type: ignore[index]
    text = re.sub(r"<(style|script)[^>]*>.*?</\1>|Written by cdpr_sim [^<]*", "", text, flags=re.DOTALL)
    text = " ".join(re.sub(r'"data:image[^"]*"', '"data:image"', text).split())
    return re.sub(r"(?=<(?:tr|p|h\d|table|section|div|figure|option)\b)", "\n", text) + json.dumps(data, indent=0)


def test_the_page_is_as_reviewed(snapshot):
    """Made-up results: each method's number in its column, what disagrees or does not rest is said; what is drawn."""
    snapshot("page/methods-disagree.txt", shown_page(made_up.summary()), rel=1e-6)
    agree = dataclasses.replace(made_up.checked(), disagreements=())
    views = made_up.view(1), made_up.view(2)
    swapped = [dataclasses.replace(one, settled=one.solved, solved=one.settled) for one in views]
    shown = made_up.summary(
        check=agree, first=views[0], worst=tuple(swapped), modes=None, missing=(), plane=swept("cogiro")
    )
    snapshot("page/swapped-and-agreeing.txt", shown_page(shown), rel=1e-6)


def test_the_worst_poses_are_the_worst(monkeypatch):
    """No pose of the grid ends up farther away than the first, settled one by one."""
    monkeypatch.setattr(robot_summary, "POINTS", 3)
    robot, counts = cdpr.load_robot("parallel"), (3, 2, 2)
    first = robot_summary.summarise(robot, (0.285, 0.25, 0.1), grid=counts, motion=False).worst[0].settled
    axes = (np.linspace(*ends, count) for ends, count in zip(robot.workspace.T, counts, strict=True))
    settled = [first, *(cdpr.settle(robot, at) for at in itertools.product(*axes))]
    arm = robot.characteristic_length
    away = [np.hypot(np.linalg.norm(one.deviation), arm * one.rotation.magnitude()) for one in settled]
    assert away[0] == pytest.approx(max(away), rel=ALONG)


def test_what_is_worst_is_the_same_in_the_summary_and_on_the_maps(monkeypatch, without_pictures):
    """On crossed cables the worst pose lies beside the middle: the maps go through it, and say so."""
    monkeypatch.setattr(robot_summary, "POINTS", 13)
    robot, counts = cdpr.load_robot("cogiro"), (5, 3, 2)
    found = robot_summary.summarise(robot, grid=counts, motion=False)
    axes = (np.linspace(*ends, count) for ends, count in zip(robot.workspace.T, counts, strict=True))
    equilibria = cdpr.solve_many(robot, list(itertools.product(*axes)))
    distance, tilt = 1e3 * np.linalg.norm(equilibria.deviation, axis=-1).max(), np.degrees(equilibria.tilt.max())
    assert tilt > 10 * np.degrees(found.first.solved.tilt)
    words = Page(html_page.html_page(found)).words
    assert f"the deviation is up to {distance:.2f} mm and the tilt up to {tilt:.2f}°" in words
    y = found.worst[0].problem.pose.translation[1]
    assert found.plane["y"].item() == y != robot.home[1]
    assert float(np.degrees(found.plane["tilt"].max())) > 0.9 * tilt
    assert f"Tilt of the platform at y = {1e3 * y:g} mm, from " in words


def test_what_cannot_be_shown_is_said():
    """A workspace without height has no map, and a sentence says why."""
    robot = cdpr.load_robot("parallel")
    flat = robot.workspace.copy()
    flat[:, 2] = 0.2
    shown = robot_summary.summarise(robot.replace(workspace=flat), grid=(2, 1, 1), motion=False)
    assert shown.plane is None
    assert shown.missing[0].startswith("No maps: plane: found a workspace of")


def test_the_command_writes_the_page_whole_and_over_nothing(tmp_path, monkeypatch, without_pictures):
    """One that is there stays, unless forced."""
    monkeypatch.setattr(robot_summary, "POINTS", 5)
    path, contents = tmp_path / "robot.html", []
    words = ["report", "two-cable", "-o", str(path), "--no-video", "--grid", "2", "1", "1"]
    for more, status in (
        ([], 0),
        (["--material", "fishing-0.4mm"], 2),
        (["--material", "fishing-0.4mm", "--force"], 0),
    ):
        result = CliRunner().invoke(app, [*words, *more])
        assert (result.exit_code, "--force" in result.stderr) == (status, status == 2)
        contents.append(path.read_bytes())
    assert b"two-cable" in contents[0]
    assert contents[1] == contents[0]
    assert b"fishing-0.4mm" in contents[2]
    assert [one.name for one in tmp_path.iterdir()] == ["robot.html"]


# In a browser -------------------------------------------------------------------------------------------------------

PHONE = 360
"""[pixel] Width of a small one."""

A4 = 718
"""[pixel] Between the margins of a sheet: 210 mm less 10 mm on either side, at 96 pixels an inch."""

LEAST_LETTERS = 12.0
"""[pixel] Smaller type is hard to read."""

LEAST_CONTRAST = 4.5
"""Of text to what is behind it: WCAG 2.2, success criterion 1.4.3."""

LEAST_TARGET = 24
"""[pixel] What a finger has to hit: WCAG 2.2, success criterion 2.5.8; of a check box, its label."""

SCRIPTS = Path(__file__).with_name("browser")
CONTRASTS = (SCRIPTS / "contrasts.js").read_text(encoding="utf-8")
DASHES = (SCRIPTS / "dashes.js").read_text(encoding="utf-8")

COLORS = """
const canvas = document.getElementById("robot"), pen = canvas.getContext("2d");
return new Set(new Uint32Array(pen.getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size;
"""

SMALL = f"""
return [...document.querySelectorAll("button, select, input:not([type=checkbox]), .controls label")]
  .filter((one) => Math.min(one.offsetWidth, one.offsetHeight) < {LEAST_TARGET}).map((one) => one.outerHTML);
"""

CUT = f"""
return [...document.querySelectorAll("table, img, canvas")]
  .filter((one) => one.checkVisibility() && one.getBoundingClientRect().right > {A4}).map((one) => one.tagName);
"""


class Browser:
    """Chromium without a window, by the driver that is installed beside it; nothing is downloaded."""

    def __init__(self) -> None:
        webdriver = pytest.importorskip("selenium.webdriver", reason="found no selenium: pip install selenium")
        programs = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
        if None in programs:
            pytest.skip("found no chromium and chromedriver: on Debian, apt install chromium chromium-driver")
        options = webdriver.ChromeOptions()
        options.binary_location = programs[0]
        for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(programs[1]))

    def __call__(self, script: str):
        """What the script returns."""
        return self.driver.execute_script(script)

    def window(self, width: int, **media) -> None:
        size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        scheme = media.pop("scheme", "light")
        media |= {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""} | media)

    def drawing(self) -> str:
        """What is on the canvas."""
        return self("return document.getElementById('robot').toDataURL()")

    def changes(self, act: Callable[[], object]) -> bool:
        """Whether the drawing does."""
        before = self.drawing()
        act()
        return self.drawing() != before

    def press(self, *keys: str) -> None:
        """Keys, for whatever has the keyboard."""
        self.driver.switch_to.active_element.send_keys(*keys)

    def tab_to(self, name: str) -> None:
        """By the tabulator alone, from the top of the page."""
        self("document.activeElement.blur(); window.scrollTo(0, 0)")
        for _ in range(40):
            self.press("\ue004")
            if self.driver.switch_to.active_element.get_attribute("id") == name:
                return
        raise AssertionError(f"{name} is not reached by the tabulator")

    def requests(self) -> list[str]:
        """Since they were asked for before, but those of files."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        sent = [one["params"]["request"]["url"] for one in events if one["method"] == "Network.requestWillBeSent"]
        return [url for url in sent if not url.startswith(("file:", "data:"))]

    def open(self, path, text: str) -> None:
        path.write_text(text, encoding="utf-8")
        self.driver.get(path.as_uri())


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    one = Browser()
    yield one
    one.driver.quit()


@pytest.fixture
def opened(browser, text, tmp_path) -> Browser:
    """The page in a wide window, its log empty but for what the page has done."""
    browser.window(1280)
    for kind in ("browser", "performance"):
        browser.driver.get_log(kind)
    browser.open(tmp_path / "robot.html", text)
    return browser


def wait_for(true: Callable[[], bool]) -> None:
    """Until something is, for a minute: machines can be busy."""
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_it_loads_without_an_error_and_asks_the_network_for_nothing(opened, text, tmp_path):
    """Nothing on the console, no request; and both would be seen: a page that breaks, or asks, is told from it."""
    film = "const film = document.querySelector('video'); return [film.error, film.readyState > 1, film.videoWidth]"
    wait_for(lambda: opened(film)[1])
    assert opened(film) == [None, True, 320]
    assert opened.driver.get_log("browser") == []
    assert opened.requests() == []
    breaks = text.replace("const views", "").replace('getElementById("scene")', 'getElementById("lost")')
    asks = text.replace("</main>", '<img alt="" src="https://example.invalid/x.png"></main>')
    for broken in (breaks, asks):
        opened.open(tmp_path / "broken.html", broken)
        wait_for(lambda: opened.driver.get_log("browser") != [])
    opened.requests()
    asked: list[str] = []
    opened.open(tmp_path / "broken.html", asks.replace(html_page.POLICY, ""))
    wait_for(lambda: asked.extend(opened.requests()) or asked != [])  # they are told some time after the page is there
    assert asked == ["https://example.invalid/x.png"]


def test_the_robot_is_drawn_and_turns_by_keyboard_and_mouse(opened):
    """In many colours; keys, sliders, boxes and the mouse change it, and Home brings it back as it was."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    assert opened(COLORS) > 20
    begun = opened.drawing()
    opened.tab_to("robot")
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+"):
        assert opened.changes(lambda key=key: opened.press(key)), key
    opened.press(Keys.HOME)
    assert opened.drawing() == begun
    for control in ("turn", "height", "zoom"):
        opened.tab_to(control)
        assert opened.changes(lambda: opened.press(Keys.ARROW_RIGHT)), control
    opened.tab_to("reset")
    opened.press(Keys.ENTER)
    assert opened.drawing() == begun
    for control in ("tensions", "commanded"):
        opened.tab_to(control)
        assert opened.changes(lambda: opened.press(Keys.SPACE)), control
    canvas = opened.driver.find_element(By.ID, "robot")
    for shift in ((60, 0), (0, 30)):
        drag = ActionChains(opened.driver).move_to_element(canvas).click_and_hold().move_by_offset(*shift).release()
        assert opened.changes(drag.perform), shift


def test_dots_of_slack_cables_go_on_from_piece_to_piece(opened):
    """A cable is drawn in pieces, nearest last: each begins its pattern where the piece before it ended."""
    pieces = opened(DASHES)
    after = {tuple(np.round(end, 6)): (offset, start, end) for offset, start, end in pieces}
    gone = [
        offset - before - np.hypot(*np.subtract(end, start))
        for offset, begin, _ in pieces
        if (found := after.get(tuple(np.round(begin, 6)))) is not None
        for before, start, end in [found]
    ]
    assert len(gone) > 20
    assert np.abs(gone).max() < DASH


def test_a_pose_is_chosen_by_keyboard(opened, found):
    """The picture, its words and both methods' answers follow; a worst pose's button leads back up to it."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    def answers() -> list[str]:
        every = opened.driver.find_elements(By.CSS_SELECTOR, "[data-view]")
        return [one.text for one in every if one.is_displayed()]

    (first,) = answers()
    opened.tab_to("pose")
    assert opened.changes(lambda: opened.press(Keys.ARROW_DOWN))
    (second,) = answers()
    rest = found.worst[0].settled
    assert f"{1e3 * rest.position[0]:.3f}" in second
    assert second != first
    label = opened.driver.find_element(By.ID, "robot").get_attribute("aria-label")
    assert label == opened.driver.find_element(By.ID, "description").text
    assert f"tilt {np.degrees(rest.tilt):.2f}".rstrip("0") in label
    opened.driver.find_element(By.CSS_SELECTOR, "[data-show='2']").send_keys(Keys.ENTER)
    assert opened("return document.getElementById('pose').selectedIndex") == 2
    assert opened.driver.switch_to.active_element.get_attribute("id") == "robot"


@pytest.mark.parametrize(("width", "scheme"), [*itertools.product([PHONE, 1280], ["light", "dark"])])
def test_it_is_legible(opened, width, scheme):
    """On a phone as on a desk, on light and on dark paper: nothing to scroll sideways, type large and dark enough."""
    opened.window(width, scheme=scheme)
    size = "return [innerWidth, document.documentElement.scrollWidth <= innerWidth]"

    def legible() -> bool:
        seen = opened(CONTRASTS)
        assert len(seen) > 100
        large = all(one[2] >= LEAST_CONTRAST and one[3] >= LEAST_LETTERS for one in seen)
        return large and opened(size) == [width, True]

    assert legible()
    assert opened(SMALL) == []
    for broken in ("font-size: 9px", "color: #888 !important; background: #777", "min-width: 2000px"):
        opened(f"document.querySelector('.lead').style.cssText = '{broken}'")
        assert not legible(), broken


def test_on_paper_nothing_is_cut_off(opened):
    """What scrolls on a screen is whole on a sheet of A4, on white paper even where the screen is dark."""
    opened.window(A4, scheme="dark", media="print")
    assert opened(CUT) == []
    assert opened("return getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert not opened("return document.querySelector('.controls, video').checkVisibility()")


def test_what_is_not_seen_is_said(opened):
    """Pictures have words instead, controls their labels, sections their headings."""
    for claim in (
        "[...document.images].every((one) => one.alt.length > 10) && document.images.length",
        "[...document.querySelectorAll('input, select')].every((one) => one.labels.length)",
        "[...document.querySelectorAll('[tabindex], video')].every((one) => one.ariaLabel)",
        "document.documentElement.lang === 'en'",
    ):
        assert opened(f"return {claim}"), claim


def test_a_film_in_a_notebook_is_no_wider_than_its_page(browser, monkeypatch, tmp_path):
    """It shrinks with the page, in its own proportions; where there is room it has its own size."""
    displayed = []
    monkeypatch.setattr("IPython.display.display", lambda thing: displayed.append(thing.data))
    cdpr.show(made_up.states(), seconds=0.2, fps=10, size=(960, 540), renderer="raycast")
    for width, expected in ((640, [640, 360]), (1280, [960, 540])):
        browser.window(width)
        browser.open(tmp_path / "notebook.html", f'<body style="margin: 0">{displayed[0]}</body>')
        film = (
            "const { offsetWidth, offsetHeight } = document.querySelector('video'); return [offsetWidth, offsetHeight]"
        )
        assert browser(film) == expected


@pytest.mark.parametrize(("ink", "paper"), [("#dddddd", "#111111"), ("#222222", "#ffffff")])
def test_introductions_in_notebooks_are_legible(browser, found, ink, paper, tmp_path):
    """On a dark notebook's paper as on a light one's."""
    shown = found.first.settled._repr_html_() + found.check._repr_html_() + found.first.agreement._repr_html_()
    body = f'<body style="color: {ink}; background: {paper}">{shown}'
    browser.open(tmp_path / "notebook.html", f'<!DOCTYPE html><meta charset="utf-8">{body}')
    seen = browser(CONTRASTS)
    assert len(seen) > 30
    assert [one for one in seen if one[2] < LEAST_CONTRAST] == []
