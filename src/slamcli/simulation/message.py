# SPDX-License-Identifier: MIT
"""What a simulated recording consists of."""

from __future__ import annotations

from typing import NamedTuple

from slamcli.measurements import Measurement


class Message(NamedTuple):
    """One measurement with its topic and the time at which it is logged (true time, when it is complete)."""

    log_time_ns: int
    topic: str
    measurement: Measurement
    msgtype: str | None = None
    """Message type where it is not the usual one of the measurement."""
