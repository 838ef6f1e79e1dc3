# SPDX-License-Identifier: MIT
"""A small exact world: an L-shaped room with a pillar, a scanner without noise, wheels that drift."""

from __future__ import annotations

import math

import numpy as np

from slamcli.geometry import se2
from slamcli.gmapping import GmappingParameters
from slamcli.gmapping.beams import BeamModel
from slamcli.measurements import LaserScan, Odometry

CORNERS = np.array([(-3.0, -2.0), (4.1, -2.0), (4.1, 1.2), (1.3, 1.2), (1.3, 4.0), (-3.0, 4.0)])
PILLAR = np.array([(-1.5, 0.8), (-1.1, 0.8), (-1.1, 1.4), (-1.5, 1.4)])
SECOND = 1_000_000_000


def _segments():
    sides = [np.stack([corners, np.roll(corners, -1, axis=0)], axis=1) for corners in (CORNERS, PILLAR)]
    return np.concatenate(sides)


SEGMENTS = _segments()


def ranges(pose, angles):
    """Exact distances to the walls along beams."""
    heading = angles + pose[2]
    u = np.column_stack([np.cos(heading), np.sin(heading)])
    a, d = SEGMENTS[:, 0] - np.asarray(pose[:2]), SEGMENTS[:, 1] - SEGMENTS[:, 0]
    cross = u[:, None, 0] * d[None, :, 1] - u[:, None, 1] * d[None, :, 0]
    cross = np.where(np.abs(cross) < 1e-12, np.nan, cross)
    r = (a[None, :, 0] * d[None, :, 1] - a[None, :, 1] * d[None, :, 0]) / cross
    t = (a[None, :, 0] * u[:, None, 1] - a[None, :, 1] * u[:, None, 0]) / cross
    return np.nanmin(np.where((r > 1e-9) & (t >= 0) & (t <= 1), r, np.inf), axis=1)


def scan_at(pose, stamp_ns=0, beams=90, fov=2 * math.pi, noise=None):
    increment = fov / beams
    angles = -fov / 2 + np.arange(beams) * increment
    found = ranges(pose, angles)
    if noise is not None:
        found = found + noise.normal(0, 0.01, beams)
    return LaserScan(
        stamp_ns=stamp_ns, frame_id="laser", angle_min_rad=-fov / 2, angle_increment_rad=increment, range_min_m=0.05,
        range_max_m=20.0, ranges_m=found.astype(np.float32), topic="/scan",
    )  # fmt: skip


def beams_at(pose, beams=90, **parameters):
    model = BeamModel(GmappingParameters(**parameters), np.eye(4))
    return model.beams(scan_at(pose, beams=beams))


def drive(count, turns=1.0, period_s=0.1):
    """A smooth drive around the pillar: stamps (N,) and true poses (N, 3)."""
    phase = np.linspace(0, 2 * math.pi * turns, count)
    x, y = -1.3 + 1.0 * np.cos(phase), 1.1 + 1.25 * np.sin(phase)
    yaw = np.unwrap(np.arctan2(1.25 * np.cos(phase), -1.0 * np.sin(phase)))
    stamps = SECOND * 1000 + np.round(np.arange(count) * period_s * SECOND).astype(np.int64)
    return stamps, np.column_stack([x, y, se2.wrap_angle(yaw)])


def drifting(poses, scale=1.03, turn=1.05, bias=0.001):
    """Odometry of that drive, beginning at zero: too long, turning too much, and drawn to one side."""
    motions = se2.between(poses[:-1], poses[1:]) * np.array([scale, scale, turn]) + np.array([0.0, 0.0, bias])
    found = [np.zeros(3)]
    for motion in motions:
        found.append(se2.compose(found[-1], motion))
    return np.array(found)


def odometry(stamp_ns, pose):
    half = pose[2] / 2
    return Odometry(
        stamp_ns=int(stamp_ns), frame_id="odom", child_frame_id="base_link", topic="/odom",
        position_m=np.array([pose[0], pose[1], 0.0]), quat_xyzw=np.array([0.0, 0.0, math.sin(half), math.cos(half)]),
    )  # fmt: skip


def from_first(poses):
    """Poses as seen from the first one."""
    return se2.between(np.broadcast_to(poses[0], poses.shape), poses)
