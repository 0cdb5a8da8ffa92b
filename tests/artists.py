"""A figure as text: all that is drawn, in data coordinates, with colours by the names that ``style`` gives them.

With widths of lines, sizes, which is in front, alignments, the grid of panels and the view of axes in space. Nothing in
it depends on the widths of letters, or on where the layout puts what.
"""

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, QuadMesh
from matplotlib.colors import ListedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text
from matplotlib.ticker import FixedFormatter, FuncFormatter
from mpl_toolkits.mplot3d.art3d import Line3D, Line3DCollection, Poly3DCollection, Text3D

from cdpr_sim.drawing import style

NAMES: dict[str, str] = {"#ffffff": "white", "#000000": "black"}
"""Of colours; of a colour with several names, the first in ``style``."""

for _name, _value in vars(style).items():
    if isinstance(_value, str) and _value.startswith("#"):
        NAMES.setdefault(to_hex(_value), _name)
    if isinstance(_value, tuple) and len(_value) == 3 and all(isinstance(one, float) for one in _value):
        NAMES.setdefault(to_hex(_value), _name)
for _name in ("MAP_SLACK", "MAP_OUTCOMES"):
    _many = getattr(style, _name)
    for _key in _many if isinstance(_many, dict) else range(len(_many)):
        NAMES.setdefault(to_hex(_many[_key]), f"{_name}[{_key}]")

MOST = 40
"""Numbers that are written one by one; of more, their count, ends, extremes and sum."""


def by_gid(of: Figure | Axes) -> dict[str, Line2D]:
    """Lines that have an id; of those with the same one, the first."""
    every = [line for ax in (of.axes if isinstance(of, Figure) else [of]) for line in ax.lines]
    return {str(line.get_gid()): line for line in reversed(every) if line.get_gid()}


def color(value: object) -> str:
    """Its name in ``style``, and how opaque it is where it is not."""
    if isinstance(value, str) and value == "none":
        return "none"
    word = to_hex(value, keep_alpha=True)
    if word.endswith("00"):
        return "none"
    return NAMES.get(word[:7], word[:7]) + (f" {int(word[7:], 16) / 255:.2g}" if word[7:] != "ff" else "")


def numbers(values: object) -> str:
    """Six digits of each, or what tells many from others."""
    array = np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)
    flat = array.ravel()
    if flat.size <= MOST:
        return ", ".join(
            " ".join(f"{one:.6g}" for one in row) for row in np.atleast_2d(array).reshape(-1, array.shape[-1])
        )
    known = flat[np.isfinite(flat)]
    shape = " × ".join(map(str, array.shape))
    ends = " ".join(f"{one:.6g}" for one in (flat[0], flat[-1], known.min(), known.max(), known.sum()))
    weighted = known @ np.cos(np.arange(known.size))  # no two numbers may be exchanged
    return f"{shape}, {known.size} known: first, last, least, most, sum {ends}; {weighted:.5g}"


def described(line: Line2D) -> str:
    """By which a reader tells one series from another."""
    how = []
    if line.get_linestyle() != "None":
        how += [color(line.get_color()), str(line._unscaled_dash_pattern[1] or "-"), f"w{line.get_linewidth():g}"]
    if line.get_marker() not in ("None", "", None):
        fill, edge = color(line.get_mfc()), f"{color(line.get_mec())} w{line.get_mew():g}"
        how.append(f"{line.get_marker()} of {edge} in {fill}, size{line.get_ms():g}")
    return ", ".join(how) + in_front(line)


def in_front(one: Artist) -> str:
    """The order of drawing, where it is not the usual one of its kind."""
    return f" z{one.get_zorder():g}" if one.get_zorder() != type(one).zorder else ""


def _line(line: Line2D) -> str:
    data = np.transpose(line.get_data_3d()) if isinstance(line, Line3D) else line.get_xydata()
    how = [described(line)] if described(line) else []
    if not str(line.get_label()).startswith("_"):
        how.append(f"“{line.get_label()}”")
    if line.get_drawstyle() != "default":
        how.append(line.get_drawstyle())
    return f"line {line.get_gid() or ''}: {', '.join(how)}: {numbers(data)}"


