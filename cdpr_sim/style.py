"""Colours, widths and scales of everything that is drawn, in one place. Colours are sRGB, 0 to 1."""

from __future__ import annotations

Color = tuple[float, float, float]

# ---------------------------------------------------------------------------------------------------- VIDEO ----------

# What is in the scene; widths are fractions of the frame's diagonal.

PLATFORM_COLOR: Color = (0.16, 0.38, 0.62)
"""Where the platform is, in MuJoCo."""

COMMANDED_COLOR: Color = (0.10, 0.10, 0.14)
"""Where it was commanded: the ghost and the path."""

GHOST_ALPHA = 0.20
GHOST_SIZE = 0.985
"""Of the platform's, so that where they coincide the platform is what is seen."""

PATH_ALPHA = 0.35
PATH_RADIUS = 0.0013
TRAIL_RADIUS = 0.0018

STATIC_COLOR: Color = (1.0, 0.80, 0.15)
"""Outline of the static solver's pose."""

STATIC_RADIUS = 0.0011

SHADOW_ALPHA = 0.09

CABLE_RADIUS = 0.0022
SLACK_COLOR: Color = (0.90, 0.24, 0.05)
"""A slack cable: vermilion, which no tension has, nor is it mistaken for one in any common colour blindness."""

TENSION_MAP = "viridis"
"""Perceptually uniform; only its darker part is used, which stands out from the pale floor."""

TENSION_RANGE = (0.58, 0.0)
"""Of the map, from no tension (teal) to the largest (deep purple)."""

# The camera: degrees, and the fraction of the picture that the robot's frame fills.

AZIMUTH, ELEVATION, FIELD_OF_VIEW, FILL = 102.0, -12.0, 22.0, 0.94
CLOSE_UP = 2.3
"""Height of the close-up, in diagonals of the platform."""

SUPERSAMPLING = 2
"""Rays or fragments per pixel and axis. MuJoCo's own multisampling and shadows cost software OpenGL a factor of 8."""

SLICES, STACKS, QUADS = 12, 6, 12
"""Of MuJoCo's round shapes and chains; its default 28 and 16 cost software OpenGL a factor of 4."""

# The page around it; sizes are fractions of its shorter side.

PAGE_PAPER: Color = (1.0, 1.0, 1.0)
PAGE_INK: Color = (0.11, 0.12, 0.14)
PAGE_FAINT: Color = (0.42, 0.44, 0.48)
PAGE_RULE: Color = (0.84, 0.86, 0.88)
TITLE_HEIGHT, TEXT_HEIGHT, LABEL_HEIGHT, NUMBER_HEIGHT = 0.038, 0.027, 0.0245, 0.042
"""Heights of type: title, text, labels, and the numbers to be read at a glance."""

LEAST_HEIGHT = 10
"""[pixel] Smaller type cannot be read."""
# ------------------------------------------------------------------------------------------------ end of VIDEO -------
