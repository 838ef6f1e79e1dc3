# SPDX-License-Identifier: MIT
"""Which of a sensor's messages are used, where a configuration asks for a share of them."""

from __future__ import annotations

from collections.abc import Mapping

from slamcli.recordings.sensor_picks import SensorPicks


class FixedRatioSampler:
    """Takes a fixed share of what passes by, evenly spread, beginning with the first.

    Whenever fewer than the share were taken of what came before, the next one is taken (Cartographer's rule).
    """

    def __init__(self, ratio: float) -> None:
        self._ratio = ratio
        self._num_seen = 0
        self._num_taken = 0

    def pulse(self) -> bool:
        """Return whether to take the next one."""
        self._num_seen += 1
        if self._num_taken / self._num_seen < self._ratio:
            self._num_taken += 1
            return True
        return False


def sampler_by_topic(picks: SensorPicks, ratios: Mapping[str, float]) -> dict[str, FixedRatioSampler]:
    """Return the sampler of each topic; all range sensors share one, as in Cartographer."""
    ranges = FixedRatioSampler(ratios.get("ranges", 1.0))
    samplers = {topic.name: ranges for topic in picks.ranges}
    others = {
        "odometry": picks.odometry.odom_topic,
        "imu": picks.imu,
        "fixes": picks.fixes,
        "landmarks": picks.landmarks,
    }
    for role, topic in others.items():
        if topic is not None:
            samplers[topic.name] = FixedRatioSampler(ratios.get(role, 1.0))
    return samplers
