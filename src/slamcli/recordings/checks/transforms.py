# SPDX-License-Identifier: MIT
"""Checks of the frame tree and of odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamcli.measurements import Image, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.frames import is_transform_topic

_LATE_S = 1.0
_BASE_FRAMES = ("base_link", "base_footprint", "base")
_MAP_FRAMES = ("map", "earth", "world")


def contradictions(evidence: Evidence) -> Iterator[Finding]:
    """Say where the transforms contradict each other (two parents, cycles)."""
    for problem in evidence.frames.problems:
        yield Finding(
            severity="error" if "cycle" in problem else "warning",
            topic="/tf",
            message=problem,
            mend="--rename-frame OLD=NEW, or --static-tf for the transform that is right",
        )


def missing(evidence: Evidence) -> Iterator[Finding]:
    """Find sensors whose place on the robot is unknown."""
    tree = evidence.frames
    base = next((frame for frame in _BASE_FRAMES if frame in tree.frames), None)
    if base is None:
        base = next((o.first.child_frame_id for o in evidence.of(Odometry).values() if o.first is not None), "") or None
    if base is None and evidence.of(Image) and not _has_ranges(evidence):
        yield from _missing_imu(evidence)
        return
    for kind, what in ((LaserScan, "scanner"), (PointCloud, "scanner"), (ImuSample, "IMU"), (Image, "camera")):
        for name, found in evidence.of(kind).items():
            frame = getattr(found.first, "frame_id", None)
            if frame is None or (base is not None and tree.connected(base, frame)):
                continue
            if what == "scanner" and evidence.laser_placed:
                continue
            if kind is PointCloud and frame in _MAP_FRAMES:
                continue  # a map, no sensor
            if base is None:
                severity, message = "warning", f"no transforms: where the {what} ({frame}) sits on the robot is unknown"
            elif frame == "":
                severity, message = "error", f"the {what}'s messages name no frame"
            else:
                severity, message = "error", f"no transform from {base} to the {what}'s frame {frame}"
            mend = f"--static-tf {base or 'base_link'},{frame or 'FRAME'},X,Y,Z,YAW,PITCH,ROLL"
            yield Finding(
                severity=severity,
                topic=name,
                message=message,
                stamp_ns=getattr(found.first, "stamp_ns", None),
                mend=f"{mend} or --laser-pose X,Y,YAW or --urdf FILE"
                if what == "scanner"
                else f"{mend} or --urdf FILE",
            )


def _has_ranges(evidence: Evidence) -> bool:
    """Return whether there are scans, or clouds of a sensor: those in a map's frame are maps."""
    clouds = evidence.of(PointCloud).values()
    return bool(evidence.of(LaserScan)) or any(
        getattr(found.first, "frame_id", None) not in _MAP_FRAMES for found in clouds
    )


def _missing_imu(evidence: Evidence) -> Iterator[Finding]:
    """Find IMUs whose place is unknown where cameras are all there is: these need no robot, but an IMU needs its camera."""
    cameras = [found.first.frame_id for found in evidence.of(Image).values() if found.first is not None]
    for name, found in evidence.of(ImuSample).items():
        frame = getattr(found.first, "frame_id", "")
        if cameras and not any(camera == frame or evidence.frames.connected(camera, frame) for camera in cameras):
            yield Finding(
                severity="warning",
                topic=name,
                message=f"no transform from the camera ({cameras[0]}) to the IMU's frame {frame or '(none)'}",
                stamp_ns=getattr(found.first, "stamp_ns", None),
                mend=f"--static-tf {cameras[0]},{frame or 'FRAME'},X,Y,Z,YAW,PITCH,ROLL or --urdf FILE",
            )


def late(evidence: Evidence) -> Iterator[Finding]:
    """Find moving transforms that begin after, or end before, the scans."""
    ranges = {**evidence.of(LaserScan), **evidence.of(PointCloud)}
    if not ranges:
        return
    first = min(int(found.stamps_ns.min()) for found in ranges.values())
    last = max(int(found.stamps_ns.max()) for found in ranges.values())
    for edge in evidence.frames.edges:
        if edge.static or len(edge.stamps_ns) < 2:
            continue
        begins_s = (int(edge.stamps_ns[0]) - first) / 1e9
        ends_s = (last - int(edge.stamps_ns[-1])) / 1e9
        for off_s, what, stamp in (
            (begins_s, "begins after the first scan", edge.stamps_ns[0]),
            (ends_s, "ends before the last scan", edge.stamps_ns[-1]),
        ):
            if off_s > _LATE_S:
                yield Finding(
                    severity="warning",
                    topic="/tf",
                    message=f"{edge.parent} -> {edge.child} {what}, by {off_s:.1f} s",
                    stamp_ns=int(stamp),
                    mend=f"--start {off_s:.1f}" if what.startswith("begins") else "",
                )


def map_parent(evidence: Evidence) -> Iterator[Finding]:
    """Find a recorded localisation: transforms below a map frame are another run's result."""
    for edge in evidence.frames.edges:
        if edge.parent in _MAP_FRAMES:
            yield Finding(
                severity="note",
                topic="/tf",
                message=f"{edge.parent} -> {edge.child} was recorded: the result of another SLAM run, not used",
            )


def shared_frames(evidence: Evidence) -> Iterator[Finding]:
    """Find a frame that several sensors of one kind share (cartographer refuses that)."""
    for kind in (LaserScan, PointCloud, ImuSample):
        by_frame: dict[str, list[str]] = {}
        for name, found in evidence.of(kind).items():
            frame = getattr(found.first, "frame_id", "")
            if frame:
                by_frame.setdefault(frame, []).append(name)
        for frame, names in by_frame.items():
            if len(names) > 1:
                yield Finding(
                    severity="note",
                    topic=names[0],
                    message=f"{', '.join(names)} share the frame {frame}: one sensor published twice, or a wrong frame",
                )


def odometry(evidence: Evidence) -> Iterator[Finding]:
    """Say if there is no odometry, or if it jumps."""
    if not _has_ranges(evidence):
        return
    moving = [edge for edge in evidence.frames.edges if not edge.static and "odom" in edge.parent]
    if not evidence.odometry and not moving:
        has_tf = any(is_transform_topic(found.topic) for found in evidence.surveys.values())
        yield Finding(
            severity="warning",
            message="no odometry: no nav_msgs/Odometry topic, and no odom frame that moves on /tf"
            + ("" if has_tf else " (there is no /tf at all)"),
        )
    for name, found in evidence.odometry.items():
        if len(found.poses) < 3:
            continue
        steps = np.linalg.norm(np.diff(np.array(found.poses)[:, :2], axis=0), axis=1)
        jumps = np.flatnonzero(steps > max(1.0, 20 * float(np.percentile(steps, 95))))
        if len(jumps):
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{len(jumps)} jumps, the largest of {steps.max():.2f} m between two messages",
                stamp_ns=found.stamps[int(jumps[0]) + 1],
                count=len(jumps),
            )
