# SPDX-License-Identifier: MIT
"""Frames, scans and samples in one order: what comes before what, and what nothing waits for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from slamcli.measurements import Image, ImuSample, LaserScan, Measurement, Odometry, PointCloud, SessionStart
from slamcli.pipelines.sensor_order import SensorOrder, end_ns
from slamcli.runtime import RunLog

MS = 1_000_000


def odom(ms: float, topic: str = "/odom") -> Odometry:
    return Odometry(
        stamp_ns=round(ms * MS), frame_id="odom", child_frame_id="base", position_m=np.zeros(3),
        quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), topic=topic,
    )  # fmt: skip


def imu(ms: float) -> ImuSample:
    return ImuSample(
        stamp_ns=round(ms * MS), frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.zeros(3), topic="/imu"
    )


def frame(ms: float) -> Image:
    return Image(stamp_ns=round(ms * MS), frame_id="c", encoding="mono8", pixels=np.zeros((2, 2), np.uint8), topic="/f")


def scan(ms: float, sweep_ms: float = 0.0) -> LaserScan:
    return LaserScan(
        stamp_ns=round(ms * MS), frame_id="l", angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.1, range_max_m=9.0,
        ranges_m=np.ones(11, np.float32), time_increment_s=sweep_ms / 1e4, topic="/s",
    )  # fmt: skip


def ordered(
    read: Sequence[Measurement], *, topics: Sequence[str] = ("/odom",), track: Sequence[Odometry] = (), by_stamp: bool = True,
    late_ms: float = 0.0,
) -> tuple[list[tuple[str, float]], RunLog]:  # fmt: skip
    """Return what comes out, as kind and stamp; images are decided `late_ms` after they were read."""
    log = RunLog()
    order = SensorOrder(topics, track, log, by_stamp=by_stamp)
    out: list[Measurement] = []
    waiting: list[Image] = []
    for measurement in read:
        assert not isinstance(measurement, SessionStart)
        now = measurement.stamp_ns
        if isinstance(measurement, Image):
            waiting.append(measurement)
        else:
            out += order.add(measurement)
        while waiting and now > waiting[0].stamp_ns + late_ms * MS:
            out += order.add(waiting.pop(0))
        out += order.ready(now, waiting[0].stamp_ns if waiting else None)
    for image in waiting:
        out += order.add(image)
    out += order.ready(None)
    order.tell()
    return [(type(m).__name__[0], m.stamp_ns / MS) for m in out if not isinstance(m, SessionStart)], log


def test_samples_up_to_a_frame_and_the_next_one_come_first() -> None:
    read: list[Measurement] = [odom(0), frame(30), odom(50), frame(60), odom(100), frame(100), odom(150)]
    found, _ = ordered(read)
    assert found == [("O", 0), ("O", 50), ("I", 30), ("O", 100), ("I", 60), ("I", 100)]


def test_sparse_odometry_does_not_run_ahead() -> None:
    read: list[Measurement] = sorted([odom(200 * i) for i in range(6)] + [frame(10 + 33 * i) for i in range(24)], key=lambda m: m.stamp_ns)  # type: ignore[union-attr]  # fmt: skip
    found, _ = ordered(read)
    frames = [ms for kind, ms in found if kind == "I"]
    assert frames == [10 + 33 * i for i in range(24)]
    for i, (kind, ms) in enumerate(found):
        if kind == "I":
            latest = max(stamp for other, stamp in found[:i] if other == "O")
            assert ms <= latest < ms + 200


def test_a_sweep_waits_for_the_odometry_of_its_end() -> None:
    assert end_ns(scan(10, sweep_ms=40.0)) == 50 * MS
    cloud = PointCloud(
        stamp_ns=5, frame_id="l", points_m=np.zeros((2, 3), np.float32), offset_ns=np.array([0, 90], dtype=np.int64)
    )
    assert end_ns(cloud) == 95
    found, _ = ordered([odom(0), scan(10, sweep_ms=40.0), odom(20), odom(40), odom(60), odom(80)])
    assert found == [("O", 0), ("O", 20), ("O", 40), ("O", 60), ("L", 10)]


def test_frames_and_scans_come_by_stamp_though_frames_are_known_late() -> None:
    read: list[Measurement] = [
        odom(0),
        frame(10),
        scan(12),
        odom(20),
        frame(30),
        odom(40),
        scan(44),
        odom(60),
        odom(90),
    ]
    found, _ = ordered(read, late_ms=15.0)
    assert [entry for entry in found if entry[0] != "O"] == [("I", 10), ("L", 12), ("I", 30), ("L", 44)]


def test_a_pause_of_odometry_holds_nothing_up_for_long() -> None:
    read: list[Measurement] = [odom(0), odom(20), *[frame(33.0 * i) for i in range(1, 40)], odom(5000)]
    log = RunLog()
    order = SensorOrder(("/odom",), (), log)
    held = []
    for measurement in read:
        list(order.add(measurement))
        list(order.ready(measurement.stamp_ns))  # type: ignore[union-attr]
        held.append(len(order._moments))
    assert max(held) <= 17  # half a second of frames


def test_odometry_of_transforms_is_merged_in() -> None:
    found, _ = ordered(
        [frame(30), imu(35), frame(60), imu(70)], topics=("/imu",), track=[odom(20.0 * i) for i in range(5)]
    )
    assert found == [("O", 0), ("O", 20), ("I", 35), ("O", 40), ("I", 30), ("O", 60), ("I", 70), ("I", 60)]


def test_what_runs_backwards_is_left_out_only_where_stamps_count() -> None:
    read: list[Measurement] = [odom(0), scan(10), scan(30), scan(20), odom(50)]
    found, log = ordered(read)
    assert [ms for kind, ms in found if kind == "L"] == [10, 30]
    assert log.warnings == ["/s: 1 measurements are not later than the one before and are left out"]
    found, log = ordered(read, by_stamp=False)
    assert [ms for kind, ms in found if kind == "L"] == [10, 30, 20]
    assert log.warnings == []


@pytest.mark.parametrize("by_stamp", [True, False])
def test_without_samples_nothing_waits(by_stamp: bool) -> None:
    found, _ = ordered([scan(10), scan(20), scan(30)], topics=(), by_stamp=by_stamp)
    assert found == [("L", 10), ("L", 20), ("L", 30)]
