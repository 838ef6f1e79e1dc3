# SPDX-License-Identifier: MIT
"""ORB-SLAM's settings files of both schemas: the tolerant reader, the rig in them, and what the original stops at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamcli.cartographer import CartographerParameters
from slamcli.errors import CalibrationError, ConfigError
from slamcli.gmapping import GmappingParameters
from slamcli.measurements import RigCalibration
from slamcli.native.checks.files import check_file
from slamcli.native.kalibr_yaml import read_kalibr_yaml
from slamcli.native.launch import read_launch
from slamcli.native.opencv_yaml import is_opencv_yaml, parse_opencv_yaml
from slamcli.native.orbslam_cameras import rig_calibration
from slamcli.native.orbslam_launch import find_settings
from slamcli.native.orbslam_names import canonical
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.parameters import declarations, resolve

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
TABLES = {
    "gmapping": declarations(GmappingParameters),
    "cartographer": declarations(CartographerParameters),
    "orbslam3": declarations(OrbSlam3Parameters),
}

NEW = """%YAML:1.0
---
File.version: "1.0"
Camera.type: "PinHole"   # the model
Camera1.fx: 458.654
Camera1.fy:457.296
Camera1.cx: 367.215
Camera1.cy: 248.375
Camera1.k1: -0.28340811
Camera1.k2: 0.07395907
Camera1.p1: 0.00019359
Camera1.p2: 1.76187114e-05
Camera2.fx: 457.587
Camera2.fy: 456.134
Camera2.cx: 379.999
Camera2.cy: 255.238
Camera2.k1: -0.28368365
Camera2.k2: 0.07451284
Camera2.p1: -0.00010473
Camera2.p2: -3.55590700e-05
Camera.width: 752
Camera.height: 480
Camera.fps: 20
Camera.RGB: 1
Stereo.ThDepth: 60.0
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [0.999997256477797,-0.002317135723275,-0.000343393120620,0.110074137800478,
         0.002312067192432,0.999898048507103,-0.014090668452683,-0.000156612054392,
         0.000376008102320,0.014089835846691,0.999900662638081,0.000889382785432,
         0,0,0,1.000000000000000]
IMU.T_b_c1: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
IMU.NoiseGyro: 1.7e-04
IMU.NoiseAcc: 2.0e-03
IMU.GyroWalk: 1.9393e-05
IMU.AccWalk: 3.e-03
IMU.Frequency: 200.0
ORBextractor.nFeatures: 1200
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""

LEGACY = """%YAML:1.0
Camera.type: "PinHole"
Camera.fx: 435.2046959714599
Camera.fy: 435.2046959714599
Camera.cx: 367.4517211914062
Camera.cy: 252.2008514404297
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: 752
Camera.height: 480
Camera.fps: 20.0
Camera.bf: 47.90639384423901
Camera.RGB: 1
ThDepth: 35.0
DepthMapFactor: 5000.0
LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
LEFT.R:  !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [1,0,0,0,1,0,0,0,1]
LEFT.P:  !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [435.2, 0, 367.4, 0,  0, 435.2, 252.2, 0,  0, 0, 1, 0]
RIGHT.K: !!opencv-matrix
   data: [457.587, 0.0, 379.999, 0.0, 456.134, 255.238, 0.0, 0.0, 1]
RIGHT.R: !!opencv-matrix
   data: [1,0,0,0,1,0,0,0,1]
RIGHT.P: !!opencv-matrix
   data: [435.2, 0, 367.4, -47.9,  0, 435.2, 252.2, 0,  0, 0, 1, 0]
ORBextractor.nFeatures: 1200
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
"""


def values(text: str) -> dict[str, object]:
    return {canonical(s.name): s.value for s in parse_opencv_yaml(text, "s.yaml")}


def rig(text: str) -> RigCalibration:
    return rig_calibration(values(text), "s.yaml")


def messages(tmp_path: Path, text: str) -> list[tuple[str, int, str]]:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    return [(f.severity, f.line, f.message) for f in check_file(path, TABLES)]


