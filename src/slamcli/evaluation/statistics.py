# SPDX-License-Identifier: MIT
"""Figures that sum up a column of errors."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamcli.errors import EstimationError


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of errors, in the unit of the errors (`sse`: squared)."""

    rmse: float
    """Root of the mean square."""
    mean: float
    median: float
    std: float
    """Standard deviation about the mean, of the errors themselves (divided by N)."""
    min: float
    max: float
    sse: float
    """Sum of squares."""
    count: int

    @classmethod
    def of(cls, errors: ArrayLike) -> Statistics:
        """Return the statistics of errors (N,).

        Raises
        ------
        EstimationError
            If there are no errors.

        Examples
        --------
        >>> Statistics.of([3.0, 4.0]).rmse ** 2
        12.5
        """
        e = np.asarray(errors, dtype=np.float64)
        if not e.size:
            raise EstimationError("no errors to sum up")
        squares = e * e
        return cls(
            rmse=float(np.sqrt(squares.mean())),
            mean=float(e.mean()),
            median=float(np.median(e)),
            std=float(e.std()),
            min=float(e.min()),
            max=float(e.max()),
            sse=float(squares.sum()),
            count=e.size,
        )

    def as_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)

    def figures(self, name: str) -> dict[str, float]:
        """Return the figures by the keys that a threshold can be set on: ``name.rmse`` and so on, without the count."""
        return {f"{name}.{key}": value for key, value in self.as_dict().items() if key != "count"}
