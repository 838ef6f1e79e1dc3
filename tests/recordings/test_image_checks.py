# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import data_folders
import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.measurements import FrameTransform, Image
from slamcli.recordings import RecordingWriter, create_recording, open_recording
from slamcli.recordings.checks import Finding
from slamcli.recordings.diagnosis import diagnose

START, STEP = 1_700_000_000_000_000_000, 50_000_000
COLOUR, DEPTH = "/camera/rgb/image_raw", "/camera/depth/image_raw"


def _findings(path: Path, check: str) -> tuple[Finding, ...]:
    with open_recording(path) as recording:
        return tuple(finding for finding in diagnose(recording).findings if finding.check == check)


def _sharp(number: int, shape: tuple[int, ...] = (48, 64)) -> NDArray[np.uint8]:
    return np.random.default_rng(number).integers(0, 256, shape, dtype=np.uint8)


def _write(
    writer: RecordingWriter, topic: str, number: int, pixels: Any, encoding: str = "mono8", frame: str = "c"
) -> None:
    writer.write(topic, Image(stamp_ns=START + number * STEP, frame_id=frame, encoding=encoding, pixels=pixels))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag of 40 images with one fault of each kind."""
    path = tmp_path / "a.mcap"
    with create_recording(path) as writer:
        for number in range(50):
            pixels = _sharp(number)
            if number in (20, 21, 22, 23, 24, 30):
                continue
            if number in (5, 6):
                pixels = np.full((48, 64), 3, np.uint8)
                pixels[0, number] = 9
            elif number == 8:
                pixels = np.full((48, 64), 250, np.uint8)
            elif number == 10:
                pixels = np.full((48, 64), 120, np.uint8)
            elif number in (12, 13):
                pixels = cv2.GaussianBlur(
                    cv2.resize(_sharp(number, (6, 8)), (64, 48), interpolation=cv2.INTER_CUBIC), (9, 9), 3
                )
            elif number == 16:
                pixels = _sharp(15)
            elif number == 40:
                pixels = _sharp(number, (24, 32))
            _write(writer, COLOUR, number, pixels)
    return path


def test_black_bright_and_bare_images(bag: Path) -> None:
    found = {finding.message: finding for finding in _findings(bag, "image-exposure")}
    assert list(found) == [
        "2 of 44 images (5 %) are black",
        "1 of 44 images (2 %) are overexposed",
        "1 of 44 images (2 %) are without texture (a bare wall, a covered lens)",
    ]
    first = next(iter(found.values()))
    assert (first.severity, first.stamp_ns, first.count) == ("note", START + 5 * STEP, 2)


def test_blurred_images(bag: Path) -> None:
    (finding,) = _findings(bag, "image-blur")
    assert (finding.count, finding.stamp_ns) == (2, START + 12 * STEP)


def test_repeated_images(bag: Path) -> None:
    (finding,) = _findings(bag, "image-repeated")
    assert (finding.count, finding.severity, finding.stamp_ns) == (1, "warning", START + 16 * STEP)


def test_dropped_images(bag: Path) -> None:
    (finding,) = _findings(bag, "image-dropped")
    assert (finding.count, finding.severity) == (6, "warning")
    assert "about 6 images were dropped (12.0 % at 20 Hz), up to 5 in a row" in finding.message


def test_images_that_change_their_size(bag: Path) -> None:
    (finding,) = _findings(bag, "image-size")
    assert (finding.severity, finding.count, finding.stamp_ns) == ("error", 1, START + 40 * STEP)
    assert "43 of 64 x 48, 1 of 32 x 24" in finding.message


@pytest.mark.parametrize(
    ("metres", "severity", "words"),
    [
        (0.05, "error", "0.05 m typically"),
        (25.0, "error", "25 m typically"),
        (2.0, None, ""),
        (0.0, "warning", "no depth"),
    ],
)
def test_depth_of_another_unit(tmp_path: Path, metres: float, severity: str | None, words: str) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        for number in range(12):
            _write(writer, DEPTH, number, np.full((48, 64), metres * (1 + number / 1e5), np.float32), "depth")
    found = _findings(tmp_path / "a.mcap", "depth-scale")
    assert [finding.severity for finding in found] == ([severity] if severity else [])
    assert all(words in finding.message for finding in found)


def test_depth_that_is_hardly_there(tmp_path: Path) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        depth = np.zeros((48, 64), np.float32)
        depth[:4] = 2.0
        _write(writer, DEPTH, 0, depth, "depth")
    (finding,) = _findings(tmp_path / "a.mcap", "depth-scale")
    assert finding.message == "only 8 % of the pixels have depth"


@pytest.mark.parametrize(("shape", "frame", "words"), [
    ((24, 32), "c", "depth has 32 x 24 pixels, colour on /camera/rgb/image_raw 64 x 48"),
    ((48, 64), "d", "depth is seen from d, 2.5 cm beside c"),
    ((48, 64), "c", None),
])  # fmt: skip
def test_depth_that_is_not_registered(tmp_path: Path, shape: tuple[int, int], frame: str, words: str | None) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        mount = FrameTransform(
            stamp_ns=START, parent_frame_id="c", child_frame_id="d", position_m=np.array([0.025, 0, 0]),
            quat_xyzw=np.array([0, 0, 0, 1.0]), static=True,
        )  # fmt: skip
        writer.write("/tf_static", mount)
        _write(writer, COLOUR, 0, _sharp(0))
        _write(writer, DEPTH, 0, np.full(shape, 2, np.float32), "depth", frame)
    found = _findings(tmp_path / "a.mcap", "depth-registration")
    assert len(found) == (words is not None)
    assert all(words is not None and words in finding.message for finding in found)


def test_a_folder_tells_which_images_are_missing(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1", 12)
    first, second = sorted((folder / "depth").iterdir())[:2]
    first.unlink()
    second.write_bytes(second.read_bytes()[:-60])
    found = [finding.message for finding in _findings(folder, "damage")]
    assert len(found) == 2
    assert "1 of 12 images that it names are missing" in found[0]
    assert "/camera/depth/image: 1 images cannot be read" in found[1]


def test_big_recordings_are_sampled(tmp_path: Path) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        for number in range(450):
            _write(writer, COLOUR, number, _sharp(number, (8, 8)) // (1 if number % 2 else 200))
    (finding,) = _findings(tmp_path / "a.mcap", "image-exposure")
    assert finding.severity == "warning"
    assert "of 150 images that were looked at (50 %) are black" in finding.message
