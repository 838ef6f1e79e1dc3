# SPDX-License-Identifier: MIT
"""Scans whose sweeps take the whole period, without wheels: the speed they are straightened by must not swing."""

from pathlib import Path

import numpy as np

from slamcli.formats.trajectories import read_tum
from slamcli.geometry import se3
from slamcli.measurements import LaserScan
from slamcli.pipelines.generate import generate
from slamcli.recordings import open_recording
from slamcli.rtabmap.scan_odometry import PlanarScanOdometry, ScanOdometrySettings
from slamcli.runtime import RunLog
from slamcli.trajectory import interpolate, path_lengths


def test_the_way_is_as_long_as_it_is(tmp_path: Path) -> None:
    bag, truth_path = tmp_path / "room.mcap", tmp_path / "room.truth.tum"
    generate("cluttered_room", bag, seed=1, duration_s=15.0, settings={"odometry.enabled": False}, truth=truth_path)
    settings = ScanOdometrySettings(cell_m=0.05, deskewing=True, range_min_m=0.0, range_max_m=0.0, no_return="ignore")
    with open_recording(bag) as recording:
        odometry = PlanarScanOdometry(settings, {"/scan": recording.frames().lookup("base_link", "laser")}, RunLog())
        for scan in recording.measurements(["/scan"]):
            assert isinstance(scan, LaserScan)
            assert scan.time_increment_s * scan.num_beams > 0.15  # of a period of a sixth of a second
            odometry.add(scan)
    track = odometry.solve()
    poses = np.array([se3.to_se2(step.T_odom_base) for step in track.steps])
    truth = interpolate(read_tum(truth_path), track.recorded_ns)
    true_way = float(path_lengths(truth.positions_m)[-1])
    assert float(path_lengths(poses[:, :2])[-1]) < 1.06 * true_way  # more than 1.5 times where it swings
    turns = np.diff(np.unwrap(poses[:, 2]))
    true_turns = np.diff(np.unwrap(_yaws(truth.quats_xyzw)))
    assert np.abs(turns - true_turns).max() < 0.03


def _yaws(quats_xyzw: np.ndarray) -> np.ndarray:
    """Return the headings (N,) of quaternions (N, 4)."""
    return 2.0 * np.arctan2(quats_xyzw[:, 2], quats_xyzw[:, 3])
