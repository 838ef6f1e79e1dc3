# SPDX-License-Identifier: MIT
"""Recordings with a fault each, mapped: what the tier makes of them, and what it says.

    python benchmarks/hard_cartographer.py OUT [NAME ...] [--seed N] [--algo cartographer] [--set KEY=VALUE] [--no-map]

writes OUT/NAME.mcap and OUT/NAME.truth.tum, runs `slamcli map` on each, and prints one row: exit code, error of the
trajectory (root mean square after the best rigid transform, metres), its share of the way, seconds, and below it the
warnings. A row says TRACEBACK where the program broke. Names that begin with 3d- have a spinning scanner and an IMU.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import SlamcliError
from slamcli.formats.trajectories import read_tum, write_tum
from slamcli.measurements import FrameTransform, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.pipelines.evaluate import score_trajectory
from slamcli.pipelines.generate import open_world
from slamcli.recordings import create_recording
from slamcli.simulation import Message, Simulation, resolve_settings
from slamcli.trajectory import path_lengths

Change = Callable[[float, Any], Any]
"""Takes seconds from the start and a measurement, returns what is recorded instead (None: nothing)."""

SHOWN = 6
GRAVITY = np.array([0.0, 0.0, 9.80665])
PLAIN = """
name: plain_corridor
description: A corridor of 90 m without anything in its middle.
rooms: [[0, 0, 90, 2.4]]
boxes:
  - {at: [3, 0.3], size: [1.0, 0.5]}
  - {at: [7, 2.2], size: [0.6, 0.4]}
  - {at: [84, 0.3], size: [1.4, 0.5]}
  - {at: [87, 2.1], size: [0.6, 0.5]}
