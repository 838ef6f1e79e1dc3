# SPDX-License-Identifier: MIT
import gzip
import math
import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import RecordingError
from slamcli.measurements import FrameTransform, LaserScan, Odometry
from slamcli.recordings.breezy import BreezyOptions, is_breezy, read_breezy
from slamcli.recordings.carmen import CarmenOptions, read_carmen
from slamcli.recordings.carmen_lines import is_carmen, stamp_from_text
from slamcli.recordings.carmen_scanner import RangeSurvey, ScannerParams, beam_directions
from slamcli.recordings.log_record import LogRecord
from slamcli.runtime import RunLog

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
RANGES = " ".join(["1.50"] * 178 + ["81.83", "8.00"])


def flaser(stamp: str, x: float = 0.0, kind: str = "FLASER", ranges: str = RANGES, laser_x: float | None = None) -> str:
    laser_x = x if laser_x is None else laser_x
    count = len(ranges.split())
    return f"{kind} {count} {ranges} {laser_x} 0.5 0.1 {x} 0.5 0.1 {stamp} nohost 0.1\n"


def odom(stamp: str, x: float = 0.0) -> str:
    return f"ODOM {x} 0.5 0.1 0.25 -0.5 0.0 {stamp} nohost 0.1\n"


def read(path: Path, text: str, options: CarmenOptions | None = None) -> tuple[list[LogRecord], RunLog]:
    path.write_text(text)
    log = RunLog()
    return list(read_carmen(path, log, options)), log


def by_topic(records: list[LogRecord], topic: str) -> list:
    return [record.measurement for record in records if record.topic == topic]


def test_a_small_log(tmp_path: Path) -> None:
    text = (
        "# message_name [message contents]\nPARAM robot_frontlaser_offset 0.25 nohost 0\n"
        + odom("100.000001")
        + flaser("100.100000")
        + odom("100.2", 1.0)
        + "TRUEPOS 1.5 2.5 0.3 1.0 0.5 0.1 100.25 nohost 0.1\n"
    )
    records, _ = read(tmp_path / "a.log", text)
    assert [r.topic for r in records] == [
        *("/tf_static", "/odom", "/tf", "/scan"),
        *("/odom", "/tf", "/base_pose_ground_truth"),
    ]
    mount: FrameTransform = records[0].measurement
    assert (mount.parent_frame_id, mount.child_frame_id, mount.static) == ("base_link", "laser", True)
    assert mount.position_m.tolist() == [0.25, 0.0, 0.0]
    first: Odometry = records[1].measurement
    assert (first.stamp_ns, first.frame_id, first.child_frame_id) == (100_000_001_000, "odom", "base_link")
    assert first.pose_se2 == pytest.approx([0.0, 0.5, 0.1])
    assert first.linear_m_s[0] == 0.25
    assert first.angular_rad_s[2] == -0.5
    scan: LaserScan = records[3].measurement
    assert (scan.stamp_ns, scan.frame_id, scan.num_beams) == (100_100_000_000, "laser", 180)
    assert scan.angle_min_rad == pytest.approx(-math.pi / 2)
    assert scan.angle_increment_rad == pytest.approx(math.radians(1))
    assert scan.ranges_m[177] == 1.5
    assert scan.ranges_m[178] == np.inf
    assert scan.ranges_m[179] == 8.0
    truth: Odometry = records[-1].measurement
    assert truth.pose_se2 == pytest.approx([1.5, 2.5, 0.3])
    assert truth.stamp_ns == 100_250_000_000


def test_stamps_and_order_are_kept_where_stamps_run_backwards(tmp_path: Path) -> None:
    stamps = ["10.5", "10.1", "10.3", "10.9"]
    records, log = read(tmp_path / "a.clf", "".join(odom(s) + flaser(s, i) for i, s in enumerate(stamps)))
    scans = [r for r in records if r.topic == "/scan"]
    assert [r.measurement.stamp_ns for r in scans] == [10_500_000_000, 10_100_000_000, 10_300_000_000, 10_900_000_000]
    times = [r.log_time_ns for r in records]
    assert times == sorted(set(times))
    assert "1 on /odom, 1 on /scan, 1 on /tf, by up to 0.400 s" in log.warnings[0]


def test_odometry_of_laser_records_where_there_are_no_odom_lines(tmp_path: Path) -> None:
    records, log = read(tmp_path / "a.clf", flaser("1.0", 0.0, laser_x=0.0) + flaser("2.0", 0.5, laser_x=0.5))
    odometry = by_topic(records, "/odom")
    assert [o.stamp_ns for o in odometry] == [10**9, 2 * 10**9]
    assert [o.position_m[0] for o in odometry] == [0.0, 0.5]
    assert len(by_topic(records, "/tf")) == 2
    assert any("no ODOM lines" in note for note in log.notes)


