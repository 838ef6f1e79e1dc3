# SPDX-License-Identifier: MIT
"""How short a path can be: lengths over free cells at any angle, to judge the paths of planners."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _shortest_kernels as kernels
from slamcli.navigation.costmap import INSCRIBED, NO_INFORMATION


class _Window(Protocol):
    """What is read of a `CostWindow`."""

    @property
    def costs(self) -> NDArray[np.uint8]: ...
    @property
    def origin_m(self) -> tuple[float, float]: ...
    @property
    def resolution_m(self) -> float: ...


class ShortestField:
    """Lengths of the shortest paths for the inflated robot from one start to any goal.

    A path may use every point of a cell below 253 (and of unknown cells with `allow_unknown`), touch the edges of others, and
    turn anywhere: costs do not matter. No straight line slips between two blocked cells that touch by their corners,
    but a path that turns in that very corner does, which planners may not: there lengths are too short, never too long. It is Theta* over the corners of cells (Nash et al. 2007) without a goal and with
    corners taken up again when they get nearer: each length belongs to a path that exists, so it is never below the optimum.
    Held against visibility graphs in the tests: equal on inflated maps (0.1 % at most), up to 3 % above it in clutter of
    single cells.

    Parameters
    ----------
    window
        A `CostWindow`, or anything with its `costs`, `origin_m` and `resolution_m`; copied, so it may change.
    start
        x, y (more is ignored), metres, in the window's frame.
    goal
        Only this goal is asked for: the search stops when it is reached.
    """

    def __init__(
        self,
        window: _Window,
        start: Sequence[float],
        goal: Sequence[float] | None = None,
        *,
        allow_unknown: bool = False,
    ) -> None:
        free = window.costs < INSCRIBED
        if allow_unknown:
            free |= window.costs == NO_INFORMATION
        self._origin = np.array(window.origin_m, dtype=np.float64)
        self._resolution_m = window.resolution_m
        self._width = window.costs.shape[1] + 2
        bordered = np.pad(free, 1)
        self._start = self._point(start)
        # The robot stands there: its own cell is free, whatever the costmap says (as for planners).
        if self._inside(self._start, free.shape):
            bordered[int(self._start[1]), int(self._start[0])] = True
        self._free = bordered.reshape(-1)
        self._reached = np.full(self._free.size, np.inf)
        self._roots = np.zeros(self._free.size, dtype=np.int64)
        self._shape = free.shape
        self._only = None if goal is None else self._point(goal)
        self._length = math.inf
        if self._usable(self._start) and (self._only is None or self._usable(self._only)):
            target = self._start if self._only is None else self._only
            self._length = kernels.spread(
                self._free, self._width, self._start, target, self._only is not None, self._reached, self._roots
            )

    def length(self, goal: Sequence[float]) -> float:
        """Return the length in metres to a goal x, y; inf if no path leads there."""
        point = self._point(goal)
        if self._only is not None and np.array_equal(point, self._only):
            return float(self._length) * self._resolution_m
        if not self._usable(self._start) or not self._usable(point):
            return math.inf
        cells = kernels.length_to(self._free, self._width, self._start, point, self._reached, self._roots)
        return float(cells) * self._resolution_m

    def _point(self, point: Sequence[float]) -> NDArray[np.float64]:
        """Return x, y in cells from the lower left corner of the border."""
        return (np.array(point[:2], dtype=np.float64) - self._origin) / self._resolution_m + 1.0

    def _usable(self, point: NDArray[np.float64]) -> bool:
        return self._inside(point, self._shape) and bool(self._free[int(point[1]) * self._width + int(point[0])])

    def _inside(self, point: NDArray[np.float64], shape: tuple[int, ...]) -> bool:
        return bool(np.isfinite(point).all() and 1 <= point[0] < shape[1] + 1 and 1 <= point[1] < shape[0] + 1)


def shortest_length(
    window: _Window, start: Sequence[float], goal: Sequence[float], *, allow_unknown: bool = False
) -> float:
    """Return the length in metres of the shortest any-angle path over cells below 253; inf if there is none.

    For many goals from one start build a `ShortestField` instead.
    """
    return ShortestField(window, start, goal, allow_unknown=allow_unknown).length(goal)


def warm() -> None:
    """Compile the kernels of this module."""
    free = np.ones((6, 6), dtype=np.bool_)
    free[[0, -1]] = free[:, [0, -1]] = free[2, 3] = False
    cells, reached, roots = free.reshape(-1), np.full(36, np.inf), np.zeros(36, dtype=np.int64)
    start, goal = np.array([1.5, 1.5]), np.array([4.5, 4.5])
    kernels.spread(cells, 6, start, goal, False, reached, roots)
    kernels.length_to(cells, 6, start, goal, reached, roots)
