"""Maps of a workspace from the datasets of ``sweep`` and ``check``; only contour levels are computed here.

A row for each quantity, on one scale; a column for each robot and material. Panels show the poses of a grid in one
plane of the workspace, with a dashed border around the static feasible workspace; a small picture above each robot's
first column shows their location in the frame, and the exits of the cables.
"""

# pyright: reportArgumentType=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor masked arrays.
from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from cdpr_sim.core.describe import span
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, styled
from cdpr_sim.drawing.readable_numbers import per_cent, plain, power_of_ten

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.contour import QuadContourSet
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec

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
"""Label of a colour bar, by its variable."""

FACTORS = {"tilt": 180 / np.pi, "distance": 1e3}
"""Factors from SI units to those of the titles."""

MOST_CABLES = len(style.MAP_SLACK) - 1
"""Largest number of slack cables with a colour of its own."""

LEAST = 1e-3
"""[°] or [mm] Smaller maxima are given as "less than"."""

SLOPES = 0.3, 2.0
"""Height over width of a panel: to scale in between; that of panels of wider and of higher grids."""

MARGIN = 1.6
"""[inch] About the width of the labels beside panels."""

LOCATOR = 0.5
"""[inch] Height of the picture that locates the maps in the frame."""


class Panel(NamedTuple):
    """One map: its axes, values (vertical, horizontal), and the feasibility margins or None."""

    ax: Axes
    values: xr.DataArray
    margin: xr.DataArray | None

    @property
    def at(self) -> tuple[np.ndarray, np.ndarray]:
        """The poses' coordinates, horizontal and vertical."""
        vertical, horizontal = (self.values[name].values for name in self.values.dims)
        return horizontal, vertical


class Colors(NamedTuple):
    """Of a row: the scale of its colours, ticks and labels of its bar (None: matplotlib's), and contours to label."""

    scale: ScalarMappable
    ticks: Sequence[float] | None = None
    labels: Sequence[str] | None = None
    contours: Sequence[QuadContourSet] = ()


@styled
def draw_elastic_map(dataset: xr.Dataset, *, names: Sequence[str] = ELASTIC) -> Figure:
    """Tilt, deviation, slack cables and feasibility over a plane of the workspace, on shared scales.

    Args:
        dataset: of ``sweep``, with a single coordinate along one of x, y and z. With ``capacity_margin`` in it, the
            border of the feasible workspace is drawn where that is zero, between the poses; without, around them.
        names: the variables to draw, a row each.

    Raises:
        InvalidInput: a dataset that is not a plane, or lacks a variable.
    """
    return _draw(dataset, names, "static equilibria")


@styled
def draw_agreement_map(dataset: xr.Dataset) -> Figure:
    """Outcome of the comparison of MuJoCo and statics, and their difference, over a plane of the workspace.

    Args:
        dataset: a plane of ``check``'s dataset, or the result of its ``across``.

    Raises:
        InvalidInput: a dataset that is not a plane.
    """
    return _draw(dataset, ("outcome", "position_error"), "agreement of MuJoCo and statics")


def write(figure: Figure, path: Path) -> None:
    """Save a map atomically.

    Raises:
        InvalidInput: the file cannot be written; an existing file is unchanged.
    """
    with appearing(path) as (temporary,):
        figure.savefig(temporary, dpi=style.PNG_DPI, format=path.suffix[1:].lower())


