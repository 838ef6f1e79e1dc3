# SPDX-License-Identifier: MIT
"""sensor_msgs/MultiEchoLaserScan, read as its first echoes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.laser_scan import scan_from_message
from slamcli.recordings.adapters.messages import MessageFactory


def _first_echoes(echoes: Any) -> NDArray[np.float32]:
    """Return the first echo of each beam, NaN (no answer) for a beam without any."""
    return np.array([beam.echoes[0] if len(beam.echoes) else np.nan for beam in echoes], dtype=np.float32)


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[LaserScan]:
    ranges, intensities = _first_echoes(message.ranges), _first_echoes(message.intensities)
    return (scan_from_message(message, ranges, intensities, stamp_ns, context),)


def _encode(scan: LaserScan, messages: MessageFactory) -> Any:
    def echoes(values: NDArray[np.float32] | None) -> list[Any]:
        readings = np.zeros(0, dtype=np.float32) if values is None else np.asarray(values, dtype=np.float32)
        return [messages.make("sensor_msgs/msg/LaserEcho", readings[i : i + 1]) for i in range(len(readings))]

    angle_max = scan.angle_min_rad + max(scan.num_beams - 1, 0) * scan.angle_increment_rad
    return messages.make(
        "sensor_msgs/msg/MultiEchoLaserScan",
        messages.header(scan.stamp_ns, scan.frame_id),
        *map(float, (scan.angle_min_rad, angle_max, scan.angle_increment_rad)),
        *map(float, (scan.time_increment_s, scan.scan_time_s, scan.range_min_m, scan.range_max_m)),
        echoes(scan.ranges_m),
        echoes(scan.intensities),
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/MultiEchoLaserScan",), produces=LaserScan, decode=_decode, encode=_encode)
