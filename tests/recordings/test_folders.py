# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import data_folders
import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.errors import RecordingError
from slamcli.measurements import CameraModel, Image, StampedPose
from slamcli.pipelines.convert import convert
from slamcli.recordings import open_recording
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog

RGB, DEPTH = "/camera/rgb/image_color/compressed", "/camera/depth/image"


def _all(path: Path, topic: str, log: RunLog | None = None, **more: Any) -> list[Any]:
    with open_recording(path, log=log, **more) as recording:
        return list(recording.measurements([topic]))


def test_seven_scenes_is_a_recording(tmp_path: Path) -> None:
    folder = data_folders.seven_scenes(tmp_path / "seq-01")
    log = RunLog()
    with open_recording(folder, log=log) as recording:
        assert recording.contents.format == "7-Scenes folder"
        assert {topic.name: topic.count for topic in recording.contents.topics} == {
            "/camera/rgb/camera_info": 4, "/camera/depth/camera_info": 4, RGB: 4, DEPTH: 4, "/groundtruth": 4,
        }  # fmt: skip
        images = list(recording.measurements([RGB]))
        depth = list(recording.measurements([DEPTH]))
        poses = list(recording.measurements(["/groundtruth"]))
        cameras = list(recording.measurements(["/camera/rgb/camera_info"]))
    assert [image.stamp_ns for image in images] == [1, 33333333, 66666667, 100000000]
    np.testing.assert_array_equal(images[2].pixels, data_folders.picture(2))
    assert depth[1].encoding == "depth"
    assert depth[1].pixels[0, :3].tolist() == [0.0, 0.0, np.float32(1.012)]
    assert [type(pose) for pose in poses] == [StampedPose] * 4
    np.testing.assert_allclose(poses[3].position_m, [0.3, 0, 0])
    assert cameras[0].intrinsics[0].tolist() == [585.0, 0.0, 320.0]
    assert (cameras[0].width, cameras[0].height) == (64, 48)
    assert any("nominal" in note for note in log.notes)
    assert not log.warnings


def test_own_intrinsics_of_seven_scenes_go_first(tmp_path: Path) -> None:
    folder = data_folders.seven_scenes(tmp_path / "a", 1)
    (folder / "camera-intrinsics.txt").write_text("538 0 31\n0 539 23\n0 0 1\n")
    camera = _all(folder, "/camera/rgb/camera_info")[0]
    assert camera.intrinsics.tolist() == [[538, 0, 31], [0, 539, 23], [0, 0, 1]]


@pytest.mark.parametrize(("name", "fx"), [("rgbd_dataset_freiburg1_desk", 517.3), ("fr3_office", 535.4)])
def test_tum_is_a_recording(tmp_path: Path, name: str, fx: float) -> None:
    folder = data_folders.tum(tmp_path / name)
    log = RunLog()
    images, depth = _all(folder, RGB, log), _all(folder, DEPTH)
    assert [image.stamp_ns for image in images][:2] == [1305031102_175304000, 1305031102_208637000]
    assert depth[0].stamp_ns - images[0].stamp_ns == 7_000_000
    np.testing.assert_array_equal(images[0].pixels, data_folders.picture(0))
    assert depth[0].pixels[0, :3].tolist() == [0.0, 0.0, float(np.float32(1002) / np.float32(5000))]
    assert log.notes == []
    assert _all(folder, "/camera/depth/camera_info", log)[0].intrinsics[0, 0] == fx
    assert any("freiburg" in note for note in log.notes)
    assert len(_all(folder, "/groundtruth")) == 4


