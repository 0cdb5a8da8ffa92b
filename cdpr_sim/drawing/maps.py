"""Maps of a workspace from the datasets of ``sweep`` and ``check``; only contour levels are computed here.

A row for each quantity, on one scale; a column for each robot and material. Panels show the poses of a grid in one
plane of the workspace, with a dashed border around the static feasible workspace; a small picture above each robot's
columns shows their location in the frame, and the exits of the cables.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cdpr_sim.core.describe import span
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.lettering import in_legible_letters
from cdpr_sim.drawing.readable_numbers import per_cent, plain, power_of_ten

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

SUFFIXES = (".png", ".svg", ".pdf")
"""File formats of a map."""

ELASTIC = ("tilt", "distance", "slack_count", "feasible")
"""Rows of an elastic map."""

QUANTITIES = (*ELASTIC, "capacity_margin")
"""Variables of ``sweep`` for an elastic map; the last gives the border of the feasible workspace between the poses."""

TITLES = {
    "tilt": "tilt [°]",
    "distance": "deviation [mm]",
    "slack_count": "slack cables",
    "feasible": "feasible",
    "wrench_feasible": "feasible for\nall wrenches",
    "outcome": "outcome",
    "position_error": "difference [mm]",
}
"""Title of a row, by its variable."""

FACTORS = {"tilt": 180 / np.pi, "distance": 1e3}
"""Factors from SI units to those of the titles."""

MOST_CABLES = len(style.MAP_SLACK) - 1
"""Largest number of slack cables with a colour of its own."""


LEAST = 1e-3
"""[°] or [mm] Smaller maxima are given as "less than"."""


@dataclass(frozen=True)
class _Layout:
    """Positions on the page [inch]; rows of a single column are arranged in blocks side by side."""

    rows: int
    columns: int
    panel: tuple[float, float]
    left: float = 1.0
    right: float = 0.85
    top: float = 1.65
    bottom: float = 0.85
    gap: tuple[float, float] = (0.3, 0.27)
    bar: float = 0.11

    @property
    def blocks(self) -> int:
        """Number of blocks side by side."""
        return 2 if self.columns == 1 and self.rows > 1 else 1

    @property
    def size(self) -> tuple[float, float]:
        high = -(-self.rows // self.blocks)
        return self.blocks * self._block, self.top + high * (self.panel[1] + self.gap[1]) + self.bottom

    @property
    def _block(self) -> float:
        return self.left + self.columns * (self.panel[0] + self.gap[0]) + self.right

    def lowest(self, row: int) -> bool:
        """Whether this row is the lowest of its block."""
        return row + self.blocks >= self.rows

    def box(self, row: int, column: int) -> tuple[float, float, float, float]:
        """Position of a panel in figure coordinates; the column after the last is the colour bar."""
        (width, height), (page_width, page_height) = self.panel, self.size
        down, block = divmod(row, self.blocks)
        x = block * self._block + self.left + column * (width + self.gap[0])
        y = page_height - self.top - down * (height + self.gap[1]) - height
        wide = width if column < self.columns else self.bar
        x -= 0.0 if column < self.columns else self.gap[0] / 2
        return x / page_width, y / page_height, wide / page_width, height / page_height


@dataclass(frozen=True)
class _Row:
    """One quantity: its axes, its values (vertical, horizontal) per column, and the feasibility margins."""

    figure: Figure
    axes: Sequence[Axes]
    bar: Axes
    panels: Sequence[xr.DataArray]
    margins: Sequence[xr.DataArray | None]

    def each(self) -> Iterator[tuple[Axes, np.ndarray, np.ndarray, np.ndarray]]:
        """(axes, x, y, values) of each panel."""
        for ax, panel in zip(self.axes, self.panels, strict=True):
            vertical, horizontal = panel.dims
            yield ax, panel[horizontal].values, panel[vertical].values, panel.values


@in_legible_letters
def draw_elastic_map(dataset: xr.Dataset, *, names: Sequence[str] = ELASTIC) -> Figure:
    """Tilt, deviation, slack cables and feasibility over a plane of the workspace, on shared scales.

    Args:
        dataset: of ``sweep``, with a single coordinate along one of x, y and z. With ``capacity_margin`` in it, the
            border of the feasible workspace is drawn where that is zero, between the poses; without, around them.
        names: the variables to draw, a row each.

    Raises:
        InvalidInput: a dataset that is not a plane, or lacks a variable.
    """
    return _draw(dataset, names)


@in_legible_letters
def draw_agreement_map(dataset: xr.Dataset) -> Figure:
    """Outcome of the comparison of MuJoCo and statics, and their difference, over a plane of the workspace.

    Args:
        dataset: a plane of ``check``'s dataset, or the result of its ``across``.

    Raises:
        InvalidInput: a dataset that is not a plane.
    """
    return _draw(dataset, ("outcome", "position_error"))


def write(figure: Figure, path: Path) -> None:
    """Save a map atomically.

    Raises:
        InvalidInput: the file cannot be written; an existing file is unchanged.
    """
    with appearing(path) as (temporary,):
        figure.savefig(temporary, dpi=style.PNG_DPI, format=path.suffix[1:].lower())


def _draw(dataset: xr.Dataset, rows: Sequence[str]) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    for name in rows:
        if name not in dataset:
            raise InvalidInput(f"map: found no variable {name!r} in the dataset, expected one that has it")
    normal, horizontal, vertical = _plane(dataset)
    flat = dataset.isel({normal: 0}).transpose(..., vertical, horizontal, "axis")
    columns = variants_of(flat)
    (left, right), (low, high) = (outer_edges(flat[name].values) for name in (horizontal, vertical))
    layout = _Layout(len(rows), len(columns), _panel_size((high - low) / (right - left)))
    figure = Figure(figsize=layout.size, facecolor=style.MAP_BACKGROUND)
    FigureCanvasAgg(figure)
    shown = {name: [c for c, _ in enumerate(columns) if _differs(flat[name], columns, c)] for name in rows}
    border = next((name for name in ("capacity_margin", "feasible") if name in flat), "")  # by its zero level or step
    for r, name in enumerate(rows):
        axes = []
        for c in shown[name]:
            ax = figure.add_axes(layout.box(r, c), label="panel")
            ax.set_xlim(left, right)
            ax.set_ylim(low, high)
            below = [later for later in rows[r + 1 :] if c in shown[later]]
            last = layout.lowest(r) or (layout.blocks == 1 and not below)
            _furnish(ax, (horizontal, vertical), last, c == 0)
            axes.append(ax)
        panels = [columns[c].data[name] for c in shown[name]]
        margins = [columns[c].data[border] if border else None for c in shown[name]]
        bar = figure.add_axes(layout.box(r, len(columns)), label="bar")
        _ROWS[name](_Row(figure, axes, bar, panels, margins))
        if name != "feasible":
            for ax, margin in zip(axes, margins, strict=True):
                if margin is not None:
                    _outline_feasible(ax, margin, linestyles="dashed")
        x, y, _, height = layout.box(r, 0)
        _write(
            figure, x - 0.78 / layout.size[0], y + height / 2, TITLES[name], 2, rotation=90, va="center", weight="bold"
        )
        for c in set(range(len(columns))) - set(shown[name]):
            x, y, wide, height = layout.box(r, c)
            same = "rigid cables:\nthe same for every material"
            _write(figure, x + wide / 2, y + height / 3, same, -0.5, va="center", color=style.MAP_MUTED)
    _head(figure, layout, columns)
    _locate(figure, layout, flat, columns, (horizontal, vertical))
    note = ""
    if border and set(rows) != {"feasible"}:
        note = "Dashed: border of the static feasible workspace."
        if border == "capacity_margin" and any(_thin(one.data[border]) for one in columns):
            note = "Green: static feasible workspace, which for an under-actuated robot is a line."
    note = " ".join(filter(None, [note, describe_pretension(dataset)]))
    _say_where(figure, layout, dataset, (normal, horizontal, vertical), note)
    _thin_ticks(figure)
    return figure


def describe_pretension(dataset: xr.Dataset) -> str:
    """The pretension of a sweep's robots as a sentence; "" without any."""
    found = np.atleast_1d(dataset["pretension"].values) if "pretension" in dataset.coords else np.array([])
    known = found[np.isfinite(found)]
    return f"Rest lengths for a pretension of {span(known)} N." if known.size else ""