def test_mount_from_the_poses_of_the_records(tmp_path: Path) -> None:
    line = "FLASER 2 1.0 2.0 1.0 2.2 1.5707963 1.0 2.0 1.5707963 {} h 0\n"
    records, _ = read(tmp_path / "a.clf", line.format("1.0") + line.format("2.0"))
    assert records[0].measurement.position_m == pytest.approx([0.2, 0.0, 0.0], abs=1e-6)
    # Poses that a filter corrected say nothing about the mount.
    other = "FLASER 2 1.0 2.0 1.4 2.2 1.5 1.0 2.0 1.5707963 2.0 h 0\n"
    records, log = read(tmp_path / "b.clf", line.format("1.0") + other)
    assert records[0].measurement.position_m == pytest.approx([0, 0, 0])
    assert "poses in its records vary" in log.warnings[0]


def test_rear_laser(tmp_path: Path) -> None:
    text = "PARAM robot_rearlaser_offset -0.3 nohost 0\n" + odom("1.0") + flaser("1.1", kind="RLASER")
    records, _ = read(tmp_path / "a.clf", text)
    mount = records[0].measurement
    assert mount.child_frame_id == "rear_laser"
    assert mount.position_m[0] == -0.3
    assert abs(mount.quat_xyzw[2]) == pytest.approx(1.0)
    assert by_topic(records, "/rear_scan")[0].frame_id == "rear_laser"


def test_robotlaser(tmp_path: Path) -> None:
    text = (
        "ROBOTLASER1 0 -1.0 2.0 0.5 20.0 0.01 0 5 1.0 2.0 20.0 25.0 nan 2 7 7 "
        "1.1 2.0 0.0 1.0 2.0 0.0 0.1 0.2 0.5 0.5 1e6 5.25 host 0.5\n"
    )
    records, _ = read(tmp_path / "a.log", text)
    scan = by_topic(records, "/scan")[0]
    assert (scan.angle_min_rad, scan.angle_increment_rad, scan.range_max_m) == (-1.0, 0.5, 20.0)
    np.testing.assert_array_equal(scan.ranges_m, np.array([1, 2, np.inf, np.inf, np.nan], dtype=np.float32))
    assert scan.stamp_ns == 5_250_000_000
    assert records[0].measurement.position_m == pytest.approx([0.1, 0.0, 0.0])


def test_options_and_params_for_the_scanner(tmp_path: Path) -> None:
    options = CarmenOptions(fov_rad=math.radians(90), max_range_m=1.4)
    records, _ = read(tmp_path / "a.clf", flaser("1.0"), options)
    scan = by_topic(records, "/scan")[0]
    assert scan.angle_min_rad == pytest.approx(-math.pi / 4)
    assert np.isinf(scan.ranges_m).all()
    assert scan.range_max_m == 1.4
    records, _ = read(tmp_path / "a.clf", "PARAM laser_front_laser_fov 270 h 0\n" + flaser("1.0"))
    assert by_topic(records, "/scan")[0].angle_min_rad == pytest.approx(math.radians(-135))
    params = ScannerParams({"laser_front_laser_max": "30", "robot_frontlaser_offset": "x"})
    assert params.max_range_m(rear=False) == 30.0
    assert params.mount(rear=False) is None


@pytest.mark.parametrize(
    ("num_beams", "first_deg", "last_deg"),
    [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (401, -50, 50), (1081, -135, 135)],
)
def test_beam_directions(num_beams: int, first_deg: float, last_deg: float) -> None:
    first, step = beam_directions(num_beams)
    assert math.degrees(first) == pytest.approx(first_deg)
    assert math.degrees(first + (num_beams - 1) * step) == pytest.approx(last_deg)


def survey(values: list[float]) -> tuple[float, bool]:
    found = RangeSurvey()
    found.add(np.array(values))
    return found.limit_m()


def test_readings_that_mean_no_return() -> None:
    assert survey([1.0, 2.0, 81.91]) == (80.0, True)
    limit, shown = survey([1.0, 7.9, 8.191, 8.183])
    assert shown
    assert 8.17 < limit <= 8.183
    assert survey([5.0 + k / 100 for k in range(100)] + [50.0] * 30) == (50.0, True)  # clipped by a simulator
    assert survey([5.0, 5.01, 5.02]) == (8.0, False)
    assert survey([]) == (80.0, False)
    assert survey([float("nan"), float("inf"), 3.0]) == (8.0, False)


