"""Maps of a workspace: small multiples of what ``sweep`` and ``check`` found. Nothing is computed here but levels.

A row for each quantity, on one scale; a column for each robot and material. Panels lie in one plane of the workspace,
seen with the frame around it, the exits of the cables, and a dashed border around what rigid cables could hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing
from cdpr_sim.drawing import style

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg", ".pdf")
"""Of the files that a map can be written to."""

MOST_CABLES = len(style.MAP_SLACK) - 1
"""Slack cables told apart by colour; more look alike."""


LEAST = 1e-3
"""Degrees or millimetres: less is not told apart in small print."""


@dataclass(frozen=True)
class _Layout:
    """Where things go on the page, in inches."""

    rows: int
    columns: int
    panel: tuple[float, float]
    left: float = 1.0
    right: float = 0.85
    top: float = 0.8
    bottom: float = 0.6
    gap: float = 0.14
    bar: float = 0.11

    @property
    def size(self) -> tuple[float, float]:
        width, height = self.panel
        return (
            self.left + self.columns * (width + self.gap) + self.right,
            self.top + self.rows * (height + self.gap) + self.bottom,
        )

    def box(self, row: int, column: int) -> tuple[float, float, float, float]:
        """The panel's place on the page, as matplotlib wants it; one column too far: the colour bar's."""
        (width, height), (page_width, page_height) = self.panel, self.size
        x = self.left + column * (width + self.gap)
        y = page_height - self.top - row * (height + self.gap) - height
        wide = width if column < self.columns else self.bar
        return x / page_width, y / page_height, wide / page_width, height / page_height


@dataclass(frozen=True)
class _Row:
    """One quantity over all columns: where it is drawn, and its values, (vertical, horizontal) each."""

    figure: Figure
    axes: Sequence[Axes]
    bar: Axes
    panels: Sequence[xr.DataArray]

    def each(self) -> Any:
        """(axes, x, y, values) of each panel."""
        for ax, panel in zip(self.axes, self.panels, strict=True):
            vertical, horizontal = panel.dims
            yield ax, panel[horizontal].values, panel[vertical].values, panel.values


ELASTIC = ("tilt", "distance", "slack_count", "feasible")
"""What an elastic map shows, a row each."""


def draw_elastic_map(dataset: xr.Dataset, *, names: Sequence[str] = ELASTIC) -> Figure:
    """Tilt, deviation, slack cables and feasibility over a plane of the workspace, on shared scales.

    Args:
        dataset: of ``sweep``, with a single coordinate along one of x, y and z.
        names: the variables to draw, a row each.

    Raises:
        InvalidInput: a dataset that is not a plane, or lacks a variable.
    """
    return _draw(dataset, {name: _ELASTIC[name] for name in names})


def draw_agreement_map(dataset: xr.Dataset) -> Figure:
    """Where MuJoCo and statics agree, and how well, over a plane of the workspace.

    Args:
        dataset: a plane of ``check``'s dataset, or what its ``across`` gives.

    Raises:
        InvalidInput: a dataset that is not a plane.
    """
    return _draw(dataset, {"outcome": _draw_outcome, "position_error": _draw_error})


def write(figure: Figure, path: Path) -> None:
    """Save a map: whole or not at all.

    Raises:
        InvalidInput: the file cannot be written; what was there is still there.
    """
    with appearing(path) as (temporary,):
        figure.savefig(temporary, dpi=style.PNG_DPI, format=path.suffix[1:].lower())


def _draw(dataset: xr.Dataset, rows: dict[str, Callable[[_Row], str]]) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    for name in rows:
        if name not in dataset:
            raise InvalidInput(f"map: found no variable {name!r} in the dataset, expected one that has it")
    normal, horizontal, vertical = _plane(dataset)
    flat = dataset.isel({normal: 0}).transpose(..., vertical, horizontal, "axis")
    columns = _columns(flat)
    i, j = "xyz".index(horizontal), "xyz".index(vertical)
    low, high = _extent(flat)
    width = style.MAP_PANEL
    layout = _Layout(len(rows), len(columns), (width, width * (high[j] - low[j]) / (high[i] - low[i])))
    figure = Figure(figsize=layout.size, facecolor=style.MAP_BACKGROUND)
    FigureCanvasAgg(figure)
    for r, (name, draw) in enumerate(rows.items()):
        axes = []
        for c, (_, choice) in enumerate(columns):
            ax = figure.add_axes(layout.box(r, c), label="panel")
            ax.set_xlim(low[i], high[i])
            ax.set_ylim(low[j], high[j])
            _furnish(ax, flat.sel(choice), (horizontal, vertical), r == len(rows) - 1, c == 0)
            axes.append(ax)
        panels = [flat[name].sel({k: v for k, v in choice.items() if k in flat[name].dims}) for _, choice in columns]
        bar = figure.add_axes(layout.box(r, len(columns)), label="bar")
        title = draw(_Row(figure, axes, bar, panels))
        if name != "feasible" and "feasible" in flat:
            for ax, (_, choice) in zip(axes, columns, strict=True):
                _outline_feasible(ax, flat["feasible"].sel({k: v for k, v in choice.items() if k != "material"}))
        x, y, _, height = layout.box(r, 0)
        _write(figure, x * 0.22, y + height / 2, title, 2, rotation=90, va="center", weight="bold")
    _head(figure, layout, [names for names, _ in columns])
    where = dataset[normal].attrs.get("section", f"{normal} = {float(dataset[normal][0]):.4g} m")
    if "feasible" in flat and set(rows) != {"feasible"}:
        where += "   dashed: border of the static feasible workspace"
    _write(figure, layout.box(0, 0)[0], 0.08 / layout.size[1], where, 0, ha="left", color=style.MAP_FAINT)
    return figure


def _plane(dataset: xr.Dataset) -> tuple[str, str, str]:
    """The axis that the map looks along, and those to the right and up."""
    across = [name for name in "xyz" if dataset.sizes[name] == 1]
    if len(across) != 1:
        sizes = " x ".join(str(dataset.sizes[name]) for name in "xyz")
        raise InvalidInput(f"map: found a grid of {sizes}, expected a plane: one position along just one of x, y and z")
    horizontal, vertical = (name for name in "xyz" if name != across[0])
    return across[0], horizontal, vertical


def _columns(flat: xr.Dataset) -> list[tuple[tuple[str, str], dict[str, str]]]:
    """Per column, its robot and material in words, and how it is selected."""
    result = []
    for robot in np.atleast_1d(flat["robot"].values):
        for material in np.atleast_1d(flat["material"].values) if "material" in flat.coords else [""]:
            choice = {k: v for k, v in (("robot", robot), ("material", material)) if k in flat.dims}
            result.append(((str(robot), str(material)), choice))
    return result


def _extent(flat: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Two corners of the box around all frames and the grid, and a little more."""
    frames = flat["frame"].values.reshape(-1, 2, 3)
    low, high = frames[:, 0].min(0), frames[:, 1].max(0)
    for i, name in enumerate("xyz"):
        low[i], high[i] = min(low[i], float(flat[name].min())), max(high[i], float(flat[name].max()))
    margin = 0.02 * (high - low).max()
    return low - margin, high + margin


