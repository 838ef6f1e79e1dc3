# SPDX-License-Identifier: MIT
"""Things that happen every so often in simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable

TICK_S = 0.01
"""Step of simulated time; every rhythm is kept to the tick."""


class Rhythm:
    """Something that happens every so often; never with rate 0.

    Parameters
    ----------
    rate_hz
        How often, Hz; not more than once a tick.
    act
        What happens.
    first_tick
        When it happens for the first time.
    """

    def __init__(self, rate_hz: float, act: Callable[[], None], first_tick: int = 0) -> None:
        self._period = 1.0 / (rate_hz * TICK_S) if rate_hz > 0.0 else math.inf
        self._count, self._first = 0, first_tick
        self.due: float = first_tick if rate_hz > 0.0 else math.inf
        """The tick at which it happens next."""
        self.act = act

    def advance(self) -> None:
        """Note that it has happened."""
        self._count += 1
        self.due = max(self._first + round(self._count * self._period), int(self.due) + 1)
