"""The page to hand on: one file, whose numbers are MuJoCo's and the solver's, and which a browser shows as it is."""

import dataclasses
import itertools
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator

import made_up
import numpy as np
import pytest
from page_reader import Page
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.report import html_page
from cdpr_sim.studies import robot_summary

POSE = (0.285, 0.25, 0.1)
"""Where four cables of eight are slack, and the platform tilts by 5.3°."""

GRID = (3, 2, 2)

DASH = 1e-3
"""[pixel] A canvas keeps offsets of dashes in single precision: 3e-5 measured; a pattern is 6 long."""

HOSTILE = "<img src=x onerror=alert(1)> & [bold]'"
"""A name to be read as it is."""

PARABOLA = 0.05
"""How well a slack cable is drawn as long as it is: 2.5 % measured, of a steep one."""

ALONG = 1e-5
"""Fraction by which MuJoCo stops elsewhere along the direction in which the corners are neutrally stable (stiffness
2e-10 of the largest): 2e-6 measured between corners that symmetry makes equal. The next poses are half as far away."""

BALANCED = 2e-3
"""[N] What four decimals of a newton and three of a millimetre leave unbalanced of 3.9 N: 3e-4 measured."""


@pytest.fixture(scope="module")
def robot() -> cdpr.Robot:
    return cdpr.load_robot("parallel").replace(name=HOSTILE)


@pytest.fixture(scope="module")
def found(robot) -> robot_summary.RobotSummary:
    """With a drive of a few states, so that its film is short."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robot_summary, "MOTION", 6)
        patch.setattr(robot_summary, "POINTS", 15)
        return robot_summary.summarise(robot, POSE, grid=GRID)


@pytest.fixture
def without_pictures(monkeypatch) -> None:
    """Maps are drawn and not encoded, which takes most of a page's time."""
    monkeypatch.setattr("cdpr_sim.drawing.axes.encoded", lambda *_: b"")


@pytest.fixture(scope="module")
def text(found) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html_page, "VIDEO_SIZE", (320, 240))
        return html_page.html_page(found)


@pytest.fixture(scope="module")
def read(text) -> Page:
    return Page(text)


