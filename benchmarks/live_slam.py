# SPDX-License-Identifier: MIT
"""SLAM as it goes on recordings with ground truth: each scan is answered before the next one is read.

    slamcli generate office office.bag --truth office.tum --map-out office.map.yaml
    python benchmarks/live_slam.py office.bag [more.bag ...] [--algo gmapping cartographer] [--set KEY=VALUE ...] [--batch]

Beside X.bag lie X.tum, the true poses at the scans, and X.map.yaml, the true map. Printed are the RMSE of the live pose,
aligned at the first scan, and of the trajectory of `finish` (aligned the same way); the share of the map's walls within 0.1 m of true ones
and the other way round, of the newest live map and of that of `finish`; recorded seconds per second of CPU time, of scans and odometry and with a
map each second; the longest scan and the longest map. With --batch the same recordings through the batch tier.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from slamcli.evaluation.map_errors import map_errors
from slamcli.evaluation.map_layers import map_layers
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum
from slamcli.geometry import se2
from slamcli.mapper import LiveMapper, MappingResult, Setup, find_live_tier
from slamcli.measurements import LaserScan, Odometry
from slamcli.pipelines.config import load_native
from slamcli.pipelines.feeds import find_feed
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.recordings import open_recording
from slamcli.runtime import RunLog
from slamcli.trajectory.wheel_odometry import WheelOdometry


def wall_scores(grid, truth, move) -> str:
    errors = map_errors(map_layers(grid, "map"), map_layers(truth, "truth"), move, tolerance_m=0.1)
    return f"{100 * errors.accuracy:.1f}/{100 * errors.completeness:.1f} %"


def rmse(poses: np.ndarray, truth: np.ndarray) -> str:
    apart = se2.between(truth[0], truth) - se2.between(poses[0], poses)
    turn = np.degrees(se2.wrap_angle(apart[:, 2]))
    return f"{100 * np.sqrt((apart[:, :2] ** 2).sum(axis=1).mean()):.1f} cm {np.sqrt((turn**2).mean()):.2f} deg"


class Replay:
    """One recording through one live mapper."""

    def __init__(self, mapper: LiveMapper, odometry: WheelOdometry) -> None:
        self.mapper, self.odometry, self.poses = mapper, odometry, []
        self.scan_s, self.grid_s, self.grids = [], [], 0
        self.next_ns = 0

    def take(self, measurement) -> None:
        start = time.process_time()
        self.mapper.process(measurement)
        spent = time.process_time() - start
        if not isinstance(measurement, LaserScan):
            return
        self.scan_s.append(spent)
        self.poses.append(se2.compose(self.mapper.T_map_odom, self.odometry.at(np.array([measurement.stamp_ns]))[0]))
        if measurement.stamp_ns >= self.next_ns:
            start = time.process_time()
            self.grid = self.mapper.grid()
            self.grid_s.append(time.process_time() - start)
            self.next_ns = measurement.stamp_ns + 1_000_000_000


def run(bag: Path, algo: str, sets: list[str], batch: bool) -> None:
    truth, true_map = read_tum(bag.with_suffix(".tum")), read_map(bag.with_suffix(".map.yaml")).grid
    log, tier = RunLog(), find_live_tier(algo)
    with open_recording([bag], log=log) as recording:
        feed = find_feed(recording, tier, load_native(algo, (), sets), SensorRequest(), log)
        setup = Setup(T_base_laser=feed.T_base_laser, T_base_sensor=feed.T_base_sensor, log=log)
        measurements = list(feed.measurements())
    mapper = tier.build(feed.plan.parameters, setup) if batch else tier.build_live(feed.plan.parameters, setup)
    told = [item for item in measurements if isinstance(item, Odometry)]
    odometry = WheelOdometry(np.array([item.stamp_ns for item in told]), np.array([item.pose_se2 for item in told]))
    replay, start = Replay(mapper, odometry), time.process_time()
    for measurement in measurements:
        mapper.process(measurement) if batch else replay.take(measurement)
    finishing = time.process_time()
    result: MappingResult = mapper.finish()
    end = time.process_time()
    seconds = (measurements[-1].stamp_ns - measurements[0].stamp_ns) / 1e9
    poses = result.trajectory.poses_se2
    true = truth.poses_se2[
        np.searchsorted(truth.stamps_ns, result.trajectory.stamps_ns - 500_000).clip(0, len(truth.stamps_ns) - 1)
    ]
    move = se2.compose(true[0], se2.inverse(poses[0]))
    words = [f"{bag.stem:16s} {algo:12s} {'batch' if batch else 'live ':5s}"]
    if not batch:
        move_live = se2.compose(true[0], se2.inverse(replay.poses[0]))
        words.append(
            f"pose {rmse(np.array(replay.poses), true)}, walls {wall_scores(replay.grid, true_map, move_live)};"
        )
        spent = sum(replay.scan_s)
        words.append(
            f"{seconds / (finishing - start - sum(replay.grid_s)):.0f} x, {seconds / (finishing - start):.0f} x with maps; scan {1e3 * spent / len(replay.scan_s):.1f}"
            f" (max {1e3 * max(replay.scan_s):.0f}) ms, map {1e3 * np.mean(replay.grid_s):.1f} (max {1e3 * max(replay.grid_s):.0f}) ms;"
        )
    words.append(
        f"finish: {rmse(poses, true)}, walls {wall_scores(result.grid, true_map, move)} in {end - finishing:.1f} s"
    )
    print(" ".join(words), flush=True)
    for warning in log.warnings:
        print("   ", warning)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bags", nargs="+", type=Path)
    parser.add_argument("--algo", nargs="+", default=["gmapping", "cartographer"])
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--batch", action="store_true")
    arguments = parser.parse_args()
    for bag in arguments.bags:
        for algo in arguments.algo:
            run(bag, algo, arguments.set, False)
            if arguments.batch:
                run(bag, algo, arguments.set, True)


if __name__ == "__main__":
    main()