def test_values_types_and_lines_are_read() -> None:
    found = {s.name: s for s in parse_opencv_yaml(NEW, "s.yaml")}
    assert found["Camera1.fy"].value == 457.296  # without a blank behind the colon
    assert (found["Camera.type"].value, found["Camera.type"].line) == ("PinHole", 4)
    assert (type(found["Camera.fps"].value), type(found["Stereo.ThDepth"].value)) == (int, float)
    assert found["IMU.AccWalk"].value == 0.003
    assert len(found["Stereo.T_c1_c2"].value.split()) == 16
    assert is_opencv_yaml(NEW)
    assert is_opencv_yaml("Camera.fx: 3.0\n")
    assert not is_opencv_yaml("amcl:\n  min_particles: 3\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Camera.fx 525\n", "s.yaml:1: 'Camera.fx 525' is no `key: value`"),
        ("A: !!opencv-matrix\n  rows: 2\n  cols: 2\n  dt: f\n  data: [1, 2, 3]\n", "s.yaml:1: matrix A is said to be 2 x 2 and holds 3"),
        ("\nA: !!opencv-matrix\n  rows: 2\nB: 1\n", "s.yaml:2: matrix A has no data"),
        ("A: [1, 2\n", "s.yaml:1: a list is not closed"),
        ("A: [1, two]\n", "s.yaml:1: 'two' is no number"),
        ("  A:\n    B: 1\n", "s.yaml:1: A: levels are not read"),
    ],
)  # fmt: skip
def test_lines_that_are_wrong_are_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_opencv_yaml(text, "s.yaml")
    assert str(caught.value).startswith(message)


def test_every_entry_of_both_schemas_is_a_parameter() -> None:
    new = resolve(OrbSlam3Parameters, values(NEW))
    assert (new.extractor.num_features, new.device.stereo.th_depth, new.device.imu.acc_walk) == (1200, 60.0, 0.003)
    legacy = resolve(OrbSlam3Parameters, values(LEGACY))
    assert (legacy.device.camera1.fx, legacy.device.stereo.th_depth) == (435.2046959714599, 35.0)
    assert legacy.device.rgbd.depth_map_factor == 5000.0
    assert legacy.device.left.K.split()[0] == "458.654"
    mission = {canonical(s.name): s.value for s in parse_opencv_yaml((CONFIGS / "TUM_RGBD.yaml").read_text(), "")}
    found = resolve(OrbSlam3Parameters, mission)
    assert (found.device.camera.bf, found.device.stereo.th_depth, found.extractor.num_features) == (40.0, 40.0, 1200)


def test_two_cameras_of_schema_1_0() -> None:
    found = rig(NEW)
    assert found.main is not None
    assert found.right is not None
    assert (found.main.width, found.main.height, found.main.distortion_model) == (752, 480, "plumb_bob")
    np.testing.assert_allclose(found.main.distortion, [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0])
    assert found.right.intrinsics[0, 2] == 379.999
    assert found.T_main_right is not None
    np.testing.assert_allclose(found.T_main_right[:3, 3], [0.110074137800478, -0.000156612054392, 0.000889382785432])
    assert found.T_main_imu is not None
    np.testing.assert_allclose(
        np.linalg.inv(found.T_main_imu)[:3, 3], [-0.0216401454975, -0.064676986768, 0.00981073058949], atol=1e-9
    )
    assert found.imu_noise is not None
    assert (found.imu_noise.gyroscope, found.imu_noise.accelerometer_walk) == (1.7e-4, 3e-3)


def test_legacy_stereo_that_is_to_be_rectified() -> None:
    found = rig(LEGACY)
    assert found.main is not None
    assert found.right is not None
    assert (found.main.intrinsics[0, 0], found.main.projection[0, 0], found.right.projection[0, 3]) == (
        458.654,
        435.2,
        -47.9,
    )
    assert found.main.distortion[0] == -0.28340811
    assert found.T_main_right is None
    assert found.baseline_m == pytest.approx(47.90639384423901 / 435.2046959714599)


def test_legacy_rectified_stereo_and_rgbd() -> None:
    found = rig("Camera.fx: 525.0\nCamera.fy: 525.0\nCamera.cx: 319.5\nCamera.cy: 239.5\nCamera.bf: 40.0\n")
    assert found.main is not None
    assert found.right is not None
    assert found.right.projection[0, 3] == pytest.approx(-40.0)
    assert found.baseline_m == pytest.approx(40.0 / 525.0)
    assert found.main.width == 0
    assert rig("Camera.bf: 40.0\n").bf == 40.0


