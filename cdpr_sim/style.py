"""Colours, widths and scales of everything that is drawn."""

# MAPS: elastic maps over the workspace (maps.py)
MAP_PANEL = 2.6
"""Width of a panel [inch]."""

MAP_INK, MAP_MUTED, MAP_FAINT = "#22303c", "#5d6974", "#8b97a3"
"""Text and contours; small print; outlines and ticks."""

MAP_BACKGROUND, MAP_UNSOLVED = "#ffffff", "#d8d8d8"
"""The page; and poses without an equilibrium."""

MAP_TILT, MAP_DISTANCE = "magma_r", "viridis_r"
"""Colour maps of tilt and of deviation: dark is bad."""

MAP_SLACK = ["#f4f1de", "#f2d492", "#f2a65a", "#e5734a", "#c8443c", "#96263a", "#641236", "#3d0a2c", "#1c0517"]
"""No cable slack, one, two, ...: from pale to dark."""

MAP_FEASIBLE, MAP_INFEASIBLE = "#58a55c", "#ececec"
"""The static feasible workspace, green as in the paper's Fig. 10 and 11, and what is outside it."""

MAP_BORDER = "#2c7a3f"
"""Its border in other panels, dashed."""

MAP_OUTCOMES = {
    "agree": "#58a55c",
    "agree_but_free": "#a8d5a2",
    "different_equilibria": "#f2a65a",
    "disagree": "#c8443c",
    "unsettled": "#7b3fa0",
    "unsolved": "#3f51a0",
    "refused": "#d8d8d8",
}
"""What checking a pose came to."""

MAP_FONT = 8
"""Size of ticks and contour labels [pt]; titles are larger by up to 3."""
