# SPDX-License-Identifier: MIT
"""Laser scans as the tiers take them: counter-clockwise, one fan, readings after REP 117."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import LaserScan
from slamcli.runtime import RunLog

FAN_SAMPLE = 50
"""How many of the first scans decide on the fan."""
_MAX_BEAMS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Fan:
    """The directions of a scan's beams: counter-clockwise, evenly spaced."""

    angle_min_rad: float
    angle_increment_rad: float
    num_beams: int

    def fits(self, other: Fan) -> bool:
        """Return whether no beam of the other fan is off by more than a twentieth of a beam."""
        tolerance = 0.05 * self.angle_increment_rad
        drift = abs(self.angle_increment_rad - other.angle_increment_rad) * self.num_beams
        return self.num_beams == other.num_beams and abs(self.angle_min_rad - other.angle_min_rad) + drift < tolerance


def clean_ranges(ranges_m: NDArray[np.float32], range_min_m: float, range_max_m: float) -> NDArray[np.float32]:
    """Return readings after REP 117, float32 (N,): a distance, +inf "nothing there" or NaN "no answer".

    Readings at or beyond `range_max_m` become +inf, those below `range_min_m` (zero, negative and -inf too) NaN.
    A `range_max_m` that is not positive is no limit.
    """
    ranges = np.asarray(ranges_m, dtype=np.float32)
    far = ranges >= np.float32(range_max_m) if range_max_m > 0 else ranges == np.inf
    near = (ranges < np.float32(range_min_m)) | (ranges <= 0)
    return np.where(near, np.float32(np.nan), np.where(far, np.float32(np.inf), ranges))


def turn_counter_clockwise(scan: LaserScan, *, mirrored: bool = False) -> LaserScan:
    """Return a scan with cleaned readings whose beams run counter-clockwise in the upright scan frame.

    Parameters
    ----------
    mirrored
        True for a scanner that is mounted upside down: its angles change their sign.

    Notes
    -----
    The stamp stays the recorded one. Where beams had to be put into reverse order `time_increment_s` becomes negative:
    then beam N - 1 was measured at the stamp, and beam i ``(N - 1 - i) * |time_increment_s|`` later.
    """
    first, increment = scan.angle_min_rad, scan.angle_increment_rad
    if mirrored:
        first, increment = -first, -increment
    ranges = clean_ranges(scan.ranges_m, scan.range_min_m, scan.range_max_m)
    intensities, time_increment = scan.intensities, scan.time_increment_s
    if increment < 0:
        first, increment = first + (scan.num_beams - 1) * increment, -increment
        ranges, time_increment = np.ascontiguousarray(ranges[::-1]), -time_increment
        intensities = None if intensities is None else np.ascontiguousarray(intensities[::-1])
    return LaserScan(
        stamp_ns=scan.stamp_ns,
        frame_id=scan.frame_id,
        angle_min_rad=first,
        angle_increment_rad=increment,
        range_min_m=scan.range_min_m,
        range_max_m=scan.range_max_m,
        ranges_m=ranges,
        time_increment_s=time_increment,
        scan_time_s=scan.scan_time_s,
        intensities=intensities,
        topic=scan.topic,
    )


def resample(scan: LaserScan, fan: Fan) -> LaserScan:
    """Return a counter-clockwise scan on another fan: each beam takes the nearest reading, NaN where none is near.

    Near is half a beam of the wider spaced of the two fans.
    """
    angles = fan.angle_min_rad + np.arange(fan.num_beams) * fan.angle_increment_rad
    exact = (angles - scan.angle_min_rad) / scan.angle_increment_rad
    index = np.clip(np.rint(exact), 0, max(scan.num_beams - 1, 0)).astype(np.int64)
    reach = 0.5 * max(1.0, fan.angle_increment_rad / scan.angle_increment_rad) + 1e-6
    inside = np.abs(exact - index) <= reach

    def taken(values: NDArray[np.float32]) -> NDArray[np.float32]:
        if len(values) == 0:
            return np.full(fan.num_beams, np.nan, dtype=np.float32)
        return np.where(inside, values[index], np.float32(np.nan))

    return LaserScan(
        stamp_ns=scan.stamp_ns,
        frame_id=scan.frame_id,
        angle_min_rad=fan.angle_min_rad,
        angle_increment_rad=fan.angle_increment_rad,
        range_min_m=scan.range_min_m,
        range_max_m=scan.range_max_m,
        ranges_m=taken(scan.ranges_m),
        time_increment_s=scan.time_increment_s * fan.angle_increment_rad / scan.angle_increment_rad,
        scan_time_s=scan.scan_time_s,
        intensities=None if scan.intensities is None else taken(scan.intensities),
        topic=scan.topic,
    )


