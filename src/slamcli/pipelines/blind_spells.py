# SPDX-License-Identifier: MIT
"""Times in which a range sensor saw nothing at all, said aloud."""

from __future__ import annotations

import numpy as np

from slamcli.measurements import LaserScan, PointCloud
from slamcli.runtime import RunLog

_LONG_S = 1.0


class BlindSpells:
    """Watches the range sensors of a recording for sweeps without any distance."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._began: dict[str, int] = {}
        self._num: dict[str, int] = {}
        self._spells: dict[str, list[tuple[int, int]]] = {}

    def see(self, sweep: LaserScan | PointCloud) -> None:
        """Take the next sweep; stamps that run backwards lengthen nothing."""
        points = np.isfinite(sweep.ranges_m).any() if isinstance(sweep, LaserScan) else len(sweep.points_m) > 0
        began = self._began.get(sweep.topic)
        if not points:
            self._num[sweep.topic] = self._num.get(sweep.topic, 0) + 1
            if began is None:
                self._began[sweep.topic] = sweep.stamp_ns
                self._spells.setdefault(sweep.topic, []).append((sweep.stamp_ns, sweep.stamp_ns))
        elif began is not None:
            del self._began[sweep.topic]
        if began is not None:
            first, last = self._spells[sweep.topic][-1]
            self._spells[sweep.topic][-1] = (first, max(last, sweep.stamp_ns))

    def tell(self) -> None:
        """Write into the log how many sweeps held nothing, and warn of more than a second of them."""
        for topic, spells in self._spells.items():
            self._log.counts[f"{topic}: sweeps without any distance"] = self._num[topic]
            long = [(first, last) for first, last in spells if last - first > _LONG_S * 1e9]
            if long:
                first, last = max(long, key=lambda spell: spell[1] - spell[0])
                times = "once" if len(long) == 1 else f"{len(long)} times"
                self._log.warn(
                    f"{topic} sees nothing for more than a second {times}, the longest for {(last - first) / 1e9:.1f} s from "
                    f"{first / 1e9:.3f} s: other sensors alone tell the motion there"
                )
