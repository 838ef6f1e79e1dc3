# SPDX-License-Identifier: MIT
"""Checks of cameras: calibration, sizes, synchronisation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamcli.measurements import CameraModel, Image
from slamcli.recordings.camera_topics import info_topic
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.tier_fit import sensor_topics


def calibration(evidence: Evidence) -> Iterator[Finding]:
    """Find images without, with an unset, or with a changing calibration."""
    infos = list(evidence.of(CameraModel))
    for name, found in evidence.of(Image).items():
        if info_topic(name, infos) is None:
            yield Finding(
                severity="warning",
                topic=name,
                message="no sensor_msgs/CameraInfo belongs to these images",
                stamp_ns=getattr(found.first, "stamp_ns", None),
                mend="--camera-info FILE",
            )
    for name, seen in evidence.cameras.items():
        first = seen.first
        if first is not None and not (first.intrinsics[0, 0] > 0 and first.intrinsics[1, 1] > 0):
            yield Finding(
                severity="error",
                topic=name,
                message="the camera is not calibrated: its focal length is 0",
                stamp_ns=first.stamp_ns,
                mend=f"--camera-info {name}=FILE",
            )
        if seen.num_changes:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"the calibration changes during the recording ({seen.num_changes} messages differ from the first)",
                stamp_ns=seen.first_change_ns,
                count=seen.num_changes,
                mend=f"--camera-info {name}=FILE",
            )


def size(evidence: Evidence) -> Iterator[Finding]:
    """Compare the size of images with the one in their calibration."""
    infos = list(evidence.of(CameraModel))
    for name, seen in evidence.images.items():
        info = info_topic(name, infos)
        model = evidence.cameras[info].first if info is not None and info in evidence.cameras else None
        if seen.first is None:
            continue
        height, width = seen.first.pixels.shape[:2]
        if model is not None and model.width and (model.width, model.height) != (width, height):
            yield Finding(
                severity="error",
                topic=name,
                message=f"images have {width} x {height} pixels, the calibration on {info} is for "
                f"{model.width} x {model.height}",
                stamp_ns=seen.first.stamp_ns,
                mend=f"--camera-info {info}=FILE",
            )


def synchronisation(evidence: Evidence) -> Iterator[Finding]:
    """Find pairs of images (colour and depth, left and right) that were not taken together."""
    sensors = sensor_topics(evidence.surveys, evidence.frames)
    pairs = [(sensors.colour[0], sensors.depth[0])] if sensors.colour and sensors.depth else []
    if sensors.stereo is not None:
        pairs.append(sensors.stereo)
    for a, b in pairs:
        stamps_a, stamps_b = (np.sort(evidence.surveys[name].stamps_ns) for name in (a, b))
        if len(stamps_a) < 2 or len(stamps_b) < 2:
            continue
        after = np.clip(np.searchsorted(stamps_b, stamps_a), 1, len(stamps_b) - 1)
        near = np.minimum(np.abs(stamps_b[after] - stamps_a), np.abs(stamps_a - stamps_b[after - 1])) / 1e9
        period = float(np.median(np.diff(stamps_a))) / 1e9
        apart = float(np.median(near))
        if apart > 0.005 and apart > 0.1 * period:
            yield Finding(
                severity="error" if apart > period else "warning",
                topic=b,
                message=f"typically {1e3 * apart:.1f} ms apart from the images of {a}",
                stamp_ns=int(stamps_b[0]),
                mend=f"--time-offset {b}=SECONDS",
            )
        lonely = int(np.count_nonzero(near > 0.5 * period))
        if lonely > 0.05 * len(near) and apart <= 0.5 * period:
            yield Finding(
                severity="note", topic=a, message=f"{lonely} of {len(near)} images have no partner on {b}", count=lonely
            )
