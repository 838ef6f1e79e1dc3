# SPDX-License-Identifier: MIT
"""Which sensors the tier takes, and which parameters follow from them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer, find_tier
from slamcli.parameters import resolve
from slamcli.rtabmap import TIER
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.runtime import RunLog


def offer(*cameras: str, scans: int = 0, clouds: int = 0, **more: Any) -> SensorOffer:
    return SensorOffer(num_laser_scans=scans, num_point_clouds=clouds, cameras=frozenset(cameras), **more)


def plan(found: SensorOffer, log: RunLog | None = None, **given: Any) -> InputPlan:
    values = {name.replace("__", "/"): value for name, value in given.items()}
    return TIER.plan(resolve(RtabmapParameters, values), set(values), found, log or RunLog())


def test_the_tier_is_installed() -> None:
    assert find_tier("rtabmap") is TIER
    assert TIER.modes == ("rgbd", "stereo", "scan")


@pytest.mark.parametrize(
    ("found", "taken"),
    [
        (offer("mono", "rgbd"), ("rgbd", 0, 0)),
        (offer("mono", "stereo"), ("stereo", 0, 0)),
        (offer("mono", "rgbd", "stereo"), ("rgbd", 0, 0)),
        (offer("mono", "rgbd", "stereo", mode="stereo"), ("stereo", 0, 0)),
        (offer("mono", "rgbd", scans=1), ("rgbd", 1, 0)),
        (offer("mono", "rgbd", scans=1, mode="rgbd"), ("rgbd", 0, 0)),
        (offer("mono", "rgbd", scans=1, mode="rgbd", named=frozenset({"scans"})), ("rgbd", 1, 0)),
        (offer("mono", "rgbd", scans=1, mode="scan"), (None, 1, 0)),
        (offer(scans=3), (None, 1, 0)),
        (offer(scans=2, named=frozenset({"scans"})), (None, 2, 0)),
        (offer(clouds=1), (None, 0, 1)),
        (offer(scans=1, clouds=1), (None, 1, 0)),
        (offer("mono", clouds=1), (None, 0, 1)),
        (offer("mono", scans=1, odometry=True), (None, 1, 0)),
        (offer("mono", scans=1, odometry=True, named=frozenset({"images"})), ("mono", 1, 0)),
        (offer("mono", scans=1, named=frozenset({"images"})), (None, 1, 0)),
    ],
)
def test_sensors_are_taken_by_mode_and_name(found: SensorOffer, taken: tuple[str | None, int, int]) -> None:
    made = plan(found)
    assert (made.camera_mode, made.num_laser_scans, made.num_point_clouds) == taken


@pytest.mark.parametrize(
    ("given", "taken"),
    [
        ({"subscribe_depth": True}, ("rgbd", 0, 0)),
        ({"subscribe_scan": True}, ("rgbd", 1, 0)),
        ({"subscribe_scan": True, "subscribe_depth": False}, (None, 1, 0)),
        ({"subscribe_stereo": True}, ("stereo", 0, 0)),
        ({"subscribe_scan_cloud": True, "subscribe_rgb": False}, (None, 0, 1)),
    ],
)
def test_a_configuration_that_subscribes_is_followed(
    given: dict[str, bool], taken: tuple[str | None, int, int]
) -> None:
    log = RunLog()
    made = plan(offer("mono", "rgbd", "stereo", scans=1, clouds=1), log, **given)
    assert (made.camera_mode, made.num_laser_scans, made.num_point_clouds) == taken


@pytest.mark.parametrize(
    ("found", "given", "error", "words"),
    [
        (offer(), {}, RecordingError, "no images with depth"),
        (offer("mono"), {}, RecordingError, "--algo orbslam3"),
        (offer("mono", mode="rgbd"), {}, UsageError, "--depth-topic"),
        (offer("mono", "rgbd", mode="stereo"), {}, UsageError, "the recording has colour with depth"),
        (offer("mono", "rgbd", mode="scan"), {}, UsageError, "--scan-topic"),
        (
            offer("mono", "rgbd"),
            {"subscribe_depth": False, "subscribe_scan": True},
            UsageError,
            "subscribes to nothing",
        ),
    ],
)
def test_what_there_is_not_is_refused(
    found: SensorOffer, given: dict[str, bool], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        plan(found, **given)


def test_planar_scans_alone_map_in_the_plane_without_images() -> None:
    log = RunLog()
    made = plan(offer(scans=1, odometry=True), log)
    p = made.parameters
    assert (p.reg.strategy, p.reg.force_3dof, p.kp.max_features) == (1, True, -1)
    assert (p.rgbd.proximity_path_max_neighbors, p.rgbd.neighbor_link_refining) == (10, True)
    assert (p.grid.sensor, p.grid.range_max) == (0, 0.0)
    assert (made.spatial, made.odometry) == (False, True)
    settled = [note for note in log.notes if note.startswith("set for planar scans: ")]
    assert len(settled) == 1
    assert "Kp/MaxFeatures -1" in settled[0]
    assert "Reg/Force3DoF true" in settled[0]


def test_what_the_user_set_is_kept() -> None:
    p = plan(offer("mono", "rgbd", scans=1), Reg__Strategy=0, Grid__Sensor=1, Reg__Force3DoF=False).parameters
    assert (p.reg.strategy, p.grid.sensor, p.reg.force_3dof, p.grid.range_max) == (0, 1, False, 5.0)
    assert p.rgbd.proximity_path_max_neighbors == 10
    assert plan(offer(scans=1), Grid__RangeMax=3.0).parameters.grid.range_max == 3.0


def test_images_alone_keep_the_defaults() -> None:
    log = RunLog()
    settled = plan(offer("mono", "rgbd"), log).parameters
    assert settled.slamcli.odometry == "visual"
    assert replace(settled, slamcli=RtabmapParameters().slamcli) == RtabmapParameters()
    assert log.notes == ["maps from colour with depth and its own odometry (choose with --mode)"]


def test_sweeps_take_the_values_of_rtabmaps_own_example() -> None:
    p = plan(offer(clouds=1, imu=True)).parameters
    assert (p.icp.voxel_size, p.icp.max_translation, p.mem.stm_size, p.rgbd.proximity_path_max_neighbors) == (
        0.1,
        3.0,
        30,
        1,
    )
    assert not p.reg.force_3dof
    assert (p.grid.sensor, p.grid.is_3d, p.grid.ray_tracing, p.grid.range_max) == (0, False, True, 20.0)
    depth = plan(offer("mono", "rgbd", clouds=1), Grid__Sensor=1).parameters
    assert (depth.grid.sensor, depth.grid.range_max) == (1, 5.0)
    assert plan(offer(clouds=1, flat_clouds=True)).parameters.reg.force_3dof


@pytest.mark.parametrize(
    ("found", "given", "words"),
    [
        (offer("mono", "rgbd"), {"Reg__Strategy": 1}, "needs scans"),
        (offer(scans=1), {"Reg__Strategy": 0}, "needs images"),
        (offer("mono", "rgbd"), {"Grid__Sensor": 0}, "asks for scans"),
        (offer(scans=1), {"Grid__Sensor": 2}, "asks for depth images"),
        (offer("mono", "rgbd"), {"Mem__BinDataKept": False}, "images are not kept"),
    ],
)
def test_values_that_these_sensors_cannot_serve_are_warned_of(
    found: SensorOffer, given: dict[str, int], words: str
) -> None:
    log = RunLog()
    plan(found, log, **given)
    assert any(words in warning for warning in log.warnings)


def test_odometry_and_imu() -> None:
    found = offer("mono", "rgbd", odometry=True, imu=True)
    assert plan(found).odometry
    assert not plan(found, subscribe_odom=False).odometry
    assert plan(offer("mono", "rgbd", odometry=True, named=frozenset({"odometry"})), subscribe_odom=False).odometry
    assert not plan(found).imu
    assert plan(offer("mono", "rgbd", imu=True, imu_placed=True)).imu
    assert plan(offer("mono", "rgbd", imu=True, named=frozenset({"imu"}))).imu


def test_frames_are_those_of_the_node() -> None:
    made = plan(offer("mono", "rgbd"), frame_id="base", odom_frame_id="odom", map_frame_id="world")
    assert (made.base_frame, made.odom_frame, made.map_frame) == ("base", "odom", "world")
    assert plan(offer("mono", "rgbd")).base_frame is None
