# SPDX-License-Identifier: MIT
"""A corridor around a block, with doors and niches, that a robot drives around more than once; and its sensors."""

from __future__ import annotations

import math

import numpy as np

from slamcli.cartographer.mapper_2d import Mapper2D
from slamcli.cartographer.parameters import CartographerParameters, Submaps2d, TrajectoryBuilder2d
from slamcli.geometry import se2
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample, LaserScan, Odometry
from slamcli.runtime import RunLog

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
BOXES = np.array(
    [
        (-2.0, -2.0, 12.03, 9.01), (0.02, 0.03, 10.0, 7.04),  # the outer walls and the block
        (3.1, -2.0, 3.5, -1.4), (8.7, -2.0, 9.9, -1.7), (11.2, 2.0, 12.03, 3.3), (11.6, 6.1, 12.03, 6.5),
        (6.2, 8.3, 6.6, 9.01), (1.0, 8.6, 2.4, 9.01), (-2.0, 5.2, -1.3, 5.9), (-2.0, 1.1, -1.7, 2.9),
        (4.9, 7.04, 5.3, 7.4), (-0.4, 3.0, 0.02, 3.4), (10.0, 4.6, 10.3, 5.4),
    ]
)  # fmt: skip
"""Low x, low y, high x, high y."""


