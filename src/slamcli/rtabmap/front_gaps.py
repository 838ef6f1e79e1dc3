# SPDX-License-Identifier: MIT
"""Where images, scans or odometry are missing beside each other, said aloud."""

from __future__ import annotations

from slamcli.runtime import RunLog

_LONG_NS = 2_000_000_000
"""A sensor that goes on for longer without the other one is spoken of."""


class Stretch:
    """Frames to which the same happened: how many, and their longest run."""

    def __init__(self) -> None:
        self.count = 0
        self._began_ns: int | None = None
        self._longest: tuple[int, int] = (0, 0)
        """Length and begin, nanoseconds."""

    def note(self, stamp_ns: int, happened: bool) -> None:
        """Take the next frame."""
        if self._began_ns is not None:
            self._longest = max(self._longest, (stamp_ns - self._began_ns, self._began_ns), key=lambda run: run[0])
        if not happened:
            self._began_ns = None
            return
        self.count += 1
        if self._began_ns is None:
            self._began_ns = stamp_ns
            if self._longest[0] == 0:
                self._longest = (0, stamp_ns)

    @property
    def longest(self) -> str:
        """The longest run in words."""
        length_ns, began_ns = self._longest
        return f"the longest for {length_ns / 1e9:.1f} s from {began_ns / 1e9:.3f} s"


class FrontGaps:
    """Watches what comes of each image, and tells at the end what was missing.

    Parameters
    ----------
    scans
        Whether each image should have a scan.
    """

    def __init__(self, log: RunLog, *, scans: bool) -> None:
        self._log, self._scans = log, scans
        self._carried, self._scanless = Stretch(), Stretch()
        self._num = self._num_lost = 0
        self._first_ns = self._last_ns = 0
        """Stamps of images."""
        self._ranges: tuple[int, int] | None = None
        """First and last stamp of scans and clouds."""

    def see_scan(self, stamp_ns: int) -> None:
        """Take the next scan or cloud."""
        self._ranges = (stamp_ns if self._ranges is None else self._ranges[0], stamp_ns)

    def see_frame(self, stamp_ns: int, *, lost: bool, carried: bool, has_scan: bool) -> None:
        """Take what came of the next image."""
        if not self._num:
            self._first_ns = stamp_ns
        self._num += 1
        self._last_ns = stamp_ns
        self._num_lost += lost
        self._carried.note(stamp_ns, carried)
        self._scanless.note(stamp_ns, self._scans and not has_scan)

    def tell(self) -> None:
        """Write it into the log."""
        counts, warn = self._log.counts, self._log.warn
        if self._num_lost:  # `run_figures` says when, with those that other maps hold
            counts["images without odometry"] += self._num_lost
        if self._carried.count:
            counts["images placed by the recording's odometry alone"] += self._carried.count
            warn(
                f"{self._carried.count} of {self._num} images show nothing known ({self._carried.longest}): the recording's odometry "
                "alone tells the motion there"
            )
        if self._scans and self._scanless.count > 0.1 * self._num:
            counts["images without a scan"] += self._scanless.count
            warn(f"{self._scanless.count} of {self._num} images have no scan within 0.2 s ({self._scanless.longest})")
        if self._num and self._ranges is not None:
            before, after = self._first_ns - self._ranges[0], self._ranges[1] - self._last_ns
            if before > _LONG_NS:
                warn(
                    f"scans begin {before / 1e9:.1f} s before the images: that part is not mapped (--mode scan maps it)"
                )
            if after > _LONG_NS:
                warn(f"images end {after / 1e9:.1f} s before the scans: that part is not mapped (--mode scan maps it)")
