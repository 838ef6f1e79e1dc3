# SPDX-License-Identifier: MIT
"""The IMU samples of a run, in order, with what was wrong with them counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuSample

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuSamples:
    """N readings of one IMU, in its frame, as columns."""

    stamps_ns: Integers
    """int64 (N,), increasing."""
    angular_rad_s: Floats
    """float64 (N, 3)."""
    acceleration_m_s2: Floats
    """float64 (N, 3), specific forces: gravity's reaction included."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.stamps_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuCounts:
    """What became of the samples that were given."""

    used: int
    repeated: int
    """Stamp as the one before: dropped."""
    late: int
    """Stamp before the one before: dropped."""
    not_finite: int
    """NaN or infinite: dropped."""
    gaps: int
    """Places where samples lie more than three usual periods apart."""
    longest_gap_s: float


class ImuBuffer:
    """Samples as they come; those that cannot be used are counted and left out."""

    def __init__(self) -> None:
        self._stamps = np.empty(1024, np.int64)
        self._values = np.empty((1024, 6))
        self._count = 0
        self._repeated = self._late = self._not_finite = 0
        self.offset_ns = 0
        """Taken off every stamp; see `shift`."""

    def __len__(self) -> int:
        """Return the number of usable samples."""
        return self._count

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last usable sample; None if there is none."""
        return int(self._stamps[self._count - 1]) if self._count else None

    def shift(self, nanoseconds: int) -> None:
        """Take this off the stamps of all samples, those to come too: the IMU's clock is ahead by it."""
        self.offset_ns += nanoseconds
        self._stamps[: self._count] -= nanoseconds

    def add(self, sample: ImuSample) -> None:
        """Take the next sample."""
        values = np.concatenate([sample.angular_rad_s, sample.acceleration_m_s2])
        if not np.isfinite(values).all():
            self._not_finite += 1
            return
        last, stamp = self.last_ns, sample.stamp_ns - self.offset_ns
        if last is not None and stamp <= last:
            self._repeated += stamp == last
            self._late += stamp < last
            return
        if self._count == len(self._stamps):
            self._stamps = np.concatenate([self._stamps, np.empty_like(self._stamps)])
            self._values = np.concatenate([self._values, np.empty_like(self._values)])
        self._stamps[self._count] = stamp
        self._values[self._count] = values
        self._count += 1

    def samples(self, since_ns: int | None = None) -> ImuSamples:
        """Return what there is as columns (copies), from the last sample not after `since_ns` on; None: from the first."""
        stamps = self._stamps[: self._count]
        first = 0 if since_ns is None else max(int(np.searchsorted(stamps, since_ns, side="right")) - 1, 0)
        values = self._values[first : self._count]
        return ImuSamples(
            stamps_ns=stamps[first:].copy(), angular_rad_s=values[:, :3].copy(), acceleration_m_s2=values[:, 3:].copy()
        )

    def counts(self) -> ImuCounts:
        """Return what became of the samples so far."""
        apart = np.diff(self._stamps[: self._count])
        usual = float(np.median(apart)) if len(apart) else 0.0
        return ImuCounts(
            used=self._count, repeated=self._repeated, late=self._late, not_finite=self._not_finite,
            gaps=int(np.count_nonzero(apart > 3 * usual)), longest_gap_s=float(apart.max()) * 1e-9 if len(apart) else 0.0,
        )  # fmt: skip