def _panel_size(slope: float) -> tuple[float, float]:
    """Width and height [inch] of a map whose height over width is ``slope``, with room for its labels."""
    least, most = style.MAP_HEIGHT
    width = float(np.clip(style.MAP_PANEL, least / slope, most / slope))
    width = float(np.clip(width, style.MAP_PANEL / 2, 2 * style.MAP_PANEL))
    return width, max(width * slope, least)


def _differs(values: xr.DataArray, columns: Sequence[Variant], column: int) -> bool:
    """Whether a column differs from the previous one: feasibility with rigid cables does not depend on the material."""
    robots = [one.robot for one in columns]
    return "material" in values.dims or robots.index(robots[column]) == column


def _say_where(figure: Figure, layout: _Layout, dataset: xr.Dataset, axes: tuple[str, str, str], border: str) -> None:
    """Write the range of the poses at the foot of the page."""
    normal, *plane = axes
    sizes = " × ".join(str(dataset.sizes[name]) for name in plane)
    reach = ", ".join(f"{name} = {float(dataset[name][0]):.4g} to {float(dataset[name][-1]):.4g} m" for name in plane)
    section = dataset[normal].attrs.get("section", f"{normal} = {float(dataset[normal][0]):.4g} m")
    exits = ", the exits of the cables" if "exits" in dataset.coords else ""
    sentences = [
        f"All numbers refer to these {sizes} commanded poses: {reach}, {section}.",
        border,
        f"Above: the frame{exits} and, shaded, the region of these poses.",
    ]
    left = 0.3
    text = textwrap.fill(" ".join(filter(None, sentences)), int((layout.size[0] - 2 * left) * style.MAP_LETTERS))
    _write(figure, left / layout.size[0], 0.06 / layout.size[1], text, -0.5, ha="left", color=style.MAP_MUTED)


