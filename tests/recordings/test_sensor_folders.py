# SPDX-License-Identifier: MIT
"""EuRoC, TUM-VI and ICL-NUIM."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import data_folders
import numpy as np
import pytest

from slamcli.geometry import quaternion
from slamcli.pipelines.convert import convert
from slamcli.recordings import open_recording
from slamcli.recordings.imu_noise import recorded_noise
from slamcli.runtime import RunLog

LEFT, RIGHT = "/cam0/image_raw/compressed", "/cam1/image_raw/compressed"


def _all(path: Path, topic: str, log: RunLog | None = None) -> list[Any]:
    with open_recording(path, log=log) as recording:
        return list(recording.measurements([topic]))


@pytest.mark.parametrize("inner", ["", "mav0"])
def test_euroc_is_a_recording(tmp_path: Path, inner: str) -> None:
    folder = data_folders.euroc(tmp_path / "V1_01") / inner
    log = RunLog()
    with open_recording(folder, log=log) as recording:
        assert recording.contents.format == "EuRoC folder"
        counts = {topic.name: topic.count for topic in recording.contents.topics}
        assert counts == {
            "/tf_static": 1, "/cam0/camera_info": 4, LEFT: 4, "/cam1/camera_info": 4, RIGHT: 4,
            "/imu0": 40, "/imu0/noise": 1, "/groundtruth": 4,
        }  # fmt: skip
        frames = recording.frames()
        np.testing.assert_allclose(frames.lookup("cam0", "cam1")[:3, 3], [0.1, 0, 0], atol=1e-12)
        np.testing.assert_allclose(frames.lookup("body", "imu0"), np.eye(4))
        noise = recorded_noise(recording.raw, "/imu0")
    assert noise is not None
    assert (noise.gyroscope, noise.accelerometer, noise.gyroscope_walk, noise.accelerometer_walk) == (
        1e-4,
        3e-3,
        2e-5,
        4e-3,
    )
    assert [image.stamp_ns for image in _all(folder, RIGHT)][1] == 1403715273312142976
    np.testing.assert_array_equal(_all(folder, RIGHT)[1].pixels, data_folders.picture(11, 1))
    camera = _all(folder, "/cam0/camera_info")[0]
    assert camera.distortion_model == "plumb_bob"
    assert camera.distortion.tolist() == [-0.28, 0.07, 0.0002, 0.00002, 0.0]
    assert (camera.intrinsics[0, 0], camera.width, camera.height) == (50.5, 64, 48)
    samples = _all(folder, "/imu0")
    assert samples[3].stamp_ns == 1403715273262142976 + 15_000_000
    np.testing.assert_allclose(samples[3].acceleration_m_s2, [9.8, 0.1, 0.03])
    np.testing.assert_allclose(_all(folder, "/groundtruth")[2].position_m, [0.2, 0, 1])
    assert log.warnings == []


def test_tum_vi_has_fisheye_cameras_and_16_bit_images(tmp_path: Path) -> None:
    folder = data_folders.tum_vi(tmp_path / "room1")
    target = tmp_path / "x.mcap"
    convert([folder], target)
    for path in (folder, target):
        with open_recording(path) as recording:
            frames = recording.frames()
            np.testing.assert_allclose(frames.lookup("body", "cam0")[:3, 3], [0.05, 0, 0], atol=1e-12)
            np.testing.assert_allclose(frames.lookup("body", "cam1")[:3, 3], [0.15, 0, 0], atol=1e-12)
            noise = recorded_noise(recording.raw, "/imu0")
        assert noise is not None
        assert (noise.gyroscope, noise.accelerometer_walk, noise.frequency_hz) == (0.00016, 0.00086, 200.0)
        image = _all(path, LEFT)[0]
        assert image.encoding == "mono8"
        np.testing.assert_array_equal(image.pixels, data_folders.picture(0, 1))
        camera = _all(path, "/cam1/camera_info")[0]
        assert camera.distortion_model == "equidistant"
        assert camera.distortion.tolist() == [0.003, 0.0007, -0.002, 0.0002]
        assert len(_all(path, "/groundtruth")) == 4


def test_icl_nuim_is_mirrored_into_a_right_handed_world(tmp_path: Path) -> None:
    folder = data_folders.icl_nuim(tmp_path / "kt0")
    with open_recording(folder) as recording:
        assert recording.contents.format == "ICL-NUIM folder"
    poses = _all(folder, "/groundtruth")
    assert [pose.stamp_ns for pose in poses] == [1, 33333333, 66666667, 100000000]
    assert [image.stamp_ns for image in _all(folder, "/camera/depth/image")] == [pose.stamp_ns for pose in poses]
    np.testing.assert_allclose(poses[3].position_m, [0, -0.3, -2], atol=1e-12)
    mirror = np.diag([1.0, -1.0, 1.0])
    turned = quaternion.to_matrix([np.sin(0.15), 0, 0, np.cos(0.15)])
    np.testing.assert_allclose(quaternion.to_matrix(poses[3].quat_xyzw), mirror @ turned @ mirror, atol=1e-9)
    # A point seen with fy = -480 by the given pose is, mirrored, the one seen with fy = 480 by the mirrored pose.
    ray = np.array([0.2, -0.4, 1.0])
    given = turned @ (ray * [1, -1, 1]) + [0, 0.3, -2]
    np.testing.assert_allclose(
        quaternion.to_matrix(poses[3].quat_xyzw) @ ray + poses[3].position_m, given * [1, -1, 1], atol=1e-9
    )
    assert _all(folder, "/camera/rgb/camera_info")[0].intrinsics[1, 1] == 480.0


def test_damaged_euroc_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    folder = data_folders.euroc(tmp_path / "V1")
    base = folder / "mav0"
    (base / "cam1" / "sensor.yaml").write_text(
        "%YAML:1.0\nsensor_type: camera\nresolution: [64, 48]\nintrinsics: [1, 2]\n"
    )
    (base / "cam1" / "data.csv").unlink()
    table = base / "imu0" / "data.csv"
    lines = table.read_text().splitlines()
    lines[5], lines[7] = "1403715273282142976,1,2,3", lines[7].replace("9.8", "nan")
    lines[9], lines[10] = lines[10], lines[9]
    table.write_text("\n".join(lines))
    log = RunLog()
    with open_recording(folder, log=log) as recording:
        counts = {topic.name: topic.count for topic in recording.contents.topics}
        stamps = [sample.stamp_ns for sample in recording.measurements(["/imu0"])]
    assert counts["/imu0"] == 38
    assert stamps == sorted(stamps)
    assert counts[RIGHT] == 4
    assert "/cam1/camera_info" not in counts
    told = "\n".join(log.warnings)
    for line in ("2 lines cannot be understood", "1 of 38 stamps run backwards", "cam1/data.csv is missing",
                 "intrinsics are not fu, fv, cu, cv", "no calibration that can be read"):  # fmt: skip
        assert line in told


def test_truth_of_a_marker_is_carried_over_to_the_body(tmp_path: Path) -> None:
    folder = data_folders.euroc(tmp_path / "V1")
    base = folder / "mav0"
    (base / "state_groundtruth_estimate0").rename(base / "vicon0")
    data = ", ".join(map(str, data_folders.shifted(0, 0, 0.25).reshape(-1).tolist()))
    (base / "vicon0" / "sensor.yaml").write_text(f"T_BS:\n  data: [{data}]\n")
    np.testing.assert_allclose(_all(folder, "/groundtruth")[1].position_m, [0.1, 0, 0.75], atol=1e-12)


def test_dso_says_the_lens_where_kalibr_is_not_there(tmp_path: Path) -> None:
    folder = data_folders.tum_vi(tmp_path / "room1")
    (folder / "dso" / "camchain.yaml").unlink()
    for camera, first in ((0, "EquiDistant 0.5 0.625 0.5 0.5 0.01 0.02 0.03 0.04"), (1, "Pinhole 1 2 3 4 0 0 0 0")):
        (folder / "dso" / f"cam{camera}").mkdir()
        (folder / "dso" / f"cam{camera}" / "camera.txt").write_text(f"{first}\n64 48\ncrop\n64 48\n")
    log = RunLog()
    (camera, *_) = _all(folder, "/cam0/camera_info", log)
    assert camera.intrinsics.tolist() == [[32, 0, 31.5], [0, 30, 23.5], [0, 0, 1]]
    assert camera.distortion.tolist() == [0.01, 0.02, 0.03, 0.04]
    assert any("no fisheye camera as DSO writes it" in line for line in log.warnings)
    assert any("DSO's camera.txt" in line for line in log.notes)