def _draw(dataset: xr.Dataset, rows: Sequence[str], what: str) -> Figure:
    for name in rows:
        if name not in dataset:
            raise InvalidInput(f"map: found no variable {name!r} in the dataset, expected one that has it")
    plane = _plane(dataset)
    normal, horizontal, vertical = plane
    flat = dataset.isel({normal: 0}).transpose(..., vertical, horizontal, "axis")
    variants = variants_of(flat)
    region = np.transpose([outer_edges(flat[name].values) for name in plane[1:]])
    border = next((name for name in ("capacity_margin", "feasible") if name in flat), "")  # by its zero level or step

    columns = len(variants) if len(variants) > 1 else min(2, len(rows))
    slope = float(np.clip(np.divide(*np.ptp(region, axis=0)[::-1]), *SLOPES))
    least, most = style.WIDTH / 2 + 1, style.WIDTH if columns > 1 else style.WIDTH / 2 + 1
    width = float(np.clip(MARGIN + columns * style.MAP_HEIGHT / slope, least, most))
    names = " and ".join(dict.fromkeys(one.robot for one in variants))
    if len(variants) == 1:
        names = f"{names}, {variants[0].material}"
    figure = canvas(width, 8.0, f"{names}: {what}", _caption(dataset, plane, rows, variants, border))
    maps = len(rows) * len(variants)
    grid = figure.add_gridspec(-(-maps // columns), columns)
    contours = []
    for row, name in enumerate(rows):
        panels = []
        for column, one in enumerate(variants):
            place = row * len(variants) + column
            ax = figure.add_subplot(grid[divmod(place, columns)], label="panel")
            _furnish(ax, region, plane[1:], lowest=place + columns >= maps, first=place % columns == 0)
            if row == 0 and len(variants) > 1:
                looks = {"xycoords": "axes fraction", "textcoords": "offset points", "weight": "bold"}
                ax.annotate(f"{one.robot}\n{one.material}", (0, 1), (0, 17), **looks, parse_math=False)
            panels.append(Panel(ax, one.data[name], one.data[border] if border else None))
        colors = _COLORED[name](panels)
        _add_bar(figure, panels, colors, TITLES[name])
        contours += [(lines, colors.scale) for lines in colors.contours]
        for one in panels if name != "feasible" else []:
            _outline_feasible(one, linestyles="dashed")
    for column, one in enumerate(variants):
        if column == 0 or one.robot != variants[column - 1].robot:
            _locate(figure.axes[column], one.data, region, plane[1:], above=0.6 if len(variants) > 1 else 0.2)
    _fit_height(figure, grid, slope)
    for lines, scale in contours:
        _label(lines, scale)
    return figure


def _fit_height(figure: Figure, grid: GridSpec, slope: float) -> None:
    """Give the page the height at which its panels have this height over their width."""
    for _ in range(3):  # a bar's width depends on its height
        figure.draw_without_rendering()  # lays it out
        panel = figure.axes[0].get_window_extent()
        figure.set_figheight(figure.get_figheight() + grid.nrows * (panel.width * slope - panel.height) / figure.dpi)
    figure.draw_without_rendering()


def describe_pretension(dataset: xr.Dataset) -> str:
    """The pretension of a sweep's robots as a sentence; "" without any."""
    found = np.atleast_1d(dataset["pretension"].values) if "pretension" in dataset.coords else np.array([])
    known = found[np.isfinite(found)]
    return f"Rest lengths for a pretension of {span(known)} N." if known.size else ""


def _caption(
    dataset: xr.Dataset, plane: Sequence[str], rows: Sequence[str], variants: Sequence[Variant], border: str
) -> str:
    """The range of the poses, and what is drawn on and beside the maps."""
    normal, *along = plane
    sizes = " × ".join(str(dataset.sizes[name]) for name in along)
    reach = ", ".join(f"{name} = {float(dataset[name][0]):.4g} to {float(dataset[name][-1]):.4g} m" for name in along)
    section = dataset[normal].attrs.get("section", f"{normal} = {float(dataset[normal][0]):.4g} m")
    sentences = [f"All numbers refer to these {sizes} commanded poses: {reach}, {section}."]
    if border and set(rows) != {"feasible"}:
        line = any(_thin(one.data[border]) for one in variants)
        green = "Green: static feasible workspace, which for an under-actuated robot is a line."
        sentences.append(green if line else "Dashed: border of the static feasible workspace.")
    if "feasible" in rows:
        sentences.append("Feasible: rigid cables of any material could hold the platform there.")
    exits = ", the exits of the cables" if "exits" in dataset.coords else ""
    sentences.append(f"Above: the frame{exits} and, shaded, the region of these poses.")
    return " ".join(filter(None, [*sentences, describe_pretension(dataset)]))


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


def _furnish(ax: Axes, region: np.ndarray, names: Sequence[str], *, lowest: bool, first: bool) -> None:
    """Limits, ticks and labels; names of axes at the left and at the foot of the page."""
    ax.set(xlim=region[:, 0], ylim=region[:, 1], facecolor=style.MAP_UNSOLVED)
    ax.set_xlabel(f"{names[0]} [m]" if lowest else "")
    ax.set_ylabel(f"{names[1]} [m]" if first else "")
    ax.tick_params(labelbottom=lowest, labelleft=first, length=2)
    ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10], prune="both"))
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10], prune="both"))
    ax.spines[:].set(visible=True, color=style.FAINT)


