"""A figure as text: all that is drawn, in data coordinates, with colours by the names that ``style`` gives them.

Nothing in it depends on fonts or on where things are put on the page.
"""

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PolyCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter
from mpl_toolkits.mplot3d.art3d import Line3D, Line3DCollection, Poly3DCollection, Text3D

from cdpr_sim.drawing import style

NAMES: dict[str, str] = {"#ffffff": "white", "#000000": "black"}
"""Of colours; of a colour with several names, the first in ``style``."""

for _name, _value in vars(style).items():
    if isinstance(_value, str) and _value.startswith("#"):
        NAMES.setdefault(to_hex(_value), _name)

MOST = 40
"""Numbers that are written one by one; of more, their count, ends, extremes and sum."""


def looks(artist: Artist) -> tuple:
    """By which a reader tells one series from another."""
    if isinstance(artist, Line2D):
        return to_hex(artist.get_color()), artist.get_linestyle(), str(artist.get_marker())
    assert isinstance(artist, Patch)
    return to_hex(artist.get_facecolor(), keep_alpha=True), to_hex(artist.get_edgecolor())


def legend(of: Figure | Axes) -> dict[str, Artist]:
    """What stands before each of its words."""
    (one,) = of.legends if isinstance(of, Figure) else [of.get_legend()]
    return dict(zip([text.get_text() for text in one.get_texts()], one.legend_handles, strict=True))


def by_gid(of: Figure | Axes) -> dict[str, Line2D]:
    """Lines that have an id; of those with the same one, the last."""
    axes = of.axes if isinstance(of, Figure) else [of]
    return {str(line.get_gid()): line for ax in axes for line in ax.lines if line.get_gid()}


def color(value: object) -> str:
    """Its name in ``style``, and how opaque it is where it is not."""
    if isinstance(value, str) and value == "none":
        return "none"
    word = to_hex(value, keep_alpha=True)  # type: ignore[arg-type]
    if word.endswith("00"):
        return "none"
    return NAMES.get(word[:7], word[:7]) + (f" {int(word[7:], 16) / 255:.2g}" if word[7:] != "ff" else "")


def numbers(values: object) -> str:
    """Six digits of each, or what tells many from others."""
    array = np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)
    flat = array.ravel()
    if flat.size <= MOST:
        return ", ".join(" ".join(f"{one:.6g}" for one in row) for row in np.atleast_2d(array).reshape(-1, array.shape[-1]))
    known = flat[np.isfinite(flat)]
    shape = " × ".join(map(str, array.shape))
    ends = " ".join(f"{one:.6g}" for one in (flat[0], flat[-1], known.min(), known.max(), known.sum()))
    weighted = known @ np.cos(np.arange(known.size))  # no two numbers may be exchanged
    return f"{shape}, {known.size} known: first, last, least, most, sum {ends}; {weighted:.5g}"


def _line(line: Line2D) -> str:
    data = np.transpose(line.get_data_3d()) if isinstance(line, Line3D) else line.get_xydata()
    how = [color(line.get_color())]
    if line.get_linestyle() != "None":
        how.append(str(line._unscaled_dash_pattern[1] or "-"))  # type: ignore[attr-defined]
    if line.get_marker() not in ("None", "", None):
        how.append(f"{line.get_marker()} of {color(line.get_mec())} in {color(line.get_mfc())}")
    if not str(line.get_label()).startswith("_"):
        how.append(f"“{line.get_label()}”")
    if line.get_drawstyle() != "default":
        how.append(line.get_drawstyle())
    return f"line {line.get_gid() or ''}: {', '.join(how)}: {numbers(data)}"


def _fill(patch: Patch) -> str:
    return f"{color(patch.get_facecolor())} in {color(patch.get_edgecolor())}{patch.get_hatch() or ''}"


def _patch(patch: Patch) -> str:
    ends = patch.get_patch_transform().transform_path(patch.get_path()).vertices
    label = "" if str(patch.get_label()).startswith("_") else f" “{patch.get_label()}”"
    return f"{type(patch).__name__} {patch.get_gid() or ''}{label}: {_fill(patch)}: {numbers(ends)}"


