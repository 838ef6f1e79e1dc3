# SPDX-License-Identifier: MIT
from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from memory_recording import MemoryContainer

from slamcli.errors import RecordingError, UsageError
from slamcli.measurements import FrameTransform, ImuSample, LaserScan, Odometry, StampedTwist
from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import RawMessage
from slamcli.recordings.stamps import StampCheck, merge_by_stamp
from slamcli.runtime import RunLog

S = 1_000_000_000


def _message(topic: str, log_s: float) -> RawMessage:
    return RawMessage(topic, round(log_s * S), b"")


def _merge(items: list[tuple[float, str, float]], look_ahead_s: float = 1.0) -> list[tuple[float, str]]:
    """Merge (stamp, topic, log time) given in log order."""
    stream = ((round(stamp * S), _message(topic, log)) for stamp, topic, log in items)
    return [(stamp / S, message.topic) for stamp, message in merge_by_stamp(stream, look_ahead_s)]


def test_topics_are_merged_by_stamp() -> None:
    # The scans are logged 0.3 s after they were made, the odometry at once.
    items = [(t, "odom", t) for t in np.arange(0, 10, 0.05)] + [(t, "scan", t + 0.3) for t in np.arange(0, 10, 0.1)]
    merged = _merge(sorted(items, key=lambda item: item[2]))
    stamps = [stamp for stamp, _ in merged]
    assert stamps == sorted(stamps)
    assert len(merged) == len(items)


def test_recorded_order_is_kept_within_a_topic() -> None:
    scans = [(1.0, "scan", 1.0), (2.0, "scan", 2.0), (1.5, "scan", 3.0), (4.0, "scan", 4.0)]
    odometry = [(t, "odom", t + 0.001) for t in (1.2, 1.7, 2.2, 3.0)]
    merged = _merge(sorted(scans + odometry, key=lambda item: item[2]), look_ahead_s=2.0)
    assert [stamp for stamp, topic in merged if topic == "scan"] == [1.0, 2.0, 1.5, 4.0]
    assert [stamp for stamp, topic in merged if topic == "odom"] == [1.2, 1.7, 2.2, 3.0]
    assert merged.index((1.5, "scan")) == merged.index((2.0, "scan")) + 1


def test_equal_stamps_keep_the_log_order() -> None:
    assert _merge([(1.0, "b", 1.0), (1.0, "a", 1.0), (1.0, "b", 1.0)]) == [(1.0, "b"), (1.0, "a"), (1.0, "b")]


def test_memory_is_bounded_whatever_the_stamps_are() -> None:
    taken = 0

    def endless() -> object:
        nonlocal taken
        for i in range(100_000):
            taken += 1
            # One topic's clock is a year ahead.
            yield (i * S + (365 * 86400 * S if i % 2 else 0)), _message("ahead" if i % 2 else "right", i * 0.01)

    largest = 0
    for given, _ in enumerate(merge_by_stamp(endless()), start=1):  # type: ignore[arg-type]
        largest = max(largest, taken - given)
    assert largest <= 103


def test_stamp_check_counts() -> None:
    check = StampCheck()
    for stamp in (10, 20, 20, 15, 30, 25):
        check.take(stamp)
    assert (check.num, check.num_backward, check.num_duplicate) == (6, 2, 1)
    assert (check.largest_backward_ns, check.first_backward_ns) == (5, 15)


def _scan(stamp_s: float) -> LaserScan:
    return LaserScan(
        stamp_ns=round(stamp_s * S),
        frame_id="laser",
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.1,
        range_max_m=10.0,
        ranges_m=np.ones(3, dtype=np.float32),
    )


def _odometry(stamp_s: float) -> Odometry:
    return Odometry(
        stamp_ns=round(stamp_s * S),
        frame_id="odom",
        child_frame_id="base_link",
        position_m=np.zeros(3),
        quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    )


@pytest.fixture(params=["ros1", "cdr"])
def container(request: pytest.FixtureRequest) -> MemoryContainer:
    container = MemoryContainer(request.param)
    with container.writer() as writer:
        for i in range(20):
            writer.write("/scan", _scan(100 + 0.1 * i), log_time_ns=round((100.2 + 0.1 * i) * S))
        for i in range(40):
            writer.write("/odom", _odometry(100 + 0.05 * i))
    return container


def test_measurements_are_merged_by_header_stamp(container: MemoryContainer) -> None:
    merged = list(container.recording().measurements(["/scan", "odom"]))
    stamps = [measurement.stamp_ns for measurement in merged]
    assert stamps == sorted(stamps)
    assert sum(isinstance(measurement, LaserScan) for measurement in merged) == 20
    assert len(merged) == 60