def _add_bar(figure: Figure, panels: Sequence[Panel], colors: Colors, title: str) -> None:
    bar = figure.colorbar(
        colors.scale, ax=[one.ax for one in panels], ticks=colors.ticks, label=title, aspect=15, pad=0.02
    )
    bar.ax.minorticks_off()
    if colors.labels is not None:
        bar.set_ticklabels(colors.labels)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)


def _label(lines: QuadContourSet, scale: ScalarMappable) -> None:
    """Write the level on each contour, over a gap in it; not where it would leave the panel."""
    panel = lines.axes.get_window_extent()
    for text in lines.clabel(fmt=lambda level: f"{level:g}", fontsize=7.5, inline=False):
        text.set_path_effects([withStroke(linewidth=2.5, foreground=scale.to_rgba(float(text.get_text())))])
        box = text.get_window_extent()
        text.set_visible(panel.x0 < box.x0 and box.x1 < panel.x1 and panel.y0 < box.y0 and box.y1 < panel.y1)


def _locate(ax: Axes, one: xr.Dataset, region: np.ndarray, names: Sequence[str], above: float) -> None:
    """Draw frame, exits and the region of the maps [inch] ``above`` a panel."""
    inches = ax.figure.dpi_scale_trans + ScaledTranslation(0, 1, ax.transAxes)
    picture = ax.inset_axes((0, above, 3 * LOCATOR, LOCATOR), transform=inches, label="locator")
    picture.set(aspect="equal", anchor="SW")
    picture.set_axis_off()
    both = ["xyz".index(name) for name in names]
    frame = one["frame"].values[:, both]
    looks = {"fill": False, "ec": style.MUTED, "lw": style.THIN, "clip_on": False}
    picture.add_patch(Rectangle(region[0], *np.ptp(region, axis=0), fc=style.MAP_LOCATED, lw=0, label="maps"))
    picture.add_patch(Rectangle(frame[0], *np.ptp(frame, axis=0), **looks, label="frame"))
    if "exits" in one:
        picture.plot(*one["exits"].values[:, both].T, "o", ms=2.6, color=style.INK, clip_on=False)
    picture.margins(0)


def _draw_mesh(panels: Sequence[Panel], values: Sequence[np.ndarray], colors: str | ListedColormap, scale: Normalize):
    """Draw a cell for each pose; cells without a value have the panel's own colour."""
    for panel, cells in zip(panels, values, strict=True):
        looks = {"cmap": colors, "norm": scale, "shading": "nearest", "rasterized": True, "zorder": 0.5}
        panel.ax.pcolormesh(*panel.at, np.ma.masked_invalid(cells), **looks)
    return ScalarMappable(scale, colors)


def _largest(values: Sequence[np.ndarray]) -> float:
    """Of all known values; 0 without any."""
    return max((float(known.max()) for one in values if (known := one[np.isfinite(one)]).size), default=0.0)


def _draw_smooth(panels: Sequence[Panel], factor: float, unit: str, cmap: str) -> Colors:
    """Draw a continuous quantity: colours on a shared scale, and labelled contours."""
    values = [factor * one.values.values for one in panels]
    largest = max(_largest(values), LEAST)  # rounding of poses that are held has no scale of its own
    levels, contours = _round_levels(largest), []
    for panel, one in zip(panels, values, strict=True):
        known = one[np.isfinite(one)]
        if not known.size:
            continue
        most = float(known.max())
        _note(panel.ax, f"at most {plain(most)}{unit}" if most >= LEAST else f"less than {LEAST:g}{unit}")
        inside = [level for level in levels if known.min() < level < most]
        if inside and min(one.shape) > 1:
            inks = ["white" if level > 0.45 * largest else style.INK for level in inside]
            lines = panel.ax.contour(*panel.at, one, levels=inside, colors=inks, linewidths=style.HAIR)
            contours.append(lines)
    return Colors(_draw_mesh(panels, values, cmap, Normalize(0, largest)), [0, *levels], None, contours)


def _draw_discrete(
    panels: Sequence[Panel], codes: Sequence[np.ndarray], colors: Sequence[str], labels: Sequence[str]
) -> Colors:
    """Draw a colour for each of the codes 0, 1, ...."""
    scale = BoundaryNorm(np.arange(len(colors) + 1) - 0.5, len(colors))
    return Colors(_draw_mesh(panels, codes, ListedColormap(list(colors)), scale), [*range(len(colors))], labels)


def _draw_slack(panels: Sequence[Panel]) -> Colors:
    counts = [np.minimum(one.values.values, MOST_CABLES) for one in panels]
    most = int(_largest(counts))
    return _draw_discrete(panels, counts, style.MAP_SLACK[: most + 1], [str(n) for n in range(most + 1)])