def _thin_ticks(figure: Figure) -> None:
    """Hide tick labels that would overlap other tick labels."""
    panels = [ax for ax in figure.axes if ax.get_label() == "panel"]
    for ax in panels:
        ax.apply_aspect()
    for name in ("xaxis", "yaxis"):
        kept: list[Any] = []
        for ax in panels:
            axis = getattr(ax, name)
            low, high = axis.get_view_interval()
            axis.get_majorticklabels()  # places them
            for tick in axis.get_major_ticks():
                label: Text = tick.label1
                if not (label.get_visible() and label.get_text() and low <= tick.get_loc() <= high):
                    continue
                box = label.get_window_extent().padded(0.05 * figure.dpi)
                if any(box.overlaps(other) for other in kept):
                    label.set_visible(False)
                else:
                    kept.append(box)


def _plane(dataset: xr.Dataset) -> tuple[str, str, str]:
    """The axis normal to the plane, and the horizontal and vertical axes."""
    across = [name for name in "xyz" if dataset.sizes[name] == 1]
    if len(across) != 1:
        sizes = " x ".join(str(dataset.sizes[name]) for name in "xyz")
        raise InvalidInput(f"map: found a grid of {sizes}, expected a plane: one position along just one of x, y and z")
    horizontal, vertical = (name for name in "xyz" if name != across[0])
    return across[0], horizontal, vertical


class Variant(NamedTuple):
    """Names of a robot and a material, and their part of a dataset."""

    robot: str
    material: str
    data: xr.Dataset


def variants_of(dataset: xr.Dataset) -> list[Variant]:
    """Each robot of a dataset with each material."""
    result = []
    for robot in np.atleast_1d(dataset["robot"].values):
        one = dataset.sel(robot=robot) if "robot" in dataset.dims else dataset
        for material in np.atleast_1d(one["material"].values):
            chosen = one.sel(material=material) if "material" in one.dims else one
            result.append(Variant(str(robot), str(material), chosen))
    return result


def outer_edges(coordinates: np.ndarray) -> tuple[float, float]:
    """Outer edges of the cells that ``pcolormesh`` draws around the coordinates."""
    first, last = coordinates[1] - coordinates[0], coordinates[-1] - coordinates[-2]
    return float(coordinates[0] - first / 2), float(coordinates[-1] + last / 2)


def _furnish(ax: Axes, names: tuple[str, str], lowest: bool, first: bool) -> None:
    """Style of a panel's axes."""
    ax.set_aspect("equal")
    ax.tick_params(labelsize=style.MAP_FONT, colors=style.MAP_FAINT, length=2, labelcolor=style.MAP_INK)
    ax.tick_params(labelbottom=lowest, bottom=lowest, labelleft=first, left=first)
    for axis, name, shown in ((ax.xaxis, names[0], lowest), (ax.yaxis, names[1], first)):
        if shown:
            axis.set_label_text(f"{name} [m]", fontsize=style.MAP_FONT, color=style.MAP_INK)
    ax.spines[:].set(color=style.MAP_FAINT, linewidth=0.6)