def test_malformed_lines_are_counted(tmp_path: Path) -> None:
    text = (
        odom("1.0")
        + "FLASER 180 1.0 2.0\nFLASER x\nFLASER -5 1\nODOM 1 2 nan 0 0 0 5.0 h 0\nODOM 1 2 3 0 0 0 -5.0 h 0\nODOM\n"
        + "ROBOTLASER1 0 1\nODOM 1 2 3 0 0 0 1e400 h 0\nSYNC x\n\x00\xff\n"
        + odom("2.0")
    )
    records, log = read(tmp_path / "a.log", text)
    assert len(by_topic(records, "/odom")) == 2
    assert log.counts["malformed lines"] == 8
    assert "8 malformed lines left out (first: line 2: too few values)" in log.warnings[0]


@pytest.mark.parametrize("text", ["", "# only words\n", "FLASER 3 1 2\n", "garbage\n" * 5])
def test_a_log_without_a_usable_line_is_one_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(RecordingError, match="no line of it can be used") as caught:
        read(tmp_path / "a.log", text)
    assert "\n" not in str(caught.value)


def test_gzip_also_cut_off(tmp_path: Path) -> None:
    text = "".join(flaser(f"{k}.5", k) for k in range(1, 400)).encode()
    packed = gzip.compress(text)
    path = tmp_path / "a.clf.gz"
    path.write_bytes(packed)
    assert is_carmen(path)
    log = RunLog()
    assert len(by_topic(list(read_carmen(path, log)), "/scan")) == 399
    path.write_bytes(packed[: len(packed) // 2])
    log = RunLog()
    read_part = by_topic(list(read_carmen(path, log)), "/scan")
    assert 10 < len(read_part) < 399
    assert "damaged after line" in log.warnings[0]


def test_stamps_are_exact() -> None:
    assert stamp_from_text(b"976052857.337530") == 976052857337530000
    assert stamp_from_text(b"70.179699") == 70179699000
    assert stamp_from_text(b"1.5e1") == 15_000_000_000
    assert stamp_from_text(b"12") == 12_000_000_000
    for text in (b"-1.0", b"nan", b"1e12", b"9999999999.0"):
        with pytest.raises(ValueError):
            stamp_from_text(text)


def breezy_line(time_us: int, left: int, right: int, readings: list[int]) -> str:
    return " ".join(map(str, [time_us, 0, left, right, *([0] * 20), *readings])) + "\n"


def test_breezy(tmp_path: Path) -> None:
    readings = [0, 7, 1000, 4000] + [2500] * 678
    path = tmp_path / "exp.dat"
    path.write_text(
        breezy_line(1_000_000, 100, 100, readings)
        + breezy_line(1_100_000, 1100, 1100, readings)
        + "damaged 1 2\n"
        + breezy_line(1_200_000, 1100, 2100, readings)
    )
    assert is_breezy(path)
    log = RunLog()
    records = list(read_breezy(path, log))
    odometry = by_topic(records, "/odom")
    half_turn_m = math.pi * 0.077
    assert odometry[1].position_m[0] == pytest.approx(half_turn_m)
    assert odometry[1].linear_m_s[0] == pytest.approx(half_turn_m / 0.1)
    assert odometry[2].pose_se2[2] == pytest.approx(half_turn_m / 0.33)
    scan = by_topic(records, "/scan")[0]
    assert scan.num_beams == 682
    assert scan.angle_min_rad == pytest.approx(-681 * math.pi / 1024)
    np.testing.assert_array_equal(scan.ranges_m[:5], np.array([np.inf, np.nan, 1.0, np.inf, 2.5], dtype=np.float32))
    assert records[0].measurement.position_m[0] == 0.145
    assert log.counts["malformed lines"] == 1
    slow = BreezyOptions(ticks_per_turn=4000)
    assert by_topic(list(read_breezy(path, RunLog(), slow)), "/odom")[1].position_m[0] == pytest.approx(half_turn_m / 2)
    path.write_text("1 2 3\n")
    assert not is_breezy(path)
    with pytest.raises(RecordingError, match="no line of it can be used"):
        list(read_breezy(path, RunLog()))


@pytest.mark.real_data
@pytest.mark.skipif(not (DATA / "laser").is_dir(), reason=f"no recordings under {DATA}")
@pytest.mark.parametrize(
    ("name", "scans", "odometry", "no_return"),
    [
        ("mit-csail.clf.gz", 1988, 1988, 23711),
        ("aces.clf.gz", 7374, 7375, 11139),
        ("SENA_one_loop.clf", 225, 225, 9312),
    ],
)
def test_real_logs(name: str, scans: int, odometry: int, no_return: int) -> None:
    log = RunLog()
    counts = {"/scan": 0, "/odom": 0}
    for record in read_carmen(DATA / "laser" / name, log):
        counts[record.topic] = counts.get(record.topic, 0) + 1
    assert (counts["/scan"], counts["/odom"], log.counts["readings without return"]) == (scans, odometry, no_return)