def test_fisheye_and_rectified() -> None:
    lens = "".join(
        f"Camera1.{n}: {v}\n"
        for n, v in zip(
            ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
            (190.9, 190.9, 254.9, 256.8, 0.003, 0.0007, -0.002, 0.0002),
            strict=True,
        )
    )
    found = rig('Camera.type: "KannalaBrandt8"\n' + lens)
    assert found.main is not None
    assert found.main.distortion_model == "equidistant"
    np.testing.assert_array_equal(found.main.distortion, [0.003, 0.0007, -0.002, 0.0002])
    flat = rig('Camera.type: "Rectified"\nStereo.b: 0.2\n' + lens)
    assert flat.main is not None
    assert flat.right is not None
    assert not flat.main.distortion.any()
    assert flat.right.projection[0, 3] == pytest.approx(-190.9 * 0.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Camera1.fx: 500.0\n", "Camera1.fy is missing"),
        ('Camera.type: "Omni"\nCamera1.fx: 500.0\n', "Camera.type 'Omni'"),
        (NEW.replace("0.999997256477797", "0.2"), "no rigid transform"),
        (LEGACY.replace("LEFT.R:", "LEFT.Q:"), "LEFT.R is missing"),
        (NEW.replace("Camera2.cy", "Camera2.cz"), "Camera2.cy is missing"),
        (NEW.replace("Camera1.fx: 458.654", "Camera1.fx: 0.0"), "must be more than 0"),
        (NEW.replace("Camera1.fx: 458.654", "Camera1.fx: wide"), "Camera1.fx is 'wide', not a finite number"),
        (NEW.replace("IMU.NoiseGyro: 1.7e-04", "IMU.NoiseGyro: 0.0"), "IMU.NoiseGyro is 0: must be more than 0"),
        (NEW.replace("Camera.width: 752", "Camera.width: -3"), "not a number of pixels"),
    ],
)
def test_rigs_that_are_wrong_are_refused(text: str, message: str) -> None:
    with pytest.raises(CalibrationError, match=message):
        rig(text)


def test_a_sound_file_has_no_errors(tmp_path: Path) -> None:
    assert not [m for m in messages(tmp_path, NEW + "RGBD.DepthMapFactor: 1.0\n") if m[0] in ("error", "warning")]


def test_what_the_original_stops_at_in_the_missions_file() -> None:
    found = [(f.severity, f.line, f.message) for f in check_file(CONFIGS / "TUM_RGBD.yaml", TABLES)]
    errors = [m for severity, _, m in found if severity == "error"]
    assert len(errors) == 1
    assert errors[0].startswith("Camera.k1, Camera.k2, Camera.p1, Camera.p2: missing")
    assert ("note", 11, "ThDepth: points nearer than 3.05 m are close") in found
    assert any("DepthMapFactor is missing" in m for _, _, m in found)
    launched = [(f.severity, f.message) for f in check_file(CONFIGS / "orb_slam3_stereo.launch", TABLES)]
    assert (
        "warning",
        "topics are those of a stereo camera, and TUM_RGBD.yaml is named as settings of RGB-D",
    ) in launched
    assert ("error", errors[0]) in launched


@pytest.mark.parametrize(
    ("change", "severity", "words"),
    [
        (("Camera1.k1: -0.28340811", "Camera1.k1: 0"), "error", "Camera1.k1=0 must be a real number (0.0)"),
        (("Camera.fps: 20", "Camera.fps: 20.0"), "error", "reads a whole number"),
        (("ORBextractor.nLevels: 8", "ORBextractor.nLevels: 8.0"), "error", "must be a whole number"),
        (("Stereo.ThDepth: 60.0", "Stereo.ThDepth: 0.0"), "error", "every point counts as far"),
        (("Stereo.ThDepth: 60.0\n", ""), "warning", "takes 0 with RGB-D (by version)"),
        (("Camera.RGB: 1", "RGBD.DepthMapFactor: 0.0"), "warning", "is taken as 1"),
        (("Camera.width: 752", "Camera.witdh: 752"), "error", "did you mean Camera.width"),
        (("Stereo.ThDepth: 60.0", "ThDepth: 60.0"), "error", "reads Stereo.ThDepth"),
        (("ORBextractor.minThFAST: 7", "ORBextractor.minThFAST: 30"), "warning", "finds less than the first"),
        (("Viewer.PointSize: 2.0", "Viewer.PointSize: 2"), "error", "must be a real number"),
    ],
)  # fmt: skip
def test_traps(tmp_path: Path, change: tuple[str, str], severity: str, words: str) -> None:
    assert change[0] in NEW
    found = messages(tmp_path, NEW.replace(*change))
    assert any(s == severity and words in m for s, _, m in found), found


