"""Number formats for figures, without exponents such as 1.7e+02."""

from __future__ import annotations

import math

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain(value: float) -> str:
    """Two significant digits, or all digits before the point: 0.062, 3.8, 41, 170, 12,000."""
    return f"{value:,.0f}" if abs(value) >= 99.5 else f"{value:.2g}"


def power_of_ten(value: float) -> str:
    """The next power of ten above: 10⁻⁷ for 8e-8."""
    return "10" + f"{math.ceil(math.log10(value) - 1e-9)}".translate(_SUPERSCRIPTS) if value > 0 else "0"


def exponent(value: float) -> str:
    """The next power of ten above, as on a keyboard: 1e-7 for 8e-8."""
    return f"1e{math.ceil(math.log10(value)):d}"


def per_cent(share: float) -> str:
    """A share in per cent; 100 and 0 are used for all and none only."""
    if share in (0, 1):
        return f"{100 * share:.0f} %"
    return f"{min(max(100 * share, 0.1), 99.9):.{0 if 0.995 <= 100 * share < 99.5 else 1}f} %"