def _locate(
    figure: Figure,
    layout: _Layout,
    flat: xr.Dataset,
    columns: Sequence[Variant],
    names: tuple[str, str],
) -> None:
    """Draw frame, exits and the region of the maps above each robot's name; all robots on one scale."""
    from matplotlib.patches import Rectangle

    i, j = ("xyz".index(name) for name in names)
    (x, x_end), (y, y_end) = (outer_edges(flat[name].values) for name in names)
    frames = flat["frame"].values.reshape(-1, 2, 3)
    lower = np.minimum(frames[:, 0].min(0)[[i, j]], (x, y))
    upper = np.maximum(frames[:, 1].max(0)[[i, j]], (x_end, y_end))
    wide, high = np.maximum(upper - lower, 0.02 * (upper - lower).max())
    scale = min(layout.panel[0] / wide, style.MAP_LOCATOR / high)  # inches per metre
    width, height = scale * wide / layout.size[0], scale * high / layout.size[1]
    foot = 1 - (layout.top - 0.8) / layout.size[1]
    for robot, middle in _middles(layout, columns).items():
        one = flat.sel(robot=robot) if "robot" in flat.dims else flat
        ax = figure.add_axes((middle - width / 2, foot, width, height), label="locator")
        ax.set_axis_off()
        ax.set_xlim(lower[0], lower[0] + wide)
        ax.set_ylim(lower[1], lower[1] + high)
        ax.add_patch(Rectangle((x, y), x_end - x, y_end - y, color=style.MAP_LOCATED, linewidth=0, label="maps"))
        corner, size = one["frame"].values[0, [i, j]], np.ptp(one["frame"].values, axis=0)[[i, j]]
        ax.add_patch(
            Rectangle(tuple(corner), *size, fill=False, edgecolor=style.MAP_FAINT, clip_on=False, label="frame")
        )
        if "exits" in one:
            exits = one["exits"].values
            ax.plot(exits[:, i], exits[:, j], "o", markersize=2.6, color=style.MAP_INK, zorder=5, clip_on=False)


def _middles(layout: _Layout, columns: Sequence[Variant]) -> dict[str, float]:
    """Horizontal middle of each robot's columns, in figure coordinates."""
    middles, robots = {}, [one.robot for one in columns]
    for robot in robots:
        first = robots.index(robot)
        start, *_ = layout.box(0, first)
        end, _, width, _ = layout.box(layout.blocks - 1, first + robots.count(robot) - 1)
        middles[robot] = (start + end + width) / 2
    return middles


def _head(figure: Figure, layout: _Layout, columns: Sequence[Variant]) -> None:
    """Write the names of robots above their columns, and of materials below them."""
    _, y, width, height = layout.box(0, 0)
    for c, (_, material, _) in enumerate(columns):
        for block in range(layout.blocks):
            x = layout.box(block, c)[0]
            _write(figure, x + width / 2, y + height + 0.23 / layout.size[1], material, 1)
    for robot, middle in _middles(layout, columns).items():
        _write(figure, middle, y + height + 0.46 / layout.size[1], robot, 4, weight="bold")


def _write(figure: Figure, x: float, y: float, text: str, larger: float, **how: Any) -> None:
    how = {"ha": "center", "va": "bottom", "color": style.MAP_INK} | how
    figure.text(x, y, text, fontsize=style.MAP_FONT + larger, parse_math=False, **how)


def _draw_smooth(row: _Row, factor: float, unit: str, cmap: str) -> None:
    """Draw a continuous quantity: colours on a shared scale, and labelled contours."""
    from matplotlib.colors import ListedColormap, Normalize

    known = [panel.values[np.isfinite(panel.values)] for panel in row.panels]
    largest = max((factor * float(values.max()) for values in known if values.size), default=0.0)
    largest = max(largest, LEAST)  # rounding of poses that are held has no scale of its own
    levels = _round_levels(largest)
    image = None
    for ax, x, y, values in row.each():
        values = values * factor
        finite = np.isfinite(values)
        if not finite.all():
            grey = ListedColormap([style.MAP_UNSOLVED])
            ax.pcolormesh(x, y, np.where(finite, np.nan, 1.0), cmap=grey, shading="nearest", rasterized=True)
        image = ax.pcolormesh(x, y, values, cmap=cmap, norm=Normalize(0, largest), shading="nearest", rasterized=True)
        if finite.any():
            most = float(values[finite].max())
            _note(ax, f"at most {plain(most)}{unit}" if most >= LEAST else f"less than {LEAST:g}{unit}")
        inside = [level for level in levels if finite.any() and values[finite].min() < level < values[finite].max()]
        if inside and min(values.shape) > 1:
            inks = [style.MAP_BACKGROUND if level > 0.45 * largest else style.MAP_INK for level in inside]
            lines = ax.contour(x, y, values, levels=inside, colors=inks, linewidths=0.6)
            size = style.MAP_FONT - 1.5
            places = _label_places(ax, lines, [f"{level:g}" for level in inside], size, (x[[0, -1]], y[[0, -1]]))
            ax.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=size, inline_spacing=2, manual=places)
    _bar(row, image, ticks=[0, *levels])


