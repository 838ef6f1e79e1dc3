# SPDX-License-Identifier: MIT
"""Bars that figures must not miss."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from slamcli.errors import UsageError


@dataclass(frozen=True, slots=True)
class Threshold:
    """A bar for one figure."""

    key: str
    value: float
    upper: bool = True
    """Whether the figure must be at most `value`; otherwise at least."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a threshold."""

    threshold: Threshold
    figure: float

    @property
    def passed(self) -> bool:
        """Whether the figure keeps to the bar; a figure that is not a number does not."""
        bar = self.threshold
        return self.figure <= bar.value if bar.upper else self.figure >= bar.value

    @property
    def message(self) -> str:
        """What happened in one line: by how much it failed, or what was left."""
        bar = self.threshold
        side = "at most" if bar.upper else "at least"
        off = abs(self.figure - bar.value)
        share = f", {100 * off / abs(bar.value):.1f} %" if bar.value and math.isfinite(off) else ""
        verdict = "kept by" if self.passed else "missed by"
        return f"{bar.key} = {self.figure:.6g}, must be {side} {bar.value:g}: {verdict} {off:.3g}{share}"


def parse_threshold(text: str, *, upper: bool) -> Threshold:
    """Return the threshold of ``KEY=VALUE``.

    Raises
    ------
    UsageError
        If it is not of this form.
    """
    key, equals, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (equals and key.strip()) or math.isnan(number):
        option = "--max" if upper else "--min"
        raise UsageError(f"{option} {text!r} is not KEY=VALUE (for example {option} ate.rmse=0.05)")
    return Threshold(key.strip(), number, upper)


def judge(figures: Mapping[str, float], thresholds: Sequence[Threshold]) -> tuple[Verdict, ...]:
    """Return the verdict on each threshold.

    Raises
    ------
    UsageError
        If there is no figure of that name; the message names those there are.
    """
    for threshold in thresholds:
        if threshold.key not in figures:
            near = difflib.get_close_matches(threshold.key, figures, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UsageError(f"no figure {threshold.key!r} here{hint} (there are {', '.join(figures)})")
    return tuple(Verdict(threshold, float(figures[threshold.key])) for threshold in thresholds)
