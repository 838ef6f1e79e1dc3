# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.measurements import CameraModel, FrameTransform, Image, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.recordings import create_recording, open_recording, summary
from slamcli.recordings.camera_topics import info_topic
from slamcli.recordings.summary import RecordingSummary, summarise

S = 1_000_000_000
START = 1_600_000_000 * S


def _camera(stamp: int) -> CameraModel:
    return CameraModel(
        stamp_ns=stamp,
        frame_id="camera",
        width=16,
        height=12,
        distortion_model="plumb_bob",
        distortion=np.zeros(5),
        intrinsics=np.array([[500.0, 0, 8], [0, 501, 6], [0, 0, 1]]),
        rectification=np.eye(3),
        projection=np.zeros((3, 4)),
    )


def _measurement(topic: str, stamp: int) -> Any:
    image = np.zeros((12, 16), np.uint8)
    held = {"stamp_ns": stamp, "frame_id": topic.split("/")[1]}
    if "scan" in topic:
        return LaserScan(
            **held,
            angle_min_rad=-1.0,
            angle_increment_rad=0.01,
            range_min_m=0.1,
            range_max_m=30.0,
            ranges_m=np.ones(201, np.float32),
        )
    if "points" in topic:
        heights = 0.0 if "flat" in topic else 1.0
        points = np.ones((7, 3), np.float32) * np.array([1, 1, heights], np.float32) * np.arange(1, 8)[:, None]
        return PointCloud(**held, points_m=points.astype(np.float32), intensities=np.ones(7, np.float32))
    if "imu" in topic:
        return ImuSample(**held, angular_rad_s=np.zeros(3), acceleration_m_s2=np.array([0, 0, 9.81]))
    if "odom" in topic:
        return Odometry(**held, child_frame_id="base_link", position_m=np.zeros(3), quat_xyzw=np.array([0, 0, 0, 1.0]))
    if "info" in topic:
        return _camera(stamp)
    if "depth" in topic:
        return Image(**held, encoding="depth", pixels=np.ones((12, 16), np.float32))
    return Image(**held, encoding="mono8", pixels=image)