def _furnish(ax: Axes, one: xr.Dataset, names: tuple[str, str], lowest: bool, first: bool) -> None:
    """The frame's outline, the exits, and quiet axes."""
    from matplotlib.patches import Rectangle

    i, j = ("xyz".index(name) for name in names)
    (x0, y0), (x1, y1) = one["frame"].values[:, [i, j]]
    ax.add_patch(
        Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor=style.MAP_FAINT, linewidth=1.2, label="frame")
    )
    if "exits" in one:
        exits = one["exits"].values
        ax.plot(exits[:, i], exits[:, j], "o", markersize=2.6, color=style.MAP_INK, zorder=5, clip_on=False)
    ax.set_aspect("equal")
    ax.tick_params(labelsize=style.MAP_FONT, colors=style.MAP_FAINT, length=2, labelcolor=style.MAP_INK)
    ax.tick_params(labelbottom=lowest, bottom=lowest, labelleft=first, left=first)
    for axis, name, shown in ((ax.xaxis, names[0], lowest), (ax.yaxis, names[1], first)):
        if shown:
            axis.set_label_text(f"{name} [m]", fontsize=style.MAP_FONT, color=style.MAP_INK)
    for spine in ax.spines.values():
        spine.set_visible(False)


def _head(figure: Figure, layout: _Layout, columns: Sequence[tuple[str, str]]) -> None:
    """Robots over their columns, materials below them."""
    robots = [robot for robot, _ in columns]
    above = 0.32 if any(material for _, material in columns) else 0.1
    for c, (robot, material) in enumerate(columns):
        x, y, width, height = layout.box(0, c)
        _write(figure, x + width / 2, y + height + 0.07 / layout.size[1], material, 1)
        if robots.index(robot) == c:
            end = layout.box(0, c + robots.count(robot) - 1)[0] + width
            _write(figure, (x + end) / 2, y + height + above / layout.size[1], robot, 4, weight="bold")


def _write(figure: Figure, x: float, y: float, text: str, larger: int, **how: Any) -> None:
    how = {"ha": "center", "va": "bottom", "color": style.MAP_INK} | how
    figure.text(x, y, text, fontsize=style.MAP_FONT + larger, **how)


