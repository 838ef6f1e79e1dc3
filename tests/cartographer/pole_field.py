# SPDX-License-Identifier: MIT
"""A drive around a rectangle in a field of single poles, which scans cannot be matched with: wheels that bend, fixes, landmarks."""

from __future__ import annotations

import itertools
import math

import numpy as np

from slamcli.cartographer.mapper_2d import Mapper2D
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.geometry import quaternion, se2
from slamcli.mapper import Setup
from slamcli.measurements import LandmarkObservation, Landmarks, LaserScan, Odometry, StampedPose
from slamcli.runtime import RunLog

PERIOD_S, SPEED_M_S = 0.25, 1.0
BEND_RAD_M = 0.01
LANDMARKS = {"a": (1.0, 3.0, 0.3), "b": (4.0, -3.0, -1.2), "c": (-2.0, 2.0, 2.5)}
FIELD = np.array([-37.0, 52.0, 1.1])
"""The map in the fixed frame."""
ANTENNA_M = np.array([-0.8, 0.3])


def path(width=24.0, height=16.0, extra=4.0):
    """Stamps (N,) and true poses (N, 3) around a rectangle with round corners, and `extra` metres over the start."""
    radius = 2.0
    sides = [width - 2 * radius, height - 2 * radius] * 2
    yaws, along = [], SPEED_M_S * PERIOD_S
    corner = math.pi / 2 * radius
    total = sum(sides) + 4 * corner + extra
    for s in np.arange(0.0, total, along):
        yaw, rest = 0.0, s
        for side in (*sides, sides[0]):
            if rest < side:
                break
            rest -= side
            yaw += min(rest, corner) / radius
            if rest < corner:
                break
            rest -= corner
        yaws.append(yaw)
    poses = [np.zeros(3)]
    for before, after in itertools.pairwise(yaws):
        turn = after - before
        chord = along if abs(turn) < 1e-9 else 2 * math.sin(turn / 2) / turn * along
        poses.append(se2.compose(poses[-1], [chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn]))
    return np.arange(len(poses)) * round(PERIOD_S * 1e9) + 10**18, np.array(poses)


def scans(stamps, poses, max_range=6.0, beams=120):
    """What a scanner sees of poles, one every 7 m."""
    grid = np.arange(-14.0, 45.0, 7.0)
    centres = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2) + 1.3
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    for stamp, pose in zip(stamps.tolist(), poses, strict=True):
        u = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
        off = centres - pose[:2]
        ahead = u @ off.T
        miss = (off**2).sum(axis=1) - ahead**2 - 0.15**2
        reach = np.where((miss < 0) & (ahead > 0), ahead - np.sqrt(np.maximum(-miss, 0.0)), np.inf).min(axis=1)
        yield LaserScan(
            stamp_ns=stamp, frame_id="laser", angle_min_rad=-math.pi, angle_increment_rad=2 * math.pi / beams,
            range_min_m=0.1, range_max_m=max_range, topic="/scan",
            ranges_m=np.where(reach < max_range, reach, np.inf).astype(np.float32),
        )  # fmt: skip


def wheels(stamps, poses, bend=BEND_RAD_M):
    """Odometry that turns by `bend` per metre."""
    steps = se2.between(poses[:-1], poses[1:])
    steps[:, 2] += bend * np.hypot(steps[:, 0], steps[:, 1])
    pose = poses[0]
    for k, stamp in enumerate(stamps.tolist()):
        pose = pose if k == 0 else se2.compose(pose, steps[k - 1])
        yield Odometry(
            stamp_ns=stamp, frame_id="odom", child_frame_id="base_link", topic="/odom",
            position_m=np.array([*pose[:2], 0.0]), quat_xyzw=quaternion.from_yaw(pose[2]),
        )  # fmt: skip


def fixes(stamps, poses, sigma=0.5, period_s=1.0, wrong=0.0, turned=False, rng=None):
    """What a receiver says every second, `wrong` of them far off; `turned` for a sensor of whole poses."""
    rng = np.random.default_rng(3) if rng is None else rng
    for k in range(0, len(stamps), round(period_s / PERIOD_S)):
        seen = se2.compose(FIELD, poses[k])
        place = se2.transform_points(seen, ANTENNA_M[None])[0] + rng.normal(0.0, sigma, 2)
        if rng.random() < wrong:
            place += rng.uniform(-60.0, 60.0, 2)
        covariance = np.diag([sigma**2] * 3 + [0.01 if turned else math.inf] * 3)
        yield StampedPose(
            stamp_ns=int(stamps[k]) + 30_000_000, frame_id="earth_plane", child_frame_id="gps", topic="/fix",
            position_m=np.array([*place, 0.0]), quat_xyzw=quaternion.from_yaw(seen[2] if turned else 0.0), covariance=covariance,
        )  # fmt: skip


def landmarks(stamps, poses, reach_m=5.0, weight=1e4, rng=None):
    """What a detector says that is mounted half a metre ahead and looks sideways: tags within reach, to 2 cm and a degree."""
    rng = np.random.default_rng(4) if rng is None else rng
    for stamp, pose in zip(stamps.tolist(), poses, strict=True):
        found = []
        for name, place in LANDMARKS.items():
            seen = se2.between(se2.compose(pose, [0.5, 0.0, 0.0]), place)
            if math.hypot(*seen[:2]) < reach_m:
                seen = seen + rng.normal(0.0, [0.02, 0.02, 0.02])
                lying = quaternion.multiply(quaternion.from_yaw(seen[2]), [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
                found.append(
                    LandmarkObservation(
                        id=name, position_m=np.array([*seen[:2], 1.0]), quat_xyzw=lying, translation_weight=weight,
                        rotation_weight=weight,
                    )
                )  # fmt: skip
        yield Landmarks(stamp_ns=stamp + 100_000_000, frame_id="camera", topic="/landmarks", observations=tuple(found))


def mount(x=0.0, y=0.0):
    T = np.eye(4)
    T[:2, 3] = x, y
    return T


def run(*streams, parameters=None, state=None, log=None):
    """Map what streams of measurements tell, in the order of time."""
    setup = Setup(
        T_base_laser={"/scan": np.eye(4)},
        T_base_sensor={"/fix": mount(*ANTENNA_M), "/landmarks": mount(0.5)},
        state=state,
        log=log or RunLog(),
    )
    mapper = Mapper2D(parameters or CartographerParameters(), setup)
    for measurement in sorted((one for stream in streams for one in stream), key=lambda one: one.stamp_ns):
        mapper.process(measurement)
    return mapper.finish()
