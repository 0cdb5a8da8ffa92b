"""Tolerances within which two methods agree on an equilibrium."""

POSITION_TOLERANCE = 1e-6
"""[m] A thousandth of a millimetre. DemoBot's settled poses are 1e-9 m from the solver's at most
(``scripts/dev/measure_constants.py``), where a residual of 1e-9 of the weight meets the softest stiffness (a
few N/m)."""

ROTATION_TOLERANCE = 1e-5
"""[rad]"""

TENSION_TOLERANCE = 1e-3
"""[N]"""