def test_a_time_offset_moves_a_topic(container: MemoryContainer) -> None:
    recording = container.recording(Mends(time_offsets_ns={"/scan": -S // 2}))
    first = next(iter(recording.measurements(["/scan"])))
    assert first.stamp_ns == round(99.5 * S)
    merged = list(recording.measurements(["/scan", "/odom"]))
    assert [m.stamp_ns for m in merged] == sorted(m.stamp_ns for m in merged)


def test_start_and_duration_are_log_time(container: MemoryContainer) -> None:
    recording = container.recording()
    part = list(recording.measurements(["/odom"], start_s=0.5, duration_s=0.5))
    assert [m.stamp_ns for m in part] == [round((100 + 0.05 * i) * S) for i in range(10, 20)]
    for wrong in ({"start_s": 99.0}, {"start_s": -1.0}, {"duration_s": 0.0}, {"start_s": float("nan")}):
        with pytest.raises(UsageError):
            recording.measurements(["/odom"], **wrong)


def test_backward_and_repeated_stamps_are_kept_and_counted_once() -> None:
    container = MemoryContainer()
    stamps = [1.0, 2.0, 2.0, 1.5, 3.0]
    for i, stamp in enumerate(stamps):
        container.writer().write("/scan", _scan(stamp), log_time_ns=i * S + S)
    log = RunLog()
    recording = container.recording(log=log)
    for _ in range(2):
        assert [m.stamp_ns / S for m in recording.measurements(["/scan"])] == stamps
    assert log.counts == {"/scan: stamps that run backwards": 1, "/scan: stamps that repeat": 1}
    assert log.warnings == ["/scan: 1 of 5 stamps run backwards, by up to 0.500 s; the recorded order is kept"]


def test_a_look_at_the_beginning_tells_nothing() -> None:
    container = MemoryContainer()
    for i, stamp in enumerate([2.0, 1.0, 3.0]):
        container.writer().write("/scan", _scan(stamp), log_time_ns=i * S + S)
    log = RunLog()
    assert len(list(islice(container.recording(log=log).measurements(["/scan"]), 2))) == 2
    assert (log.warnings, dict(log.counts)) == ([], {})


def test_unset_stamps_are_log_time_and_said_aloud() -> None:
    container = MemoryContainer()
    container.writer().write("/scan", _scan(0.0), log_time_ns=7 * S)
    container.writer().write(
        "/cmd_vel",
        StampedTwist(stamp_ns=0, frame_id="", linear_m_s=np.zeros(3), angular_rad_s=np.zeros(3)),
        msgtype="geometry_msgs/msg/Twist",
        log_time_ns=8 * S,
    )
    log = RunLog()
    recording = container.recording(log=log)
    assert [m.stamp_ns for m in recording.measurements(["/scan", "/cmd_vel"])] == [7 * S, 8 * S]
    assert log.warnings == ["/scan: 1 header stamps are unset (0): the log time is used instead"]


def test_what_cannot_be_decoded_is_left_out_and_said(container: MemoryContainer) -> None:
    bad = container.stored[3]
    container.stored[3] = RawMessage(bad.topic, bad.log_time_ns, bytes(bad.data)[: len(bad.data) // 2])
    log = RunLog()
    assert len(list(container.recording(log=log).measurements(["/scan"]))) == 19
    assert log.counts["/scan: messages that cannot be decoded"] == 1
    assert "1 messages cannot be decoded and are left out, the first at" in log.warnings[0]


def test_topics_that_do_not_fit_are_named_with_those_that_would(container: MemoryContainer) -> None:
    recording = container.recording()
    with pytest.raises(RecordingError, match=r"memory.mcap: no topic '/scam'; did you mean /scan\?"):
        recording.topic("/scam", LaserScan)
    with pytest.raises(
        RecordingError, match=r"/odom is nav_msgs/Odometry, not LaserScan; .*one of: /scan \(sensor_msgs"
    ):
        recording.topic("/odom", LaserScan)
    with pytest.raises(RecordingError, match="no sensor_msgs/Imu topic"):
        recording.topic("/imu", ImuSample)
    assert [topic.name for topic in recording.topics(LaserScan)] == ["/scan"]


def test_empty_topics_are_refused(container: MemoryContainer) -> None:
    container.stored = [message for message in container.stored if message.topic != "/scan"]
    with pytest.raises(RecordingError, match="/scan is empty"):
        container.recording().measurements(["/scan"])


def test_one_topic_holds_one_type(container: MemoryContainer) -> None:
    writer = container.writer()
    writer.write("/scan", _scan(1.0))
    with pytest.raises(RecordingError, match="/scan holds sensor_msgs/msg/LaserScan"):
        writer.write("/scan", _odometry(1.0))


def _transform(stamp_s: float, x: float, parent: str = "odom", child: str = "base_link") -> FrameTransform:
    return FrameTransform(
        stamp_ns=round(stamp_s * S),
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array([x, 0.0, 0.0]),
        quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    )


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_frames_from_tf_static_and_mends(encoding: str) -> None:
    container = MemoryContainer(encoding)
    with container.writer() as writer:
        for i in range(10):
            writer.write_transforms("/tf", [_transform(i, i), _transform(i, 0.0, "base_link", "/imu")])
        # Static transforms that are recorded last count all the same.
        writer.write("/tf_static", _transform(0, 0.3, "base_link", "laser"), log_time_ns=9 * S)
    mends = Mends(renamed_frames={"imu": "imu_link"}, static_transforms=(_transform(0, 2.0, "base_link", "camera"),))
    recording = container.recording(mends)
    tree = recording.frames()
    assert tree is recording.frames()
    assert tree.frames == ("base_link", "camera", "imu_link", "laser", "odom")
    np.testing.assert_allclose(tree.lookup("odom", "laser", round(4.5 * S))[0, 3], 4.8)
    np.testing.assert_allclose(tree.lookup("laser", "camera")[0, 3], 1.7)
    assert len(list(recording.measurements(["/tf"]))) == 20


def test_transforms_that_are_not_finite_are_counted() -> None:
    container = MemoryContainer()
    container.writer().write("/tf", _transform(1, 1.0))
    broken = bytearray(container.stored[0].data)
    at = bytes(broken).index(np.float64(1.0).tobytes())
    broken[at : at + 8] = np.float64(np.nan).tobytes()
    container.stored.append(RawMessage("/tf", 2 * S, bytes(broken)))
    recording = container.recording()
    assert recording.frames().edge("base_link").num_samples == 1  # type: ignore[union-attr]
    assert recording.log.counts["/tf: transforms that are not finite or name no frame"] == 1
