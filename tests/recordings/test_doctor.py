# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from slamcli.cli.main import run
from slamcli.geometry import quaternion
from slamcli.measurements import CameraModel, FrameTransform, Image, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.recordings import RecordingWriter, create_recording, open_recording
from slamcli.recordings.checks import CHECKS, Finding
from slamcli.recordings.diagnosis import Diagnosis, diagnose
from slamcli.recordings.mend_parsing import parse_mends

S = 1_000_000_000
START = 1_700_000_000 * S
NUM_BEAMS = 120
TURN_RAD_S = 0.4


def _room(yaw: float, clockwise: bool = False) -> np.ndarray:
    """Return what a scanner at (1, 0.5) in a room of 6 m x 4 m sees that is turned by yaw."""
    angles = yaw + np.radians(-120 + 2 * np.arange(NUM_BEAMS))
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        x = np.where(c > 0, (3 - 1) / c, (-3 - 1) / c)
        y = np.where(s > 0, (2 - 0.5) / s, (-2 - 0.5) / s)
    ranges = np.minimum(x, np.abs(y)).astype(np.float32)
    return ranges[::-1].copy() if clockwise else ranges


def _scan(stamp: int, yaw: float = 0.0, **changes: Any) -> LaserScan:
    values: dict[str, Any] = dict(
        stamp_ns=stamp,
        frame_id="laser",
        angle_min_rad=np.radians(-120),
        angle_increment_rad=np.radians(2),
        range_min_m=0.1,
        range_max_m=20.0,
        ranges_m=_room(yaw),
    )
    return LaserScan(**{**values, **changes})


def _tf(stamp: int, parent: str, child: str, yaw: float = 0.0, roll: float = 0.0, x: float = 0.0) -> FrameTransform:
    return FrameTransform(
        stamp_ns=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=np.array([x, 0.0, 0.0]),
        quat_xyzw=quaternion.from_roll_pitch_yaw(roll, 0.0, yaw),
    )