def _draw_feasible(panels: Sequence[Panel]) -> Colors:
    """Draw the feasible poses and their share; of an under-actuated robot, the line that they form."""
    masks = []
    for one in panels:
        held, line = one.values.values, one.margin is not None and _thin(one.margin)
        masks.append(np.where(line, 0.0, held))
        share = "only on the line" if held.any() else "none of the poses"
        _note(one.ax, share if line else per_cent(float(held.mean())) + " of the poses")
        _outline_feasible(one, linestyles="solid")
    return _draw_discrete(panels, masks, [style.MAP_INFEASIBLE, style.MAP_FEASIBLE], ["no", "yes"])


def _draw_outcome(panels: Sequence[Panel]) -> Colors:
    names = panels[0].values.attrs["flag_meanings"].split()
    present = sorted({int(code) for one in panels for code in np.unique(one.values)})
    codes = [np.searchsorted(present, one.values).astype(float) for one in panels]
    labels = [names[code].replace("_", "\n", 1).replace("_", " ") for code in present]
    return _draw_discrete(panels, codes, [style.MAP_OUTCOMES[names[code]] for code in present], labels)


def _draw_error(panels: Sequence[Panel]) -> Colors:
    """Draw the difference of the two methods [mm] on a logarithmic scale."""
    errors = [np.where(one.values > 0, 1e3 * one.values.values, np.nan) for one in panels]
    for one, error in zip(panels, errors, strict=True):
        if np.isfinite(error).any():
            _note(one.ax, f"at most {power_of_ten(float(np.nanmax(error)))} mm")
    known = np.concatenate([error[np.isfinite(error)] for error in errors])
    low, high = (known.min(), known.max()) if known.size else (1e-12, 1e-6)
    return Colors(_draw_mesh(panels, errors, style.MAP_DISTANCE, LogNorm(low, max(high, 10 * low))))


_COLORED: dict[str, Callable[[Sequence[Panel]], Colors]] = {
    "tilt": lambda panels: _draw_smooth(panels, FACTORS["tilt"], "°", style.MAP_TILT),
    "distance": lambda panels: _draw_smooth(panels, FACTORS["distance"], " mm", style.MAP_DISTANCE),
    "slack_count": _draw_slack,
    "feasible": _draw_feasible,
    "wrench_feasible": lambda panels: _draw_feasible([one._replace(margin=one.values) for one in panels]),
    "outcome": _draw_outcome,
    "position_error": _draw_error,
}


def _outline_feasible(panel: Panel, **looks: Any) -> None:
    """Draw the border where the margin is zero, or a mask steps; none where all or no poses are feasible.

    The feasible poses of an under-actuated robot form a line, and are drawn as a line.
    """
    if panel.margin is None:
        return
    margins = panel.margin.values - 0.5 if panel.margin.dtype == bool else panel.margin.values
    held = margins > 0
    if held.all() or not held.any() or min(held.shape) < 2:
        return
    x, y = panel.at
    if not _thin(panel.margin):  # beside minus infinity, the zero level is next to the finite values
        margins = np.maximum(margins, -1e9)
        panel.ax.contour(x, y, margins, levels=[0], colors=style.MAP_BORDER, linewidths=1.1, **looks)
        return
    for where, (dy, dx) in ((held[1:] & held[:-1], (1, 0)), (held[:, 1:] & held[:, :-1], (0, 1))):
        rows, columns = np.nonzero(where)
        ends = [x[columns], x[columns + dx]], [y[rows], y[rows + dy]]
        panel.ax.plot(*ends, color=style.MAP_BORDER, linewidth=1.6, solid_capstyle="butt")


def _thin(margin: xr.DataArray) -> bool:
    """Whether the feasible set has no area, since beside it no tensions balance the load."""
    outside = margin.values[~(margin.values >= 0)]
    return margin.dtype != bool and bool(outside.size) and bool(np.isneginf(outside).all())


def _note(ax: Axes, text: str) -> None:
    """Write a note above the panel, below what ``_locate`` draws there."""
    ax.set_title(text, fontsize=8, color=style.MUTED, y=1.0, pad=3)


def _round_levels(largest: float) -> list[float]:
    """Two to six round levels up to ``largest``, with steps of 1, 2 or 5 times a power of ten."""
    levels = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(0, largest)
    return [float(level) for level in levels if 0 < level <= largest * (1 + 1e-9)]
