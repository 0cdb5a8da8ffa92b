"""The common layout of figures: title, caption, legends, style, and their files."""

# pyright: reportArgumentType=false, reportCallIssue=false
# matplotlib's stubs know no keyword dictionaries.
from __future__ import annotations

import functools
import io
import textwrap
from collections.abc import Callable, Sequence
from typing import ParamSpec

import matplotlib
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D

from cdpr_sim.drawing import style
from cdpr_sim.drawing.lettering import in_legible_letters

P = ParamSpec("P")


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator: draw in the package's style, and leave the caller's matplotlib settings unchanged."""

    @in_legible_letters
    @functools.wraps(draw)
    def in_style(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(style.RC)
            return draw(*args, **kwargs)

    return in_style


def canvas(width: float, height: float, title: str, caption: str, kind: type[Figure] = Figure) -> Figure:
    """A figure [inch] with a title above and a caption below."""
    figure = kind(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.06)  # type: ignore[union-attr]
    figure.suptitle(textwrap.fill(title, int(width * style.TITLE_LETTERS)), **style.TITLE)
    figure.supxlabel(textwrap.fill(caption, int(width * style.CAPTION_LETTERS)), **style.CAPTION)
    for text in figure.texts:
        text.set_parse_math(False)  # names and descriptions may contain any characters
    return figure


def encoded(figure: Figure, kind: str = "png") -> bytes:
    """The figure as a file's content, "png" or "svg", reproducible: no dates, no versions, no random ids."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(style.RC):  # type: ignore[arg-type]
        if kind == "svg":
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": "cdpr-sim"})
        else:
            figure.set_dpi(style.PNG_DPI)
            FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": "cdpr-sim"})
    return buffer.getvalue()


def key(label: str, **looks) -> Line2D:
    """Legend entry of a line or of markers."""
    return Line2D([], [], label=label, **looks)


def legend_above(figure: Figure, handles: Sequence[Artist], columns: int, share: float = 0.04) -> SubplotSpec:
    """Place a legend under the title, on this share of the figure's height; return the place of the rest."""
    top, rest = figure.add_gridspec(2, 1, height_ratios=(share, 1))
    ax = figure.add_subplot(top, label="legend")
    ax.set_axis_off()
    ax.legend(handles=handles, loc="center left", ncols=columns, borderaxespad=0)
    return rest
