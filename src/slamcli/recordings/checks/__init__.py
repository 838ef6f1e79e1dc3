# SPDX-License-Identifier: MIT
"""What can be wrong with a recording: one small function for each fault, and one line for each in `CHECKS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from slamcli.recordings.checks import cameras, container, images, inertial, scanner, stamps, sweeps, transforms
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import SEVERITIES, Finding

Check = Callable[[Evidence], Iterator[Finding]]

# Name (as users see it) -> check.
CHECKS: dict[str, Check] = {
    "damage": container.damage,
    "empty-topic": container.empty_topics,
    "undecodable": container.undecodable,
    "mend-unused": container.unused_mends,
    "stamp-unset": stamps.unset,
    "stamp-unit": stamps.unit,
    "stamp-backward": stamps.backward,
    "stamp-duplicate": stamps.duplicate,
    "stamp-gap": stamps.gaps,
    "stamp-delay": stamps.delay,
    "stamp-clocks": stamps.clocks,
    "stamp-turning": stamps.turning,
    "tf-problems": transforms.contradictions,
    "tf-missing": transforms.missing,
    "tf-late": transforms.late,
    "tf-map-parent": transforms.map_parent,
    "frame-shared": transforms.shared_frames,
    "frame-slash": sweeps.slashes,
    "odometry": transforms.odometry,
    "scan-beams": scanner.beam_count,
    "scan-angle-max": scanner.angle_max,
    "scan-limits": scanner.limits,
    "scan-returns": scanner.returns,
    "scan-direction": scanner.direction,
    "scan-mirrored": scanner.mirrored,
    "sweep-overlap": sweeps.overlap,
    "sweep-stamp": sweeps.stamp_meaning,
    "sweep-repeated": sweeps.repeated,
    "sweep-blind": sweeps.blind,
    "point-times": sweeps.point_times,
    "imu-gravity": inertial.gravity,
    "imu-rotation": inertial.rotation,
    "camera-info": cameras.calibration,
    "camera-size": cameras.size,
    "depth-scale": images.depth_scale,
    "depth-registration": images.registration,
    "camera-sync": cameras.synchronisation,
    "image-size": images.size_changes,
    "image-dropped": images.dropped,
    "image-repeated": images.repeated,
    "image-exposure": images.exposure,
    "image-blur": images.blur,
}

__all__ = ["CHECKS", "SEVERITIES", "Check", "Evidence", "Finding"]
