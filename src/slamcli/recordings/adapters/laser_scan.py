# SPDX-License-Identifier: MIT
"""sensor_msgs/LaserScan."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import LaserScan
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory


def scan_from_message(
    message: Any, ranges: NDArray[np.float32], intensities: NDArray[np.float32], stamp_ns: int, context: DecodeContext
) -> LaserScan:
    """Return the scan of a LaserScan or MultiEchoLaserScan message whose readings are given.

    Beam i points to ``angle_min + i * angle_increment``, as the message's definition says, even where angle_max
    contradicts it (counted); only a missing increment is taken from angle_max.
    """
    first, last, increment = message.angle_min, message.angle_max, message.angle_increment
    steps = max(len(ranges) - 1, 1)
    if increment == 0.0 and last != first:
        increment = (last - first) / steps
        context.count("scans without angle_increment, taken from angle_max")
    elif increment != 0.0 and abs((last - first) / increment - steps) > 1.5:
        context.count("scans whose angle_max does not fit the number of beams (angle_increment is followed)")
    if context.mends.flip_scan:
        first, increment = -first, -increment
    has_intensities = len(intensities) == len(ranges) and len(ranges) > 0
    return LaserScan(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        angle_min_rad=first,
        angle_increment_rad=increment,
        range_min_m=message.range_min,
        range_max_m=message.range_max,
        ranges_m=ranges,
        time_increment_s=message.time_increment,
        scan_time_s=message.scan_time,
        intensities=intensities if has_intensities else None,
        topic=context.topic,
    )


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[LaserScan]:
    # Copies: the message's arrays are views of a whole chunk of the bag, which they would keep alive.
    ranges = np.array(message.ranges, dtype=np.float32)
    intensities = np.array(message.intensities, dtype=np.float32)
    return (scan_from_message(message, ranges, intensities, stamp_ns, context),)


def _encode(scan: LaserScan, messages: MessageFactory) -> Any:
    angle_max = scan.angle_min_rad + max(scan.num_beams - 1, 0) * scan.angle_increment_rad
    intensities = scan.intensities if scan.intensities is not None else np.zeros(0, dtype=np.float32)
    range_max = scan.range_max_m if math.isfinite(scan.range_max_m) else np.finfo(np.float32).max
    return messages.make(
        "sensor_msgs/msg/LaserScan",
        messages.header(scan.stamp_ns, scan.frame_id),
        *map(float, (scan.angle_min_rad, angle_max, scan.angle_increment_rad)),
        *map(float, (scan.time_increment_s, scan.scan_time_s, scan.range_min_m, range_max)),
        np.asarray(scan.ranges_m, dtype=np.float32),
        np.asarray(intensities, dtype=np.float32),
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/LaserScan",), produces=LaserScan, decode=_decode, encode=_encode)