def scene(text: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', text)[1])  # type: ignore[index]


def test_the_page_is_one_file_that_asks_for_nothing(read, text):
    """Everything is within; a browser is told to fetch nothing; and names are read, not obeyed."""
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


def test_both_methods_numbers_on_the_page_hold_the_platform(robot, read):
    """Position, rotation and tensions as they are printed, column by column, carry m g and leave no moment."""
    table = next(table for table in read.tables if "tension 1 [N]" in table)
    assert table[""] == ["commanded", "MuJoCo", "Newton"]
    for column in (1, 2):
        position = 1e-3 * np.array([float(table[f"{axis} [mm]"][column]) for axis in "xyz"])
        angle = np.radians(float(table["about y [°]"][column]))
        words = {label: cells[column] for label, cells in table.items() if label.startswith("tension ")}
        assert sum(label.endswith(", slack") for label in words) == 4
        tensions = np.array([float(word) for word in words.values()])
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        arms = robot.anchors @ turn.T
        ways = robot.exits - position - arms
        forces = tensions[:, None] * ways / np.linalg.norm(ways, axis=1, keepdims=True)
        assert forces.sum(0) == pytest.approx([0, 0, robot.mass * robot.gravity], abs=BALANCED)
        assert np.cross(arms, forces).sum(0) == pytest.approx(np.zeros(3), abs=0.1 * BALANCED)


def shown_page(summary) -> str:
    """The page's text without its style, its script and its maps; the data of its picture, a number a line."""
    text = html_page.html_page(summary)
    data = json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', text)[1])  # type: ignore[index]
    text = re.sub(r"<(style|script)[^>]*>.*?</\1>|Written by cdpr_sim [^<]*", "", text, flags=re.DOTALL)
    return re.sub(r"(?=<(?:tr|p|h\d|table|section|div|figure|option)\b)", "\n", text) + json.dumps(data, indent=0)


def test_the_page_is_as_reviewed(snapshot):
    """Made-up results: each method's number in its column, what disagrees or does not rest is said; what is drawn."""
    snapshot("page/methods-disagree.txt", shown_page(made_up.summary()), rel=1e-6)
    agree = dataclasses.replace(made_up.checked(), disagreements=())
    views = made_up.view(1), made_up.view(2)
    swapped = [dataclasses.replace(one, settled=one.solved, solved=one.settled) for one in views]
    shown = made_up.summary(check=agree, first=views[0], worst=tuple(swapped), modes=None, missing=())
    snapshot("page/swapped-and-agreeing.txt", shown_page(shown), rel=1e-6)


def test_the_worst_poses_are_the_worst(robot, found, read):
    """No pose of the grid ends up farther away than the first, settled one by one; its row says what MuJoCo does."""
    x, y, z = (np.linspace(*robot.workspace[:, axis], n) for axis, n in enumerate(GRID))
    settled = [cdpr.settle(robot, (a, b, c)) for a in x for b in y for c in z]
    arm = robot.characteristic_length
    away = [np.hypot(np.linalg.norm(one.deviation), arm * one.rotation.magnitude()) for one in settled]
    first = found.worst[0].settled
    assert np.hypot(np.linalg.norm(first.deviation), arm * first.rotation.magnitude()) == pytest.approx(
        max(away), rel=ALONG
    )
    table = next(table for table in read.tables if "pose" in table and "1" in table)
    place, mujoco, newton, tilt, *_ = table["1"]
    worst = settled[int(np.argmax(away))]
    at = 1e-3 * np.array([float(number) for number in place.split(", ")])
    again = cdpr.settle(robot, at)
    assert float(mujoco) == pytest.approx(1e3 * np.linalg.norm(worst.deviation), abs=1e-2)
    assert float(mujoco) == pytest.approx(1e3 * np.linalg.norm(again.deviation), abs=1e-2)
    assert float(newton) == pytest.approx(1e3 * np.linalg.norm(cdpr.solve(robot, at).deviation), abs=1e-2)
    assert float(tilt) == pytest.approx(np.degrees(again.tilt), abs=1e-2)


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
    assert found.plane["y"].item() == y
    assert y != robot.home[1]
    assert float(np.degrees(found.plane["tilt"].max())) > 0.9 * tilt
    assert f"Tilt of the platform at y = {1e3 * y:g} mm, from " in words


def test_cables_are_drawn_from_exit_to_anchor_and_slack_ones_as_long_as_they_are(robot, found, text):
    """What turns on the page is where MuJoCo has it: platform, commanded pose, ends and lengths of cables."""
    drawn = scene(text)
    for view, shown in zip((found.first, *found.worst), drawn["views"], strict=True):
        rest = view.settled
        assert shown["platform"]["position"] == pytest.approx(rest.position, abs=1e-6)
        assert np.array(shown["platform"]["rotation"]) == pytest.approx(rest.rotation.as_matrix(), abs=1e-6)
        assert shown["commanded"]["position"] == pytest.approx(view.problem.pose.translation, abs=1e-6)
        anchors = rest.position + robot.anchors @ rest.rotation.as_matrix().T
        for cable, one in enumerate(shown["cables"]):
            way = np.array(one["curve"])
            assert way[0] == pytest.approx(robot.exits[cable], abs=1e-6)
            assert way[-1] == pytest.approx(anchors[cable], abs=1e-6)
            length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
            assert one["slack"] == (rest.tensions[cable] == 0)
            if one["slack"]:
                assert length > np.linalg.norm(way[-1] - way[0]) + 1e-4
                assert length == pytest.approx(rest.rest_lengths[cable], rel=PARABOLA)
            else:
                assert length == pytest.approx(rest.lengths[cable], abs=1e-6)
            assert one["label"] == ("slack" if one["slack"] else f"{float(f'{rest.tensions[cable]:.3g}'):g} N")


def test_what_cannot_be_shown_is_said(robot):
    """A workspace without height has no map, and a sentence says why."""
    flat = robot.workspace.copy()
    flat[:, 2] = 0.2
    shown = Page(
        html_page.html_page(robot_summary.summarise(robot.replace(workspace=flat), grid=(2, 1, 1), motion=False))
    )
    assert "No maps: plane: found a workspace of" in shown.words
    assert "Maps of the workspace" not in shown.words


def test_the_command_writes_the_page_whole_and_over_nothing(tmp_path, monkeypatch, without_pictures):
    """Mistakes are a sentence and exit status 2, and leave no file; one that is there stays, unless forced."""
    monkeypatch.setattr(robot_summary, "POINTS", 5)
    runner, path = CliRunner(), tmp_path / "robot.html"

    def run(*words: str):
        return runner.invoke(app, ["report", "two-cable", "-o", str(path), "--no-video", *words])

    for words, said in {
        ("--grid", "0", "1", "1"): "grid",
        ("--pose", "0.4", "0.1", "0.2"): "planar",
        ("--material", "spaghetti"): "spaghetti",
    }.items():
        result = run(*words)
        assert (result.exit_code, said in result.stderr) == (2, True), result.stderr
        assert len(result.stderr.strip().splitlines()) == 1
        assert list(tmp_path.iterdir()) == []
    assert run("--grid", "2", "1", "1").exit_code == 0
    before = path.read_bytes()
    assert b"two-cable" in before
    refused = run("--grid", "2", "1", "1", "--material", "fishing-0.4mm")
    assert (refused.exit_code, path.read_bytes()) == (2, before)
    assert "--force" in refused.stderr
    assert run("--grid", "2", "1", "1", "--material", "fishing-0.4mm", "--force").exit_code == 0
    assert b"fishing-0.4mm" in path.read_bytes()
    assert runner.invoke(app, ["report", "two-cable", "-o", str(tmp_path / "robot.pdf")]).exit_code == 2
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

CONTRASTS = """
const pen = Object.assign(document.createElement("canvas"), {width: 1, height: 1}).getContext("2d");
const bytes = (color) => {
  pen.clearRect(0, 0, 1, 1);
  pen.fillStyle = color;
  pen.fillRect(0, 0, 1, 1);
  return [...pen.getImageData(0, 0, 1, 1).data];
};
const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
const behind = (one) => {
  for (; one; one = one.parentElement) {
    const color = bytes(getComputedStyle(one).backgroundColor);
    if (color[3] === 255) return color;
  }
  return [255, 255, 255];
};
const speaks = (one) => one.checkVisibility() && !one.closest("noscript, select")
  && [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
return [...document.querySelectorAll("body *")].filter(speaks).map((one) => {
  const look = getComputedStyle(one), paper = behind(one);
  const ink = bytes(look.color).map((v, i) => +look.opacity * v + (1 - look.opacity) * paper[i]);
  const [a, b] = [light(ink), light(paper)].sort((x, y) => y - x);
  return [one.tagName, one.textContent.slice(0, 40), (a + 0.05) / (b + 0.05), parseFloat(look.fontSize)];
});
"""
"""Of each element with words of its own: its tag, its words, their contrast and their size [pixel]."""


@pytest.fixture(scope="module")
def browser() -> Iterator:
    """Chromium without a window, by the driver that is installed beside it; nothing is downloaded."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="found no selenium: pip install selenium")
    programs = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    if None in programs:
        pytest.skip("found no chromium and chromedriver: on Debian, apt install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = programs[0]
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(programs[1]))
    yield driver
    driver.quit()


@pytest.fixture
def opened(browser, text, tmp_path) -> Iterator:
    """The page in a wide window, its log empty but for what the page has done."""
    path = tmp_path / "robot.html"
    path.write_text(text, encoding="utf-8")
    window(browser, 1280)
    for kind in ("browser", "performance"):
        browser.get_log(kind)
    browser.get(path.as_uri())
    yield browser
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def window(browser, width: int) -> None:
    size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def drawing(browser) -> str:
    """What is on the canvas."""
    return browser.execute_script("return document.getElementById('robot').toDataURL()")


def press(browser, *keys: str) -> None:
    """Keys, for whatever has the keyboard."""
    browser.switch_to.active_element.send_keys(*keys)


def requests(browser) -> list[str]:
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [one["params"]["request"]["url"] for one in events if one["method"] == "Network.requestWillBeSent"]
    return [url for url in sent if not url.startswith(("file:", "data:"))]


def test_it_loads_without_an_error_and_asks_the_network_for_nothing(opened, text, tmp_path):
    """Nothing on the console, no request; and both would be seen: a page that breaks, or asks, is told from it."""
    assert opened.get_log("browser") == []
    assert requests(opened) == []
    film = "const film = document.querySelector('video'); return [film.error, film.readyState > 1, film.videoWidth]"
    wait_for(lambda: opened.execute_script(film)[1])
    assert opened.execute_script(film) == [None, True, 320]
    for name, broken in {
        "breaks": text.replace("const views", "").replace('getElementById("scene")', 'getElementById("lost")'),
        "asks": text.replace("</main>", '<img alt="" src="https://example.invalid/x.png"></main>'),
    }.items():
        path = tmp_path / f"{name}.html"
        path.write_text(broken, encoding="utf-8")
        opened.get(path.as_uri())
        assert opened.get_log("browser") != [], name
    path.write_text(broken.replace(html_page.POLICY, ""), encoding="utf-8")
    requests(opened)
    opened.get(path.as_uri())
    assert requests(opened) == ["https://example.invalid/x.png"]


def test_the_robot_is_drawn_and_turns_by_keyboard(opened):
    """The picture has many colours; arrow keys, sliders and boxes change it, and Home brings it back as it was."""
    from selenium.webdriver.common.keys import Keys

    colors = opened.execute_script(
        "const canvas = document.getElementById('robot'), pen = canvas.getContext('2d');"
        "const { data } = pen.getImageData(0, 0, canvas.width, canvas.height);"
        "return new Set(new Uint32Array(data.buffer)).size"
    )
    assert colors > 20
    begun = drawing(opened)
    tab_to(opened, "robot")
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+"):
        before = drawing(opened)
        press(opened, key)
        assert drawing(opened) != before, key
    press(opened, Keys.HOME)
    assert drawing(opened) == begun
    for control in ("turn", "height", "zoom"):
        tab_to(opened, control)
        before = drawing(opened)
        press(opened, Keys.ARROW_RIGHT)
        assert drawing(opened) != before, control
    tab_to(opened, "reset")
    press(opened, Keys.ENTER)
    assert drawing(opened) == begun
    for control in ("tensions", "commanded"):
        tab_to(opened, control)
        before = drawing(opened)
        press(opened, Keys.SPACE)
        assert drawing(opened) != before, control


def test_dots_of_slack_cables_go_on_from_piece_to_piece(opened):
    """A cable is drawn in pieces, nearest last: each begins its pattern where the piece before it ended."""
    pieces = opened.execute_script(
        "const pieces = [], pen = CanvasRenderingContext2D.prototype, { stroke, moveTo, lineTo } = pen; let ends = [];"
        "pen.moveTo = function (...at) { ends = [at]; return moveTo.apply(this, at); };"
        "pen.lineTo = function (...at) { ends.push(at); return lineTo.apply(this, at); };"
        "pen.stroke = function () {"
        " if (this.getLineDash().join() === '1,5') pieces.push([this.lineDashOffset, ...ends]);"
        " return stroke.call(this); };"
        "const turn = document.getElementById('turn'); turn.value = 30; turn.dispatchEvent(new Event('input'));"
        "return pieces"
    )
    after = {tuple(np.round(end, 6)): (offset, start, end) for offset, start, end in pieces}
    gone = [
        offset - before - np.hypot(*np.subtract(end, start))
        for offset, begin, _ in pieces
        if (found := after.get(tuple(np.round(begin, 6)))) is not None
        for before, start, end in [found]
    ]
    assert len(gone) > 20
    assert np.abs(gone).max() < DASH


def test_a_film_in_a_notebook_is_no_wider_than_its_page(browser, monkeypatch, tmp_path):
    """It shrinks with the page, in its own proportions; where there is room it has its own size."""
    from selenium.webdriver.common.by import By

    displayed = []
    monkeypatch.setattr("IPython.display.display", lambda thing: displayed.append(thing.data))
    motion = cdpr.drive(cdpr.load_robot("parallel"), [(0.3, 0.25, 0.1), (0.31, 0.25, 0.1)], seconds=1.0, states=2)
    cdpr.show(motion, seconds=0.2, fps=10, size=(960, 540), renderer="raycast")
    path = tmp_path / "notebook.html"
    path.write_text(f'<body style="margin: 0">{displayed[0]}</body>', encoding="utf-8")
    for width, expected in ((640, (640, 360)), (1280, (960, 540))):
        window(browser, width)
        browser.get(path.as_uri())
        size = browser.find_element(By.TAG_NAME, "video").size
        assert (size["width"], size["height"]) == expected


def test_the_robot_turns_by_mouse(opened):
    """To the side and from above; the page stays where it is."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    canvas = opened.find_element(By.ID, "robot")
    for shift in ((60, 0), (0, 30)):
        before = drawing(opened)
        ActionChains(opened).move_to_element(canvas).click_and_hold().move_by_offset(*shift).release().perform()
        assert drawing(opened) != before, shift


def test_a_pose_is_chosen_by_keyboard(opened, found):
    """The picture, its words and both methods' answers follow; a worst pose's button leads back up to it."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    def answers() -> list[str]:
        return [one.text for one in opened.find_elements(By.CSS_SELECTOR, "[data-view]") if one.is_displayed()]

    (first,), begun = answers(), drawing(opened)
    tab_to(opened, "pose")
    press(opened, Keys.ARROW_DOWN)
    (second,) = answers()
    rest = found.worst[0].settled
    assert f"{1e3 * rest.position[0]:.3f}" in second
    assert second != first
    assert drawing(opened) != begun
    label = opened.find_element(By.ID, "robot").get_attribute("aria-label")
    assert label == opened.find_element(By.ID, "description").text
    assert f"tilt {np.degrees(rest.tilt):.2f}".rstrip("0") in label
    opened.find_element(By.CSS_SELECTOR, "[data-show='2']").send_keys(Keys.ENTER)
    assert opened.execute_script("return document.getElementById('pose').selectedIndex") == 2
    assert opened.switch_to.active_element.get_attribute("id") == "robot"


@pytest.mark.parametrize("width", [PHONE, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_is_legible(opened, width, scheme):
    """On a phone as on a desk, on light and on dark paper: nothing to scroll sideways, type large and dark enough."""
    window(opened, width)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    size = "return [innerWidth, document.documentElement.scrollWidth <= innerWidth]"
    assert opened.execute_script(size) == [width, True]
    seen = opened.execute_script(CONTRASTS)
    assert len(seen) > 100
    assert [one for one in seen if one[3] < LEAST_LETTERS] == []
    assert [one for one in seen if one[2] < LEAST_CONTRAST] == []
    small = opened.execute_script(
        "return [...document.querySelectorAll('button, select, input:not([type=checkbox]), .controls label')]"
        f".filter((one) => Math.min(one.offsetWidth, one.offsetHeight) < {LEAST_TARGET}).map((one) => one.outerHTML)"
    )
    assert small == []
    for broken in ("font-size: 9px", "color: #888 !important; background: #777", "min-width: 2000px"):
        opened.execute_script(f"document.querySelector('.lead').style.cssText = '{broken}'")
        seen = opened.execute_script(CONTRASTS)
        whole = min(one[2] for one in seen) >= LEAST_CONTRAST and min(one[3] for one in seen) >= LEAST_LETTERS
        assert not (whole and opened.execute_script(size) == [width, True]), broken


def test_on_paper_nothing_is_cut_off(opened):
    """What scrolls on a screen is whole on a sheet of A4, on white paper even where the screen is dark."""
    opened.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}]},
    )
    window(opened, A4)
    cut = (
        "return [...document.querySelectorAll('table, img, canvas')].filter((one) => one.checkVisibility()"
        f" && one.getBoundingClientRect().right > {A4}).map((one) => one.tagName)"
    )
    assert opened.execute_script(cut) == []
    assert opened.execute_script("return getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert not opened.execute_script("return document.querySelector('.controls, video').checkVisibility()")


def test_what_is_not_seen_is_said(opened):
    """Pictures have words instead, controls their labels, sections their headings."""
    assert opened.execute_script("return [...document.images].every((one) => one.alt.length > 10)")
    assert opened.execute_script(
        "return [...document.querySelectorAll('input, select')].every((one) => one.labels.length)"
    )
    unnamed = "return [...document.querySelectorAll('[tabindex], video')].filter((one) => !one.ariaLabel).length"
    assert opened.execute_script(unnamed) == 0
    assert opened.execute_script("return document.documentElement.lang") == "en"


@pytest.mark.parametrize(("ink", "paper"), [("#dddddd", "#111111"), ("#222222", "#ffffff")])
def test_introductions_in_notebooks_are_legible(browser, found, ink, paper, tmp_path):
    """On a dark notebook's paper as on a light one's."""
    path = tmp_path / "notebook.html"
    shown = found.first.settled._repr_html_() + found.check._repr_html_() + found.first.agreement._repr_html_()
    style = f"color: {ink}; background: {paper}"
    path.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body style="{style}">{shown}', encoding="utf-8")
    browser.get(path.as_uri())
    seen = browser.execute_script(CONTRASTS)
    assert len(seen) > 30
    assert [one for one in seen if one[2] < LEAST_CONTRAST] == []


def tab_to(browser, name: str) -> None:
    """By the tabulator alone, from the top of the page."""
    from selenium.webdriver.common.keys import Keys

    browser.execute_script("document.activeElement.blur(); window.scrollTo(0, 0)")
    for _ in range(40):
        press(browser, Keys.TAB)
        if browser.switch_to.active_element.get_attribute("id") == name:
            return
    raise AssertionError(f"{name} is not reached by the tabulator")


def wait_for(true: Callable[[], bool]) -> None:
    """Until something is, for a minute: machines can be busy."""
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)