start: [1.2, 1.2, 0]
route: {waypoints: [[88, 1.2], [1.2, 1.2]]}
robot: {speed: 1.0}
laser: {range_max: 8}
"""
SHORT_3D = {"lidar3d.columns": 450}
DRIFT = {"odometry.srt": 0.03, "odometry.stt": 0.05, "odometry.distance_scale": 1.02}


def unchanged(_time_s: float, measurement: Any) -> Any:
    return measurement


def blind(begin_s: float, end_s: float, *, says: float = math.inf) -> Change:
    """A scanner that sees nothing for a while."""

    def change(time_s: float, measurement: Any) -> Any:
        if not begin_s <= time_s < end_s:
            return measurement
        if isinstance(measurement, LaserScan):
            return dataclasses.replace(measurement, ranges_m=np.full_like(measurement.ranges_m, says))
        if isinstance(measurement, PointCloud):
            return without_points(measurement)
        return measurement

    return change


def now_and_then_empty(time_s: float, measurement: Any) -> Any:
    """Every fifth scan or cloud has no beams or points at all."""
    if round(time_s * 10) % 5:
        return measurement
    if isinstance(measurement, LaserScan):
        return dataclasses.replace(measurement, ranges_m=measurement.ranges_m[:0])
    return without_points(measurement) if isinstance(measurement, PointCloud) else measurement


def without_points(cloud: PointCloud) -> PointCloud:
    return PointCloud(
        stamp_ns=cloud.stamp_ns, frame_id=cloud.frame_id, points_m=cloud.points_m[:0], topic=cloud.topic,
        offset_ns=np.zeros(0, np.int64), intensities=np.zeros(0, np.float32), rings=np.zeros(0, np.uint16),
    )  # fmt: skip


def jumping_odometry(metres: float, at_s: tuple[float, ...]) -> Change:
    """Odometry whose position leaps sideways, and stays there."""

    def change(time_s: float, measurement: Any) -> Any:
        leap = np.array([0.0, metres * sum(time_s >= t for t in at_s), 0.0])
        wheels = isinstance(measurement, Odometry) and measurement.topic == "/odom"
        if wheels or (isinstance(measurement, FrameTransform) and not measurement.static):
            return dataclasses.replace(measurement, position_m=measurement.position_m + leap)
        return measurement

    return change


def imu_without_gravity(_time_s: float, measurement: Any) -> Any:
    if isinstance(measurement, ImuSample):
        return dataclasses.replace(measurement, acceleration_m_s2=measurement.acceleration_m_s2 - GRAVITY)
    return measurement


def imu_in_g(_time_s: float, measurement: Any) -> Any:
    if isinstance(measurement, ImuSample):
        return dataclasses.replace(measurement, acceleration_m_s2=measurement.acceleration_m_s2 / GRAVITY[2])
    return measurement


def imu_silent(begin_s: float, end_s: float) -> Change:
    return lambda time_s, m: None if isinstance(m, ImuSample) and begin_s <= time_s < end_s else m


def without_odometry(_time_s: float, measurement: Any) -> Any:
    wheels = isinstance(measurement, Odometry) and measurement.topic == "/odom"
    return None if wheels or (isinstance(measurement, FrameTransform) and not measurement.static) else measurement


# name: (world, settings, seconds or None for the world's route, fault)
VARIANTS: dict[str, tuple[str, dict[str, Any], float | None, Change]] = {
    "plain-corridor": (PLAIN, {}, None, unchanged),
    "plain-corridor-drift": (PLAIN, DRIFT, None, unchanged),
    "empty-scans": ("office", {}, None, now_and_then_empty),
    "blind-minute": ("loop_corridor", {}, None, blind(60, 120)),
    "blind-minute-zeros": ("loop_corridor", {}, None, blind(60, 120, says=0.0)),
    "blind-start": ("office", {}, None, blind(0, 15)),
    "odometry-jumps-3m": ("office", {}, None, jumping_odometry(3.0, (40.0, 90.0))),
    "clock+0.3": ("office", {"clock.laser_offset": 0.3}, None, unchanged),
    "clock-0.3": ("office", {"clock.laser_offset": -0.3}, None, unchanged),
    "no-odometry": ("loop_corridor", {}, None, without_odometry),
    "imu-without-gravity": ("office", {"imu.enabled": True}, None, imu_without_gravity),
    "slip": ("office", {"slip.count": 6, "slip.seconds": 2.0}, None, unchanged),
    "people": ("office", {"people.count": 10}, None, unchanged),
    "3d-office": ("office3d", SHORT_3D, None, unchanged),
    "3d-corridor": ("corridor3d", SHORT_3D, None, unchanged),
    "3d-empty-clouds": ("office3d", SHORT_3D, 80.0, now_and_then_empty),
    "3d-blind-minute": ("office3d", SHORT_3D, None, blind(40, 100)),
    "3d-odometry-jumps-3m": ("office3d", SHORT_3D, 80.0, jumping_odometry(3.0, (30.0, 60.0))),
    "3d-imu-without-gravity": ("office3d", SHORT_3D, 80.0, imu_without_gravity),
    "3d-imu-in-g": ("office3d", SHORT_3D, 80.0, imu_in_g),
    "3d-imu-silent": ("office3d", SHORT_3D, 80.0, imu_silent(30, 40)),
    "3d-no-imu": ("office3d", {**SHORT_3D, "imu.enabled": False}, 80.0, unchanged),
    "3d-clock+0.3": ("office3d", {**SHORT_3D, "clock.laser_offset": 0.3}, 80.0, unchanged),
    "3d-clock-0.3": ("office3d", {**SHORT_3D, "clock.laser_offset": -0.3}, 80.0, unchanged),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(VARIANTS)}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--algo", default="cartographer")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE", help="of the tier")
    parser.add_argument("--no-map", action="store_true", help="only write the recordings")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    broken = 0
    for name in arguments.names or VARIANTS:
        if name not in VARIANTS:
            parser.error(f"no variant {name!r}; there are {', '.join(VARIANTS)}")
        bag = arguments.out / f"{name}-{arguments.seed}.mcap"
        if not bag.exists():
            write(bag, *VARIANTS[name], seed=arguments.seed)
        if not arguments.no_map:
            broken += mapped(name, bag, arguments.algo, arguments.settings)
    sys.exit(1 if broken else 0)


def write(
    bag: Path, world: str, settings: Mapping[str, Any], duration_s: float | None, change: Change, *, seed: int
) -> None:
    """Write a recording with its fault, and its truth beside it."""
    if "\n" in world:
        source = bag.with_suffix(".yaml")
        source.write_text(world)
        world = str(source)
    place = open_world(world)
    simulation = Simulation(place, resolve_settings(place.settings, settings), seed=seed, duration_s=duration_s)
    messages = simulation.messages()
    statics, first = leading_statics(messages)
    with create_recording(bag) as recording:
        recording.write_transforms("/tf_static", statics)
        began = statics[0].stamp_ns
        message: Message | None = first
        while message is not None:
            kept = change((message.log_time_ns - began) / 1e9, message.measurement)
            if kept is not None:
                recording.write(message.topic, kept, log_time_ns=message.log_time_ns)
            message = next(messages, None)
        write_tum(bag.with_suffix(".truth.tum"), simulation.truth())


def leading_statics(messages: Iterator[Message]) -> tuple[list[FrameTransform], Message | None]:
    statics = []
    for message in messages:
        if not (isinstance(message.measurement, FrameTransform) and message.measurement.static):
            return statics, message
        statics.append(message.measurement)
    return statics, None


def mapped(name: str, bag: Path, algo: str, settings: list[str]) -> bool:
    """Map a recording, print what came of it, and return whether the program broke."""
    folder = bag.with_name(f"{bag.stem}-maps")
    sets = [word for setting in settings for word in ("--set", setting)]
    begin = time.perf_counter()
    command = [sys.executable, "-m", "slamcli", "map", "--algo", algo, str(bag), "-o", str(folder), *sets]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    broke = "Traceback" in done.stderr or done.returncode not in (0, 1, 2)
    error, warnings = "-", []
    if done.returncode == 0:
        warnings = json.loads((folder / "run.json").read_text())["warnings"]
        truth = read_tum(bag.with_suffix(".truth.tum"))
        try:
            score = score_trajectory(read_tum(folder / "trajectory.tum"), truth)
            distances = np.linalg.norm(score.aligned.positions_m - score.reference.positions_m, axis=1)
            ate, way = float(np.sqrt(np.mean(distances**2))), float(path_lengths(truth.positions_m)[-1])
            error = f"{ate:.3f} m ({ate / way * 100:.2f} %)"
        except SlamcliError as wrong:
            error = f"no score: {wrong}"
    else:
        warnings = done.stderr.strip().splitlines()[-1:]
    state = "TRACEBACK" if broke else f"exit {done.returncode}"
    print(f"{name:24} {state:10} {error:22} {seconds:6.1f} s", flush=True)
    for warning in warnings[:SHOWN]:
        print(f"    {warning}", flush=True)
    if len(warnings) > SHOWN:
        print(f"    ... {len(warnings)} warnings", flush=True)
    return broke


if __name__ == "__main__":
    main()
