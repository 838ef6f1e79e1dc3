# SPDX-License-Identifier: MIT
"""The player's time, and the statistics of the steps over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.pipelines.replay import Replay
from slamcli.reports.step_charts import series


@dataclass(frozen=True, slots=True)
class PlayerClock:
    """Seconds since the first pose, never running backwards: a clock that did waits until it has caught up."""

    began_ns: int

    def of(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times (N,) of stamps (N,)."""
        return np.maximum.accumulate(np.asarray(stamps_ns, dtype=np.int64) - self.began_ns) / 1e9

    def order(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the places (N,) of stamps (N,) in the order of time."""
        return np.argsort(stamps_ns, kind="stable")


def add_charts(
    replay: Replay, clock: PlayerClock, arrays: dict[str, NDArray[Any]]
) -> tuple[list[dict[str, Any]], dict[str, list[float]]]:
    """Add the statistics of the steps; return how they are drawn, and the marks for the time line."""
    written = replay.run.get("steps")
    columns = written if isinstance(written, dict) else {}
    steps = {name: _column(values) for name, values in columns.items() if isinstance(values, list)}
    if not len(steps.get("stamp_ns", ())) or steps["stamp_ns"].dtype.kind != "i":
        return [], {}
    times = clock.of(steps["stamp_ns"])
    charts, marks = [], {}
    for number, one in enumerate(series(steps)):
        names = {"time": "step_time", "values": f"step_{number}"}
        arrays["step_time"], arrays[names["values"]] = times, one.values.astype(np.float32)
        if one.marks is not None and one.marks.any():
            names["marks"] = f"step_{number}_marks"
            arrays[names["marks"]] = times[one.marks]
        charts.append({
            "title": one.title, "unit": one.unit, "caption": one.caption, "from_zero": one.from_zero, **names,
        })  # fmt: skip
    for kind, name, value in (("resampling", "resampled", 1), ("lost", "tracked", 0)):
        column = steps.get(name)
        if column is not None and column.shape == times.shape:
            marks[kind] = times[column == value].round(3).tolist()
    return charts, marks


def _column(values: list[Any]) -> NDArray[Any]:
    """Return a column of the record as an array: int64 where all are whole numbers, else float64, NaN where there is none."""
    if all(type(value) is int for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([float(v) if isinstance(v, (int, float)) else np.nan for v in values], dtype=np.float64)