def test_a_given_depth_scale_is_applied_once(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1")
    for scale in (1000.0, 2000.0):
        depth = _all(folder, DEPTH, mends=Mends(depth_units_per_m=scale))[0]
        assert depth.pixels[0, 2] == np.float32(1002) / np.float32(scale)


def test_kitti_is_a_stereo_recording(tmp_path: Path) -> None:
    folder = data_folders.kitti(tmp_path / "06", cameras=(0, 1, 2, 3))
    with open_recording(folder) as recording:
        assert [topic.count for topic in recording.topics(Image)] == [4] * 4
        cameras = {c.topic: c for t in recording.topics(CameraModel) for c in recording.measurements([t])}
        shifts = {topic: camera.projection[0, 3] for topic, camera in cameras.items()}
        assert shifts == pytest.approx(
            {
                "/gray/left/camera_info": 0.0,
                "/gray/right/camera_info": -350.0,
                "/color/left/camera_info": 0.0,
                "/color/right/camera_info": -350.0,
            }
        )
        frames = recording.frames()
        np.testing.assert_allclose(frames.lookup("gray_left", "gray_right", 0)[:3, 3], [0.5, 0, 0], atol=1e-12)
        np.testing.assert_allclose(frames.lookup("gray_left", "color_left", 0)[:3, 3], [-0.06, 0, 0], atol=1e-12)
        poses = list(recording.measurements(["/groundtruth"]))
    assert [pose.stamp_ns for pose in poses] == [1, 100_000_000, 200_000_000, 300_000_000]
    assert poses[3].position_m.tolist() == [0, 0, 3]


def test_kitti_poses_beside_the_sequences(tmp_path: Path) -> None:
    folder = data_folders.kitti(tmp_path / "sequences" / "07")
    (tmp_path / "poses").mkdir()
    shutil.move(folder / "poses.txt", tmp_path / "poses" / "07.txt")
    assert len(_all(folder, "/groundtruth")) == 4


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ""])
@pytest.mark.parametrize("make", [data_folders.tum, data_folders.seven_scenes, data_folders.kitti])
def test_a_converted_folder_says_the_same(tmp_path: Path, make: Any, suffix: str) -> None:
    folder = make(tmp_path / "fr2")
    target = tmp_path / f"out{suffix}"
    convert([folder], target)
    with open_recording(folder) as a, open_recording(target) as b:
        topics = [topic.name for topic in a.contents.topics if topic.name != "/tf_static"]
        assert sorted(topic.name for topic in b.contents.topics if topic.name != "/tf_static") == sorted(topics)
        for topic in topics:
            for x, y in zip(a.measurements([topic]), b.measurements([topic]), strict=True):
                assert x.stamp_ns == y.stamp_ns
                if isinstance(x, Image):
                    assert x.pixels.dtype == y.pixels.dtype
                    np.testing.assert_array_equal(x.pixels, y.pixels)
                elif isinstance(x, CameraModel):
                    np.testing.assert_array_equal(x.projection, y.projection)