def _fill(patch: Patch) -> str:
    edge = f"{color(patch.get_edgecolor())} w{patch.get_linewidth():g}"
    return f"{color(patch.get_facecolor())} in {edge}{patch.get_hatch() or ''}{in_front(patch)}"


def _patch(patch: Patch) -> str:
    ends = patch.get_patch_transform().transform_path(patch.get_path()).vertices
    names = [str(one) for one in (patch.get_gid(), patch.get_label()) if one and not str(one).startswith("_")]
    return f"{' '.join([type(patch).__name__, *names])}: {_fill(patch)}: {numbers(ends)}"


def _mesh(mesh: QuadMesh, ax: Axes) -> str:
    across, up = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    words = f"{mesh.get_cmap().name} from {numbers(mesh.get_clim())}"
    if ax.get_label() == "<colorbar>":
        return f"colours: {words}"
    if isinstance(mesh.get_cmap(), ListedColormap) and mesh.get_cmap().N < 10:
        rows = mesh.to_rgba(np.ma.masked_invalid(mesh.get_array()))
        words = " / ".join(", ".join(map(color, row)) for row in rows)
    return f"mesh over {numbers(across)} and {numbers(up)}: {words}: {numbers(mesh.get_array())}"


def _collection(one: Collection) -> str:
    if isinstance(one, Line3DCollection):
        points = np.concatenate(one._segments3d)
    elif isinstance(one, Poly3DCollection):
        points = np.concatenate([*one._faces])
    else:
        points = np.concatenate([path.vertices for path in one.get_paths()] or [np.empty((0, 2))])
    kind, shown = type(one).__name__, []
    for colors in (one.get_facecolor(), one.get_edgecolor()):
        names = list(dict.fromkeys(map(color, colors)))
        shown.append(" ".join(names) if len(names) < 6 else "several")
    widths = sorted({float(width) for width in np.atleast_1d(one.get_linewidth())})
    shown[-1] += "".join(f" w{width:g}" for width in widths) + in_front(one)
    return f"{kind}: {' in '.join(shown)}: {numbers(points) if len(points) else 'nothing'}"


def _text(text: Text, ax: Axes) -> str:
    if isinstance(text, Text3D):
        at = numbers(text.get_position_3d())
    elif isinstance(text, Annotation):
        at = f"{numbers(text.get_position())} {text.anncoords} of {numbers(text.xy)} {text.xycoords}"
    else:
        at = numbers(text.get_position()) + (" of axes" if text.get_transform() == ax.transAxes else "")
    return f"text “{text.get_text()}” {lettered(text)}: {at}"


def lettered(text: Text) -> str:
    """Colour, size, which point of it is placed, and what is unusual."""
    how = f"{color(text.get_color())} size{text.get_fontsize():g} {text.get_ha()} {text.get_va()}{in_front(text)}"
    how += f" {text.get_weight()}" if text.get_weight() != "normal" else ""
    how += f" turned {text.get_rotation():g}°" if text.get_rotation() else ""
    box = text.get_bbox_patch()
    return how + (f" on {_fill(box)}" if box is not None else "")


def key_of(artist: Artist) -> str:
    """What stands beside a word of a legend; "" for nothing."""
    if isinstance(artist, Line2D):
        return described(artist)
    return _fill(artist) if isinstance(artist, Patch) else type(artist).__name__


def _legend(one: Legend) -> Iterator[str]:
    yield f"legend at {one._loc}, {one._ncols} columns, size{one.get_texts()[0].get_fontsize():g}{in_front(one)}"
    for word, artist in zip(one.get_texts(), one.legend_handles, strict=True):
        yield f"  “{word.get_text()}”: {key_of(artist)}"