def _record(path: Path, topics: tuple[str, ...], num: int = 20) -> Path:
    with create_recording(path) as writer:
        for i in range(num):
            for topic in topics:
                writer.write(topic, _measurement(topic, START + i * S // 10))
    return path


def _summarise(path: Path, **options: Any) -> RecordingSummary:
    with open_recording(path) as recording:
        return summarise(recording, **options)


def test_topics_counts_rates_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    with create_recording(path) as writer:
        for i in range(101):
            stamp = START + i * S // 10 + (S if i > 50 else 0)
            writer.write("/scan", _measurement("/scan", stamp))
            if i == 100:
                writer.write("/odom", _measurement("/odom", stamp))
    result = _summarise(path)
    scan, odom = result.topics
    assert (scan.count, odom.count) == (101, 1)
    assert scan.rate_hz == pytest.approx(100 / 11)
    assert odom.rate_hz is None
    assert (scan.largest_gap_s, scan.gap_at_ns) == (pytest.approx(1.1), START + 5 * S)
    assert scan.traits == "201 beams over 114.6°, 0.1 to 30 m"
    assert result.duration_s == pytest.approx(11.0)
    assert result.sampled_s is None


def _tiers(path: Path) -> dict[str, tuple[bool, str, dict[str, str]]]:
    return {fit.tier: (fit.runs, fit.mode, dict(fit.topics)) for fit in _summarise(path).tiers}


def test_which_tiers_can_run(tmp_path: Path) -> None:
    tiers = _tiers(_record(tmp_path / "a.mcap", ("/scan", "/odom"), 3))
    assert tiers["gmapping"] == (True, "scans and odometry", {"scan": "/scan", "odom": "/odom"})
    assert tiers["cartographer"] == (True, "2D", {"scan": "/scan", "odom": "/odom"})
    assert tiers["rtabmap"] == (True, "planar scans and odometry", {"scan": "/scan", "odom": "/odom"})
    assert tiers["orbslam3"] == (False, "needs camera images", {})

    tiers = _tiers(_record(tmp_path / "b.mcap", ("/points", "/imu"), 3))
    assert not tiers["gmapping"][0]
    assert tiers["cartographer"] == (True, "3D", {"points": "/points", "imu": "/imu"})

    tiers = _tiers(_record(tmp_path / "flat.mcap", ("/points_flat", "/imu"), 3))
    assert tiers["cartographer"] == (True, "2D", {"points": "/points_flat", "imu": "/imu"})
    tiers = _tiers(_record(tmp_path / "alone.mcap", ("/points", "/os/points_b"), 3))
    mode = "3D (without an IMU: expect less), one of 2 sensors unless --points-topic names more"
    assert tiers["cartographer"] == (True, mode, {"points": "/points"})
    tiers = _tiers(_record(tmp_path / "scans.mcap", ("/rear_scan", "/scan", "/odom_truth"), 3))
    mode = "2D, scans alone, one of 2 sensors unless --scan-topic names more"
    assert tiers["cartographer"] == (True, mode, {"scan": "/scan"})

    topics = ("/cam/rgb/image", "/cam/rgb/camera_info", "/cam/depth/image", "/cam/depth/camera_info")
    tiers = _tiers(_record(tmp_path / "c.mcap", topics, 3))
    roles = {"rgb": "/cam/rgb/image", "depth": "/cam/depth/image", "camera_info": "/cam/rgb/camera_info"}
    assert tiers["rtabmap"] == (True, "RGB-D and its own odometry", roles)
    assert tiers["orbslam3"] == (True, "RGB-D", roles)

    tiers = _tiers(_record(tmp_path / "d.mcap", ("/left/image", "/right/image", "/imu"), 3))
    pair = {"left": "/left/image", "right": "/right/image"}
    mode = "stereo and its own odometry, calibration to be given with --camera-info"
    assert tiers["rtabmap"] == (True, mode, {**pair, "imu": "/imu"})
    assert tiers["orbslam3"][1:] == (
        "stereo with IMU, calibration to be given with --camera-info",
        {**pair, "imu": "/imu"},
    )

    tiers = _tiers(_record(tmp_path / "e.mcap", (*topics, "/scan", "/odom"), 3))
    mode = "RGB-D, planar scans and odometry (--mode rgbd or scan)"
    assert tiers["rtabmap"] == (True, mode, {**roles, "scan": "/scan", "odom": "/odom"})
    tiers = _tiers(_record(tmp_path / "f.mcap", ("/cam/rgb/image", "/odom"), 3))
    why = "needs colour and depth images, a stereo pair, or scans or point clouds"
    assert tiers["rtabmap"] == (False, why, {})


def test_the_calibration_that_belongs_to_an_image() -> None:
    infos = ["/left/camera_info", "/right/camera_info", "/cam/camera_info"]
    assert info_topic("/left/image_raw", infos) == "/left/camera_info"
    assert info_topic("/right/image_rect/compressed", infos) == "/right/camera_info"
    assert info_topic("/cam/color/image_raw", infos) == "/cam/camera_info"
    assert info_topic("/other/image_raw", infos) is None


def test_a_big_recording_is_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    with create_recording(path, compression="none") as writer:
        for i in range(2000):
            stamp = START + i * S // 10
            if i == 0:
                static = FrameTransform(
                    stamp_ns=stamp,
                    parent_frame_id="base_link",
                    child_frame_id="laser",
                    position_m=np.zeros(3),
                    quat_xyzw=np.array([0, 0, 0, 1.0]),
                    static=True,
                )
                writer.write("/tf_static", static)
            writer.write("/scan", _measurement("/scan", stamp))
        writer.write("/imu", _measurement("/imu", stamp))
    monkeypatch.setattr(summary, "_QUICK_BYTES", 200_000)
    result = _summarise(path)
    assert result.sampled_s is not None
    assert 5 < result.sampled_s < 100
    by_name = {topic.topic.name: topic for topic in result.topics}
    assert by_name["/scan"].count == 2000
    assert by_name["/scan"].rate_hz == pytest.approx(10.0, rel=0.01)
    assert by_name["/imu"].traits == "without orientation"
    assert result.frames.frames == ("base_link", "laser")
    assert _summarise(path, full=True).sampled_s is None


def test_the_command_as_text_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _record(tmp_path / "a.mcap", ("/scan", "/odom", "/cam/image", "/cam/camera_info"))
    assert run(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "  80 messages in 1.900 s, from 2020-09-13 12:26:40 UTC" in shown
    line = next(line for line in shown.splitlines() if line.startswith("/scan"))
    assert line.split()[:6] == ["/scan", "sensor_msgs/LaserScan", "20", "10", "0.1", "s"]
    assert "no frames (neither /tf nor /tf_static)" in shown
    assert "gmapping      yes: scans and odometry (scan /scan, odom /odom)" in shown
    assert run(["info", str(path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["messages"], document["duration_s"], document["format"]) == (80, 1.9, "mcap")
    assert [topic["name"] for topic in document["topics"]] == ["/scan", "/odom", "/cam/image", "/cam/camera_info"]
    assert document["calibration"][0]["K"] == [[500.0, 0, 8], [0, 501, 6], [0, 0, 1]]
    assert {tier["tier"]: tier["runs"] for tier in document["tiers"]} == {
        "gmapping": True,
        "cartographer": True,
        "rtabmap": True,
        "orbslam3": True,
    }


def test_two_files_are_one_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = _record(tmp_path / "a.mcap", ("/scan",))
    second = _record(tmp_path / "b.mcap", ("/odom",))
    assert run(["info", str(first), str(second), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == 40
