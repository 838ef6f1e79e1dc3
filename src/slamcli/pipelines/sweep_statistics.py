# SPDX-License-Identifier: MIT
"""What many runs of one set amount to, and whether two sets really differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

Verdict = Literal[
    "better", "worse", "likely better", "likely worse", "within the spread", "same", "one run", "no value"
]

_RESAMPLES = 4000
_SHARE = 0.95
_SIGNIFICANT = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Order statistics of the objective over seeds; NaN where no run gave a value."""

    count: int
    """Runs with a value."""
    failed: int
    """Runs without one."""
    median: float
    lower: float
    """First quartile."""
    upper: float
    """Third quartile."""
    minimum: float
    maximum: float

    @classmethod
    def of(cls, values: ArrayLike) -> Spread:
        """Return the statistics of values (N,), of which those that are NaN are failures."""
        found = np.asarray(values, dtype=np.float64)
        good = found[np.isfinite(found)]
        if not len(good):
            return cls(
                count=0, failed=len(found), median=math.nan, lower=math.nan, upper=math.nan, minimum=math.nan,
                maximum=math.nan,
            )  # fmt: skip
        lower, median, upper = (float(q) for q in np.percentile(good, [25, 50, 75]))
        return cls(
            count=len(good), failed=len(found) - len(good), median=median, lower=lower, upper=upper,
            minimum=float(good.min()), maximum=float(good.max()),
        )  # fmt: skip

    @property
    def failure_rate(self) -> float:
        """Share of the runs that failed."""
        total = self.count + self.failed
        return self.failed / total if total else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A set against the baseline, paired by seed (and recording)."""

    pairs: int
    better_in: int
    """Pairs in which the set is better."""
    worse_in: int
    median: float
    """Median of the differences (set minus baseline)."""
    low: float
    """Lower end of the 95 % bootstrap interval of that median."""
    high: float
    p_value: float
    """Of the exact two-sided sign test; pairs without a difference are left out."""
    verdict: Verdict


def compare(values: ArrayLike, baseline: ArrayLike, *, maximise: bool) -> Comparison:
    """Return whether values (N,) are better than those of the baseline (N,) that belong to them.

    A difference counts where the percentile bootstrap interval of the median difference leaves 0 out (Efron & Tibshirani, *An
    Introduction to the Bootstrap*, 1993, ch. 13) and the exact sign test says p <= 0.05, which takes six pairs at least; where
    only the interval does, it is likely. Where seeds change nothing, any difference counts. Pairs in which either failed are
    left out. The resampling has a seed of its own: the
    same values give the same answer.

    Notes
    -----
    The best of many sets is looked at because it was the best: with many sets some differ from the baseline by chance.
    """
    one, other = np.asarray(values, dtype=np.float64), np.asarray(baseline, dtype=np.float64)
    both = np.isfinite(one) & np.isfinite(other)
    differences = (one - other)[both]
    count = len(differences)
    if not count:
        return Comparison(
            pairs=0, better_in=0, worse_in=0, median=math.nan, low=math.nan, high=math.nan, p_value=math.nan,
            verdict="no value",
        )  # fmt: skip
    more, less = int((differences > 0).sum()), int((differences < 0).sum())
    better, worse = (more, less) if maximise else (less, more)
    low, high = _interval(differences)
    p_value = _sign_test(better, worse)
    if count > 1 and np.ptp(one[both]) == np.ptp(other[both]) == 0.0:
        p_value = 0.0 if better + worse else 1.0  # seeds change nothing: what differs, differs
    return Comparison(
        pairs=count, better_in=better, worse_in=worse, median=float(np.median(differences)), low=low, high=high,
        p_value=p_value, verdict=_verdict(count, low, high, p_value, up=maximise),
    )  # fmt: skip


def _interval(differences: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    picks = rng.integers(len(differences), size=(_RESAMPLES, len(differences)))
    medians = np.median(differences[picks], axis=1)
    tail = 50 * (1 - _SHARE)
    low, high = np.percentile(medians, [tail, 100 - tail])
    return float(low), float(high)


def _sign_test(better: int, worse: int) -> float:
    """Return the probability of signs at least as uneven, if both were as likely."""
    total, fewer = better + worse, min(better, worse)
    if not total:
        return 1.0
    return min(1.0, 2 * sum(math.comb(total, k) for k in range(fewer + 1)) / 2**total)


def _verdict(count: int, low: float, high: float, p_value: float, *, up: bool) -> Verdict:
    if low == high == 0.0:
        return "same"
    if count == 1:
        return "one run"
    if low <= 0 <= high:
        return "within the spread"
    good = (low > 0) == up
    if p_value <= _SIGNIFICANT:
        return "better" if good else "worse"
    return "likely better" if good else "likely worse"


def mean_ranks(columns: Sequence[Sequence[float]], *, maximise: bool) -> list[float]:
    """Return the mean rank (1 is best) of each of N sets over columns of N values; a value that is NaN is the last, ties share."""
    ranks = np.array([_ranks(np.asarray(column, dtype=np.float64), maximise=maximise) for column in columns])
    return [float(rank) for rank in ranks.mean(axis=0)]


def _ranks(
    values: np.ndarray[tuple[int], np.dtype[np.float64]], *, maximise: bool
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    cost = np.where(np.isfinite(values), -values if maximise else values, np.inf)
    below = (cost[None, :] < cost[:, None]).sum(axis=1)
    same = (cost[None, :] == cost[:, None]).sum(axis=1)
    ranks: np.ndarray[tuple[int], np.dtype[np.float64]] = below + (same + 1) / 2
    return ranks