def _axis(ax: Axes, name: str) -> str:
    axis = getattr(ax, f"{name}axis")
    low, high = getattr(ax, f"get_{name}lim")()
    words = f"{name}: “{axis.get_label_text()}” {low:.5g} to {high:.5g} {axis.get_scale()}"
    if isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter):
        ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=False)
        words += "".join(f"; {at:.5g} “{label.get_text()}”" for at, label in ticks)
    return words


def _placed(ax: Axes) -> Iterator[str]:
    """Its place among the panels, its title's size, its aspect, its frame, and from where it is seen."""
    if (spec := ax.get_subplotspec()) is not None:
        grid = spec.get_gridspec()
        ratios = [[f"{one:.5g}" for one in some] for some in (grid.get_width_ratios(), grid.get_height_ratios())]
        yield f"rows {spec.rowspan.start}-{spec.rowspan.stop}, columns {spec.colspan.start}-{spec.colspan.stop}"
        yield f"of {' '.join(ratios[0])} × {' '.join(ratios[1])},"
    elif ax.get_axes_locator() is None:
        yield f"at {numbers(ax.get_position().bounds)},"
    yield f"aspect {ax.get_aspect()}"
    yield from (
        f"{text.get_va()} size{text.get_fontsize():g}" for text in (ax.title, ax._left_title) if text.get_text()
    )
    if ax.name == "3d":
        yield f"from {ax.elev:g}° {ax.azim:g}°, box {numbers(ax._box_aspect)}"
    else:
        yield "".join(side[0] for side, spine in ax.spines.items() if spine.get_visible())


def _axes(ax: Axes) -> Iterator[str]:
    titles = " / ".join(filter(None, (ax.get_title(where) for where in ("left", "center"))))
    ground = color(ax.get_facecolor())
    yield f"AXES {ax.get_label() or ''} {titles}{'' if ground == 'white' else f', on {ground}'}"
    yield " ".join(_placed(ax))
    if getattr(ax, "_axis3don", ax.axison):
        yield from (_axis(ax, name) for name in ("xyz" if ax.name == "3d" else "xy"))
    yield from map(_line, ax.lines)
    yield from map(_patch, ax.patches)
    yield from (_mesh(one, ax) if isinstance(one, QuadMesh) else _collection(one) for one in ax.collections)
    for image in ax.images:
        if image.get_array().ndim == 3:  # a ray-cast picture, whose scene is reviewed in ``snapshots/film/``
            yield f"picture of {' × '.join(map(str, image.get_array().shape))} over {numbers(image.get_extent())}"
            continue
        limits = f"{numbers(image.get_extent())} {image.origin} {image.get_cmap().name} {numbers(image.get_clim())}"
        yield f"image {limits}: {numbers(image.get_array())}"
    labels = [text for one in ax.collections for text in getattr(one, "labelTexts", ())]
    yield from (_text(text, ax) for text in ax.texts if text not in labels)
    for table in ax.tables:
        cells = table.get_celld()
        for row in sorted({row for row, _ in cells}):
            yield "row " + " | ".join(cells[place].get_text().get_text() for place in sorted(cells) if place[0] == row)
    if ax.get_legend() is not None:
        yield from _legend(ax.get_legend())
    for inset in ax.child_axes:
        yield "inset"
        yield from _axes(inset)


def text_of(figure: Figure) -> str:
    """All of it; words without their line breaks, which depend on the width of letters."""
    lines = [figure.get_suptitle(), figure.get_supxlabel()]
    others = [text for text in figure.texts if text.get_text() not in lines]
    lines += [f"{numbers(figure.get_size_inches().round(1))} inches"]  # a map fits its height to its letters
    lines += [f"text “{text.get_text()}” {lettered(text)}: {numbers(text.get_position())}" for text in others]
    for one in figure.legends:
        lines += _legend(one)
    for ax in figure.axes:
        lines += ["", *_axes(ax)]
    return "\n".join(line.replace("\n", " ") for line in lines)
