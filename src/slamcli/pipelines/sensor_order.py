# SPDX-License-Identifier: MIT
"""Frames, scans and clouds of one recording in one order, each after the odometry and IMU samples that it needs."""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator

from slamcli.measurements import Image, ImuSample, LaserScan, Measurement, Odometry, PointCloud, RgbdFrame, StereoPair
from slamcli.runtime import RunLog

LONGEST_WAIT_NS = 500_000_000
"""Nothing waits longer than this for a sample: where odometry or the IMU pauses, memory must not grow."""
_NEVER = -(1 << 62)
_TRACK = "the track"

Moment = Image | StereoPair | RgbdFrame | LaserScan | PointCloud
Sample = Odometry | ImuSample


def end_ns(moment: Moment) -> int:
    """Return the stamp at which the last part of a measurement was taken: a sweep takes time."""
    if isinstance(moment, LaserScan):
        return moment.stamp_ns + max(0, round((moment.num_beams - 1) * moment.time_increment_s * 1e9))
    if isinstance(moment, PointCloud) and moment.offset_ns is not None and len(moment.offset_ns):
        return moment.stamp_ns + max(0, int(moment.offset_ns.max()))
    return moment.stamp_ns


class SensorOrder:
    """Holds frames, scans and clouds back until the samples up to their end, and the first one after it, are there.

    Where samples pause for longer than `LONGEST_WAIT_NS` it goes on without.

    Parameters
    ----------
    samples
        Topics of odometry and IMU that are read message by message.
    track
        Odometry that is known as a whole, in the order of its stamps.
    by_stamp
        Whether frames, scans and clouds come out in the order of their stamps; those of a topic that are not later than
        the one before are left out then. Otherwise they keep the order in which they come.
    """

    def __init__(
        self, samples: Collection[str], track: Iterable[Odometry], log: RunLog, *, by_stamp: bool = True
    ) -> None:
        self._queues: dict[str, deque[Sample]] = {name: deque() for name in samples}
        self._track = iter(track)
        self._next_of_track = next(self._track, None)
        self._log, self._by_stamp = log, by_stamp
        self._given_ns = dict.fromkeys((*self._queues, _TRACK), _NEVER)
        self._moments: list[tuple[int, int, Moment]] = []
        self._number = 0
        self._last_ns: dict[str, int] = {}
        self._num_backward: Counter[str] = Counter()

    def add(self, measurement: Measurement) -> Iterator[Measurement]:
        """Take the next measurement; yield it at once if it is neither of these, as nothing waits for it."""
        if isinstance(measurement, (Odometry, ImuSample)) and measurement.topic in self._queues:
            self._queues[measurement.topic].append(measurement)
        elif isinstance(measurement, Moment):
            self._hold(measurement)
        else:
            yield measurement

    def ready(self, now_ns: int | None, pending_ns: int | None = None) -> Iterator[Measurement]:
        """Yield what nothing has to be waited for any more.

        Parameters
        ----------
        now_ns
            Stamp up to which the recording was read; None: to its end.
        pending_ns
            Stamp of an image that is not yet known to become a frame.
        """
        while self._moments:
            key, _, moment = self._moments[0]
            end = end_ns(moment)
            if now_ns is not None:
                if self._by_stamp and (now_ns <= key or (pending_ns is not None and pending_ns <= key)):
                    return
                if not self._reaches(end) and now_ns < end + LONGEST_WAIT_NS:
                    return
            yield from self._samples_to(end)
            heapq.heappop(self._moments)
            yield moment
        if now_ns is not None and pending_ns is None:
            yield from self._samples_before(now_ns - LONGEST_WAIT_NS)

    def tell(self) -> None:
        """Say what was left out."""
        for topic, number in sorted(self._num_backward.items()):
            self._log.counts[f"{topic}: messages out of order"] += number
            self._log.warn(f"{topic}: {number} measurements are not later than the one before and are left out")

    def _hold(self, moment: Moment) -> None:
        last = self._last_ns.get(moment.topic)
        if self._by_stamp and last is not None and moment.stamp_ns <= last:
            self._num_backward[moment.topic] += 1
            return
        self._last_ns[moment.topic] = moment.stamp_ns
        key = moment.stamp_ns if self._by_stamp else self._number
        heapq.heappush(self._moments, (key, self._number, moment))
        self._number += 1

    def _reaches(self, end: int) -> bool:
        return all(
            self._given_ns[name] >= end or (queue and queue[-1].stamp_ns >= end) for name, queue in self._queues.items()
        )

    def _samples_to(self, end: int) -> list[Sample]:
        """Take the samples before `end`, and of each topic the first one at or after it, by stamp."""
        found = self._samples_before(end)
        for name, queue in self._queues.items():
            if queue and self._given_ns[name] < end:
                found.append(self._take(name))
        if self._next_of_track is not None and self._given_ns[_TRACK] < end:
            found.append(self._pull(self._next_of_track))
        return sorted(found, key=lambda sample: sample.stamp_ns)

    def _samples_before(self, end: int) -> list[Sample]:
        found: list[Sample] = []
        for name, queue in self._queues.items():
            while queue and queue[0].stamp_ns < end:
                found.append(self._take(name))
        while self._next_of_track is not None and self._next_of_track.stamp_ns < end:
            found.append(self._pull(self._next_of_track))
        return sorted(found, key=lambda sample: sample.stamp_ns)

    def _take(self, name: str) -> Sample:
        sample = self._queues[name].popleft()
        self._given_ns[name] = sample.stamp_ns
        return sample

    def _pull(self, found: Odometry) -> Odometry:
        self._given_ns[_TRACK] = found.stamp_ns
        self._next_of_track = next(self._track, None)
        return found