class Robot:
    """Writes a sound recording of 20 s; a fault is a subclass or a function in its place."""

    def scan(self, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp, yaw)

    def scan_log_ns(self, i: int, stamp: int) -> int:
        return stamp + 10_000_000

    def odometry_stamp(self, i: int, stamp: int) -> int:
        return stamp

    def odometry_log_ns(self, i: int, stamp: int) -> int:
        return stamp

    def write_frames(self, writer: RecordingWriter) -> None:
        writer.write("/tf_static", _tf(START, "base_link", "laser"))

    def more(self, writer: RecordingWriter, i: int, stamp: int) -> None:
        pass

    def write(self, path: Path) -> Path:
        with create_recording(path) as writer:
            self.write_frames(writer)
            for i in range(400):
                stamp = START + i * S // 20
                yaw = TURN_RAD_S * i / 20
                odometry = Odometry(
                    stamp_ns=self.odometry_stamp(i, stamp),
                    frame_id="odom",
                    child_frame_id="base_link",
                    position_m=np.zeros(3),
                    quat_xyzw=quaternion.from_yaw(yaw),
                )
                writer.write("/odom", odometry, log_time_ns=self.odometry_log_ns(i, stamp))
                if i % 2 == 0:
                    writer.write("/scan", self.scan(i // 2, stamp, yaw), log_time_ns=self.scan_log_ns(i // 2, stamp))
                self.more(writer, i, stamp)
        return path


def _diagnose(path: Path, **mends: Any) -> Diagnosis:
    with open_recording(path, mends=parse_mends(**mends)) as recording:
        return diagnose(recording)


def _found(diagnosis: Diagnosis, check: str) -> list[Finding]:
    assert check in CHECKS
    return [finding for finding in diagnosis.findings if finding.check == check]


def _by(diagnosis: Diagnosis, *severities: str) -> list[tuple[str, str]]:
    return [(finding.check, finding.message) for finding in diagnosis.findings if finding.severity in severities]


def test_a_sound_recording_has_no_findings(tmp_path: Path) -> None:
    for name in ("a.bag", "a.mcap", "a.db3"):
        diagnosis = _diagnose(Robot().write(tmp_path / name))
        assert diagnosis.findings == ()
        assert set(diagnosis.checks) == set(CHECKS)


def _faulty(**methods: Callable[..., Any]) -> Robot:
    return type("Faulty", (Robot,), methods)()


def test_stamps_that_run_backwards_and_repeat(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp - (S // 2 if i == 50 else S // 10 if i == 80 else 0), yaw)

    diagnosis = _diagnose(_faulty(scan=scan).write(tmp_path / "a.bag"))
    (backward,) = _found(diagnosis, "stamp-backward")
    assert (backward.topic, backward.severity, backward.count) == ("/scan", "warning", 1)
    assert backward.stamp_ns == START + 5 * S - S // 2
    (repeated,) = _found(diagnosis, "stamp-duplicate")
    assert (repeated.count, repeated.stamp_ns) == (1, START + 8 * S - S // 10)


def test_a_gap(tmp_path: Path) -> None:
    def stamp(self: Robot, i: int, stamp: int) -> int:
        return stamp + (S if i >= 200 else 0)

    diagnosis = _diagnose(_faulty(odometry_stamp=stamp, odometry_log_ns=stamp).write(tmp_path / "a.mcap"))
    (gap,) = _found(diagnosis, "stamp-gap")
    assert "1 gap of more than 0.16 s, the longest of 1.05 s" in gap.message
    assert gap.stamp_ns == START + 199 * S // 20


@pytest.mark.parametrize("factor", [1000, 1_000_000])
def test_stamps_in_another_unit(tmp_path: Path, factor: int) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp // factor, yaw)

    (finding,) = _found(_diagnose(_faulty(scan=scan).write(tmp_path / "a.mcap")), "stamp-unit")
    assert finding.severity == "error"
    assert ("microseconds" if factor == 1000 else "milliseconds") in finding.message


def test_stamps_of_a_simulation_are_a_note(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp - START + S, yaw)

    (finding,) = _found(_diagnose(_faulty(scan=scan).write(tmp_path / "a.mcap")), "stamp-unit")
    assert (finding.severity, finding.topic) == ("note", "/scan")


def test_unset_stamps(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(0, yaw)

    (finding,) = _found(_diagnose(_faulty(scan=scan).write(tmp_path / "a.mcap")), "stamp-unset")
    assert finding.count == 200


def test_a_clock_that_is_off_and_its_mend(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp + 750_000_000, yaw)

    path = _faulty(scan=scan).write(tmp_path / "a.bag")
    diagnosis = _diagnose(path)
    (finding,) = _found(diagnosis, "stamp-clocks")
    assert (finding.severity, finding.mend) == ("error", "--time-offset /scan=-0.740")
    assert _found(diagnosis, "stamp-delay")[0].severity == "error"
    assert not _by(_diagnose(path, time_offsets=["/scan=-0.740"]), "error", "warning")
    (finding,) = _found(_diagnose(path, time_offsets=["/scan=-0.500"]), "stamp-clocks")
    assert finding.mend == "--time-offset /scan=-0.740"


def test_frames_that_are_missing_contradict_or_come_late(tmp_path: Path) -> None:
    def write_frames(self: Robot, writer: RecordingWriter) -> None:
        writer.write("/tf_static", _tf(START, "base_link", "lidar"))
        writer.write("/tf_static", _tf(START, "body", "base_link"))

    def more(self: Robot, writer: RecordingWriter, i: int, stamp: int) -> None:
        if 100 <= i < 300:
            writer.write("/tf", _tf(stamp, "odom", "base_link", x=0.1 * i))

    path = _faulty(write_frames=write_frames, more=more).write(tmp_path / "a.mcap")
    diagnosis = _diagnose(path)
    (missing,) = _found(diagnosis, "tf-missing")
    assert missing.severity == "error"
    assert missing.message == "no transform from base_link to the scanner's frame laser"
    assert missing.mend.startswith("--static-tf base_link,laser,X,Y,Z,YAW,PITCH,ROLL")
    (parents,) = _found(diagnosis, "tf-problems")
    assert "'base_link' has two parents" in parents.message
    assert [finding.mend for finding in _found(diagnosis, "tf-late")] == ["--start 5.0", ""]
    assert not _found(_diagnose(path, renamed_frames=["lidar=laser"]), "tf-missing")
    assert not _found(_diagnose(path, static_transforms=["base_link,laser,0,0,0,0,0,0"]), "tf-missing")
    assert not _found(_diagnose(path, laser_pose="0.1,0,0"), "tf-missing")


def test_a_recorded_localisation_and_shared_frames_are_notes(tmp_path: Path) -> None:
    def more(self: Robot, writer: RecordingWriter, i: int, stamp: int) -> None:
        writer.write("/tf", _tf(stamp, "map", "odom", x=0.001 * i))
        writer.write("/scan_2", _scan(stamp))

    diagnosis = _diagnose(_faulty(more=more).write(tmp_path / "a.mcap"))
    assert [finding.severity for finding in _found(diagnosis, "tf-map-parent")] == ["note"]
    assert "/scan, /scan_2 share the frame laser" in _found(diagnosis, "frame-shared")[0].message


def test_no_odometry_and_odometry_that_jumps(tmp_path: Path) -> None:
    path = tmp_path / "scans.mcap"
    with create_recording(path) as writer:
        for i in range(20):
            writer.write("/scan", _scan(START + i * S // 10))
    (finding,) = _found(_diagnose(path), "odometry")
    assert "no odometry" in finding.message
    path = tmp_path / "jump.mcap"
    with create_recording(path) as writer:
        for i in range(50):
            position = np.array([0.01 * i + (7.0 if i >= 30 else 0.0), 0.0, 0.0])
            stamp = START + i * S // 10
            quat = np.array([0, 0, 0, 1.0])
            writer.write("/scan", _scan(stamp))
            writer.write("/odom", Odometry(stamp_ns=stamp, frame_id="odom", position_m=position, quat_xyzw=quat))
    (finding,) = _found(_diagnose(path), "odometry")
    assert (finding.count, finding.stamp_ns) == (1, START + 3 * S)


def test_beams_that_change_and_limits_that_make_no_sense(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        ranges = _room(yaw)[: NUM_BEAMS - (i == 30)]
        ranges[:30] = 25.0
        ranges[30:60] = np.nan
        ranges[60:100] = 0.0
        return _scan(stamp, ranges_m=ranges)

    diagnosis = _diagnose(_faulty(scan=scan).write(tmp_path / "a.mcap"))
    (beams,) = _found(diagnosis, "scan-beams")
    assert (beams.severity, beams.count, beams.stamp_ns) == ("note", 1, START + 3 * S)
    assert "1 scans have 119 to 120 beams, not 120" in beams.message
    (returned,) = _found(diagnosis, "scan-returns")
    assert returned.severity == "warning"
    assert "17 % of the readings are distances; the others: 25 % NaN, 33 % zero or less, 25 % at or beyond" in (
        returned.message
    )
    (limits,) = _found(diagnosis, "scan-limits")
    assert "25 % of the readings lie beyond range_max (20 m, largest reading 25.00 m)" in limits.message

    def no_range(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp, yaw, range_max_m=0.0)

    assert _found(_diagnose(_faulty(scan=no_range).write(tmp_path / "b.mcap")), "scan-limits")[0].severity == "error"


def test_angle_max_against_the_number_of_beams(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from slamcli.recordings.adapters import laser_scan

    honest = laser_scan.ADAPTER.encode

    def lying(scan: LaserScan, messages: Any) -> Any:
        message = honest(scan, messages)
        message.angle_max += np.radians(10)
        return message

    monkeypatch.setattr("slamcli.recordings.writing.encoder_for", lambda m, t: _with_encode(m, t, lying))
    (finding,) = _found(_diagnose(Robot().write(tmp_path / "a.mcap")), "scan-angle-max")
    assert (finding.severity, finding.count, finding.stamp_ns) == ("warning", 200, START)
    assert "off by 5.0 beams" in finding.message


def _with_encode(measurement: Any, msgtype: str | None, encode: Any) -> Any:
    import dataclasses

    from slamcli.recordings.adapters import encoder_for

    adapter = encoder_for(measurement, msgtype)
    return dataclasses.replace(adapter, encode=encode) if isinstance(measurement, LaserScan) else adapter


def test_mirrored_scans_and_the_mend(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp, ranges_m=_room(yaw, clockwise=True))

    path = _faulty(scan=scan).write(tmp_path / "a.mcap")
    (finding,) = _found(_diagnose(path), "scan-mirrored")
    assert finding.severity == "error"
    assert finding.mend.startswith("--flip-scan")
    assert not _by(_diagnose(path, flip_scan=True), "error", "warning")


def test_clockwise_and_upside_down_scanners_are_notes(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        # Upside down, a scanner's counter-clockwise beams run clockwise in the room.
        return _scan(stamp, ranges_m=_room(yaw, clockwise=True), angle_min_rad=np.radians(-118))

    def write_frames(self: Robot, writer: RecordingWriter) -> None:
        writer.write("/tf_static", _tf(START, "base_link", "laser", roll=np.pi))

    diagnosis = _diagnose(_faulty(scan=scan, write_frames=write_frames).write(tmp_path / "a.mcap"))
    assert _by(diagnosis, "error", "warning") == []
    assert "hangs upside down" in _found(diagnosis, "scan-direction")[0].message

    def clockwise(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        last = np.radians(-120 + 2 * (NUM_BEAMS - 1))
        return _scan(stamp, ranges_m=_room(yaw, clockwise=True), angle_min_rad=last, angle_increment_rad=-np.radians(2))

    diagnosis = _diagnose(_faulty(scan=clockwise).write(tmp_path / "b.mcap"))
    assert _by(diagnosis, "error", "warning") == []
    assert "clockwise" in _found(diagnosis, "scan-direction")[0].message


@pytest.mark.parametrize(
    ("gravity", "severity", "guess"),
    [(9.81, None, ""), (1.0, "error", "multiples of g"), (0.0, "error", "removed"), (11.0, "warning", "calibration")],
)
def test_gravity(tmp_path: Path, gravity: float, severity: str | None, guess: str) -> None:
    def more(self: Robot, writer: RecordingWriter, i: int, stamp: int) -> None:
        rates = np.array([0.0, 0.0, 50.0 if severity is None and i == 7 else 0.1])
        sample = ImuSample(
            stamp_ns=stamp, frame_id="laser", angular_rad_s=rates, acceleration_m_s2=np.array([0.0, 0.0, gravity])
        )
        writer.write("/imu", sample)

    diagnosis = _diagnose(_faulty(more=more).write(tmp_path / "a.mcap"))
    found = _found(diagnosis, "imu-gravity")
    assert [finding.severity for finding in found] == ([severity] if severity else [])
    assert guess in (found[0].message if found else "")
    turning = _found(diagnosis, "imu-rotation")
    assert [finding.stamp_ns for finding in turning] == ([START + 7 * S // 20] if severity is None else [])


def _noise(stamp: int) -> NDArray[np.uint8]:
    return np.random.default_rng(stamp // 10**6 % 10**6).integers(0, 256, (12, 16, 3), dtype=np.uint8)


def _camera(stamp: int, focal: float = 50.0, width: int = 16) -> CameraModel:
    return CameraModel(
        stamp_ns=stamp,
        frame_id="camera",
        width=width,
        height=12,
        distortion_model="plumb_bob",
        distortion=np.zeros(5),
        intrinsics=np.array([[focal, 0, 8], [0, focal, 6], [0, 0, 1]]),
        rectification=np.eye(3),
        projection=np.zeros((3, 4)),
    )


class Camera(Robot):
    focal, width, depth_m, depth_late_ns = 50.0, 16, 2.0, 0

    def write_frames(self, writer: RecordingWriter) -> None:
        super().write_frames(writer)
        writer.write("/tf_static", _tf(START, "base_link", "camera"))

    def more(self, writer: RecordingWriter, i: int, stamp: int) -> None:
        colour = Image(stamp_ns=stamp, frame_id="camera", encoding="rgb8", pixels=_noise(stamp))
        depth = Image(
            stamp_ns=stamp + self.depth_late_ns,
            frame_id="camera",
            encoding="depth",
            pixels=np.float32(self.depth_m) + _noise(stamp)[..., 0] / np.float32(1000),
        )
        writer.write("/camera/rgb/image_raw", colour, log_time_ns=stamp)
        writer.write("/camera/rgb/camera_info", _camera(stamp, self.focal, self.width), log_time_ns=stamp)
        writer.write("/camera/depth/image_raw", depth, log_time_ns=stamp)
        writer.write("/camera/depth/camera_info", _camera(stamp), log_time_ns=stamp)


def test_a_sound_camera_and_its_faults(tmp_path: Path) -> None:
    assert _diagnose(Camera().write(tmp_path / "a.bag")).findings == ()
    faulty = Camera()
    faulty.focal, faulty.width, faulty.depth_m, faulty.depth_late_ns = 0.0, 32, 2000.0, 20_000_000
    path = faulty.write(tmp_path / "b.bag")
    diagnosis = _diagnose(path)
    (info,) = _found(diagnosis, "camera-info")
    assert (info.severity, info.topic, info.mend) == (
        "error",
        "/camera/rgb/camera_info",
        "--camera-info /camera/rgb/camera_info=FILE",
    )
    assert "16 x 12 pixels, the calibration on /camera/rgb/camera_info is for 32 x 12" in (
        _found(diagnosis, "camera-size")[0].message
    )
    (scale,) = _found(diagnosis, "depth-scale")
    assert "depth is 2e+03 m typically" in scale.message
    (late,) = _found(diagnosis, "camera-sync")
    assert "20.0 ms apart from the images of /camera/rgb/image_raw" in late.message
    assert not _found(_diagnose(path, depth_units_per_m=1000.0), "depth-scale")
    assert not _found(_diagnose(path, time_offsets=["/camera/depth/image_raw=-0.02"]), "camera-sync")


def test_images_without_calibration(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        image = Image(stamp_ns=START, frame_id="c", encoding="mono8", pixels=np.zeros((4, 4), np.uint8))
        writer.write("/left/image_raw", image)
        writer.write("/right/camera_info", _camera(START))
    (finding,) = _found(_diagnose(path), "camera-info")
    assert (finding.topic, finding.severity) == ("/left/image_raw", "warning")


def _json(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(Robot().write(tmp_path / "sound.mcap"))
    assert run(["doctor", path, "--json"]) == 0
    document = _json(capsys)
    assert (document["errors"], document["warnings"], document["findings"]) == (0, 0, [])
    assert document["checks"] == list(CHECKS)
    assert run(["doctor", path, "--flip-scan"]) == 1
    shown = capsys.readouterr().out
    assert "error   /scan: scans turn against the odometry" in shown
    assert "mend: --flip-scan" in shown
    assert run(["doctor", path, "--flip-scan", "--json"]) == 1
    document = _json(capsys)
    mirrored = next(finding for finding in document["findings"] if finding["check"] == "scan-mirrored")
    assert set(mirrored) == {"check", "severity", "topic", "message", "stamp_ns", "count", "mend"}
    assert (mirrored["severity"], mirrored["topic"], mirrored["stamp_ns"]) == ("error", "/scan", START)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere.bag"], "nowhere.bag: there is no such file"),
        ([], "Missing argument 'BAG...'"),
        (["{text}"], "text.bag"),
        (["{bag}", "--time-offset", "/scam=1"], "--time-offset /scam: a.mcap has no such topic; did you mean /scan?"),
        (["{bag}", "--static-tf", "a,b"], "--static-tf a,b: write parent,child"),
        (["{bag}", "--urdf", "nowhere.urdf"], "nowhere.urdf: cannot be read"),
        (["{bag}", "--no-return", "maybe"], "'maybe' is not one of"),
    ],
)
@pytest.mark.parametrize("command", ["doctor", "info"])
def test_wrong_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, arguments: list[str], complaint: str
) -> None:
    (tmp_path / "text.bag").write_text("no bag at all\n" * 100)
    bag = tmp_path / "a.mcap"
    if "{bag}" in arguments:
        Robot().write(bag)
    names = {"text": tmp_path / "text.bag", "bag": bag}
    assert run([command, *(argument.format(**names) for argument in arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert complaint in captured.err
    assert captured.err.count("\n") == 1


def test_help_names_the_mends() -> None:
    from slamcli.cli.main import cli

    for command in ("info", "doctor"):
        shown = CliRunner().invoke(cli, [command, "--help"]).output
        for option in ("--time-offset", "--rename-frame", "--static-tf", "--urdf", "--laser-pose", "--camera-info",
                       "--flip-scan", "--depth-scale", "--no-return"):  # fmt: skip
            assert option in shown


def _swept(time_increment_s: float, scan_time_s: float, log_delay_s: float, path: Path) -> Diagnosis:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        return _scan(stamp, yaw, time_increment_s=time_increment_s, scan_time_s=scan_time_s)

    def log(self: Robot, i: int, stamp: int) -> int:
        return stamp + round(log_delay_s * 1e9)

    # The robot's scans come every 0.1 s.
    return _diagnose(_faulty(scan=scan, scan_log_ns=log).write(path))


@pytest.mark.parametrize("times", [(0.1 / 119, 0.1), (0.0, 0.1), (0.0, 0.0), (1e-9, 1e-4), (5.0, 1e9)])
def test_a_sweep_is_no_clock_offset(tmp_path: Path, times: tuple[float, float]) -> None:
    told = _by(_swept(*times, 0.15, tmp_path / "a.mcap"), "error", "warning")
    # A sweep of minutes ten times a second is another matter.
    assert [check for check, _ in told] == (["sweep-overlap"] if times[0] == 5.0 else [])
    late = _swept(*times, 0.4, tmp_path / "b.mcap")
    (finding,) = _found(late, "stamp-clocks")
    assert finding.mend == "--time-offset /scan=0.300"
    assert "beside a sweep of 0.100 s" in _found(late, "stamp-delay")[0].message


def test_sweeps_that_overlap(tmp_path: Path) -> None:
    (finding,) = _found(_swept(0.12 / 119, 0.0, 0.15, tmp_path / "a.mcap"), "sweep-overlap")
    assert (finding.severity, finding.count) == ("warning", 199)
    assert "by up to 0.02 s (a sweep takes 0.12 s by its points' times, and they come every 0.1 s)" in finding.message
    assert not _found(_swept(0.1 / 119, 0.0, 0.15, tmp_path / "b.mcap"), "sweep-overlap")


def test_stamps_of_the_sweeps_end(tmp_path: Path) -> None:
    (finding,) = _found(_swept(0.08 / 119, 0.0, 0.005, tmp_path / "a.mcap"), "sweep-stamp")
    assert finding.mend == "--time-offset /scan=-0.080"
    assert "logged 0.075 s before their last point was measured" in finding.message
    assert not _found(_swept(0.08 / 119, 0.0, 0.081, tmp_path / "b.mcap"), "sweep-stamp")


def test_sweeps_that_repeat_and_a_scanner_that_sees_nothing(tmp_path: Path) -> None:
    def scan(self: Robot, i: int, stamp: int, yaw: float) -> LaserScan:
        if 50 <= i < 80:
            return _scan(stamp, yaw, ranges_m=np.full(NUM_BEAMS, np.inf, np.float32))
        return _scan(stamp, 0.0 if i < 3 else yaw)

    diagnosis = _diagnose(_faulty(scan=scan).write(tmp_path / "a.mcap"))
    (repeated,) = _found(diagnosis, "sweep-repeated")
    assert (repeated.severity, repeated.count, repeated.stamp_ns) == ("note", 2, START + S // 10)
    (blind,) = _found(diagnosis, "sweep-blind")
    assert (blind.severity, blind.count, blind.stamp_ns) == ("warning", 30, START + 5 * S)
    assert "30 of 200 sweeps hold no distance at all, for up to 3 s" in blind.message


def _clouds(path: Path, offset_ns: np.ndarray | None, frame: str = "laser") -> Diagnosis:
    def more(self: Robot, writer: RecordingWriter, i: int, stamp: int) -> None:
        points = np.random.default_rng(i).normal(size=(10, 3)).astype(np.float32)
        cloud = PointCloud(stamp_ns=stamp, frame_id=frame, points_m=points, offset_ns=offset_ns)
        writer.write("/points", cloud, log_time_ns=stamp + 60_000_000)

    return _diagnose(_faulty(more=more).write(path))


def test_clouds_without_times_or_with_overlapping_ones(tmp_path: Path) -> None:
    (finding,) = _found(_clouds(tmp_path / "a.mcap", None), "point-times")
    assert finding.message.startswith("points carry no times")
    times = np.linspace(0, 60_000_000, 10).astype(np.int64)
    diagnosis = _clouds(tmp_path / "b.mcap", times)
    assert not _found(diagnosis, "point-times")
    (finding,) = _found(diagnosis, "sweep-overlap")
    assert (finding.topic, finding.count) == ("/points", 399)


def test_frames_with_a_leading_slash(tmp_path: Path) -> None:
    (finding,) = _found(_clouds(tmp_path / "a.mcap", None, "/laser"), "frame-slash")
    assert finding.topic == "/points"
    assert "written /laser" in finding.message


@pytest.mark.parametrize("late_s", [0.2, -0.15])
def test_scans_and_odometry_that_turn_at_different_times(tmp_path: Path, late_s: float) -> None:
    def yaw_at(seconds: float) -> float:
        return float(0.8 * np.sin(0.7 * seconds) + 0.3 * np.sin(1.9 * seconds))

    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        writer.write("/tf_static", _tf(START, "base_link", "laser"))
        for i in range(600):
            stamp = START + i * S // 20
            odometry = Odometry(
                stamp_ns=stamp,
                frame_id="odom",
                child_frame_id="base_link",
                position_m=np.zeros(3),
                quat_xyzw=quaternion.from_yaw(yaw_at(i / 20)),
            )
            writer.write("/odom", odometry)
            if i % 2 == 0:
                writer.write("/scan", _scan(stamp, yaw_at(i / 20 - late_s)), log_time_ns=stamp)
    (finding,) = _found(_diagnose(path), "stamp-turning")
    assert finding.severity == "warning"
    assert finding.mend.startswith("--time-offset /odom=")
    assert float(finding.mend.split("=")[1]) == pytest.approx(late_s, abs=0.03)
    assert ("after" if late_s > 0 else "before") + " /odom does" in finding.message
    assert not _found(_diagnose(path, time_offsets=(finding.mend.split()[1],)), "stamp-turning")
