# SPDX-License-Identifier: MIT
"""Scans whose sweeps take the whole period, without wheels: the speed they are straightened by must not swing."""

from pathlib import Path

import numpy as np

from slamcli.formats.trajectories import read_tum
from slamcli.geometry import se3
from slamcli.measurements import LaserScan, PointCloud
from slamcli.pipelines.generate import generate
from slamcli.recordings import open_recording
from slamcli.rtabmap.cloud_odometry import CloudOdometry, CloudOdometrySettings
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_odometry import PlanarScanOdometry, ScanOdometrySettings
from slamcli.rtabmap.signature import NodeScan
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


class _Steady(CloudOdometry):
    """A robot that drives 0.1 m a sweep, seen where half of what the sweep was straightened wrongly puts it."""

    def _during_sweep(self, cloud: PointCloud, motion: np.ndarray, seconds: float) -> np.ndarray | None:
        self.wrongly_m = 0.1 - motion[0, 3]
        return None

    def _placed(self, stamp_ns: int, scan: NodeScan, predicted: np.ndarray) -> OdometryStep:
        pose = np.eye(4)
        pose[0, 3] = stamp_ns / 1e9 + 0.5 * self.wrongly_m
        return OdometryStep(stamp_ns=stamp_ns, T_odom_base=pose, covariance=np.zeros((6, 6)))


def test_so_of_clouds() -> None:
    odometry = _Steady(CloudOdometrySettings.of(RtabmapParameters()))
    points = np.ones((4, 3), dtype=np.float32)
    places = []
    for k in range(30):
        cloud = PointCloud(stamp_ns=k * 100_000_000, frame_id="lidar", points_m=points, topic="/points")
        step, _ = odometry.step(cloud, np.eye(4))
        assert step.T_odom_base is not None
        places.append(step.T_odom_base[0, 3])
    motions = np.diff(places)
    assert np.abs(motions[:3] - 0.1).max() > 0.02  # it began with the wrong speed
    assert np.abs(motions[-5:] - 0.1).max() < 1e-4


def _yaws(quats_xyzw: np.ndarray) -> np.ndarray:
    """Return the headings (N,) of quaternions (N, 4)."""
    return 2.0 * np.arctan2(quats_xyzw[:, 2], quats_xyzw[:, 3])
