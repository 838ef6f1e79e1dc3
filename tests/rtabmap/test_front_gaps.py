# SPDX-License-Identifier: MIT
"""What is said of images, scans and odometry that are missing beside each other."""

from slamcli.rtabmap.front_gaps import FrontGaps, Stretch
from slamcli.runtime import RunLog

SECOND = 1_000_000_000


def _watched(
    log: RunLog, *, frames: range, scans: range = range(0), lost: range = range(0), carried: range = range(0)
) -> None:
    """Tell of frames and scans at 10 Hz, each range in tenths of a second."""
    gaps = FrontGaps(log, scans=len(scans) > 0)
    for tick in range(200):
        stamp = tick * SECOND // 10
        if tick in scans:
            gaps.see_scan(stamp)
        if tick in frames:
            gaps.see_frame(stamp, lost=tick in lost, carried=tick in carried, has_scan=tick in scans)
    gaps.tell()


def test_nothing_is_said_of_what_is_whole() -> None:
    log = RunLog()
    _watched(log, frames=range(200), scans=range(200))
    assert log.warnings == []


def test_frames_without_odometry_are_counted() -> None:
    log = RunLog()
    _watched(log, frames=range(200), lost=range(50, 80))
    assert log.counts["images without odometry"] == 30
    assert log.warnings == []  # said where it is known which frames other maps hold


def test_wheels_that_carry_on_are_told() -> None:
    log = RunLog()
    _watched(log, frames=range(200), carried=range(190, 200))
    assert log.counts["images placed by the recording's odometry alone"] == 10
    assert "10 of 200 images show nothing known (the longest for 0.9 s from 19.000 s)" in log.warnings[0]


def test_images_that_begin_late_or_end_early_are_told() -> None:
    log = RunLog()
    _watched(log, frames=range(30, 100), scans=range(200))
    assert [warning.split(":")[0] for warning in log.warnings] == [
        "scans begin 3.0 s before the images", "images end 10.0 s before the scans",
    ]  # fmt: skip


def test_scans_that_end_are_told() -> None:
    log = RunLog()
    _watched(log, frames=range(200), scans=range(150))
    assert log.warnings == ["50 of 200 images have no scan within 0.2 s (the longest for 4.9 s from 15.000 s)"]


def test_a_run_ends_with_the_next_frame_that_is_right() -> None:
    stretch = Stretch()
    for tick in range(3):
        stretch.note(tick * SECOND, tick == 1)
    assert stretch.count == 1
    assert stretch.longest == "the longest for 1.0 s from 1.000 s"
