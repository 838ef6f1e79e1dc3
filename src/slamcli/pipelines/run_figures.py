# SPDX-License-Identifier: MIT
"""The figures of a run that thresholds can be set on: what ``run.json`` says, flat."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any


def run_figures(run: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a ``run.json`` document by keys.

    These are the numbers of its ``summary``, those of an inner object joined by a dot (``truth.ate.rmse``, ``memory.words``), then
    ``timing.total_s``, ``timing.realtime_factor`` and ``peak_memory_bytes``. What is not determined (null) is NaN, which misses every bar;
    true counts as 1. Texts and lists are left out.
    """
    timing = run["timing"]
    found = dict(_numbers(run["summary"], ""))
    found |= dict(_numbers({name: timing[name] for name in ("total_s", "realtime_factor")}, "timing."))
    return found | {"peak_memory_bytes": float(run["peak_memory_bytes"])}


def _numbers(values: Mapping[str, Any], before: str) -> Iterator[tuple[str, float]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _numbers(value, f"{before}{name}.")
        elif value is None or isinstance(value, int | float):
            yield f"{before}{name}", math.nan if value is None else float(value)