def _label_places(
    ax: Axes, lines: Any, labels: Sequence[str], size: float, colored: tuple[np.ndarray, np.ndarray]
) -> list[tuple[float, float]]:
    """Positions of contour labels: inside the coloured region, and without overlap."""
    figure = ax.figure
    point = figure.dpi / 72  # type: ignore[union-attr]
    corners = ax.transData.transform(np.transpose(colored))
    taken: list[tuple[np.ndarray, float]] = []
    places = []
    for segments, label in zip(lines.allsegs, labels, strict=True):
        reach = point * size * np.hypot(0.32 * len(label) + 0.2, 0.5)  # half a label's diagonal
        for segment in segments:
            path = ax.transData.transform(segment)
            along = np.append(0.0, np.hypot(*np.diff(path, axis=0).T).cumsum())
            if along[-1] < 4 * reach:
                continue
            inside = ((path - reach > corners[0]) & (path + reach < corners[1])).all(1)
            clear = [all(np.hypot(*(at - other)) > reach + far for other, far in taken) for at in path]
            free = np.flatnonzero(inside & clear)
            if not len(free):
                continue
            middle = free[np.argmin(np.abs(along[free] - along[-1] / 2))]
            taken.append((path[middle], reach))
            places.append(tuple(segment[middle]))
    return places


def _draw_slack(row: _Row) -> None:
    counts = [np.minimum(values, MOST_CABLES) for _, _, _, values in row.each()]
    most = int(max((np.nanmax(count) for count in counts if np.isfinite(count).any()), default=0))
    _draw_discrete(row, counts, style.MAP_SLACK[: most + 1], [str(n) for n in range(most + 1)])


def _draw_feasible(row: _Row) -> None:
    masks = [values.astype(float) for _, _, _, values in row.each()]
    smooth = [margin is not None and margin.dtype != bool and min(margin.shape) > 1 for margin in row.margins]
    colors = [style.MAP_INFEASIBLE, style.MAP_FEASIBLE]
    _draw_discrete(row, [0 * m if s else m for m, s in zip(masks, smooth, strict=True)], colors, ["no", "yes"])
    for (ax, x, y, values), margin, between in zip(row.each(), row.margins, smooth, strict=True):
        share = per_cent(float(values.mean())) + " of the poses"
        if between and margin is not None:
            if _thin(margin):
                share = "only on the line" if values.any() else "none of the poses"
            elif values.any():
                ax.contourf(*_to_edges(x, y, _finite(margin)), levels=[0, np.inf], colors=[style.MAP_FEASIBLE])
            _outline_feasible(ax, margin, linestyles="solid")
        _note(ax, share)


def _draw_outcome(row: _Row) -> None:
    names = row.panels[0].attrs["flag_meanings"].split()
    present = sorted({int(code) for panel in row.panels for code in np.unique(panel.values)})
    codes = [np.searchsorted(present, panel.values).astype(float) for panel in row.panels]
    labels = [names[code].replace("_", "\n", 1).replace("_", " ") for code in present]
    _draw_discrete(row, codes, [style.MAP_OUTCOMES[names[code]] for code in present], labels)


def _draw_error(row: _Row) -> None:
    """Draw the difference of the two methods [mm] on a logarithmic scale."""
    from matplotlib.colors import LogNorm

    errors = [np.ma.masked_invalid(np.where(values > 0, values, np.nan)) * 1e3 for _, _, _, values in row.each()]
    known = [error.compressed() for error in errors if error.count()]
    low = min((error.min() for error in known), default=1e-12)
    high = max((error.max() for error in known), default=1e-6)
    image = None
    for (ax, x, y, _), error in zip(row.each(), errors, strict=True):
        scale = LogNorm(low, max(high, 10 * low))
        image = ax.pcolormesh(x, y, error, cmap=style.MAP_DISTANCE, norm=scale, shading="nearest", rasterized=True)
        if error.count():
            _note(ax, f"at most {power_of_ten(float(error.max()))} mm")
    _bar(row, image)


