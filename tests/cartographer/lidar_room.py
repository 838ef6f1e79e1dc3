# SPDX-License-Identifier: MIT
"""A tiny world of boxes and pillars, ray cast by a spinning multi-beam sensor on a robot that moves while it sweeps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.measurements import ImuSample, PointCloud

GRAVITY = 9.81


@dataclass(frozen=True)
class BoxWorld:
    """Axis-aligned boxes (seen from outside or inside) on a floor at z = 0."""

    low: np.ndarray
    high: np.ndarray
    pillars: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """x, y, radius."""

    def cast(self, origins, directions, reach=60.0):
        """Ranges (N,) along unit directions from origins; inf where nothing is hit within reach."""
        ranges = np.full(len(origins), np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            floor = -origins[:, 2] / directions[:, 2]
            ranges = np.where(floor > 1e-6, floor, ranges)
            inverse = 1.0 / directions
            for low, high in zip(self.low, self.high, strict=True):
                a, b = (low - origins) * inverse, (high - origins) * inverse
                near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
                hit = np.where(near > 1e-6, near, far)
                ranges = np.where((near <= far) & (hit > 1e-6) & (hit < ranges), hit, ranges)
            for x, y, radius in self.pillars:
                o, d = origins[:, :2] - (x, y), directions[:, :2]
                a, b, c = (d * d).sum(1), (o * d).sum(1), (o * o).sum(1) - radius**2
                hit = (-b - np.sqrt(b * b - a * c)) / a
                ranges = np.where((hit > 1e-6) & (hit < ranges), hit, ranges)
        return np.where(ranges <= reach, ranges, np.inf)


def hall(seed=0, size=(30.0, 20.0, 6.0), boxes=14):
    """A hall with boxes and pillars in it, the same for the same seed; its middle is free."""
    rng = np.random.default_rng(seed)
    low, high = [np.array([-size[0] / 2, -size[1] / 2, -1.0])], [np.array([size[0] / 2, size[1] / 2, size[2]])]
    while len(low) <= boxes:
        centre = rng.uniform(-0.5, 0.5, 2) * size[:2]
        half = rng.uniform(0.3, 1.5, 2)
        if np.hypot(centre[0] / size[0], centre[1] / size[1]) < 0.36:
            continue
        low.append(np.array([*(centre - half), 0.0]))
        high.append(np.array([*(centre + half), rng.uniform(0.5, 4.0)]))
    pillars = np.column_stack([rng.uniform(-0.5, 0.5, (4, 2)) * size[:2], rng.uniform(0.15, 0.4, 4)])
    pillars = pillars[np.hypot(pillars[:, 0] / size[0], pillars[:, 1] / size[1]) > 0.36]
    return BoxWorld(np.array(low), np.array(high), pillars)


def city(seed=0, block=24.0, street=12.0, blocks=(4, 4)):
    """Houses with setbacks along a grid of streets, with pillars (trees) on the pavement."""
    rng = np.random.default_rng(seed)
    low, high, pillars = [], [], []
    pitch = block + street
    for i in range(blocks[0]):
        for j in range(blocks[1]):
            corner = np.array([i * pitch, j * pitch])
            for a in range(2):
                for b in range(2):
                    o = corner + np.array([a, b]) * block / 2 + rng.uniform(0.0, 2.5, 2)
                    e = corner + np.array([a + 1, b + 1]) * block / 2 - rng.uniform(0.0, 2.5, 2)
                    low.append([*o, 0.0])
                    high.append([*e, rng.uniform(4.0, 15.0)])
            for _ in range(4):
                side = rng.integers(4)
                t = rng.uniform(0, block)
                x, y = [(t, -1.5), (t, block + 1.5), (-1.5, t), (block + 1.5, t)][side]
                pillars.append([corner[0] + x, corner[1] + y, rng.uniform(0.1, 0.3)])
    return BoxWorld(np.array(low), np.array(high), np.array(pillars))


@dataclass(frozen=True)
class Drive:
    """A closed path through waypoints, driven smoothly; roll and pitch sway a little."""

    waypoints: np.ndarray
    speed: float = 2.0
    sway: float = 0.01
    height: float = 0.0
    rest: float = 1.5
    ramp: float = 2.0

    def __post_init__(self):
        steps = np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1)
        object.__setattr__(self, "_s", np.concatenate([[0.0], np.cumsum(steps)]))

    @property
    def duration(self):
        return self._s[-1] / self.speed + 2 * self.ramp + self.rest

    def _way(self, t):
        """Way driven at times t: at rest, then faster evenly, then at the speed, then slower evenly."""
        driving = self.duration - self.rest - self.ramp
        t = np.clip(t - self.rest, 0.0, driving + self.ramp)
        up = np.minimum(t, self.ramp) ** 2 / (2 * self.ramp) + np.maximum(t - self.ramp, 0.0)
        down = np.maximum(t - driving, 0.0) ** 2 / (2 * self.ramp)
        return np.clip(self.speed * (up - down), 0.0, self._s[-1])

    def positions(self, t):
        """Positions (N, 3), smoothed over 1.5 s so that corners are driven as arcs."""
        out = np.zeros((len(t), 3))
        offsets = np.linspace(-0.75, 0.75, 31)
        for o in offsets:
            s = self._way(np.asarray(t) + o)
            for d in range(2):
                out[:, d] += np.interp(s, self._s, self.waypoints[:, d]) / len(offsets)
        out[:, 2] = self.height
        return out

    def poses(self, t):
        """T_world_base (N, 4, 4) at times t (N,), seconds."""
        t = np.asarray(t, dtype=np.float64)
        e = 0.05
        moving = np.clip(t, self.rest, self.duration - self.ramp - 0.3)
        ahead, back = self.positions(moving + e), self.positions(moving - e)
        yaw = np.arctan2(ahead[:, 1] - back[:, 1], ahead[:, 0] - back[:, 0])
        roll, pitch = self.sway * np.sin(2.1 * t), self.sway * np.sin(1.3 * t + 0.4)
        q = quaternion.from_roll_pitch_yaw(roll, pitch, yaw)
        return se3.from_position_quaternion(self.positions(t), q)


@dataclass(frozen=True)
class Lidar:
    """A spinning sensor, columns measured one after the other over the sweep."""

    rings: int = 16
    columns: int = 360
    lowest_deg: float = -15.0
    highest_deg: float = 15.0
    rate_hz: float = 10.0
    noise_m: float = 0.02
    T_base_lidar: np.ndarray = field(
        default_factory=lambda: se3.from_position_quaternion([0.1, 0.0, 1.2], [0.0, 0.0, 0.0, 1.0])
    )

    def sweep(self, world, drive, t0, rng, stamp0_ns=1_700_000_000_000_000_000):
        elevation = np.radians(np.linspace(self.lowest_deg, self.highest_deg, self.rings))
        azimuth = np.linspace(0, 2 * np.pi, self.columns, endpoint=False)
        offset = np.arange(self.columns) / self.columns / self.rate_hz
        T = drive.poses(t0 + offset) @ self.T_base_lidar
        d = np.stack(
            [
                np.cos(elevation)[None] * np.cos(azimuth)[:, None],
                np.cos(elevation)[None] * np.sin(azimuth)[:, None],
                np.broadcast_to(np.sin(elevation), (self.columns, self.rings)),
            ],
            axis=-1,
        )
        world_d = np.einsum("cij,crj->cri", T[:, :3, :3], d).reshape(-1, 3)
        origins = np.repeat(T[:, :3, 3], self.rings, axis=0)
        ranges = world.cast(origins, world_d)
        ranges = ranges + rng.normal(0, self.noise_m, len(ranges))
        hit = np.isfinite(ranges)
        points = (d.reshape(-1, 3)[hit] * ranges[hit, None]).astype(np.float32)
        offsets = np.repeat((offset * 1e9).astype(np.int64), self.rings)[hit]
        heights = (origins + world_d * np.where(hit, ranges, 0)[:, None])[hit, 2]
        return PointCloud(
            stamp_ns=stamp0_ns + round(t0 * 1e9),
            frame_id="lidar",
            points_m=points,
            offset_ns=offsets,
            intensities=np.clip(heights * 10, 0, 255).astype(np.float32),
            topic="/points",
        )


def imu_samples(
    drive, t0, t1, rng, rate=100.0, gyro_bias=(0.0, 0.0, 0.0), noise=(0.002, 0.02), stamp0_ns=1_700_000_000_000_000_000
):
    """ImuSamples at [t0, t1) of an IMU that sits in the base frame's origin."""
    t = np.arange(np.ceil(t0 * rate), np.ceil(t1 * rate)) / rate
    h = 0.005
    T0, T1, T2 = drive.poses(t - h), drive.poses(t), drive.poses(t + h)
    dR = np.swapaxes(T0[:, :3, :3], 1, 2) @ T2[:, :3, :3]
    w = np.stack([dR[:, 2, 1] - dR[:, 1, 2], dR[:, 0, 2] - dR[:, 2, 0], dR[:, 1, 0] - dR[:, 0, 1]], -1) / (4 * h)
    h = 0.05
    a = (drive.positions(t + h) - 2 * drive.positions(t) + drive.positions(t - h)) / h**2
    a[:, 2] += GRAVITY
    f = np.einsum("nji,nj->ni", T1[:, :3, :3], a)
    w = w + np.asarray(gyro_bias) + rng.normal(0, noise[0], w.shape)
    f = f + rng.normal(0, noise[1], f.shape)
    return [
        ImuSample(
            stamp_ns=stamp0_ns + round(s * 1e9),
            frame_id="base_link",
            angular_rad_s=w[i],
            acceleration_m_s2=f[i],
            topic="/imu",
        )
        for i, s in enumerate(t)
    ]
