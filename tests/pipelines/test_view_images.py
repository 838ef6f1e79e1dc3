# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np

from slamcli.measurements import Image
from slamcli.pipelines.view_images import image_rows
from slamcli.recordings import create_recording, open_recording
from slamcli.reports.figures.strip import depth_colours, shrunk, strip_image

START = 1_700_000_000_000_000_000


def test_six_moments_of_each_camera(tmp_path: Path) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        for number in range(30):
            grey = np.full((120, 400), 8 * number, np.uint8)
            stamp = START + number * 100_000_000
            writer.write("/cam0/image_raw", Image(stamp_ns=stamp, frame_id="c", encoding="mono8", pixels=grey))
            depth = np.full((60, 80), 1.0 + number, np.float32)
            writer.write("/depth/image", Image(stamp_ns=stamp, frame_id="c", encoding="depth", pixels=depth))
    with open_recording(tmp_path / "a.mcap") as recording:
        grey_row, depth_row = image_rows(recording, None, None)
        (late, _) = image_rows(recording, 2.0, 0.1)
    # The recording lasts 2.9 s: moments are 0.4833 s apart, and the next image is 0.1 s or less behind.
    assert [int(picture[0, 0, 0]) // 8 for picture in grey_row.pictures] == [0, 5, 10, 15, 20, 25]
    assert grey_row.captions[:3] == ["0 s", "0.5 s", "1 s"]
    assert grey_row.pictures[0].shape == (60, 200, 3)
    assert "bright is 26 m" in depth_row.label
    assert [int(picture[0, 0, 0]) // 8 for picture in late.pictures] == [20]
    page = strip_image([grey_row, depth_row])
    assert page.shape == (60 + 56 + 60 + 56, 8 + 6 * 208, 3)
    assert strip_image([]).size == 0


def test_pixels_are_means_of_blocks() -> None:
    pixels = np.arange(2 * 400, dtype=np.uint8).reshape(2, 400) % 4
    np.testing.assert_array_equal(shrunk(pixels), [[0, 2] * 100])


def test_depth_without_reading_is_grey() -> None:
    colours = depth_colours(np.array([[0.0, np.nan, 1.0, 5.0]], np.float32), 2.0)
    assert colours[0, 0].tolist() == colours[0, 1].tolist() == [225, 225, 225]
    assert colours[0, 3].tolist() == [249, 149, 65]
