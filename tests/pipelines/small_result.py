# SPDX-License-Identifier: MIT
"""A recording of a robot that drives along a room, and the result that a perfect tier would leave of it."""

from __future__ import annotations

import json
import math

import numpy as np

from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import write_tum
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, LaserScan, Odometry
from slamcli.recordings import create_recording
from slamcli.trajectory import Trajectory

START_NS = 1_700_000_000_000_000_000
STEPS = 20
LENGTH_M, WIDTH_M = 8.0, 3.0
MOUNT_M = 0.2
"""How far the scanner sits ahead of the base."""
REACH_M = 2.5


def poses_se2():
    """Return the way of the base, (STEPS, 3)."""
    return np.column_stack([np.linspace(1.0, 6.0, STEPS), np.full(STEPS, 1.5), np.zeros(STEPS)])


def stamps_ns():
    return START_NS + np.arange(STEPS) * 500_000_000


def scan_at(i):
    """Return what the scanner sees of the room from pose i, nothing beyond REACH_M."""
    x, y, _ = poses_se2()[i]
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_x = np.where(dx > 0, (LENGTH_M - x - MOUNT_M) / dx, np.where(dx < 0, (x + MOUNT_M) / -dx, np.inf))
        to_y = np.where(dy > 0, (WIDTH_M - y) / dy, np.where(dy < 0, y / -dy, np.inf))
    ranges = np.minimum(to_x, to_y)
    ranges[ranges > REACH_M] = np.inf
    return LaserScan(
        stamp_ns=int(stamps_ns()[i]), frame_id="laser", angle_min_rad=-math.pi, angle_increment_rad=2 * math.pi / 360,
        range_min_m=0.05, range_max_m=10.0, ranges_m=ranges.astype(np.float32),
    )  # fmt: skip


def room():
    """Return the map of the room: walls a cell thick, free within, 0.1 m."""
    rows, columns = round(WIDTH_M / 0.1) + 2, round(LENGTH_M / 0.1) + 2
    cells = np.full((rows, columns), 100, dtype=np.int8)
    cells[1:-1, 1:-1] = 0
    return OccupancyGrid(cells, 0.1, (-0.1, -0.1, 0.0))


def write_recording(path):
    with create_recording(path) as recording:
        mount = FrameTransform(
            stamp_ns=START_NS, parent_frame_id="base_link", child_frame_id="laser",
            position_m=np.array([MOUNT_M, 0.0, 0.3]), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), static=True,
        )  # fmt: skip
        recording.write_transforms("/tf_static", [mount])
        for i, pose in enumerate(poses_se2()):
            odometry = Odometry(
                stamp_ns=int(stamps_ns()[i]), frame_id="odom", child_frame_id="base_link",
                position_m=np.array([pose[0] - 1.0, 0.0, 0.0]), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
                linear_m_s=np.zeros(3), angular_rad_s=np.zeros(3),
            )  # fmt: skip
            recording.write("/odom", odometry)
            recording.write("/scan", scan_at(i))


def write_result(folder, recording, **changes):
    """Write map, trajectory and record of a run on `recording`."""
    folder.mkdir()
    write_map(folder / "map.yaml", room())
    write_tum(folder / "trajectory.tum", Trajectory.from_se2(stamps_ns(), poses_se2(), "map", "base_link"))
    run = {
        "slamcli": "0", "algo": "gmapping", "seed": 0,
        "inputs": [{"name": recording.name, "size_bytes": recording.stat().st_size}],
        "topics": {"scan": "/scan", "odometry": "/odom"},
        "frames": {"base": "base_link", "odom": "odom", "laser": "laser"}, "parameters": {"maxUrange": 80.0},
    } | changes  # fmt: skip
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return folder


def write_images_result(folder, steps):
    """Write trajectory, keyframes and record of a run on ``sample_data/desk_rgbd.mcap``: no tier's, the base moves straight on."""
    folder.mkdir()
    stamps = START_NS + np.arange(31) * 100_000_000
    poses = np.column_stack([np.linspace(0, 1, 31), np.zeros(31), np.zeros(31)])
    write_tum(folder / "trajectory.tum", Trajectory.from_se2(stamps, poses, "map", "body"))
    write_tum(folder / "keyframes.tum", Trajectory.from_se2(stamps[::10], poses[::10], "map", "body"))
    run = {"algo": "orbslam3", "topics": {"rgb": "/camera/color/image_raw/compressed"}, "frames": {"base": "body"}}
    (folder / "run.json").write_text(json.dumps({**run, "steps": steps}), encoding="utf-8")
    return folder
