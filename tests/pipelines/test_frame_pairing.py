# SPDX-License-Identifier: MIT
"""Which images belong together, and what comes before them."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.measurements import Image, ImuSample, Measurement, RgbdFrame, StereoPair
from slamcli.pipelines.frame_pairing import FramePairing
from slamcli.pipelines.reading_ahead import read_ahead
from slamcli.runtime import RunLog

MS = 1_000_000


def image(ms: float, topic: str = "/rgb", encoding: str = "mono8", size: tuple[int, int] = (4, 6)) -> Image:
    pixels = np.zeros(size, dtype=np.float32 if encoding == "depth" else np.uint8)
    return Image(stamp_ns=round(ms * MS), frame_id="camera", encoding=encoding, pixels=pixels, topic=topic)


def depth(ms: float) -> Image:
    return image(ms, "/depth", "depth")


def sample(ms: float) -> ImuSample:
    return ImuSample(
        stamp_ns=round(ms * MS), frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.zeros(3), topic="/imu"
    )


def paired(
    measurements: list[Measurement], tolerance_ms: float = 20.0, imu: str | None = None
) -> tuple[list[Measurement], FramePairing, RunLog]:
    log = RunLog()
    pairing = FramePairing("/rgb", "/depth", round(tolerance_ms * MS), imu, log)
    found = list(pairing.run(sorted(measurements, key=lambda m: m.stamp_ns)))  # type: ignore[union-attr]
    pairing.tell("depth image")
    return found, pairing, log


def stamps(frames: list[Measurement]) -> list[tuple[float, float]]:
    return [(f.colour.stamp_ns / MS, f.depth.stamp_ns / MS) for f in frames if isinstance(f, RgbdFrame)]


def test_the_nearest_image_is_the_partner() -> None:
    found, _, log = paired([image(0), image(33), image(66), depth(5), depth(30), depth(70)])
    assert stamps(found) == [(0, 5), (33, 30), (66, 70)]
    assert log.notes == [
        "depth image on /depth is +4.0 ms from the image typically, 5.0 ms at most (shift it with --time-offset /depth=SECONDS)"
    ]


def test_a_partner_is_left_to_the_image_that_it_is_nearer_to() -> None:
    found, pairing, log = paired([image(0), image(33), depth(18), depth(50)])
    assert stamps(found) == [(33, 18)]  # 18 is 15 from 33, and 18 from 0
    assert pairing.figures.num_alone == 1
    assert "1 of 2 images of /rgb have no depth image on /depth within 20 ms" in log.warnings[0]


def test_nothing_beyond_the_tolerance() -> None:
    found, pairing, _ = paired([image(0), image(100), depth(21), depth(125)])
    assert found == []
    assert pairing.figures.num_alone == 2


def test_stereo_images_make_pairs() -> None:
    log = RunLog()
    pairing = FramePairing("/left", "/right", 5 * MS, None, log)
    found = list(pairing.run([image(0, "/left"), image(0, "/right"), image(50, "/right"), image(50, "/left")]))
    assert [type(f) for f in found] == [StereoPair, StereoPair]
    assert log.notes == []


def test_one_camera_needs_no_partner_and_frames_out_of_order_are_left_out() -> None:
    log = RunLog()
    pairing = FramePairing("/rgb", None, 0, None, log)
    found = list(pairing.run([image(0), image(50), image(40), image(50), image(100, size=(5, 6)), image(150)]))
    pairing.tell("partner")
    assert [m.stamp_ns // MS for m in found if isinstance(m, Image)] == [0, 50, 150]
    assert log.counts == {"/rgb: images out of order": 2, "/rgb: images of another size": 1}


def test_imu_samples_come_before_the_frame_that_needs_them() -> None:
    measurements = [sample(t) for t in range(0, 101, 10)] + [image(25), image(60), depth(26), depth(61)]
    found, _, _ = paired(measurements, imu="/imu")
    order = [m.stamp_ns // MS for m in found]  # type: ignore[union-attr]
    # All samples up to the first one at or after the frame: that is what the IMU is interpolated with.
    assert order == [0, 10, 20, 30, 25, 40, 50, 60, 60]
    assert isinstance(found[-1], RgbdFrame)


def test_a_frame_does_not_wait_for_an_imu_that_pauses() -> None:
    frames = [image(t) for t in range(0, 3000, 100)]
    log = RunLog()
    pairing = FramePairing("/rgb", None, 0, "/imu", log)
    late = 0
    for found in pairing.run([sample(0), *frames]):
        if isinstance(found, Image):
            late = max(late, pairing._last_ns - found.stamp_ns)  # type: ignore[operator]
    assert late <= 500 * MS


def test_reading_ahead_keeps_order_errors_and_words() -> None:
    def make(log: RunLog):  # type: ignore[no-untyped-def]
        yield from range(20)
        log.warn("from the other thread")
        log.counts["items"] += 20
        raise ValueError("broken")

    log = RunLog()
    items = read_ahead(make, log, 3)
    seen = [next(items) for _ in range(20)]
    log.warn("from this thread")
    with pytest.raises(ValueError, match="broken"):
        next(items)
    assert seen == list(range(20))
    assert log.warnings[-1] == "from the other thread"
    assert log.counts["items"] == 20


def test_reading_ahead_stops_with_its_reader_and_never_runs_far_ahead() -> None:
    made = []

    def make(log: RunLog):  # type: ignore[no-untyped-def]
        for i in range(1000):
            made.append(i)
            yield i

    items = read_ahead(make, RunLog(), 4)
    assert [next(items) for _ in range(5)] == [0, 1, 2, 3, 4]
    items.close()  # type: ignore[attr-defined]
    assert len(made) <= 5 + 4 + 2
