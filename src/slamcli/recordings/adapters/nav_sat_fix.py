# SPDX-License-Identifier: MIT
"""sensor_msgs/NavSatFix."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamcli.measurements import GeoFix
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory

# sensor_msgs/NavSatStatus and NavSatFix: no fix, an unaugmented fix, GPS; how much of the covariance is known.
_NO_FIX, _FIX, _GPS = -1, 0, 1
_UNKNOWN, _KNOWN = 0, 3


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[GeoFix]:
    place = (message.latitude, message.longitude)
    has_fix = message.status.status > _NO_FIX and bool(np.isfinite(place).all())
    covariance = None
    if message.position_covariance_type != _UNKNOWN:
        covariance = np.array(message.position_covariance, dtype=np.float64).reshape(3, 3)
    fix = GeoFix(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        latitude_deg=place[0],
        longitude_deg=place[1],
        altitude_m=message.altitude,
        has_fix=has_fix,
        covariance_m2=covariance,
        topic=context.topic,
    )
    return (fix,)


def _encode(fix: GeoFix, messages: MessageFactory) -> Any:
    covariance = np.zeros(9) if fix.covariance_m2 is None else fix.covariance_m2.astype(np.float64).reshape(9)
    return messages.make(
        "sensor_msgs/msg/NavSatFix",
        messages.header(fix.stamp_ns, fix.frame_id),
        messages.make("sensor_msgs/msg/NavSatStatus", _FIX if fix.has_fix else _NO_FIX, _GPS),
        float(fix.latitude_deg),
        float(fix.longitude_deg),
        float(fix.altitude_m),
        covariance,
        _UNKNOWN if fix.covariance_m2 is None else _KNOWN,
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/NavSatFix",), produces=GeoFix, decode=_decode, encode=_encode)
