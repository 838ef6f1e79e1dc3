# SPDX-License-Identifier: MIT
"""Round numbers for axes, and the colours that all figures share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Okabe and Ito's palette: told apart with every common colour blindness. doi:10.1038/nmeth.1618
BLUE = (0, 114, 178)
ORANGE = (230, 159, 0)
GREEN = (0, 158, 115)
VERMILION = (213, 94, 0)
PURPLE = (204, 121, 167)
SKY = (86, 180, 233)

# Anchors of matplotlib's "plasma" between 0.05 and 0.82, whose lightness rises evenly; its yellow end would vanish on white.
_TIME = np.array([(41, 5, 147), (114, 1, 168), (164, 35, 148), (202, 71, 120), (229, 107, 93), (249, 149, 65)], float)


def time_colours(fraction: ArrayLike) -> NDArray[np.float64]:
    """Return colours (N, 3), 0 to 255, of fractions (N,) of the time, from dark blue (0) to orange (1)."""
    f = np.clip(np.asarray(fraction, dtype=np.float64), 0.0, 1.0) * (len(_TIME) - 1)
    return np.column_stack([np.interp(f, np.arange(len(_TIME)), _TIME[:, i]) for i in range(3)])


def tick_step(span: float, count: int) -> float:
    """Return the step of the form 1, 2 or 5 times a power of ten that gives at most about `count` ticks over `span`.

    Examples
    --------
    >>> tick_step(37.0, 8)
    5.0
    """
    if not (math.isfinite(span) and span > 0):
        return 1.0
    rough = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    return next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough * (1 - 1e-9))


def ticks(low: float, high: float, count: int) -> list[float]:
    """Return round numbers between `low` and `high`, about `count` of them.

    Examples
    --------
    >>> ticks(-0.3, 2.1, 5)
    [0.0, 0.5, 1.0, 1.5, 2.0]
    """
    return multiples(low, high, tick_step(high - low, count))


def multiples(low: float, high: float, step: float) -> list[float]:
    """Return the multiples of `step` between `low` and `high`, a thousand at most."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{i * step:.12g}") + 0.0 for i in range(first, min(last, first + 999) + 1)]


def number(value: float) -> str:
    """Return a tick's label: no trailing zeros, a real minus sign.

    Examples
    --------
    >>> number(-2.50)
    '−2.5'
    """
    label = f"{value:.10g}"
    return label.replace("-", "−")


def duration(seconds: float) -> str:
    """Return a time span for a person.

    Examples
    --------
    >>> duration(2691.2), duration(75.04), duration(3.21)
    ('44 min 51 s', '75 s', '3.2 s')
    """
    if seconds < 10:
        return f"{seconds:.2g} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 120:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
