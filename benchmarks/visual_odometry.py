# SPDX-License-Identifier: MIT
"""Accuracy and cost of the rtabmap tier's visual odometry alone: no loops, no graph.

usage: python benchmarks/visual_odometry.py RECORDING:MODE:TRUTH ... [--set KEY=VALUE] [--seeds 0,1,2]

MODE is rgbd or stereo, TRUTH a trajectory file. Printed per recording and seed: ATE RMSE of the final track after alignment (SE(3)), frames with a
pose, keyframes, milliseconds a frame of finding key points and of odometry (one thread).
"""

from __future__ import annotations

import argparse
import pathlib
import time

import numpy as np

from slamcli.evaluation import AlignMode
from slamcli.evaluation.alignment import align
from slamcli.evaluation.pose_errors import absolute_errors
from slamcli.formats.trajectories import read_trajectory
from slamcli.geometry import se3
from slamcli.measurements import Image, RgbdFrame, StereoPair
from slamcli.pipelines.camera_input import CameraRequest, feed_cameras
from slamcli.pipelines.config import load_native
from slamcli.recordings import Mends, open_recording
from slamcli.recordings.camera_topics import CameraNames
from slamcli.rtabmap import TIER
from slamcli.rtabmap.feature_extraction import FeatureExtractor
from slamcli.rtabmap.odometry_settings import odometry_settings
from slamcli.rtabmap.settings import feature_settings, preparation_settings
from slamcli.rtabmap.visual_odometry import VisualOdometry
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.association import associate
from slamcli.vision.preparation import Preparation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument("--seeds", default="0")
    args = parser.parse_args()
    log = RunLog()
    config = load_native("rtabmap", (), tuple(args.sets), log, {})
    print("| recording | seed | ATE RMSE m | frames with a pose | keyframes | key points ms | odometry ms |")
    print("|---|---|---|---|---|---|---|")
    for case in args.recordings:
        path, mode, truth = case.split(":")
        with open_recording([pathlib.Path(path)], mends=Mends(), log=log) as recording:
            request = CameraRequest(names=CameraNames(), mode=mode, imu="none")
            feed = feed_cameras(recording, TIER, config.parameters, {}, request, log)
            preparation = Preparation(feed.rig, preparation_settings(feed.plan.parameters, feed.rig))
            extractor = FeatureExtractor(feature_settings(feed.plan.parameters), preparation)
            began, found = 0.0, []
            for measurement in feed.measurements():
                if isinstance(measurement, (Image, StereoPair, RgbdFrame)):
                    prepared = preparation.prepare(measurement)
                    start = time.perf_counter()
                    found.append((measurement.stamp_ns, extractor.extract(prepared)))
                    began += time.perf_counter() - start
        for seed in map(int, args.seeds.split(",")):
            settings = odometry_settings(feed.plan.parameters, extractor.settings.scales, seed)
            odometry = VisualOdometry(settings, extractor.camera, preparation.T_base_camera)
            start = time.perf_counter()
            for stamp_ns, features in found:
                odometry.step(stamp_ns, features)
            took = time.perf_counter() - start
            stamps, poses = odometry.track()
            positions, quats = se3.to_position_quaternion(poses)
            track = Trajectory(stamps_ns=stamps, positions_m=positions, quats_xyzw=quats)
            matched = associate(read_trajectory(truth), track, max_diff_s=0.02)
            errors = absolute_errors(matched.reference, align(matched, AlignMode.SE3)[0]).errors
            print(
                f"| {pathlib.Path(path).stem} | {seed} | {np.sqrt((errors**2).mean()):.4f} | {len(stamps)}/{len(found)} |"
                f" {odometry.counts['keyframes']} | {began / len(found) * 1e3:.1f} | {took / len(found) * 1e3:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
