"""Layout of a video frame around the pictures: title, numbers, tension bars, legend and scale. Nothing is computed."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.lettering import legible
from cdpr_sim.drawing.video.scene import tension_colors

KEYS = ("platform", "commanded", "static", "slack", "tension")

LEGENDS: list[dict[str, str]] = [
    dict(zip(KEYS, labels, strict=True))
    for labels in (
        ("platform in MuJoCo", "commanded pose", "pose by the static solver", "slack cable", "tension"),
        ("platform in MuJoCo", "commanded", "static solver", "slack cable", "tension"),
        ("MuJoCo", "commanded", "static", "slack", ""),
    )
]
"""Legends from long to short."""

LEAST_CHART = 8
"""[pixel] Smallest height and width of the bar chart."""


@dataclass(frozen=True)
class Box:
    """A rectangle of the page, in pixels."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        """One past the last column."""
        return self.left + self.width

    @property
    def bottom(self) -> int:
        """One past the last row."""
        return self.top + self.height


@dataclass(frozen=True)
class Cell:
    """Areas of one robot on the page: heading, full view, close-up, numbers and bars."""

    heading: Box
    view: Box
    close_up: Box
    numbers: Box
    bars: Box


class Page:
    """The layout of a video's frames: as many robots side by side as there are captions.

    Args:
        size: (width, height) [pixel].
        robots: one per cell.
        captions: the line under each robot's name, from long to short: the first that fits is written.
        largest_tension: [N] the end of the scale.
        footnote: description of the video, in a line.
        warning: written into the pictures; or empty.
        outlined: whether the static solver's outline is drawn, and included in the legend.
    """

    def __init__(
        self,
        size: tuple[int, int],
        robots: Sequence[Robot],
        captions: Sequence[Sequence[str]],
        *,
        largest_tension: float,
        footnote: str,
        outlined: bool,
        warning: str = "",
    ) -> None:
        self.size, self.largest_tension, self._warning = size, largest_tension, warning
        self._unit = min(size[1], 0.75 * size[0], 1.25 * size[0] / len(robots))
        self._gap = max(4, round(0.012 * self._unit))
        self._legend = self._line(style.LABEL_HEIGHT) * 2 + 2 * self._gap
        self.cells = [self._cell(k, len(robots)) for k in range(len(robots))]
        self._blank = Image.new("RGB", size, _rgb(style.PAGE_PAPER))
        draw = ImageDraw.Draw(self._blank)
        for cell, robot, caption in zip(self.cells, robots, captions, strict=True):
            self._draw_heading(draw, cell.heading, robot, caption)
            self._draw_bar_labels(draw, cell.bars, robot.cables)
        self._draw_legend(draw, footnote, outlined)

    def frame(
        self,
        views: Sequence[np.ndarray],
        close_ups: Sequence[np.ndarray],
        tilts: Sequence[float],
        deviations: Sequence[np.ndarray],
        tensions: Sequence[np.ndarray],
        slack: Sequence[np.ndarray],
    ) -> np.ndarray:
        """One frame, (height, width, 3) uint8.

        Of each robot: pictures, tilt [rad], deviation [m], tensions [N], and which cables are slack.
        """
        page = self._blank.copy()
        draw = ImageDraw.Draw(page)
        for k, cell in enumerate(self.cells):
            for box, pixels in ((cell.view, views[k]), (cell.close_up, close_ups[k])):
                page.paste(Image.fromarray(np.ascontiguousarray(pixels)), (box.left, box.top))
                draw.rectangle((box.left, box.top, box.right - 1, box.bottom - 1), outline=_rgb(style.PAGE_RULE))
            if self._warning:
                self._draw_warning(draw, cell.view)
            self._draw_numbers(draw, cell.numbers, tilts[k], deviations[k], slack[k])
            self._draw_bars(draw, cell.bars, tensions[k], slack[k])
        return np.asarray(page)

    def _cell(self, k: int, cells: int) -> Cell:
        gap = self._gap
        width = (self.size[0] - gap * (cells + 1)) // cells
        left = gap + k * (width + gap)
        heading = Box(left, gap, width, self._line(style.TITLE_HEIGHT) + self._line(style.LABEL_HEIGHT) + gap)
        top, bottom = heading.bottom, self.size[1] - self._legend - gap
        height = bottom - top
        if width > 1.25 * height:  # numbers beside the picture, else below
            side = int(0.27 * width)
            view = Box(left, top, width - side - gap, height)
            close = min(side, int(0.42 * height))
            right = view.right + gap
            numbers = Box(right, top + close + gap, side, 4 * self._line(style.NUMBER_HEIGHT) * 85 // 100)
            bars = Box(right, numbers.bottom + gap, side, bottom - numbers.bottom - gap)
            return Cell(heading, view, Box(right, top, side, close), numbers, bars)
        strip = int(min(0.30 * height, 0.30 * width))
        view = Box(left, top, width, height - strip - gap)
        close = int(min(1.15 * strip, 0.30 * width, max(0.12 * width, 0.62 * width - self._numbers_width())))
        numbers_width = int(min(self._numbers_width(), 0.45 * width))
        under = view.bottom + gap
        numbers = Box(left + close + 2 * gap, under, numbers_width, strip)
        bars = Box(numbers.right + gap, under, left + width - numbers.right - gap, strip)
        return Cell(heading, view, Box(left, under, close, strip), numbers, bars)

    def _draw_heading(self, draw: ImageDraw.ImageDraw, box: Box, robot: Robot, captions: Sequence[str]) -> None:
        """Name and, if it fits, description; below them the first caption that fits."""
        title = self._font(style.TITLE_HEIGHT, bold=True)
        name, other = legible(robot.name)
        if other is not None:
            title = _font(self._size(style.TITLE_HEIGHT), True, other.file)
        draw.text((box.left, box.top), name, _rgb(style.PAGE_INK), title)
        beside = box.left + draw.textlength(name + " ", title)
        at = beside, box.top + title.getmetrics()[0]
        description = self._first_fitting([robot.description, ""], box.right - beside)
        self._fitted(draw, at, description, box.right - beside, style.TEXT_HEIGHT, style.PAGE_FAINT, anchor="ls")
        line = box.top + self._line(style.TITLE_HEIGHT)
        caption = self._first_fitting(captions, box.width)
        self._fitted(draw, (box.left, line), caption, box.width, style.LABEL_HEIGHT, style.PAGE_INK)

    def _draw_warning(self, draw: ImageDraw.ImageDraw, view: Box) -> None:
        """The warning on a strip at the foot of the picture."""
        line, gap = self._line(style.TEXT_HEIGHT), self._gap
        top = view.bottom - line - 2 * gap
        draw.rectangle((view.left, top, view.right - 1, view.bottom - 1), fill=_rgb(style.PAGE_INK))
        self._fitted(
            draw, (view.left + gap, top + gap), self._warning, view.width - 2 * gap, style.TEXT_HEIGHT, style.PAGE_PAPER
        )

    def _draw_numbers(self, draw: ImageDraw.ImageDraw, box: Box, tilt: float, deviation, slack) -> None:
        """Tilt, deviation in x, y and downwards, and the number of slack cables."""
        horizontal, down = 1e3 * float(np.hypot(*deviation[:2])), -1e3 * float(deviation[2])
        rows = [("tilt", np.degrees(tilt), " °"), ("dev. xy", horizontal, " mm"), ("down", down, " mm")]
        texts = [
            (
                name,
                f"{value:.{1 if abs(value) >= 9.95 else 2}f}".replace("-", "−"),
                unit,
                style.PAGE_FAINT,
                style.PAGE_INK,
            )
            for name, value, unit in rows
        ]
        color = style.SLACK_COLOR if slack.any() else style.PAGE_FAINT
        texts.append(("slack", str(int(slack.sum())), f" of {len(slack)}", color, color))
        label, figure = self._font(style.LABEL_HEIGHT), self._font(style.NUMBER_HEIGHT, bold=True)
        unit_left = box.right - max(label.getlength(text) for text in (" mm", f" of {len(slack)}"))
        for row, (name, number, unit, faint, ink) in enumerate(texts):
            base = box.top + (row + 0.72) * box.height / 4
            draw.text((box.left, base), name, _rgb(faint), label, anchor="ls")
            draw.text((unit_left, base), number, _rgb(ink), figure, anchor="rs")
            draw.text((unit_left, base), unit, _rgb(faint), label, anchor="ls")

    def _chart(self, box: Box) -> Box:
        """Area of the bars: above their numbers and below the title."""
        line = self._line(style.LABEL_HEIGHT)
        left = self._font(style.LABEL_HEIGHT).getlength(self._newtons(self.largest_tension)) + 2 * self._gap
        top = box.top + line + self._gap
        return Box(int(box.left + left), top, int(box.width - left), box.bottom - line - top)

    def _draw_bar_labels(self, draw: ImageDraw.ImageDraw, box: Box, cables: int) -> None:
        chart, font = self._chart(box), self._font(style.LABEL_HEIGHT)
        if not _has_room(chart):
            return
        self._fitted(draw, (chart.left, box.top), "tension [N]", chart.width, style.LABEL_HEIGHT, style.PAGE_FAINT)
        for tension in (0.0, self.largest_tension / 2, self.largest_tension):
            y = chart.bottom - 1 - round((chart.height - 1) * tension / self.largest_tension)
            draw.line((chart.left, y, chart.right, y), _rgb(style.PAGE_RULE))
            anchor = (chart.left - self._gap, y)
            draw.text(anchor, self._newtons(tension), _rgb(style.PAGE_FAINT), font, anchor="rm")
        for i in range(cables):
            self._draw_bar_number(draw, chart, i, cables, style.PAGE_INK)

    def _draw_bars(self, draw: ImageDraw.ImageDraw, box: Box, tensions: np.ndarray, slack: np.ndarray) -> None:
        chart = self._chart(box)
        if not _has_room(chart):
            return
        colors, pitch = tension_colors(tensions, self.largest_tension), chart.width / len(tensions)
        for i in range(len(tensions)):
            left, right = chart.left + (i + 0.14) * pitch, chart.left + (i + 0.86) * pitch
            height = min(1.0, tensions[i] / self.largest_tension) * (chart.height - 1)
            draw.rectangle((left, chart.bottom - 1 - height, right, chart.bottom - 1), fill=_rgb(colors[i]))
            if slack[i]:  # a frame, and the number in the same colour; without mass, the frame is empty
                draw.rectangle((left, chart.top, right, chart.bottom - 1), outline=_rgb(style.SLACK_COLOR))
                self._draw_bar_number(draw, chart, i, len(tensions), style.SLACK_COLOR)
                above = Box(chart.left, chart.top, chart.width, chart.height - round(height))
                self._draw_upright(draw, (left + right) / 2, above, right - left)

    def _draw_bar_number(self, draw: ImageDraw.ImageDraw, chart: Box, i: int, cables: int, color: style.Color) -> None:
        """The cable's number under its bar, if bars are wide enough for all numbers."""
        font, pitch = self._font(style.LABEL_HEIGHT), chart.width / cables
        if font.getlength(f"{cables} ") <= pitch:
            middle = chart.left + (i + 0.5) * pitch
            draw.text((middle, chart.bottom + self._gap / 2), str(i + 1), _rgb(color), font, anchor="ma")

    def _draw_upright(self, draw: ImageDraw.ImageDraw, middle: float, chart: Box, width: float) -> None:
        """The word "slack", vertical in its bar, if it fits."""
        size = self._size(style.LABEL_HEIGHT)
        word = _upright("slack", size)
        if word.width <= width and word.height <= chart.height - 2 * self._gap:
            place = (round(middle - word.width / 2), round(chart.bottom - self._gap - word.height))
            draw.bitmap(place, word, _rgb(style.SLACK_COLOR))

    def _numbers_width(self) -> float:
        """Width of the widest line of numbers: a label, a number and its unit."""
        label, figure = self._font(style.LABEL_HEIGHT), self._font(style.NUMBER_HEIGHT, bold=True)
        return label.getlength("dev. xy ") + figure.getlength("−0.00") + label.getlength(" of 8")

    def _draw_legend(self, draw: ImageDraw.ImageDraw, footnote: str, outlined: bool) -> None:
        width, height = self.size
        line, gap = self._line(style.LABEL_HEIGHT), self._gap
        top = height - self._legend
        draw.line((gap, top, width - gap, top), _rgb(style.PAGE_RULE))
        self._fitted(draw, (gap, top + gap + line), footnote, width - 2 * gap, style.LABEL_HEIGHT, style.PAGE_FAINT)
        middle, swatch, font = top + gap + line / 2, 1.3 * line, self._font(style.LABEL_HEIGHT)
        scale = round(0.16 * width)
        ends = self._newtons(0), f"{self._newtons(self.largest_tension)} N"

        keys = ["platform", "commanded", *["static"] * outlined, "slack"]

        def needed(labels: dict[str, str]) -> float:
            swatches = sum(swatch + 3 * gap + font.getlength(labels[key]) for key in keys)
            return swatches + sum(font.getlength(text) + gap for text in (labels["tension"], *ends)) + scale

        room = width - 2 * gap
        labels = next((labels for labels in LEGENDS if needed(labels) <= room), LEGENDS[-1])
        spread = min(3.0 * gap, max(0.0, (room - needed(labels)) / len(labels)))
        x = float(gap)
        for key in keys:
            self._draw_swatch(draw, key, x, middle, swatch, 0.62 * line)
            x += swatch + gap
            draw.text((x, middle), labels[key], _rgb(style.PAGE_INK), font, anchor="lm")
            x += font.getlength(labels[key]) + 2 * gap + spread
        for text in (labels["tension"], ends[0]):
            draw.text((x, middle), text, _rgb(style.PAGE_INK), font, anchor="lm")
            x += font.getlength(text) + gap
        for column, color in enumerate(tension_colors(np.linspace(0, 1, scale), 1.0)):
            draw.line((x + column, middle - 0.31 * line, x + column, middle + 0.31 * line), _rgb(color))
        draw.text((x + scale + gap, middle), ends[1], _rgb(style.PAGE_INK), font, anchor="lm")

    def _draw_swatch(self, draw: ImageDraw.ImageDraw, entry: str, x: float, middle: float, width: float, height: float):
        top, bottom = middle - height / 2, middle + height / 2
        if entry == "slack":
            around = (x, middle - height * 1.6, x + width, bottom)
            draw.arc(around, 20, 160, _rgb(style.SLACK_COLOR), max(2, round(height / 5)))
            return
        fill = style.PLATFORM_COLOR
        if entry == "commanded":
            clear = (1 - style.GHOST_ALPHA) ** 2
            fill = tuple(clear * 0.9 + (1 - clear) * channel for channel in style.COMMANDED_COLOR)
        outline = _rgb(style.STATIC_COLOR) if entry == "static" else None
        draw.rectangle((x, top, x + width, bottom), _rgb(fill), outline, max(2, round(height / 6)))

    def _first_fitting(self, texts: Sequence[str], width: float) -> str:
        """The first text that fits into ``width`` in the smallest font; or the last."""
        least = _font(style.LEAST_HEIGHT, False)
        return next((text for text in texts if least.getlength(text) <= width), texts[-1])

    def _fitted(self, draw, at, text: str, width: float, size: float, color, anchor: str = "la") -> None:
        """Write ``text`` in a font small enough for ``width``; truncated if the smallest legible font is too wide."""
        sizes = range(self._size(size), style.LEAST_HEIGHT - 1, -1)
        text, other = legible(text)
        file = None if other is None else other.file
        fonts = (_font(pixels, False, file) for pixels in sizes)
        font = next((one for one in fonts if one.getlength(text) <= width), _font(style.LEAST_HEIGHT, False, file))
        while text and font.getlength(text) > width:
            text = text[:-2].rstrip() + "…" if len(text) > 2 else ""
        draw.text(at, text, _rgb(color), font, anchor=anchor)

    @staticmethod
    def _newtons(tension: float) -> str:
        return f"{tension:.3g}"

    def _size(self, size: float) -> int:
        return max(style.LEAST_HEIGHT, round(size * self._unit))

    def _font(self, size: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
        return _font(self._size(size), bold)

    def _line(self, size: float) -> int:
        return round(1.28 * self._size(size))


def nice_above(value: float) -> float:
    """Upper end of a scale: the next 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if step * power >= value))


def _has_room(chart: Box) -> bool:
    """Whether bars fit: with many robots on a small page they are left out."""
    return min(chart.width, chart.height) >= LEAST_CHART


def _rgb(color: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * float(channel)) for channel in color)
    return red, green, blue


@functools.lru_cache(maxsize=64)
def _font(size: int, bold: bool, file: Path | None = None) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, included in matplotlib and so the same on every machine; or the font in ``file``."""
    import matplotlib

    if file is not None:
        return ImageFont.truetype(str(file), size)
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path(), "fonts", "ttf", name)), size)


@functools.lru_cache(maxsize=8)
def _upright(word: str, size: int) -> Image.Image:
    font = _font(size, False)
    left, top, right, bottom = font.getbbox(word)
    image = Image.new("L", (int(right - left), int(bottom - top)))
    ImageDraw.Draw(image).text((-left, -top), word, 255, font)
    return image.rotate(90, expand=True)
