# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import data_folders
import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.errors import RecordingError, UsageError
from slamcli.measurements import CameraModel, Image, ImuSample, StampedPose
from slamcli.pipelines.conversion import Selection
from slamcli.pipelines.convert import convert
from slamcli.pipelines.convert_folder import convert_to_folder
from slamcli.recordings import create_recording, open_recording
from slamcli.runtime import RunLog

MAKERS = {"tum": data_folders.tum, "euroc": data_folders.euroc, "kitti": data_folders.kitti}


def _same(a: Path, b: Path) -> None:
    """Assert that two recordings say the same on every topic."""
    with open_recording(a) as first, open_recording(b) as second:
        names = [topic.name for topic in first.contents.topics]
        assert sorted(names) == sorted(topic.name for topic in second.contents.topics)
        for name in names:
            if name in ("/tf_static", "/imu0/noise"):
                continue
            for x, y in zip(first.measurements([name]), second.measurements([name]), strict=True):
                assert x.stamp_ns == y.stamp_ns
                if isinstance(x, Image):
                    np.testing.assert_array_equal(x.pixels, y.pixels)
                elif isinstance(x, CameraModel):
                    np.testing.assert_array_equal(x.projection, y.projection)
                    np.testing.assert_array_equal(x.distortion, y.distortion)
                elif isinstance(x, ImuSample):
                    np.testing.assert_array_equal(x.acceleration_m_s2, y.acceleration_m_s2)
                    np.testing.assert_array_equal(x.angular_rad_s, y.angular_rad_s)
                elif isinstance(x, StampedPose):
                    np.testing.assert_allclose(x.position_m, y.position_m, atol=1e-12)
                    np.testing.assert_allclose(x.quat_xyzw, y.quat_xyzw, atol=1e-12)
        tree, other = first.frames(), second.frames()
        for edge in tree.edges:
            np.testing.assert_allclose(
                tree.lookup(edge.parent, edge.child), other.lookup(edge.parent, edge.child), atol=1e-12
            )


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
@pytest.mark.parametrize("layout", ["tum", "euroc", "kitti"])
def test_there_and_back(tmp_path: Path, layout: str, suffix: str) -> None:
    folder = MAKERS[layout](tmp_path / "fr1_original")
    bag, back = tmp_path / f"bag{suffix}", tmp_path / "fr1_back"
    convert([folder], bag)
    made = convert_to_folder([bag], back, layout)
    assert made.num_lost == 0
    assert made.record.is_file()
    _same(folder, back)


def test_all_four_cameras_of_kitti_come_back(tmp_path: Path) -> None:
    folder = data_folders.kitti(tmp_path / "07", cameras=(0, 1, 2, 3))
    convert([folder], tmp_path / "x.mcap")
    convert_to_folder([tmp_path / "x.mcap"], tmp_path / "back", "kitti")
    for name in ("image_0", "image_1", "image_2", "image_3"):
        for path in (folder / name).iterdir():
            assert (tmp_path / "back" / name / path.name).read_bytes() == path.read_bytes()
    matrices = [np.loadtxt((root / "calib.txt").read_text().splitlines()[:4], usecols=range(1, 13))
                for root in (folder, tmp_path / "back")]  # fmt: skip
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-9)


def test_a_folder_becomes_another_layout_with_the_poses_of_its_camera(tmp_path: Path) -> None:
    folder = data_folders.euroc(tmp_path / "V1")
    log = RunLog()
    convert_to_folder([folder], tmp_path / "out", "tum", log=log)
    with open_recording(tmp_path / "out") as recording:
        poses = list(recording.measurements(["/groundtruth"]))
        images = list(recording.measurements(["/camera/rgb/image_color/compressed"]))
        camera = next(iter(recording.measurements(["/camera/rgb/camera_info"])))
    np.testing.assert_allclose(poses[1].position_m, [0.1, 0, 1.02], atol=1e-12)  # cam0 sits 0.02 m along the body's z
    np.testing.assert_array_equal(images[2].pixels, data_folders.picture(2, 1))
    assert camera.distortion.tolist() == [-0.28, 0.07, 0.0002, 0.00002, 0.0]
    assert any("left out" in line and "/imu0" in line and "/cam1/" in line for line in log.warnings)


def _image(topic: str, stamp_ns: int, encoding: str, pixels: Any) -> Image:
    return Image(stamp_ns=stamp_ns, frame_id="left", encoding=encoding, pixels=pixels, topic=topic)


