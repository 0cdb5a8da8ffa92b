"""Colours, line widths and sizes of all figures and videos."""

from __future__ import annotations

# ---------------------------------------------------------------------------------------------------------- FIGURES
# Hues are Okabe and Ito's, distinguishable by colour-blind readers (https://jfly.uni-koeln.de/color); series
# also differ in line style or marker, for print in grey.

INK, MUTED, FAINT = "#1a1a1a", "#666666", "#cccccc"
BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7"

LEFT, RIGHT = BLUE, VERMILLION
"""Cables whose exits lie left and right of the frame's middle."""

PLATFORM, COMMANDED, SLACK_CABLE = "#9dbfd6", "#8a8a8a", VERMILLION
"""Fill of a platform at equilibrium; outline of the commanded pose; a slack cable."""

CABLES = (BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, INK, MUTED)
"""Colours of cables; their numbers are written beside them."""

WHEEL = {"fc": "#e9e9e9", "ec": MUTED, "lw": 0.6}
"""The wheel of a pulley."""

COMMANDED_DASH, SLACK_DASH = (0, (2.5, 1.5)), (0, (1, 1.2))

ZONES = (("#fbeebc", ""), ("#f3cdbf", "///"))
"""(fill, hatch) of zones with fewer and with more slack cables: the paper's yellow and red."""

ZONE_HATCH = "#dba998"

STIFFNESS_MAP = "cividis"
"""Soft to stiff: perceptually uniform, also for colour-blind readers, and monotonic in grey."""

LINE, THIN, HAIR = 1.8, 1.0, 0.6
"""Line widths [points]: a result, a cable, a help line."""

POINT = 5.0
"""Size of MuJoCo's points [points]: hollow, so that the line under them shows."""

DARK, LIGHT = {"lw": 1.4, "zorder": 3}, {"lw": 3.8, "zorder": 2}
"""Two series that may coincide: a thin dark line on a wide light one."""

DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2)), (0, (6, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v")

REPORTED = {"color": INK, "lw": 3.0, "solid_capstyle": "butt", "zorder": 7}
"""Values reported in the paper."""

PNG_DPI = 110

WIDTH = 9.0
"""[inch] Width of a figure on a page of the manual, which shows it with about 100 pixels per inch."""

RC = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",  # included in matplotlib: the same on every machine
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
    "svg.hashsalt": "cdpr-sim",  # the same data give the same file
}
"""matplotlib's settings for all figures, applied in a context only."""

TITLE = {"fontsize": 13, "fontweight": "bold", "ha": "left", "x": 0.012}
CAPTION = {"fontsize": 8.5, "color": MUTED, "ha": "left", "x": 0.012, "linespacing": 1.35}
TITLE_LETTERS, CAPTION_LETTERS = 8.8, 15.2
"""Characters per inch of title and caption."""


# ------------------------------------------------------------------------------------------------------------- MAPS
# Elastic maps over the workspace.
MAP_HEIGHT = 4.5
"""Largest height of a panel [inch]."""

MAP_LOCATED, MAP_UNSOLVED = "#c9d6e2", "#d8d8d8"
"""The region of the maps in the frame; and poses without an equilibrium."""

MAP_TILT, MAP_DISTANCE = "magma_r", "YlGnBu"
"""Colour maps of tilt and of deviation: dark is large."""

MAP_SLACK = ["#f4f1de", "#f2d492", "#f2a65a", "#e5734a", "#c8443c", "#96263a", "#641236", "#3d0a2c", "#1c0517"]
"""No cable slack, one, two, ...: from pale to dark."""

MAP_FEASIBLE, MAP_INFEASIBLE = "#58a55c", "#ececec"
"""The static feasible workspace, green as in the paper's Fig. 10 and 11, and its outside."""

MAP_BORDER = "#2c7a3f"
"""Its border in other panels, dashed."""

MAP_OUTCOMES = {
    "agree": "#2f83c5",
    "agree_except_neutral": "#9fd3f2",
    "different_equilibria": "#f0b429",
    "disagree": "#a31d00",
    "unsettled": "#6b3d63",
    "unsolved": "#1a1a1a",
    "refused": "#d8d8d8",
}
"""Outcomes of the comparison at a pose: blue where the methods agree, warm where they differ, dark without a result."""

# ------------------------------------------------------------------------------------------------------------ VIDEO
Color = tuple[float, float, float]
"""sRGB, 0 to 1."""

# What is in the scene; widths are fractions of the frame's diagonal.

PLATFORM_COLOR: Color = (0.16, 0.38, 0.62)
"""The platform in MuJoCo."""

COMMANDED_COLOR: Color = (0.10, 0.10, 0.14)
"""Commanded pose: translucent platform and path."""

GHOST_ALPHA = 0.20
GHOST_SIZE = 0.985
"""Size relative to the platform, so that the platform is visible if both coincide."""

PATH_ALPHA = 0.35
PATH_RADIUS = 0.0013
TRAIL_RADIUS = 0.0018

STATIC_COLOR: Color = (1.0, 0.80, 0.15)
"""Outline of the static solver's pose."""

STATIC_RADIUS = 0.0011

SHADOW_ALPHA = 0.09

CABLE_RADIUS = 0.0022
SLACK_COLOR: Color = (0.90, 0.24, 0.05)
"""A slack cable: vermilion, which is outside the tension scale, also for colour-blind viewers."""

SLACK_SHINE = 6.0
"""Emission of a slack cable relative to its diffuse colour; one lamp contributes a seventh."""

TENSION_MAP = "viridis"
"""Perceptually uniform; only its darker part is used, which contrasts with the pale floor."""

TENSION_RANGE = (0.58, 0.0)
"""Range of the colour map, from no tension (teal) to the largest (deep purple)."""

# The camera: degrees, and the fraction of the picture that the robot's frame fills.

AZIMUTH, ELEVATION, FIELD_OF_VIEW, FILL = 102.0, -12.0, 22.0, 0.94
CLOSE_UP = 2.3
"""Height of the close-up, in diagonals of the platform."""

STILL_PLATFORM_ALPHA = 0.45
"""Of the platform in the close-up of a still, which shows all anchors."""

STILL_THICKEST = 0.03
"""Largest radius of cables and anchors in the close-up, in diagonals of the platform."""

SUPERSAMPLING = 2
"""Rays or fragments per pixel and axis. MuJoCo's own multisampling and shadows cost software OpenGL much more."""

SLICES, STACKS, QUADS = 12, 6, 12
"""Resolution of MuJoCo's round shapes and chains; its default 28 and 16 is slower in software OpenGL."""

# The page around it; sizes are fractions of its shorter side.

PAGE_PAPER: Color = (1.0, 1.0, 1.0)
PAGE_INK: Color = (0.11, 0.12, 0.14)
PAGE_FAINT: Color = (0.42, 0.44, 0.48)
PAGE_RULE: Color = (0.84, 0.86, 0.88)
TITLE_HEIGHT, TEXT_HEIGHT, LABEL_HEIGHT, NUMBER_HEIGHT = 0.038, 0.027, 0.0245, 0.042
"""Font sizes: title, text, labels and large numbers."""

LEAST_HEIGHT = 10
"""[pixel] Smallest legible font size."""
# ------------------------------------------------------------------------------------------------ end of VIDEO -------
