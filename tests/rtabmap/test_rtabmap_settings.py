# SPDX-License-Identifier: MIT
"""Which parameters lead to which key points."""

from __future__ import annotations

from typing import Any

from slamcli.parameters import resolve
from slamcli.rtabmap.feature_settings import Detector
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.settings import feature_settings, word_settings, words_are_odometrys


def given(values: dict[str, Any]) -> RtabmapParameters:
    return resolve(RtabmapParameters, values)


def test_odometrys_key_points_are_those_of_vis() -> None:
    found = feature_settings(
        given(
            {
                "Vis/FeatureType": 2,
                "Vis/GridRows": 3,
                "Vis/RoiRatios": "0 0 0 0.1",
                "Vis/DepthAsMask": False,
                "Odom/ImageDecimation": 2,
            }
        )
    )
    assert (found.detector, found.grid_rows, found.roi_ratios, found.depth_as_mask, found.decimation) == (
        Detector.ORB, 3, (0.0, 0.0, 0.0, 0.1), False, 2,
    )  # fmt: skip


def test_words_key_points_are_those_of_kp() -> None:
    found = word_settings(
        given({"Kp/DetectorStrategy": 2, "Kp/GridCols": 4, "Kp/MaxDepth": 5, "Mem/DepthMaskFloorThr": 0.1})
    )
    assert (found.detector, found.grid_columns, found.max_depth_m, found.floor_threshold_m, found.decimation) == (
        Detector.ORB, 4, 5.0, 0.1, 1,
    )  # fmt: skip


def test_there_are_enough_for_words_and_for_matching() -> None:
    assert feature_settings(given({})).max_features == 1000
    assert feature_settings(given({"Kp/MaxFeatures": 2000})).max_features == 2000
    assert word_settings(given({"Kp/MaxFeatures": 0})).max_features == 0
    assert feature_settings(given({"Kp/MaxFeatures": -1})).max_features == 1000


def test_nodes_take_odometrys_key_points_if_they_can() -> None:
    assert words_are_odometrys(given({"slamcli.odometry": "visual"}))
    assert not words_are_odometrys(given({"slamcli.odometry": "recording"}))
    assert not words_are_odometrys(given({"slamcli.odometry": "visual", "Mem/UseOdomFeatures": False}))
    assert not words_are_odometrys(given({"slamcli.odometry": "visual", "Kp/DetectorStrategy": 8}))
