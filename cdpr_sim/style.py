"""Colours, widths and sizes of everything that is drawn, in one place."""

from __future__ import annotations

# ---------------------------------------------------------------------------------------------------------- FIGURES
# Hues are Okabe and Ito's, told apart by colour-blind readers (https://jfly.uni-koeln.de/color); every series differs
# from its neighbours in line style or marker as well, for grey print.

INK, MUTED, FAINT = "#1a1a1a", "#666666", "#cccccc"
BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7"

LEFT, RIGHT = BLUE, VERMILLION
"""Cables whose exits lie left and right of the frame's middle."""

PLATFORM, COMMANDED, SLACK_CABLE = "#9dbfd6", "#8a8a8a", VERMILLION
"""Fill of a platform at rest; outline of the pose that it was commanded to; a slack cable."""

COMMANDED_DASH, SLACK_DASH = (0, (2.5, 1.5)), (0, (1, 1.2))

ZONES = (("#fbeebc", ""), ("#f3cdbf", "///"))
"""(fill, hatch) where fewer, and where more, cables are slack: the paper's yellow and red."""

ZONE_HATCH = "#dba998"

STIFFNESS_MAP = "cividis"
"""Soft to stiff: perceptually uniform, the same to colour-blind readers, monotonic in grey."""

LINE, THIN, HAIR = 1.8, 1.0, 0.6
"""Line widths [points]: a result, a cable, a help line."""

POINT = 5.0
"""Size of MuJoCo's points [points]: hollow, so that the line under them shows."""

DARK, LIGHT = {"lw": 1.4, "zorder": 3}, {"lw": 3.8, "zorder": 2}
"""Two series that may lie on each other: a thin dark line on a broad light one."""

DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2)), (0, (6, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v")

REPORTED = {"color": INK, "lw": 3.0, "solid_capstyle": "butt", "zorder": 7}
"""What others report."""

PNG_DPI = 110

RC = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": False,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": LINE,
    "lines.markersize": POINT,
    "hatch.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "cdpr-sim",  # the same data gives the same file
}
"""matplotlib's settings for all figures, used in a context and never left behind."""

TITLE = {"fontsize": 13, "fontweight": "bold", "ha": "left", "x": 0.012}
CAPTION = {"fontsize": 8.5, "color": MUTED, "ha": "left", "x": 0.012, "linespacing": 1.35}
TITLE_LETTERS, CAPTION_LETTERS = 8.8, 15.2
"""How many letters of title and caption fit into an inch."""
