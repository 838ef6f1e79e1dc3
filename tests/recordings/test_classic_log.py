# SPDX-License-Identifier: MIT
from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import RecordingError
from slamcli.measurements import LaserScan, Odometry
from slamcli.recordings import Recording, create_recording, open_recording
from slamcli.recordings.classic_log import classic_kind
from slamcli.recordings.mend_parsing import parse_mends
from slamcli.runtime import RunLog


def _carmen(num: int = 5) -> str:
    lines = ["# a comment"]
    for i in range(num):
        stamp = 1000.0 + 0.2 * i - (0.5 if i == 3 else 0.0)
        readings = " ".join(["2.50"] * 180)
        lines.append(f"ODOM {0.1 * i:.3f} 0 0 0 0 0 {stamp:.3f} host {stamp:.3f}")
        lines.append(f"FLASER 180 {readings} {0.1 * i:.3f} 0 0 {0.1 * i:.3f} 0 0 {stamp:.3f} host {stamp:.3f}")
    return "\n".join(lines) + "\n"


def _stamps(recording: Recording, topic: str) -> list[int]:
    return [m.stamp_ns // 1_000_000 for m in recording.measurements([topic])]


@pytest.mark.parametrize("name", ["a.clf", "a.log", "a.clf.gz"])
def test_a_carmen_log_is_a_recording(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    data = _carmen().encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    log = RunLog()
    with open_recording(path, log=log) as recording:
        contents = recording.contents
        assert (contents.format, contents.compression) == ("carmen log", "gzip" if name.endswith(".gz") else "none")
        assert [topic.count for topic in recording.topics(LaserScan)] == [5]
        assert _stamps(recording, "/scan") == [1000_000, 1000_200, 1000_400, 1000_100, 1000_800]
        assert log.counts["/scan: stamps that run backwards"] == 1
        poses = [m.pose_se2[0] for m in recording.measurements(["/odom"])]
        np.testing.assert_allclose(poses, [0, 0.1, 0.2, 0.3, 0.4])
        assert {type(m) for m in recording.measurements(["/scan", "/odom"])} == {LaserScan, Odometry}
        assert recording.frames().connected("odom", "laser")
        assert len(list(recording.measurements(["/odom"], start_s=0.3))) < 5


def test_mends_apply_to_classic_logs(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_carmen())
    mends = parse_mends(time_offsets=["/scan=1.5"], renamed_frames=["laser=lidar"])
    with open_recording(path, mends=mends) as recording:
        first = next(iter(recording.measurements(["/scan"])))
        assert (first.stamp_ns, first.frame_id) == (1_001_500_000_000, "lidar")
        assert "lidar" in recording.frames().frames


def test_a_renaming_that_renames_nothing_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.clf"
    path.write_text(_carmen())
    log = RunLog()
    with open_recording(path, mends=parse_mends(renamed_frames=["lasser=lidar"]), log=log) as recording:
        _stamps(recording, "/scan")
    assert "--rename-frame lasser=lidar changed nothing: no message that was read names that frame" in log.warnings


def test_classic_logs_stand_alone(tmp_path: Path) -> None:
    log, bag = tmp_path / "a.clf", tmp_path / "a.mcap"
    log.write_text(_carmen())
    with create_recording(bag):
        pass
    with pytest.raises(RecordingError, match="classic logs cannot be joined with other files"):
        open_recording([log, bag])


def test_what_is_no_classic_log(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("hello\n")
    (tmp_path / "empty.clf").write_text("")
    assert [classic_kind([tmp_path / name]) for name in ("a.txt", "empty.clf", "missing.clf", ".")] == ["", "", "", ""]
