# SPDX-License-Identifier: MIT
"""Modes and parameters of the tier."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import SensorOffer, find_tier
from slamcli.measurements import CameraModel, CameraRig
from slamcli.orbslam3 import TIER
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.orbslam3.preparing import preparation_settings
from slamcli.parameters import declarations, resolve
from slamcli.runtime import RunLog


def offer(
    *cameras: str, imu: bool = False, calibrated: bool = False, mode: str | None = None, named: str = ""
) -> SensorOffer:
    return SensorOffer(
        num_laser_scans=0, cameras=frozenset(cameras), imu=imu, imu_calibrated=calibrated, mode=mode,
        named=frozenset({named} if named else ()),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("found", "mode", "imu"),
    [
        (offer("mono"), "mono", False),
        (offer("mono", "rgbd"), "rgbd", False),
        (offer("mono", "rgbd", "stereo"), "stereo", False),
        (offer("mono", "rgbd", mode="mono"), "mono", False),
        (offer("mono", imu=True), "mono", False),
        (offer("mono", imu=True, calibrated=True), "mono", True),
        (offer("mono", imu=True, named="imu"), "mono", True),
        (offer("mono", "stereo", imu=True, calibrated=True, mode="stereo"), "stereo", False),
        (offer("mono", "stereo", imu=True, mode="stereo-inertial"), "stereo", True),
    ],
)
def test_the_mode_is_the_best_that_there_is(found: SensorOffer, mode: str, imu: bool) -> None:
    log = RunLog()
    plan = TIER.plan(OrbSlam3Parameters(), (), found, log)
    assert (plan.camera_mode, plan.imu, plan.map_frame) == (mode, imu, "map")
    assert bool(log.notes) == (found.mode is None)


@pytest.mark.parametrize(
    ("found", "error"),
    [
        (offer(), RecordingError),
        (offer("mono", mode="rgbd"), UsageError),
        (offer("mono", mode="mono-inertial"), UsageError),
    ],
)
def test_what_there_is_not_is_refused(found: SensorOffer, error: type[Exception]) -> None:
    with pytest.raises(error):
        TIER.plan(OrbSlam3Parameters(), (), found, RunLog())


def test_the_tier_is_installed_and_every_parameter_has_one_name() -> None:
    assert find_tier("orbslam3") is TIER
    names = [entry.name for entry in declarations(OrbSlam3Parameters)]
    assert len(set(names)) == len(names)
    assert {"ORBextractor.nFeatures", "Stereo.ThDepth", "System.thFarPoints", "Viewer.PointSize"} <= set(names)
    assert all(entry.help for entry in declarations(OrbSlam3Parameters))
    assert not [e.name for e in declarations(OrbSlam3Parameters) if e.name.startswith("Viewer.") and e.effective]


def test_images_are_prepared_as_the_parameters_say() -> None:
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    camera = CameraModel(
        stamp_ns=0, frame_id="", width=640, height=480, distortion_model="", distortion=np.zeros(0), intrinsics=K,
        rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]),
    )  # fmt: skip
    rig = CameraRig(mode="mono", main=camera)
    plain = preparation_settings(OrbSlam3Parameters(), rig)
    assert (plain.width, plain.height, plain.equalise) == (None, None, False)
    given = {
        "Camera.newWidth": 320,
        "slamcli.equalise": True,
        "slamcli.view_angle": 60.0,
        "slamcli.virtual_baseline": 0.1,
    }
    changed = preparation_settings(resolve(OrbSlam3Parameters, given), rig)
    assert (changed.width, changed.equalise, changed.virtual_baseline_m) == (320, True, 0.1)
    assert changed.view_angle_rad == pytest.approx(math.radians(60.0))
    assert preparation_settings(resolve(OrbSlam3Parameters, {"Camera.imageScale": 0.5}), rig).width == 320
