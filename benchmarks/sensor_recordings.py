# SPDX-License-Identifier: MIT
"""Synthetic recordings of robots with other sensors than one scanner and wheels, each with its true trajectory.

    python benchmarks/sensor_recordings.py /tmp/synth --world office --duration 180

makes two_lasers.mcap (scanners in front and behind), multi_echo.mcap, imu_scan_only.mcap (no odometry), cloud2d.mcap (the
scanner as PointCloud2, with the time of each point) and fix_landmarks.mcap (a satellite receiver and a detector of landmarks
beside scanner and wheels), and NAME.truth.tum beside each.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.formats.trajectories import write_tum
from slamcli.geometry import quaternion, se2
from slamcli.measurements import (
    FrameTransform,
    GeoFix,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    PointCloud,
)
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.scan_cloud import cloud_of
from slamcli.recordings import create_recording
from slamcli.simulation import Message, Simulation, resolve_settings
from slamcli.simulation.simulate import BASE_FRAME, MAP_FRAME, ODOM_TOPIC, STATIC_TOPIC, TF_TOPIC
from slamcli.trajectory import Trajectory

Writer = Callable[[Message], "str | None"]
"""Says as which message type a message is written; None for the usual one."""

LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 48.1, 11.6, 520.0
_LASER = {"laser.beams": 361, "laser.fov": 270.0, "laser.range_max": 30.0}


def simulate(world: str, duration_s: float, seed: int = 0, **settings: object) -> Simulation:
    """Return a simulated drive; the drive depends on world, duration and seed only."""
    named = {name.replace("__", "."): value for name, value in settings.items()}
    place = open_world(world)
    return Simulation(place, resolve_settings(place.settings, {**_LASER, **named}), seed=seed, duration_s=duration_s)


def write(path: Path, messages: Iterable[Message], simulation: Simulation, msgtype: Writer = lambda _: None) -> None:
    """Write messages, the static transforms as one, and the true trajectory beside them."""
    listed = list(messages)
    fixed = [m.measurement for m in listed if isinstance(m.measurement, FrameTransform) and m.measurement.static]
    with create_recording(path) as recording:
        recording.write_transforms(STATIC_TOPIC, fixed)
        for message in listed:
            if message.measurement not in fixed:
                recording.write(
                    message.topic, message.measurement, log_time_ns=message.log_time_ns, msgtype=msgtype(message)
                )
    ranges = {m.measurement.stamp_ns for m in listed if isinstance(m.measurement, (LaserScan, PointCloud))}
    stamps = np.array(sorted(ranges), dtype=np.int64)
    poses = simulation.motion.at((stamps - round(simulation.parameters.clock_start * 1e9)) / 1e9)
    write_tum(path.with_suffix(".truth.tum"), Trajectory.from_se2(stamps, poses, MAP_FRAME, BASE_FRAME))


def two_lasers(world: str, duration_s: float) -> tuple[list[Message], Simulation]:
    """Return the messages of a robot with a scanner in front (/scan_front) and one behind (/scan_rear), 190° each."""
    fov = {"laser__fov": 190.0, "laser__beams": 381}
    front = simulate(world, duration_s, laser__x=0.2, **fov)
    rear = simulate(world, duration_s, laser__x=-0.2, laser__yaw=180.0, **fov)
    # Noise of its own; the drive is drawn already.
    rear._seed += 1_000_003  # noqa: SLF001
    rear.scan_times_s = rear.scan_times_s[:-1] + 0.5 / rear.parameters.laser_rate
    listed = [_renamed(message, "front") for message in front.messages()]
    listed += [
        _renamed(message, "rear")
        for message in rear.messages()
        if isinstance(message.measurement, LaserScan)
        or (isinstance(message.measurement, FrameTransform) and message.measurement.child_frame_id == "laser")
    ]
    return sorted(listed, key=lambda message: message.log_time_ns), front


def _renamed(message: Message, name: str) -> Message:
    measurement = message.measurement
    if isinstance(measurement, LaserScan):
        return message._replace(topic=f"/scan_{name}", measurement=replace(measurement, frame_id=f"laser_{name}"))
    if isinstance(measurement, FrameTransform) and measurement.child_frame_id == "laser":
        return message._replace(measurement=replace(measurement, child_frame_id=f"laser_{name}"))
    return message


def fixes_and_landmarks(simulation: Simulation, seed: int = 0) -> Iterator[Message]:
    """Yield a fix a second (0.5 m of noise), and at 2 Hz the landmarks within 6 m (0.03 m, 1° of noise)."""
    rng = np.random.default_rng([seed, 77])
    motion, start_ns = simulation.motion, round(simulation.parameters.clock_start * 1e9)
    path = motion.at(np.arange(0.0, simulation.duration_s, 5.0))
    places = np.column_stack([path[::3, 0], path[::3, 1] + 0.5, np.zeros(len(path[::3]))])
    for tick in range(int(simulation.duration_s * 2)):
        stamp = start_ns + tick * 500_000_000
        pose = motion.at(np.array([tick / 2]))[0]
        if tick % 2 == 0:
            x, y = pose[:2] + 0.5 * rng.standard_normal(2)
            yield Message(stamp, "/fix", _fix(stamp, x, y))
        seen = se2.compose(se2.inverse(pose), places)
        near = np.flatnonzero(np.hypot(seen[:, 0], seen[:, 1]) < 6.0)
        noisy = seen + rng.standard_normal(seen.shape) * [0.03, 0.03, math.radians(1.0)]
        observations = tuple(
            LandmarkObservation(
                id=f"tag {i}",
                position_m=np.array([*noisy[i, :2], 0.0]),
                quat_xyzw=quaternion.from_yaw(noisy[i, 2]),
                translation_weight=30.0,
                rotation_weight=60.0,
            )
            for i in near
        )
        yield Message(stamp, "/landmark", Landmarks(stamp_ns=stamp, frame_id=BASE_FRAME, observations=observations))


def _fix(stamp_ns: int, east_m: float, north_m: float) -> GeoFix:
    # Radii of curvature of WGS 84 at the place; exact to millimetres over a building.
    w = 1 - 6.69437999014e-3 * math.sin(math.radians(LATITUDE_DEG)) ** 2
    meridian, across = 6378137.0 * (1 - 6.69437999014e-3) / w**1.5, 6378137.0 / math.sqrt(w)
    latitude = LATITUDE_DEG + math.degrees(north_m / (meridian + ALTITUDE_M))
    longitude = LONGITUDE_DEG + math.degrees(east_m / ((across + ALTITUDE_M) * math.cos(math.radians(LATITUDE_DEG))))
    return GeoFix(
        stamp_ns=stamp_ns, frame_id=BASE_FRAME, latitude_deg=latitude, longitude_deg=longitude, altitude_m=ALTITUDE_M,
        covariance_m2=np.diag([0.25, 0.25, 1.0]),
    )  # fmt: skip


def main() -> None:
    """Write every recording into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--world", default="office")
    parser.add_argument("--duration", type=float, default=180.0)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    write(asked.folder / "two_lasers.mcap", *two_lasers(asked.world, asked.duration))
    plain = simulate(asked.world, asked.duration)
    echo = "sensor_msgs/msg/MultiEchoLaserScan"
    write(
        asked.folder / "multi_echo.mcap", plain.messages(), plain,
        lambda message: echo if isinstance(message.measurement, LaserScan) else None,
    )  # fmt: skip
    clouds = (
        m._replace(topic="/points", measurement=cloud_of(m.measurement)) if isinstance(m.measurement, LaserScan) else m
        for m in plain.messages()
    )
    write(asked.folder / "cloud2d.mcap", clouds, plain)
    inertial = simulate(asked.world, asked.duration, imu__enabled=True)
    wheels = (ODOM_TOPIC, TF_TOPIC)
    write(asked.folder / "imu_scan_only.mcap", (m for m in inertial.messages() if m.topic not in wheels), inertial)
    more = sorted([*plain.messages(), *fixes_and_landmarks(plain)], key=lambda message: message.log_time_ns)
    write(asked.folder / "fix_landmarks.mcap", more, plain)


if __name__ == "__main__":
    main()