def _draw_smooth(row: _Row, factor: float, cmap: str) -> None:
    """A quantity that varies smoothly: colours on a shared scale, and contours with their values."""
    from matplotlib.colors import ListedColormap, Normalize

    known = [panel.values[np.isfinite(panel.values)] for panel in row.panels]
    largest = max((factor * float(values.max()) for values in known if values.size), default=0.0) or 1e-12
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
            _note(ax, f"at most {most:.2g}" if most >= LEAST else f"less than {LEAST:g}")
        inside = [level for level in levels if finite.any() and values[finite].min() < level < values[finite].max()]
        if inside and min(values.shape) > 1:
            inks = [style.MAP_BACKGROUND if level > 0.45 * largest else style.MAP_INK for level in inside]
            lines = ax.contour(x, y, values, levels=inside, colors=inks, linewidths=0.6)
            ax.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=style.MAP_FONT - 1.5, inline_spacing=2)
    _bar(row, image, ticks=[0, *levels])


def _draw_tilt(row: _Row) -> str:
    _draw_smooth(row, 180 / np.pi, style.MAP_TILT)
    return "tilt [°]"


def _draw_distance(row: _Row) -> str:
    _draw_smooth(row, 1e3, style.MAP_DISTANCE)
    return "deviation [mm]"


def _draw_slack(row: _Row) -> str:
    counts = [np.minimum(values, MOST_CABLES) for _, _, _, values in row.each()]
    most = int(max((np.nanmax(count) for count in counts if np.isfinite(count).any()), default=0))
    _draw_discrete(row, counts, style.MAP_SLACK[: most + 1], [str(n) for n in range(most + 1)])
    return "slack cables"


def _draw_feasible(row: _Row) -> str:
    masks = [values.astype(float) for _, _, _, values in row.each()]
    _draw_discrete(row, masks, [style.MAP_INFEASIBLE, style.MAP_FEASIBLE], ["no", "yes"])
    for ax, mask in zip(row.axes, masks, strict=True):
        _note(ax, f"{100 * mask.mean():.0f} %")
    return "feasible"


_ELASTIC: dict[str, Callable[[_Row], str]] = {
    "tilt": _draw_tilt,
    "distance": _draw_distance,
    "slack_count": _draw_slack,
    "feasible": _draw_feasible,
}


def _draw_outcome(row: _Row) -> str:
    words = row.panels[0].attrs["flag_meanings"].split()
    present = sorted({int(code) for panel in row.panels for code in np.unique(panel.values)})
    codes = [np.searchsorted(present, panel.values).astype(float) for panel in row.panels]
    labels = [words[code].replace("_", "\n", 1).replace("_", " ") for code in present]
    _draw_discrete(row, codes, [style.MAP_OUTCOMES[words[code]] for code in present], labels)
    return "outcome"


def _draw_error(row: _Row) -> str:
    """Millimetres over many powers of ten."""
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
            _note(ax, f"at most {error.max():.0e}")
    _bar(row, image)
    return "apart by [mm]"


def _draw_discrete(row: _Row, codes: Sequence[np.ndarray], colors: Sequence[str], labels: Sequence[str]) -> None:
    """A colour for each of the codes 0, 1, ..., and their names beside the bar; grey where there is none."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    cmap = ListedColormap(list(colors)).with_extremes(bad=style.MAP_UNSOLVED)
    scale = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    image = None
    for (ax, x, y, _), code in zip(row.each(), codes, strict=True):
        image = ax.pcolormesh(
            x, y, np.ma.masked_invalid(code), cmap=cmap, norm=scale, shading="nearest", rasterized=True
        )
    _bar(row, image, ticks=list(range(len(colors))), labels=labels)


def _outline_feasible(ax: Axes, mask: xr.DataArray) -> None:
    """A dashed border; none where all or nothing is feasible."""
    vertical, horizontal = mask.dims
    values = mask.values.astype(float)
    if values.min() < values.max() and min(values.shape) > 1:
        x, y = mask[horizontal].values, mask[vertical].values
        ax.contour(x, y, values, levels=[0.5], colors=style.MAP_BORDER, linewidths=1.1, linestyles="dashed")


def _bar(row: _Row, image: Any, *, ticks: list | None = None, labels: Sequence[str] = ()) -> None:
    bar = row.figure.colorbar(image, cax=row.bar, ticks=ticks)
    bar.ax.minorticks_off()
    if labels:
        bar.set_ticklabels(list(labels))
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.ax.tick_params(labelsize=style.MAP_FONT, length=0, labelcolor=style.MAP_INK)


def _note(ax: Axes, text: str) -> None:
    """Small print at the top, between the exits."""
    ax.text(
        0.5, 0.955, text, transform=ax.transAxes, ha="center", va="top", fontsize=style.MAP_FONT - 1, zorder=6,
        color=style.MAP_MUTED, bbox={"facecolor": style.MAP_BACKGROUND, "edgecolor": "none", "alpha": 0.7, "pad": 1},
    )  # fmt: skip


def _round_levels(largest: float) -> list[float]:
    """Two to six round numbers up to ``largest``, 1, 2 or 5 times a power of ten apart."""
    step = 10.0 ** np.floor(np.log10(largest / 3))
    step *= next((m for m in (1, 2, 5) if largest / (m * step) <= 6.5), 10)
    return [float(level) for level in np.arange(1, int(largest / step + 1e-9) + 1) * step]
