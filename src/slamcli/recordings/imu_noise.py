# SPDX-License-Identifier: MIT
"""Noise of an IMU in a recording: a text beside the IMU's topic, because ROS has no message for it.

The text is what Kalibr's file of an IMU holds. Data-set folders give it, conversions keep it in every format.
"""

from __future__ import annotations

from slamcli.errors import RecordingError
from slamcli.measurements import ImuNoise
from slamcli.recordings.raw import RawReader

NOISE_SUFFIX = "/noise"
"""Behind the IMU's topic: the topic (std_msgs/String) that says its noise."""
_NAMES = {
    "gyroscope": "gyroscope_noise_density", "accelerometer": "accelerometer_noise_density",
    "gyroscope_walk": "gyroscope_random_walk", "accelerometer_walk": "accelerometer_random_walk",
    "frequency_hz": "update_rate",
}  # fmt: skip


def noise_text(noise: ImuNoise) -> str:
    """Return the noise in the words of Kalibr's file, one ``name: value`` on a line."""
    return "".join(f"{name}: {getattr(noise, field)!r}\n" for field, name in _NAMES.items())


def recorded_noise(raw: RawReader, imu_topic: str) -> ImuNoise | None:
    """Return the noise that a recording (`Recording.raw`) says of an IMU, None where it says nothing that can be read."""
    topic = imu_topic + NOISE_SUFFIX
    if not any(known.name == topic and known.msgtype == "std_msgs/msg/String" for known in raw.contents.topics):
        return None
    for message in raw.messages((topic,)):
        try:
            return _parse(str(raw.decode(message).data))
        except (RecordingError, ValueError, AttributeError):
            return None
    return None


def _parse(text: str) -> ImuNoise:
    """Return the noise in such a text; raises ValueError for anything else."""
    found: dict[str, float] = {}
    for line in text.splitlines():
        name, _, value = line.partition(":")
        for field, known in _NAMES.items():
            if name.strip() == known:
                found[field] = float(value)
    if not found or not all(0 < value < float("inf") for value in found.values()):
        raise ValueError
    return ImuNoise(**found)
