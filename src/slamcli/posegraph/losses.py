# SPDX-License-Identifier: MIT
"""How much a residual counts: robust losses, and graduated non-convexity on top of two of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError

Floats = NDArray[np.float64]
Kind = Literal["none", "huber", "cauchy", "geman_mcclure", "tolerant", "truncated"]
GRADUATED: tuple[Kind, ...] = ("geman_mcclure", "truncated")
FACTOR = 1.4  # by which the surrogate sharpens in each round (Yang et al., remark 5)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """A robust loss of a whole residual's squared norm s; the cost of a graph is half the sum of the losses.

    ============== ==================================================== ==========================
    kind           loss, with c = `scale`                               source
    ============== ==================================================== ==========================
    none           s                                                    least squares
    huber          s up to c², then 2 c √s - c²                         Huber 1964
    cauchy         c² log(1 + s / c²)                                   Holland and Welsch 1977
    geman_mcclure  c² s / (c² + s)                                      Geman and McClure 1985
    tolerant       b log(1 + e^((s - a) / b)) - b log(1 + e^(-a / b)),  Ceres Solver, TolerantLoss
                   with a = `scale`, b = `sharpness`
    truncated      min(s, c²)                                           Yang et al. 2020
    ============== ==================================================== ==========================

    With `graduated` (geman_mcclure and truncated only) the optimisation begins with a convex surrogate and sharpens it
    round by round, so that it does not need a start near the minimum to tell outliers [1]_; c is then the largest norm
    of a residual that is still believed.

    References
    ----------
    .. [1] H. Yang, P. Antonante, V. Tzoumas, L. Carlone: Graduated Non-Convexity for Robust Spatial Perception, IEEE
       RA-L 2020, doi:10.1109/LRA.2020.2965893.
    """

    kind: Kind = "none"
    scale: float = 1.0
    sharpness: float = 1.0
    graduated: bool = False

    def __post_init__(self) -> None:
        if not (self.scale > 0 and self.sharpness > 0):
            raise ConfigError(
                f"scale and sharpness of a loss must be positive, not {self.scale:g} and {self.sharpness:g}"
            )
        if self.graduated and self.kind not in GRADUATED:
            raise ConfigError(f"a {self.kind} loss cannot be graduated; {' and '.join(GRADUATED)} can")

    def values(self, squares: Floats, surrogate: float = 1.0) -> Floats:
        """Return the losses float64 (N,) of squared norms float64 (N,); `surrogate` as in :meth:`weights`."""
        c2 = self.scale**2
        match self.kind:
            case "none":
                return squares
            case "huber":
                return np.where(squares <= c2, squares, 2 * self.scale * np.sqrt(squares) - c2)
            case "cauchy":
                return c2 * np.log1p(squares / c2)
            case "geman_mcclure":
                return surrogate * c2 * squares / (surrogate * c2 + squares)
            case "tolerant":
                a, b = self.scale, self.sharpness
                return b * (np.logaddexp(0.0, (squares - a) / b) - np.logaddexp(0.0, -a / b))
            case "truncated":
                if np.isinf(surrogate):
                    return np.minimum(squares, c2)
                low, high = _truncation(c2, surrogate)
                middle = 2 * self.scale * np.sqrt(squares * surrogate * (surrogate + 1)) - surrogate * (c2 + squares)
                return np.where(squares <= low, squares, np.where(squares >= high, c2, middle))

    def weights(self, squares: Floats, surrogate: float = 1.0) -> Floats:
        """Return the derivatives of the losses by the squared norms, float64 (N,): 1 where a residual counts fully.

        `surrogate` is the control parameter mu of the graduated losses ([1]_, examples 3 and 4): for geman_mcclure it
        falls to 1, for truncated it grows; 1 is the loss itself for geman_mcclure, infinity for truncated.
        """
        c2 = self.scale**2
        match self.kind:
            case "none":
                return np.ones_like(squares)
            case "huber":
                return np.where(squares <= c2, 1.0, self.scale / np.sqrt(np.maximum(squares, c2)))
            case "cauchy":
                return 1.0 / (1.0 + squares / c2)
            case "geman_mcclure":
                return (surrogate * c2 / (surrogate * c2 + squares)) ** 2
            case "tolerant":
                return np.exp(-np.logaddexp(0.0, (self.scale - squares) / self.sharpness))
            case "truncated":
                if np.isinf(surrogate):
                    return np.where(squares <= c2, 1.0, 0.0)
                low, high = _truncation(c2, surrogate)
                inner = self.scale * np.sqrt(surrogate * (surrogate + 1) / np.maximum(squares, low)) - surrogate
                return np.where(squares <= low, 1.0, np.where(squares >= high, 0.0, inner))

    def surrogates(self, largest_square: float) -> list[float]:
        """Return the control parameters of the rounds, convex first, for residuals of at most `largest_square`."""
        c2 = self.scale**2
        if not self.graduated:
            return [np.inf if self.kind == "truncated" else 1.0]
        if self.kind == "geman_mcclure":
            start = max(2 * largest_square / c2, 1.0)
            count = int(np.ceil(np.log(start) / np.log(FACTOR)))
            return [*(start / FACTOR**i for i in range(count)), 1.0]
        if 2 * largest_square <= c2:
            return [np.inf]
        start = c2 / (2 * largest_square - c2)  # remark 5
        count = int(np.ceil(np.log(max(1e3 / start, 1.0)) / np.log(FACTOR)))
        return [*(start * FACTOR**i for i in range(count)), np.inf]


def _truncation(c2: float, surrogate: float) -> tuple[float, float]:
    """Squares up to which a residual counts fully, and from which it does not count at all ([1], equation 14)."""
    return surrogate / (surrogate + 1) * c2, (surrogate + 1) / surrogate * c2
