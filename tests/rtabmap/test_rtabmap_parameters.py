# SPDX-License-Identifier: MIT
"""RTAB-Map's parameters: names, defaults, ways of writing values, what is not available."""

from __future__ import annotations

import re

import pytest

from slamcli.errors import ConfigError
from slamcli.parameters import declarations, resolve
from slamcli.rtabmap.parameters import RtabmapParameters

TABLE = {entry.name: entry for entry in declarations(RtabmapParameters)}
# Number of parameters by group of RTAB-Map 0.23.
SIZES = {
    "Rtabmap": 26, "Mem": 38, "Kp": 24, "Vis": 42, "RGBD": 45, "Optimizer": 8, "Grid": 27, "GridGlobal": 12, "Odom": 21,
    "OdomF2M": 14, "Icp": 29, "Reg": 3, "Bayes": 3, "VhEp": 4, "g2o": 5, "GTSAM": 4, "Stereo": 14, "GFTT": 6, "ORB": 8,
    "FAST": 9, "BRIEF": 1, "SURF": 7, "SIFT": 10, "Marker": 13, "ImuFilter": 6, "DbSqlite3": 5,
}  # fmt: skip


def test_all_parameters_of_each_group_are_there() -> None:
    counted: dict[str, int] = {}
    for name in TABLE:
        group, slash, _ = name.partition("/")
        if slash:
            counted[group] = counted.get(group, 0) + 1
    assert counted == SIZES


def test_fields_are_named_as_the_parameters_are() -> None:
    for name, entry in TABLE.items():
        native = name.rpartition("/")[2].rpartition(".")[2]
        field = entry.field.rpartition(".")[2]
        assert field == {"3D": "is_3d"}.get(native, field)
        if native != "3D":
            assert re.sub(r"[^a-z0-9]", "", native.lower()) == field.replace("_", ""), name


def test_defaults_of_the_pinned_build() -> None:
    p = RtabmapParameters()
    assert (p.optimizer.strategy, p.optimizer.iterations, p.optimizer.gravity_sigma) == (2, 20, 0.3)
    assert (p.icp.strategy, p.icp.max_correspondence_distance, p.icp.point_to_plane) == (1, 0.1, True)
    assert (p.kp.detector_strategy, p.vis.feature_type, p.odom_f2m.bundle_adjustment) == (10, 10, 1)
    assert (p.kp.max_features, p.mem.rehearsal_similarity, p.rtabmap.loop_thr, p.vis.min_inliers) == (
        500,
        0.6,
        0.11,
        20,
    )
    assert p.rgbd.create_occupancy_grid  # as the ROS node has it


def test_texts_are_taken_where_rtabmap_takes_them() -> None:
    p = resolve(
        RtabmapParameters,
        {"Kp/MaxFeatures": "800", "RGBD/LinearUpdate": "0.05", "Mem/IncrementalMemory": "false", "Grid/3D": "0"},
    )
    assert (p.kp.max_features, p.rgbd.linear_update, p.mem.incremental_memory, p.grid.is_3d) == (
        800,
        0.05,
        False,
        False,
    )


def test_lists_in_one_text() -> None:
    p = resolve(RtabmapParameters, {"Kp/RoiRatios": "0 0.1 0.2 0.3"})
    assert p.kp.roi == (0.0, 0.1, 0.2, 0.3)
    assert len(p.bayes.prediction) == 18
    assert p.bayes.prediction[:3] == (0.1, 0.36, 0.3)


def test_markers_by_number() -> None:
    p = resolve(
        RtabmapParameters, {"Marker/Lengths": "1:0.1 7:0.25", "Marker/Priors": "7 1 2 3 0 0 1.57|9 0 0 0 0 0 0"}
    ).marker
    assert p.length_of_each == {1: 0.1, 7: 0.25}
    assert p.prior_of_each == {7: (1.0, 2.0, 3.0, 0.0, 0.0, 1.57), 9: (0.0,) * 6}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("Kp/DetectorStrategy", 0, r"SURF is not available here: choose 8 \(GFTT/ORB\)"),
        ("Vis/FeatureType", 11, "SuperPoint is not available"),
        ("Vis/CorNNType", 6, "SuperGlue is not available"),
        ("Odom/Strategy", 2, "Fovis is not available"),
        ("Odom/Strategy", 5, "--algo orbslam3"),
        ("Kp/NNStrategy", 4, "GPU is not available"),
        ("Icp/Strategy", 2, "CCCoreLib is not available"),
        ("Kp/DetectorStrategy", 99, "choose one of 8, 10, 2, 6"),
        ("Rtabmap/LoopThr", 1.5, "between 0 and 1"),
        ("Mem/RehearsalSimilarity", "a", "not a number"),
        ("Kp/MaxFeatures", 1.5, "not a whole number"),
        ("Kp/MaxFeatures", -2, "between -1 and"),
        ("Mem/ImageCompressionFormat", ".bmp", "choose one of .jpg, .png"),
        ("Kp/RoiRatios", "0 0 0", "four shares"),
        ("Vis/RoiRatios", "0.5 0.5 0 0", "nothing is left"),
        ("Grid/DepthRoiRatios", "a b c d", "separated by blanks"),
        ("Bayes/PredictionLC", "0.1", "at least two"),
        ("Bayes/PredictionLC", "0.1 x", "separated by blanks"),
        ("Marker/Lengths", "1=0.1", "NUMBER:METRES"),
        ("Marker/Lengths", "1:-1", "above 0 m"),
        ("Marker/Priors", "1 2 3", "ROLL PITCH YAW"),
        ("Marker/Priors", "a b c d e f g", "ROLL PITCH YAW"),
    ],
)
def test_values_that_are_refused(name: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        resolve(RtabmapParameters, {name: value})
    assert str(caught.value).startswith(f"{name}=")


def test_a_name_without_its_group_is_found() -> None:
    with pytest.raises(ConfigError, match=r"Kp/MaxFeatures or Vis/MaxFeatures"):
        resolve(RtabmapParameters, {"MaxFeatures": 5})


def test_every_parameter_says_what_it_is() -> None:
    for name, entry in TABLE.items():
        assert len(entry.help) > 3, name
        assert "\n" not in entry.help
        assert not re.search(r"[^.]\.$", entry.help.replace(" ...", "")), name
