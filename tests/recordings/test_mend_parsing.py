# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamcli.errors import CalibrationError, InputError, UsageError
from slamcli.geometry import quaternion
from slamcli.recordings.calibration_file import read_camera_info
from slamcli.recordings.mend_parsing import parse_mends
from slamcli.recordings.robot_model import read_robot_model

CALIBRATION = """\
image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320, 0, 501.5, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0, 0, 0]}
"""

URDF = """\
<robot name="r">
  <link name="base_link"/>
  <joint name="laser_joint" type="fixed">
    <origin xyz="0.2 0 0.3" rpy="3.14159265358979 0 0.5"/>
    <parent link="base_link"/> <child link="laser"/>
  </joint>
  <joint name="plate" type="fixed"><parent link="base_link"/><child link="plate"/></joint>
  <joint name="wheel" type="continuous"><parent link="base_link"/><child link="wheel"/></joint>
</robot>
"""


def test_no_mends() -> None:
    mends = parse_mends()
    assert not mends.time_offsets_ns
    assert mends.no_return == "ignore"
    assert mends.laser_pose is None


def test_what_users_write() -> None:
    mends = parse_mends(
        time_offsets=["/scan=-0.05", "/a=b=1"],
        renamed_frames=["/base_laser=laser"],
        static_transforms=["base_link,laser,0.2,0,0.3,0.5,0.25,-0.125", "a,b,1,2,3,0,0,0,1"],
        laser_pose="1,-2,0.5",
        depth_units_per_m=5000.0,
        flip_scan=True,
        no_return="free",
    )
    assert mends.time_offsets_ns == {"/scan": -50_000_000, "/a=b": 1_000_000_000}
    assert mends.renamed_frames == {"base_laser": "laser"}
    first, second = mends.static_transforms
    assert (first.parent_frame_id, first.child_frame_id, first.static) == ("base_link", "laser", True)
    np.testing.assert_allclose(quaternion.to_roll_pitch_yaw(first.quat_xyzw), [-0.125, 0.25, 0.5])
    np.testing.assert_allclose(second.position_m, [1, 2, 3])
    np.testing.assert_allclose(mends.laser_pose, [1, -2, 0.5])


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ({"time_offsets": ["/scan"]}, "--time-offset /scan: write TOPIC=SECONDS"),
        ({"time_offsets": ["/scan=fast"]}, "TOPIC=SECONDS"),
        ({"time_offsets": ["/scan=nan"]}, "TOPIC=SECONDS"),
        ({"time_offsets": ["/scan=1e300"]}, "TOPIC=SECONDS"),
        ({"renamed_frames": ["laser"]}, "--rename-frame laser: write OLD=NEW"),
        ({"static_transforms": ["base_link,laser"]}, "--static-tf base_link,laser: write parent,child,x,y,z"),
        ({"static_transforms": ["a,a,0,0,0,0,0,0"]}, "--static-tf a,a"),
        ({"static_transforms": ["a,b,0,0,0,0,0,x"]}, "as numbers in metres and radians"),
        ({"static_transforms": ["a,b,0,0,0,0,0,0,0"]}, "has not length 1"),
        ({"laser_pose": "1,2"}, "--laser-pose 1,2: write x,y,yaw"),
        ({"laser_pose": "1,2,inf"}, "--laser-pose"),
        ({"depth_units_per_m": 0.0}, "--depth-scale 0"),
        ({"no_return": "maybe"}, "choose one of ignore, free, max"),
    ],
)
def test_what_cannot_be_understood(words: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        parse_mends(**words)


def test_a_calibration_file(tmp_path: Path) -> None:
    path = tmp_path / "left.yaml"
    path.write_text(CALIBRATION)
    mends = parse_mends(camera_infos=[f"/left/camera_info={path}", str(path)])
    assert set(mends.camera_models) == {"/left/camera_info", ""}
    model = mends.camera_models[""]
    assert (model.width, model.height) == (640, 480)
    np.testing.assert_array_equal(model.intrinsics, [[500.5, 0, 320], [0, 501.5, 240], [0, 0, 1]])
    np.testing.assert_array_equal(model.projection[:, :3], model.intrinsics)
    np.testing.assert_array_equal(model.distortion, [0.1, -0.2, 0, 0, 0])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no camera calibration file"),
        ("a: [", "no camera calibration file"),
        (CALIBRATION.replace("640", "wide"), "image_width is 'wide'"),
        (CALIBRATION.replace("501.5, ", ""), "camera_matrix holds 8 values, not 3 x 3"),
        (CALIBRATION.replace("501.5", ".nan"), "camera_matrix"),
        (CALIBRATION.replace("501.5", "x"), "camera_matrix holds no list of numbers"),
    ],
)
def test_a_file_that_is_no_calibration(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "left.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=complaint):
        read_camera_info(path)


def test_fixed_joints_of_a_robot_model(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    laser, plate = parse_mends(robot_model=path).model_transforms
    assert (laser.parent_frame_id, laser.child_frame_id, plate.child_frame_id) == ("base_link", "laser", "plate")
    np.testing.assert_allclose(laser.position_m, [0.2, 0, 0.3])
    np.testing.assert_allclose(np.abs(quaternion.to_roll_pitch_yaw(laser.quat_xyzw)), [np.pi, 0, 0.5], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no URDF file"),
        ("<launch/>", "begins with <launch>"),
        ("<robot/>", "holds no fixed joint"),
        (URDF.replace("0.2 0 0.3", "0.2 0"), 'origin xyz="0.2 0" is not three numbers'),
        (URDF.replace('link="laser"', ""), "names no parent or no child"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
            "expand it first",
        ),
        ("<!DOCTYPE a [" + '<!ENTITY a0 "aaaaaaaaaa">' + "".join(
            f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10)) + "]><robot>&a9;</robot>", "no URDF file"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_robot_model(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=complaint):
        read_robot_model(path)


def test_missing_files() -> None:
    for words in ({"robot_model": "nowhere.urdf"}, {"camera_infos": ["nowhere.yaml"]}):
        with pytest.raises(InputError, match=r"nowhere\.\w+: cannot be read \(No such file or directory\)"):
            parse_mends(**words)  # type: ignore[arg-type]