def _collection(one: Collection) -> str:
    if isinstance(one, Line3DCollection):
        points = np.concatenate(one._segments3d)  # type: ignore[attr-defined]
    elif isinstance(one, Poly3DCollection):
        points = np.concatenate([*one._faces])  # type: ignore[attr-defined]
    elif isinstance(one, QuadMesh):
        points = one.get_coordinates()
    else:
        points = np.concatenate([path.vertices for path in one.get_paths()] or [np.empty((0, 2))])
    if isinstance(one, QuadMesh):
        words = f"{one.get_cmap().name} {numbers(one.get_clim())}: {numbers(one.get_array())}"
    else:
        both = one.get_facecolor(), one.get_edgecolor()
        words = " in ".join(" ".join(dict.fromkeys(map(color, colors))) for colors in both)
    kind = type(one).__name__ if isinstance(one, PolyCollection) else type(one).__name__.lstrip("_")
    return f"{kind}: {words}: {numbers(points) if len(points) else 'nothing'}"


def _text(text: Text, ax: Axes) -> str:
    at = ""
    if isinstance(text, Text3D):
        at = numbers(text.get_position_3d())
    elif hasattr(text, "xy") and getattr(text, "xycoords", "data") == "data":
        at = numbers(text.xy)  # type: ignore[attr-defined]
    elif text.get_transform() == ax.transData and not hasattr(text, "xy") and ax.name != "3d":
        at = numbers(text.get_position())
    return f"text “{text.get_text()}” {color(text.get_color())} {at}"


def _legend(one: Legend) -> Iterator[str]:
    for word, artist in zip(one.get_texts(), one.legend_handles, strict=True):
        if isinstance(artist, Line2D):
            how = _line(artist).split(": ")[1]
            how = how.split(", “")[0]
        else:
            how = _fill(artist) if isinstance(artist, Patch) else type(artist).__name__
        yield f"  “{word.get_text()}”: {how}"


def _axis(ax: Axes, name: str) -> str:
    axis = getattr(ax, f"{name}axis")
    low, high = getattr(ax, f"get_{name}lim")()
    words = f"{name}: “{axis.get_label_text()}” {low:.5g} to {high:.5g} {axis.get_scale()}"
    formatter = axis.get_major_formatter()
    if isinstance(formatter, FixedFormatter):
        ticks = zip(axis.get_majorticklocs(), formatter.seq, strict=False)
        words += "".join(f"; {at:.5g} “{label}”" for at, label in ticks)
    return words


def _axes(ax: Axes) -> Iterator[str]:
    titles = " / ".join(filter(None, (ax.get_title(loc) for loc in ("left", "center"))))
    yield f"AXES {'' if ax.get_label() in ('', None) else ax.get_label()} {titles}"
    if ax.axison:
        yield from (_axis(ax, name) for name in ("xyz" if ax.name == "3d" else "xy"))
    for line in ax.lines:
        yield _line(line)
    for patch in ax.patches:
        yield _patch(patch)
    for one in ax.collections:
        yield _collection(one)
    for image in ax.images:
        limits = f"{numbers(image.get_extent())} {image.origin} {image.get_cmap().name} {numbers(image.get_clim())}"
        yield f"image {limits}: {numbers(image.get_array())}"
    for text in ax.texts:
        yield _text(text, ax)
    for table in ax.tables:
        cells = table.get_celld()
        for row in sorted({row for row, _ in cells}):
            yield "row " + " | ".join(cells[place].get_text().get_text() for place in sorted(cells) if place[0] == row)
    if ax.get_legend() is not None:
        yield "legend"
        yield from _legend(ax.get_legend())
    for inset in ax.child_axes:
        yield "inset"
        yield from _axes(inset)


def text_of(figure: Figure) -> str:
    """All of it; words without their line breaks, which depend on the width of letters."""
    lines = [figure.get_suptitle(), figure.get_supxlabel()]
    lines += [f"text “{text.get_text()}” {color(text.get_color())}" for text in figure.texts if text not in (figure._suptitle, figure._supxlabel)]  # type: ignore[attr-defined]
    for one in figure.legends:
        lines += ["legend", *_legend(one)]
    for ax in figure.axes:
        lines += ["", *_axes(ax)]
    return "\n".join(line.replace("\n", " ") for line in lines)