def test_raw_images_and_depth_of_a_bag_are_written_without_loss(tmp_path: Path) -> None:
    rgb = data_folders.picture(3)
    depth = np.full((48, 64), 1.2345, dtype=np.float32)
    depth[0, :3] = np.nan, 14.0, 0.0002
    with create_recording(tmp_path / "a.mcap") as writer:
        for number in range(3):
            writer.write("/camera/color/image_raw", _image("", 10**9 * (1 + number), "rgb8", rgb))
            writer.write("/camera/aligned_depth/image_raw", _image("", 10**9 * (1 + number), "depth", depth))
        writer.write("/camera/color/image_raw", _image("", 3 * 10**9, "rgb8", rgb))
    log = RunLog()
    made = convert_to_folder([tmp_path / "a.mcap"], tmp_path / "out", "tum", log=log)
    assert made.num_lost == 1
    assert log.counts["/camera/aligned_depth/image_raw: pixels farther than 13.1 m, written as no depth"] == 3
    with open_recording(tmp_path / "out", log=RunLog()) as recording:
        image = next(iter(recording.measurements(["/camera/rgb/image_color/compressed"])))
        read = next(iter(recording.measurements(["/camera/depth/image"])))
    np.testing.assert_array_equal(image.pixels, rgb[..., ::-1])
    assert read.pixels[0, :3].tolist() == [0.0, 0.0, float(np.float32(0.0002))]
    assert abs(read.pixels[5, 5] - 1.2345) < 1.1e-4
    assert any("no calibration" in line for line in log.warnings)


def test_kitti_keeps_moments_that_all_cameras_have(tmp_path: Path) -> None:
    with create_recording(tmp_path / "a.mcap") as writer:
        for number in range(6):
            grey = data_folders.picture(number, 1)
            if number != 2:
                writer.write("/left/image_raw", _image("", 10**9 + number * 10**8, "mono8", grey))
            if number != 4:
                writer.write("/right/image_raw", _image("", 10**9 + number * 10**8 + 10**6, "mono8", grey))
    log = RunLog()
    convert_to_folder([tmp_path / "a.mcap"], tmp_path / "out", "kitti", log=log)
    names = [sorted(path.name for path in (tmp_path / "out" / name).iterdir()) for name in ("image_0", "image_1")]
    assert names == [[f"{number:06d}.png" for number in range(4)]] * 2
    assert (tmp_path / "out" / "times.txt").read_text().split() == [
        "1.000000000",
        "1.100000000",
        "1.300000000",
        "1.500000000",
    ]
    assert log.counts["image_0: images without a partner"] == 1
    for name in ("image_0", "image_1"):
        assert (tmp_path / "out" / name / "000003.png").stat().st_size > 0


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1")
    with pytest.raises(UsageError, match="not empty"):
        convert_to_folder([folder], data_folders.kitti(tmp_path / "full"), "tum")
    with pytest.raises(UsageError, match="source"):
        convert_to_folder([folder], folder, "tum")
    with pytest.raises(UsageError, match="no layout"):
        convert_to_folder([folder], tmp_path / "x", "none")
    with pytest.raises(RecordingError, match="no images of a camera"):
        convert_to_folder([folder], tmp_path / "x", "tum", selection=Selection(topics=("/groundtruth",)))
    for path in (folder / "rgb").iterdir():
        path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RecordingError):
        convert_to_folder([folder], tmp_path / "x", "tum")
    assert not (tmp_path / "x").exists()


def test_the_command_writes_a_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = data_folders.kitti(tmp_path / "05", 10)
    part = ["--start", "0.3", "--duration", "0.4", "--json"]
    assert run(["convert", str(folder), str(tmp_path / "out"), "--layout", "euroc", *part]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "EuRoC folder"
    assert {topic["name"]: topic["count"] for topic in document["topics"]} == {
        "/gray/left/image_rect/compressed": 4, "/gray/right/image_rect/compressed": 4, "/groundtruth": 4,
    }  # fmt: skip
    with open_recording(tmp_path / "out") as recording:
        np.testing.assert_allclose(recording.frames().lookup("cam0", "cam1")[:3, 3], [0.5, 0, 0], atol=1e-12)
    assert run(["convert", str(folder), str(tmp_path / "y"), "--layout", "tum", "--format", "mcap"]) == 2
    assert "--layout writes a folder" in capsys.readouterr().err