def ranges(pose, angles, boxes=BOXES):
    """Distances (N,) to the nearest side of a box along beams from a pose; inf for none."""
    u = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])[:, None, :]
    best = np.full(len(angles), np.inf)
    for axis in (0, 1):
        lines = np.concatenate([boxes[:, axis], boxes[:, axis + 2]])
        low, high = np.tile(boxes[:, 1 - axis], 2), np.tile(boxes[:, 3 - axis], 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            r = (lines - pose[axis]) / u[..., axis]
            across = pose[1 - axis] + r * u[..., 1 - axis]
        hit = (r > 1e-9) & (across >= low) & (across <= high)
        best = np.minimum(best, np.where(hit, r, np.inf).min(axis=1))
    return best


def drive(count=240, turns=1.25):
    """True poses (N, 3) along the middle of the corridor, with round corners; from rest, faster and faster for 40 scans."""
    corners = np.array([(-1.0, -1.0), (11.0, -1.0), (11.0, 8.0), (-1.0, 8.0)])
    points, r = [], 0.9
    for k in range(4):
        before, here, after = corners[k - 1], corners[k], corners[(k + 1) % 4]
        into, out = (here - before) / np.linalg.norm(here - before), (after - here) / np.linalg.norm(after - here)
        centre = here - r * into + r * out
        a = np.linspace(0.0, math.pi / 2, 15)[:, None]
        points += list(centre + r * (np.sin(a) * into - np.cos(a) * out))
    points = np.array([*points, points[0]])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    speed = np.minimum(np.arange(count) / 40.0, 1.0)
    s = (0.5 * way[15] + turns * way[-1] * np.cumsum(speed) / speed.sum()) % way[-1]
    x, y = np.interp(s, way, points[:, 0]), np.interp(s, way, points[:, 1])
    ahead = (s + 0.05) % way[-1]
    yaw = np.arctan2(np.interp(ahead, way, points[:, 1]) - y, np.interp(ahead, way, points[:, 0]) - x)
    return np.column_stack([x, y, yaw])


def stamps_of(count, period_s=0.1):
    return START + np.round(np.arange(count) * period_s * SECOND).astype(np.int64)


def scan(
    pose,
    stamp_ns,
    *,
    topic="/scan",
    mount=(0.0, 0.0, 0.0),
    beams=180,
    fov=2 * math.pi,
    noise=None,
    blind=False,
    boxes=BOXES,
):
    angles = -fov / 2 + np.arange(beams) * fov / beams
    found = np.full(beams, np.inf) if blind else ranges(se2.compose(pose, np.array(mount)), angles, boxes)
    if noise is not None:
        found = found + noise.normal(0, 0.01, beams)
    return LaserScan(
        stamp_ns=int(stamp_ns), frame_id=topic[1:], angle_min_rad=-fov / 2, angle_increment_rad=fov / beams,
        range_min_m=0.05, range_max_m=20.0, ranges_m=found.astype(np.float32), topic=topic,
    )  # fmt: skip


def wheels(poses, scale=1.02, turn=1.03, seed=None):
    """Odometry (N, 3) of a drive, from zero: too long, turning too far, and noisy."""
    steps = se2.between(poses[:-1], poses[1:]) * np.array([scale, scale, turn])
    if seed is not None:
        steps = steps + np.random.default_rng(seed).normal(0, 1, steps.shape) * np.array([0.005, 0.001, 0.002])
    found = [np.zeros(3)]
    for step in steps:
        found.append(se2.compose(found[-1], step))
    return np.array(found)


def odometry(stamp_ns, pose):
    return Odometry(
        stamp_ns=int(stamp_ns), frame_id="odom", child_frame_id="base_link", topic="/odom",
        position_m=np.array([pose[0], pose[1], 0.0]),
        quat_xyzw=np.array([0.0, 0.0, math.sin(pose[2] / 2), math.cos(pose[2] / 2)]),
    )  # fmt: skip


def gyroscope(stamps, poses, bias=0.002, gravity=9.81):
    """IMU samples, four between two scans, of the turns of a drive."""
    fine = np.arange(stamps[0], stamps[-1] + 1, (stamps[1] - stamps[0]) // 4)
    yaw = np.interp(fine - stamps[0], stamps - stamps[0], np.unwrap(poses[:, 2]))
    rates = np.gradient(yaw, (fine - stamps[0]) / SECOND) + bias
    force = np.array([0.0, 0.0, gravity])
    return [
        ImuSample(
            stamp_ns=int(t), frame_id="base_link", topic="/imu", angular_rad_s=np.array([0.0, 0.0, rate]),
            acceleration_m_s2=force,
        )
        for t, rate in zip(fine, rates, strict=True)
    ]  # fmt: skip


def recorded(poses, stamps=None, *, told=None, imu=(), blind=(), seed=1, boxes=BOXES):
    """Scans with odometry before each, and IMU samples, in the order of their stamps."""
    stamps = stamps_of(len(poses)) if stamps is None else stamps
    noise, blind = np.random.default_rng(seed), set(blind)
    out = []
    for k, (pose, stamp) in enumerate(zip(poses, stamps, strict=True)):
        if told is not None:
            out.append(odometry(stamp, told[k]))
        out.append(scan(pose, stamp, noise=noise, blind=k in blind, boxes=boxes))
    return sorted([*imu, *out], key=lambda m: m.stamp_ns) if imu else out


def parameters(pose_graph=None, **local):
    """Small submaps, so that there are many."""
    builder = TrajectoryBuilder2d(submaps=Submaps2d(num_range_data=20), **local)
    more = {} if pose_graph is None else {"pose_graph": pose_graph}
    return CartographerParameters(trajectory_builder_2d=builder, **more)


def mapped(measurements, p=None, *, jobs=1, mounts=None, log=None):
    mounts = {"/scan": np.eye(4)} if mounts is None else mounts
    setup = Setup(T_base_laser=mounts, T_base_sensor={"/imu": np.eye(4)}, jobs=jobs, log=log or RunLog())
    mapper = Mapper2D(p or parameters(), setup)
    for measurement in measurements:
        mapper.process(measurement)
    return mapper.finish()


def errors(result, poses):
    """Distance (N,) and turn (N,) between the poses that were found and the true ones, both seen from the first."""
    found = result.trajectory.poses_se2
    off = se2.between(found[0], found) - se2.between(poses[0], poses)
    return np.hypot(off[:, 0], off[:, 1]), np.abs(se2.wrap_angle(off[:, 2]))