_ROWS: dict[str, Callable[[_Row], None]] = {
    "tilt": lambda row: _draw_smooth(row, FACTORS["tilt"], "°", style.MAP_TILT),
    "distance": lambda row: _draw_smooth(row, FACTORS["distance"], " mm", style.MAP_DISTANCE),
    "slack_count": _draw_slack,
    "feasible": _draw_feasible,
    "wrench_feasible": lambda row: _draw_feasible(replace(row, margins=row.panels)),
    "outcome": _draw_outcome,
    "position_error": _draw_error,
}


def _draw_discrete(row: _Row, codes: Sequence[np.ndarray], colors: Sequence[str], labels: Sequence[str]) -> None:
    """Draw a colour for each of the codes 0, 1, ..., with names beside the colour bar; grey without a value."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    cmap = ListedColormap(list(colors)).with_extremes(bad=style.MAP_UNSOLVED)
    scale = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    image = None
    for (ax, x, y, _), code in zip(row.each(), codes, strict=True):
        image = ax.pcolormesh(
            x, y, np.ma.masked_invalid(code), cmap=cmap, norm=scale, shading="nearest", rasterized=True
        )
    _bar(row, image, ticks=list(range(len(colors))), labels=labels)


def _outline_feasible(ax: Axes, margin: xr.DataArray, **looks: Any) -> None:
    """Draw the border where the margin is zero, or a mask steps; none where all or no poses are feasible.

    The feasible poses of an under-actuated robot form a line, and are drawn as a line.
    """
    vertical, horizontal = margin.dims
    x, y = margin[horizontal].values, margin[vertical].values
    if margin.dtype == bool:
        values, level = margin.values.astype(float), 0.5
    else:
        values, level = _finite(margin), 0.0
    held = values > level
    if held.all() or not held.any() or min(held.shape) < 2:
        return
    if margin.dtype != bool and _thin(margin):
        for where, (dy, dx) in ((held[1:] & held[:-1], (1, 0)), (held[:, 1:] & held[:, :-1], (0, 1))):
            rows, columns = np.nonzero(where)
            ends = [x[columns], x[columns + dx]], [y[rows], y[rows + dy]]
            ax.plot(*ends, color=style.MAP_BORDER, linewidth=1.6, solid_capstyle="butt")
        return
    ax.contour(x, y, values, levels=[level], colors=style.MAP_BORDER, linewidths=1.1, **looks)


def _to_edges(x: np.ndarray, y: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Extend the values to the edges of the outermost cells, half a step beyond the outermost poses."""
    (left, right), (low, high) = outer_edges(x), outer_edges(y)
    return np.array([left, *x, right]), np.array([low, *y, high]), np.pad(values, 1, mode="edge")


def _thin(margin: xr.DataArray) -> bool:
    """Whether the feasible set has no area, since beside it no tensions balance the load."""
    outside = margin.values[~(margin.values >= 0)]
    return bool(outside.size) and bool(np.isneginf(outside).all())


def _finite(margin: xr.DataArray) -> np.ndarray:
    """Replace minus infinity by a large negative number, which puts the zero level next to the finite values."""
    return np.where(np.isneginf(margin.values), -1e9, margin.values)


def _bar(row: _Row, image: Any, *, ticks: list | None = None, labels: Sequence[str] = ()) -> None:
    bar = row.figure.colorbar(image, cax=row.bar, ticks=ticks)
    bar.ax.minorticks_off()
    if labels:
        bar.set_ticklabels(list(labels))
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.ax.tick_params(labelsize=style.MAP_FONT, length=0, labelcolor=style.MAP_INK)


def _note(ax: Axes, text: str) -> None:
    """Write a note above the panel."""
    ax.annotate(
        text, (0.5, 1), (0, 2.5), xycoords="axes fraction", textcoords="offset points", ha="center", va="bottom",
        fontsize=style.MAP_FONT - 1, color=style.MAP_MUTED,
    )  # fmt: skip


def _round_levels(largest: float) -> list[float]:
    """Two to six round levels up to ``largest``, with steps of 1, 2 or 5 times a power of ten."""
    step = 10.0 ** np.floor(np.log10(largest / 3))
    step *= next((m for m in (1, 2, 5) if largest / (m * step) <= 6.5), 10)
    return [float(level) for level in np.arange(1, int(largest / step + 1e-9) + 1) * step]
