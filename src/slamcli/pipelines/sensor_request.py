# SPDX-License-Identifier: MIT
"""Which sensors the user asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.sensor_picks import TopicNames


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRequest:
    """What the user asks for; None or empty: by native files, else found from the recording."""

    names: TopicNames = field(default_factory=TopicNames)
    cameras: CameraNames = field(default_factory=CameraNames)
    camera_files: Sequence[Path] = ()
    """Calibration files of the cameras; later wins."""
    mode: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
