# SPDX-License-Identifier: MIT
"""Which sensors are taken, by options and by what is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from slamcli.cartographer.inputs import plan_inputs
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.runtime import RunLog

DEFAULTS = CartographerParameters()
EVERYTHING: dict[str, Any] = {
    "num_laser_scans": 2, "num_multi_echo_laser_scans": 1, "num_point_clouds": 1, "odometry": True, "imu": True,
    "fixes": True, "landmarks": True,
}  # fmt: skip


def plan(
    offer: dict[str, Any], options: dict[str, Any] | None = None, given: tuple[str, ...] = (), **tables: Any
) -> tuple[InputPlan, RunLog]:
    log = RunLog()
    parameters = replace(DEFAULTS, options=replace(DEFAULTS.options, **(options or {})), **tables)
    return plan_inputs(parameters, (*given, *(options or {})), SensorOffer(**offer), log), log


def numbers(found: InputPlan) -> tuple[int, int | None, int]:
    return found.num_laser_scans, found.num_multi_echo_laser_scans, found.num_point_clouds


def test_left_open_one_scanner_and_everything_else_is_taken():
    found, log = plan(EVERYTHING)
    assert numbers(found) == (1, None, 0)
    assert (found.odometry, found.imu, found.fixes, found.landmarks, found.spatial) == (True, True, True, True, False)
    assert found.parameters.options.use_nav_sat is True
    assert found.parameters.options.num_point_clouds == 0
    assert found.parameters.map_builder.dimensions == 2
    assert found.base_frame is None
    assert log.notes == [
        "mapping in 2D, as the recording's range sensors are (choose with --mode 2d or 3d)",
        "point clouds are not used, there are scans (choose with --points-topic)",
    ]
    bare, log = plan({"num_laser_scans": 1})
    assert (bare.odometry, bare.imu, bare.fixes, bare.landmarks) == (False, False, False, False)
    assert bare.parameters.trajectory_builder_2d.use_imu_data is False
    assert not log.notes
    assert log.warnings == ["no odometry and no IMU: only the range sensors tell how the robot moved"]
    assert not plan({"num_laser_scans": 1, "imu": True})[1].warnings


def test_clouds_of_depth_are_mapped_in_3d_and_flat_ones_in_2d():
    deep, log = plan({"num_laser_scans": 0, "num_point_clouds": 2, "imu": True})
    assert deep.spatial
    assert numbers(deep) == (0, 0, 1)
    assert deep.parameters.map_builder.dimensions == 3
    assert "mapping in 3D" in log.notes[0]
    flat, _ = plan({"num_laser_scans": 0, "num_point_clouds": 1, "flat_clouds": True})
    assert (flat.spatial, numbers(flat)) == (False, (0, 0, 1))


def test_a_mode_wins_over_the_configuration():
    builder = replace(DEFAULTS.map_builder, use_trajectory_builder_2d=True)
    found, log = plan({**EVERYTHING, "mode": "3d"}, map_builder=builder)
    assert found.spatial
    assert numbers(found) == (0, 0, 1)
    assert found.parameters.map_builder.use_trajectory_builder_2d is False
    assert log.notes == ["scans are not used, in 3D point clouds are (choose with --scan-topic)"]
    assert (found.landmarks, found.fixes, log.warnings) == (False, True, ["landmarks are not used in 3D"])
    assert not plan({"num_laser_scans": 0, "num_point_clouds": 1}, map_builder=builder)[0].spatial


def test_the_options_numbers_hold():
    asked = {"num_laser_scans": 2, "num_multi_echo_laser_scans": 0, "num_point_clouds": 1}
    found, log = plan(EVERYTHING, asked)
    assert numbers(found) == (2, 0, 1)
    assert not log.warnings
    few, log = plan({"num_laser_scans": 1, "odometry": True}, asked)
    assert numbers(few) == (1, 0, 0)
    assert log.warnings == [
        (
            "the options ask for num_laser_scans 2, num_multi_echo_laser_scans 0, num_point_clouds 1, and the recording has "
            "only num_laser_scans 1, num_multi_echo_laser_scans 0, num_point_clouds 0"
        )
    ]
    # backpack_2d.lua asks for a scanner of several echoes.
    none, log = plan({"num_laser_scans": 1}, {"num_laser_scans": 0, "num_multi_echo_laser_scans": 1})
    assert numbers(none) == (1, None, 0)
    assert "the recording has none of these: what it has is used" in log.warnings[0]


def test_what_the_options_forbid_or_the_recording_lacks_is_said():
    refused = {"use_odometry": False, "use_nav_sat": False, "use_landmarks": False}
    builder = replace(DEFAULTS.trajectory_builder_2d, use_imu_data=False)
    found, log = plan(EVERYTHING, refused, ("TRAJECTORY_BUILDER_2D.use_imu_data",), trajectory_builder_2d=builder)
    assert (found.odometry, found.imu, found.fixes, found.landmarks) == (False, False, False, False)
    assert log.notes[2:] == [
        "odometry is not used: use_odometry is false",
        "IMU is not used: TRAJECTORY_BUILDER_2D.use_imu_data is false",
        "GPS is not used: use_nav_sat is false",
        "landmark topic is not used: use_landmarks is false",
    ]
    asked = {"use_odometry": True, "use_nav_sat": True}
    found, log = plan({"num_laser_scans": 1}, asked, ("TRAJECTORY_BUILDER_2D.use_imu_data",))
    assert (found.odometry, found.imu, found.fixes) == (False, False, False)
    assert log.notes == [
        "use_odometry is true, and the recording has no odometry: it runs without",
        "TRAJECTORY_BUILDER_2D.use_imu_data is true, and the recording has no IMU: it runs without",
        "use_nav_sat is true, and the recording has no GPS: it runs without",
    ]


@pytest.mark.parametrize("role", ["odometry", "imu", "fixes", "landmarks"])
def test_a_named_topic_is_taken_whatever_the_options_say(role: str):
    refused = {"use_odometry": False, "use_nav_sat": False, "use_landmarks": False}
    builder = replace(DEFAULTS.trajectory_builder_2d, use_imu_data=False)
    found, _ = plan({**EVERYTHING, "named": frozenset({role})}, refused, trajectory_builder_2d=builder)
    assert {name for name in ("odometry", "imu", "fixes", "landmarks") if getattr(found, name)} == {role}


def test_named_scanners_are_all_taken():
    offer = {"num_laser_scans": 2, "num_point_clouds": 1, "odometry": True, "named": frozenset({"scans"})}
    found, log = plan(offer, {"num_laser_scans": 1})
    assert numbers(found) == (2, 0, 1)
    assert not log.warnings


def test_frames_and_sampling_of_the_options():
    found, _ = plan(
        {"num_laser_scans": 1},
        {
            "tracking_frame": "imu_link",
            "map_frame": "hall",
            "imu_sampling_ratio": 0.5,
            "rangefinder_sampling_ratio": 0.25,
        },
    )
    assert (found.base_frame, found.map_frame) == ("imu_link", "hall")
    assert (found.ratios["imu"], found.ratios["ranges"], found.ratios["odometry"]) == (0.5, 0.25, 1.0)
