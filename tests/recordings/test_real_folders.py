# SPDX-License-Identifier: MIT
"""The folders of real data sets."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.formats.trajectories import read_tum
from slamcli.measurements import CameraModel, Image
from slamcli.pipelines.convert import convert
from slamcli.pipelines.convert_folder import convert_to_folder
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.recordings import open_recording
from slamcli.recordings.checks import Finding
from slamcli.recordings.diagnosis import diagnose
from slamcli.recordings.imu_noise import recorded_noise
from slamcli.runtime import RunLog

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data")) / "visual"
pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"no data sets under {DATA}: set SLAMCLI_TEST_DATA"),
]


def _findings(name: str) -> tuple[Finding, ...]:
    with open_recording(DATA / name) as recording:
        return diagnose(recording).findings


@pytest.mark.parametrize(
    ("name", "layout", "counts", "fx"),
    [
        ("redkitchen", "7-Scenes folder", [400, 400], 585.0),
        ("kitti06", "KITTI odometry folder", [51, 51], 707.0912),
        ("fr3_cabinet", "TUM RGB-D folder", [58, 58], 535.4),
        ("euroc_v101_start", "EuRoC folder", [20, 20], 458.654),
    ],
)
def test_they_are_recordings(name: str, layout: str, counts: list[int], fx: float) -> None:
    log = RunLog()
    with open_recording(DATA / name, log=log) as recording:
        assert recording.contents.format == layout
        assert recording.contents.damage == ()
        assert [topic.count for topic in recording.topics(Image)] == counts
        info = recording.topics(CameraModel)[0]
        assert next(iter(recording.measurements([info]))).intrinsics[0, 0] == fx
    assert log.warnings == []


def test_true_poses_are_those_of_the_files() -> None:
    for name in ("redkitchen", "kitti06"):
        ours = load_trajectory(DATA / name, log=RunLog())
        given = read_tum(DATA / name / "groundtruth.tum")
        assert len(ours) == len(given)
        assert np.abs(ours.stamps_ns - given.stamps_ns).max() < 1_000  # the file has microseconds
        np.testing.assert_allclose(ours.positions_m, given.positions_m, atol=1e-6)


def test_kitti_and_euroc_say_their_baselines() -> None:
    with open_recording(DATA / "kitti06") as recording:
        right = next(iter(recording.measurements(["/gray/right/camera_info"])))
        assert -right.projection[0, 3] / right.projection[0, 0] == pytest.approx(0.5371507, abs=1e-6)
        assert recording.frames().lookup("gray_left", "gray_right")[0, 3] == pytest.approx(0.5371507, abs=1e-6)
    with open_recording(DATA / "euroc_v101_start") as recording:
        T = recording.frames().lookup("cam0", "cam1")
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(0.1100778, abs=1e-6)
        noise = recorded_noise(recording.raw, "/imu0")
        assert noise is not None
        assert noise.gyroscope == 1.6968e-4


def test_redkitchen_repeats_images_and_nothing_else_is_wrong() -> None:
    found = _findings("redkitchen")
    assert {(finding.check, finding.topic, finding.count) for finding in found} == {
        ("image-repeated", "/camera/rgb/image_color/compressed", 38),
        ("image-repeated", "/camera/depth/image", 39),
    }
    assert _findings("euroc_v101_start") == ()


def test_a_folder_comes_back_from_a_bag(tmp_path: Path) -> None:
    convert([DATA / "fr3_cabinet"], tmp_path / "a.bag")
    convert_to_folder([tmp_path / "a.bag"], tmp_path / "fr3_back", "tum")
    originals = sorted((DATA / "fr3_cabinet" / "rgb").iterdir())
    copies = sorted((tmp_path / "fr3_back" / "rgb").iterdir())
    assert [path.read_bytes() for path in originals] == [path.read_bytes() for path in copies]
    with open_recording(DATA / "fr3_cabinet") as a, open_recording(tmp_path / "fr3_back") as b:
        pairs = zip(*(r.measurements(["/camera/depth/image"]) for r in (a, b)), strict=True)
        assert all(x.stamp_ns == y.stamp_ns and np.array_equal(x.pixels, y.pixels) for x, y in pairs)