def test_parts_are_found_by_seeking(tmp_path: Path) -> None:
    folder = data_folders.kitti(tmp_path / "x", 10)
    with open_recording(folder) as recording:
        part = recording.measurements(["/gray/left/image_rect/compressed"], start_s=0.35, duration_s=0.3)
        assert [image.stamp_ns // 10**8 for image in part] == [4, 5, 6]


def test_damage_is_said_and_the_rest_is_read(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1", 6)
    rgb, depth = (sorted((folder / kind).iterdir()) for kind in ("rgb", "depth"))
    rgb[0].unlink()
    rgb[1].write_bytes(b"")
    rgb[2].write_bytes(rgb[2].read_bytes()[:-300])
    depth[3].write_bytes(depth[3].read_bytes()[:-100])
    cv2.imwrite(str(depth[4]), np.zeros((48, 64), dtype=np.uint8))
    with (folder / "rgb.txt").open("a") as stream:
        stream.write("nonsense\nabc rgb/x.png\n")
    log = RunLog()
    assert len(_all(folder, RGB, log)) == 3
    assert len(_all(folder, DEPTH, log)) == 4
    told = "\n".join(log.warnings)
    for line in ("1 of 6 images that it names are missing", "1 of 6 images are empty", "2 lines cannot be understood",
                 f"{RGB}: 1 images cannot be read", f"{DEPTH}: 2 images cannot be read"):  # fmt: skip
        assert line in told


def test_what_a_nearly_complete_folder_lacks_is_said(tmp_path: Path) -> None:
    kitti = data_folders.kitti(tmp_path / "kitti")
    (kitti / "times.txt").unlink()
    (kitti / "calib.txt").unlink()
    log = RunLog()
    images = _all(kitti, "/gray/right/image_rect/compressed", log)
    assert [image.stamp_ns for image in images] == [1, 100_000_000, 200_000_000, 300_000_000]
    assert any("times.txt is missing" in line for line in log.warnings)
    assert any("calib.txt is missing" in line for line in log.warnings)
    tum = data_folders.tum(tmp_path / "tum_fr1")
    (tum / "depth.txt").unlink()
    log = RunLog()
    assert len(_all(tum, DEPTH, log)) == 4
    assert any("depth.txt is missing: the images in depth are stamped by their names" in line for line in log.warnings)


def test_a_folder_of_sequences_is_refused_by_name(tmp_path: Path) -> None:
    data_folders.seven_scenes(tmp_path / "scene" / "seq-01", 1)
    data_folders.seven_scenes(tmp_path / "scene" / "seq-02", 1)
    with pytest.raises(RecordingError, match="name one: seq-01, seq-02"):
        open_recording(tmp_path / "scene")
    with pytest.raises(RecordingError, match="cannot be joined"):
        open_recording([tmp_path / "scene" / "seq-01", tmp_path / "scene" / "seq-02"])


@pytest.mark.parametrize(
    ("make", "inner", "message"),
    [
        ("tum", "rgb", "is a part of the data set"),
        ("tum", "rgb.txt", "is a part of the data set"),
        ("euroc", "mav0/cam0/data", "is a part of the data set"),
        ("kitti", "image_0/000000.png", "is a part of the data set"),
        (None, "near/mav0", "mav0 has neither cam0/data.csv nor imu0/data.csv"),
        (None, "near/image_0", "holds no images named 000000.png"),
        (None, "near/rgb", "TUM RGB-D has rgb.txt beside it"),
        (None, "near/nothing", "7-Scenes: frame-000000.color.png; ICL-NUIM: rgb/0.png"),
    ],
)
def test_what_lies_near_a_data_set_is_told(tmp_path: Path, make: str | None, inner: str, message: str) -> None:
    if make is not None:
        path = getattr(data_folders, make)(tmp_path / "fr1") / inner
    else:
        (tmp_path / inner).mkdir(parents=True)
        path = tmp_path / "near"
    with pytest.raises(RecordingError, match=message):
        open_recording(path)


def test_sequences_two_levels_down_are_named(tmp_path: Path) -> None:
    data_folders.kitti(tmp_path / "dataset" / "sequences" / "04")
    with pytest.raises(RecordingError, match="holds one, name it: sequences/04"):
        open_recording(tmp_path / "dataset")


def test_other_lists_named_rgb_are_no_data_set(tmp_path: Path) -> None:
    (tmp_path / "rgb.txt").write_text("255 250 250  snow\n")
    with pytest.raises(RecordingError, match="neither a ROS 2 bag"):
        open_recording(tmp_path)


def test_an_empty_list_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "empty"
    folder.mkdir()
    (folder / "rgb.txt").write_text("# nothing\n")
    with pytest.raises(RecordingError, match=r"nothing of it can be read \(.*names no images"):
        open_recording(folder)


def test_the_commands_take_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(data_folders.kitti(tmp_path / "03", 12))
    assert run(["info", folder, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "KITTI odometry folder"
    fits = {tier["tier"]: tier["mode"] for tier in document["tiers"] if tier["runs"]}
    assert fits == {"rtabmap": "stereo and its own odometry", "orbslam3": "stereo"}
    assert run(["doctor", folder]) == 0
    assert "0 errors, 0 warnings" in capsys.readouterr().out
    assert run(["view", folder, "-o", str(tmp_path / "v.png")]) == 0
    estimate = tmp_path / "estimate.tum"
    estimate.write_text("".join(f"{0.1 * i:.1f} 1 0 {i + 0.1 * (i % 2):.1f} 0 0 0 1\n" for i in range(12)))
    capsys.readouterr()
    assert run(["evaluate", str(estimate), folder, "--align-origin", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["poses"]["matched"] == 12
    assert document["ate"]["rmse"] == pytest.approx(0.1 * 0.5**0.5, abs=1e-6)
    assert run(["evaluate", str(estimate), str(tmp_path)]) == 2


def test_stamps_that_no_message_holds_are_left_out(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1")
    text = (folder / "rgb.txt").read_text()
    (folder / "rgb.txt").write_text(
        text.replace("1305031102.208637 ", "-5 ").replace("1305031102.275304 ", "3305031102.5 ")
    )
    log = RunLog()
    assert len(_all(folder, RGB, log)) == 2
    assert any("2 of 4 stamps are beyond what a message can hold (first: -5 s)" in line for line in log.warnings)


def test_threads_read_the_same(tmp_path: Path) -> None:
    folder = data_folders.tum(tmp_path / "fr1", 30)
    with open_recording(folder) as recording, ThreadPoolExecutor(4) as pool:
        topics = [RGB, DEPTH, RGB, DEPTH]
        read = list(pool.map(lambda topic: [m.pixels for m in recording.measurements([topic])], topics))
    for a, b in ((0, 2), (1, 3)):
        assert len(read[a]) == 30
        assert all(np.array_equal(x, y) for x, y in zip(read[a], read[b], strict=True))