def test_the_imu_rate_is_whole_in_one_schema_and_real_in_the_other(tmp_path: Path) -> None:
    for text, kind in ((LEGACY, "whole"), (NEW, "real")):
        for rate in ("200", "200.0"):
            changed = text.replace("IMU.Frequency: 200.0\n", "") + f"IMU.Frequency: {rate}\n"
            wrong = any(
                "IMU.Frequency" in m and f"must be a {kind} number" in m for _, _, m in messages(tmp_path, changed)
            )
            assert wrong == (("." in rate) == (kind == "whole"))


def test_launch_file_names_settings_and_vocabulary(tmp_path: Path) -> None:
    (tmp_path / "voc.txt").write_text("10 6 0 0\n")
    (tmp_path / "mine.yaml").write_text(NEW)
    launch = tmp_path / "a.launch"
    launch.write_text(
        '<launch><node pkg="orb_slam3_ros" type="orb_slam3_ros_node" name="n">'
        '<param name="voc_path" value="/nowhere/voc.txt"/><param name="settings_path" value="/nowhere/mine.yaml"/>'
        '<param name="world_frame_id" value="world"/><param name="enable_pangolin" value="true"/></node></launch>'
    )
    found = find_settings(read_launch(launch).nodes[0], ())
    assert found.path == tmp_path / "mine.yaml"
    assert {s.name: s.value for s in found.settings} == {
        "slamcli.vocabulary": str(tmp_path / "voc.txt"),
        "world_frame_id": "world",
    }
    assert any("enable_pangolin" in note for note in found.notes)
    (tmp_path / "mine.yaml").unlink()
    with pytest.raises(ConfigError, match=r"settings /nowhere/mine\.yaml are not here"):
        find_settings(read_launch(launch).nodes[0], ())


KALIBR = """
cam0:
  T_cam_imu: [[0, 1, 0, 0.1], [-1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00001]
  distortion_model: radtan
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.005
cam1:
  T_cn_cnm1: [[1, 0, 0, -0.11], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_coeffs: [0.003, 0.0007, -0.002, 0.0002]
  distortion_model: equidistant
  intrinsics: [190.9, 190.8, 254.9, 256.8]
  resolution: [512, 512]
"""


def test_kalibr_camera_chain(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR)
    found = read_kalibr_yaml(path)
    assert found.main is not None
    assert found.right is not None
    assert found.T_main_right is not None
    assert found.T_main_imu is not None
    assert (found.main.width, found.main.distortion_model, found.right.distortion_model) == (
        752,
        "plumb_bob",
        "equidistant",
    )
    np.testing.assert_allclose(found.T_main_right[:3, 3], [0.11, 0.0, 0.0])
    np.testing.assert_allclose(found.T_main_imu[:3, 3], [0.1, 0.2, 0.3])
    assert "give it by --time-offset" in found.notes[0]
    imu = tmp_path / "imu.yaml"
    imu.write_text(
        "accelerometer_noise_density: 0.0028\ngyroscope_noise_density: 0.00016\naccelerometer_random_walk: 0.00086\ngyroscope_random_walk: 0.000022\nupdate_rate: 200\n"
    )
    noise = read_kalibr_yaml(imu).imu_noise
    assert noise is not None
    assert (noise.accelerometer, noise.gyroscope_walk) == (0.0028, 0.000022)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("radtan", "fov"), "'fov' is not read"),
        (("[458.0, 457.0, 367.0, 248.0]", "[458.0, 457.0]"), "intrinsics holds 2 values, not 4"),
        (("pinhole", "omni"), "'omni' is not read"),
        (("cam0", "camera"), "no Kalibr file"),
        (("T_cn_cnm1", "T_cn_cnm2"), "cam1 has no T_cn_cnm1"),
    ],
)
def test_kalibr_files_that_are_wrong(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR.replace(*change))
    with pytest.raises(CalibrationError, match=message):
        read_kalibr_yaml(path)