def fan_of(scan: LaserScan) -> Fan:
    """Return the fan of a counter-clockwise scan."""
    return Fan(angle_min_rad=scan.angle_min_rad, angle_increment_rad=scan.angle_increment_rad, num_beams=scan.num_beams)


class ScanNormaliser:
    """Puts scans one after the other counter-clockwise, cleaned, and on one fan; counts what it resampled.

    Parameters
    ----------
    fan
        Directions of the beams of every scan that comes out.
    mirrored
        True for a scanner that is mounted upside down.
    name
        Of the scanner, for the log, where there are several.
    """

    def __init__(self, fan: Fan, *, mirrored: bool, log: RunLog, name: str = "") -> None:
        self._fan = fan
        self._mirrored = mirrored
        self._log = log
        self._of = f"{name}: " if name else ""
        self._num_resampled = 0

    def normalise(self, scan: LaserScan) -> LaserScan:
        """Return the scan on the fan: resampled if its own differs, NaN in all beams if it has none."""
        turned = turn_counter_clockwise(scan, mirrored=self._mirrored)
        result = _on_fan(turned, self._fan)
        self._num_resampled += result is not turned
        return result

    def tell(self) -> None:
        """Write into the log how many scans were resampled, if any."""
        if self._num_resampled:
            counts, fan, what = self._log.counts, self._fan, f"{self._of}scans resampled to one fan"
            counts[what] = max(counts[what], self._num_resampled)
            self._log.warn(
                f"{self._of}{self._num_resampled} scans have other beams than the rest: resampled to {fan.num_beams} beams of "
                f"{math.degrees(fan.angle_increment_rad):.3f}° from {math.degrees(fan.angle_min_rad):.1f}°"
            )


def normalise_scans(scans: Iterable[LaserScan], *, mirrored: bool, log: RunLog) -> Iterator[LaserScan]:
    """Yield every scan normalised, on the most frequent fan of the first 50 scans.

    Raises
    ------
    DataError
        If none of these has beams.
    """
    coming = iter(scans)
    head = list(islice(coming, FAN_SAMPLE))
    fan = most_frequent_fan([turn_counter_clockwise(scan, mirrored=mirrored) for scan in head])
    if fan is None:
        return
    normaliser = ScanNormaliser(fan, mirrored=mirrored, log=log)
    try:
        for scan in chain(head, coming):
            yield normaliser.normalise(scan)
    finally:
        normaliser.tell()


def most_frequent_fan(scans: list[LaserScan]) -> Fan | None:
    """Return the fan that most of the scans have (the earliest of equals), None for no scans.

    Raises
    ------
    DataError
        If none of the scans has beams, or one has more than any scanner.
    """
    if not scans:
        return None
    fans = [fan_of(scan) for scan in scans if scan.num_beams > 0]
    if not fans:
        raise DataError(f"the first {len(scans)} scans of {scans[0].topic or 'the recording'} have no beams")
    frequent, _ = Counter(fan.num_beams for fan in fans).most_common(1)[0]
    if frequent > _MAX_BEAMS:
        raise DataError(f"scans of {frequent} beams: slamcli takes up to {_MAX_BEAMS}")
    return next(fan for fan in fans if fan.num_beams == frequent)


def _on_fan(scan: LaserScan, fan: Fan) -> LaserScan:
    if fan.fits(fan_of(scan)):
        return scan
    if scan.num_beams < 2 and scan.angle_increment_rad <= 0:
        return LaserScan(
            stamp_ns=scan.stamp_ns,
            frame_id=scan.frame_id,
            angle_min_rad=fan.angle_min_rad,
            angle_increment_rad=fan.angle_increment_rad,
            range_min_m=scan.range_min_m,
            range_max_m=scan.range_max_m,
            ranges_m=np.full(fan.num_beams, np.nan, dtype=np.float32),
            topic=scan.topic,
        )
    return resample(scan, fan)
