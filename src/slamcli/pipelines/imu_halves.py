# SPDX-License-Identifier: MIT
"""An IMU whose gyroscope and accelerometer come on topics of their own, as RealSense cameras record them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from slamcli.measurements import ImuSample, Measurement
from slamcli.recordings import Topic

_MOST_WAITING = 10_000
"""Gyroscope samples that wait for an accelerometer that pauses: memory must not grow."""


def find_halves(topics: Sequence[Topic]) -> tuple[Topic, Topic] | None:
    """Return the topics of gyroscope and accelerometer where there is one of each, and no topic of both."""
    gyroscopes = [topic for topic in topics if "gyro" in topic.name.lower()]
    accelerometers = [topic for topic in topics if "accel" in topic.name.lower() and topic not in gyroscopes]
    if len(gyroscopes) == 1 and len(accelerometers) == 1 and len(topics) == 2:
        return gyroscopes[0], accelerometers[0]
    return None


def united(measurements: Iterable[Measurement], gyroscope: str, accelerometer: str) -> Iterator[Measurement]:
    """Yield measurements with one IMU sample for each of the gyroscope, on its topic, once the accelerometer's next one is there.

    The acceleration is interpolated linearly between the accelerometer's samples before and after; gyroscope samples before
    its first or after its last one are left out. All else passes through as it comes.
    """
    turns: deque[ImuSample] = deque(maxlen=_MOST_WAITING)
    before: ImuSample | None = None
    for measurement in measurements:
        if not isinstance(measurement, ImuSample) or measurement.topic not in (gyroscope, accelerometer):
            yield measurement
        elif measurement.topic == gyroscope:
            turns.append(measurement)
        elif before is None or measurement.stamp_ns > before.stamp_ns:
            while turns and turns[0].stamp_ns <= measurement.stamp_ns:
                turn = turns.popleft()
                if before is not None and turn.stamp_ns >= before.stamp_ns:
                    share = (turn.stamp_ns - before.stamp_ns) / (measurement.stamp_ns - before.stamp_ns)
                    force = before.acceleration_m_s2 + share * (
                        measurement.acceleration_m_s2 - before.acceleration_m_s2
                    )
                    yield replace(turn, acceleration_m_s2=force)
            before = measurement
