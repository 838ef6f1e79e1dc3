# SPDX-License-Identifier: MIT
"""What `config check` finds in files of RTAB-Map."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.native.checks import Finding
from slamcli.native.settings import find_native
from slamcli.pipelines.config import check


def of_ini(tmp_path: Path, *lines: str) -> list[Finding]:
    file = tmp_path / "a.ini"
    file.write_text("\n".join(["[Core]", *lines, ""]))
    return list(check([file]))


def of_node(
    tmp_path: Path, body: str, *, args: str = "", kind: str = 'pkg="rtabmap_slam" type="rtabmap"'
) -> list[Finding]:
    file = tmp_path / "a.launch"
    file.write_text(f'<launch>\n<node {kind} name="n" args="{args}">\n{body}\n</node>\n</launch>\n')
    return list(check([file]))


def params(**values: object) -> str:
    return "\n".join(f'<param name="{name.replace("__", "/")}" value="{value}"/>' for name, value in values.items())


def test_the_missions_launch_file() -> None:
    found = check([find_native(Path("rtabmap_rgbd.launch"))])
    assert {finding.severity for finding in found} == {"note"}
    words = ["depth must be registered", "sync_queue_size", "Mem/RehearsalSimilarity 0.3: far more nodes"]
    assert [sum(word in finding.message for finding in found) for word in words] == [1, 1, 1]


@pytest.mark.parametrize(
    ("line", "severity", "words"),
    [
        ("Kp/MaxFeature=5", "error", "did you mean Kp/MaxFeatures"),
        ("Kp/MaxFeatures=a", "error", "not a whole number"),
        ("Kp/SSC=no", "error", "counts as true"),
        ("Kp/DetectorStrategy=0", "warning", "SURF is not available here"),
        ("Mem/RehearsalSimilarity=1.5", "error", "between 0 and 1"),
        ("Rtabmap/LoopThr=2", "error", "between 0 and 1"),
        ("Rtabmap/LoopThr=0.9", "warning", "few hypotheses reach it"),
        ("Rtabmap/LoopThr=0.01", "warning", "nearly every hypothesis"),
        ("RGBD/AggressiveLoopThr=0.2", "warning", "above Rtabmap/LoopThr"),
        ("Kp/WordsPerImage=300", "warning", "called Kp/MaxFeatures today"),
        ("LccBow/MinInliers=300", "error", "Vis/MinInliers comes near"),
        ("KAZE/Upright=true", "note", "these parts are not here: KAZE/"),
        ("Rtabmap/PublishStats=false", "note", "has no effect"),
        ("RGBD/AngularUpdate=3", "warning", "in radians: 3 is 172°"),
        ("Optimizer/Robust=true", "warning", "RGBD/OptimizeMaxError rejects nothing"),
        ("Vis/MinInliers=5", "warning", "wrong loop closures pass"),
        ("Icp/PointToPlaneRadius=0.5", "warning", "set one of them 0"),
        ("Icp/VoxelSize=0.3", "warning", "below Icp/VoxelSize"),
        ("Grid/NormalsSegmentation=false", "warning", "needs Grid/MaxGroundHeight"),
        ("Grid/RangeMin=6", "error", "no point is left"),
        ("Grid/FootprintWidth=1", "warning", "without Grid/FootprintLength"),
        ("GridGlobal/ProbClampingMin=0.99", "error", "not below GridGlobal/ProbClampingMax"),
        ("Kp/IncrementalDictionary=false", "error", "needs Kp/DictionaryPath"),
        ("Kp/MaxFeatures=-1", "warning", "no place is known again by its looks"),
        ("Vis/CorFlowWinSize=9", "note", "has no effect"),
        ("Marker/Length=0.1", "warning", "RGBD/MarkerDetection is false"),
        ("VhEp/MatchCountMin=9", "warning", "VhEp/Enabled is false"),
        ("Odom/KalmanProcessNoise=9", "warning", "FilteringStrategy is not 1"),
        ("Mem/LocalizationReadOnly=true", "warning", "Mem/IncrementalMemory is true"),
        ("Vis/DepthMaskFloorThr=0.1\nVis/DepthAsMask=false", "warning", "Vis/DepthAsMask is false"),
        (
            "Mem/LocalizationReadOnly=true\nMem/IncrementalMemory=false\nRtabmap/MemoryThr=9",
            "warning",
            "nothing can be transferred",
        ),
        ("Mem/ReduceGraph=true\nMem/RehearsalIdUpdatedToNewOne=true", "warning", "switch one off"),
        ("Grid/MaxObstacleHeight=0.1\nGrid/MaxGroundHeight=0.2", "error", "no obstacle is left"),
        ("RGBD/LinearUpdate=0\nRGBD/AngularUpdate=0", "note", "while the robot stands"),
        ("GTSAM/Incremental=true\nOptimizer/Strategy=1", "warning", "Optimizer/Strategy is not 2"),
    ],
)
def test_lines_of_an_ini_file(tmp_path: Path, line: str, severity: str, words: str) -> None:
    found = [finding for finding in of_ini(tmp_path, *line.split("\n")) if words in finding.message]
    assert [finding.severity for finding in found] == [severity]
    assert found[0].line >= 2


def test_a_good_ini_file_has_no_findings(tmp_path: Path) -> None:
    assert (
        of_ini(
            tmp_path, "Version = 0.23.8", "Kp\\MaxFeatures = 600", "Icp\\VoxelSize = 0.05", "RGBD\\LinearUpdate = 0.2"
        )
        == []
    )


def test_an_ini_file_of_something_else(tmp_path: Path) -> None:
    file = tmp_path / "php.ini"
    file.write_text("[PHP]\nx = 1\n")
    assert [(finding.severity, "no section [Core]" in finding.message) for finding in check([file])] == [
        ("error", True)
    ]


@pytest.mark.parametrize(
    ("body", "severity", "words"),
    [
        (params(odom_frame_id="odom", subscribe_odom="true"), "warning", "odometry comes from its transforms"),
        (params(subscribe_depth="true", subscribe_stereo="true"), "error", "takes one of them"),
        (params(subscribe_scan="true", subscribe_scan_cloud="true"), "warning", "subscribe_scan_cloud is ignored"),
        ('<remap from="scan" to="/scan"/>', "warning", "not subscribed to: subscribe_scan is not true"),
        (params(RGBD__ProximityPathMaxNeighbors=10), "warning", "merges scans, and none are subscribed to"),
        (params(subscribe_scan="true", RGBD__ProximityPathMaxNeighbors=10), "warning", "matches images alone"),
        (params(Reg__Strategy=1), "warning", "asks for scans, and none are subscribed to"),
        (params(Grid__Sensor=0), "warning", "Grid/Sensor asks for scans"),
        (params(Grid__Sensor=2, subscribe_depth="false", subscribe_scan="true"), "warning", "asks for depth images"),
        (params(Icp__VoxelSize=0.1), "warning", "Reg/Strategy is 0 and no scans"),
        (params(Odom__Strategy=1), "warning", "belongs to the odometry node"),
        (params(subscribe_dept="true"), "warning", "did you mean subscribe_depth"),
        (params(own_thing=1), "note", "not checked"),
    ],
)
def test_parameters_of_the_node(tmp_path: Path, body: str, severity: str, words: str) -> None:
    assert [finding.severity for finding in of_node(tmp_path, body) if words in finding.message] == [severity]


def test_localisation_in_a_database_that_is_deleted(tmp_path: Path) -> None:
    found = of_node(tmp_path, params(Mem__IncrementalMemory="false"), args="--delete_db_on_start")
    assert [finding.severity for finding in found if "deletes it" in finding.message] == ["error"]
    assert of_node(tmp_path, params(Mem__IncrementalMemory="false")) == []


def test_the_odometry_node_and_the_wrong_package(tmp_path: Path) -> None:
    found = of_node(tmp_path, params(RGBD__LinearUpdate=0.2), kind='pkg="rtabmap_odom" type="rgbd_odometry"')
    assert [finding.message for finding in found] == [
        "rgbd_odometry does not read RGBD/LinearUpdate: it belongs to the rtabmap node"
    ]
    found = of_node(tmp_path, "", kind='pkg="gmapping" type="rtabmap"')
    assert [finding.severity for finding in found] == ["error"]


def test_parameters_of_ros_2_are_texts(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("rtabmap:\n  ros__parameters:\n    frame_id: base_link\n    Kp/MaxFeatures: 500\n    Kp/SSC: '1'\n")
    found = check([file])
    assert [(finding.severity, finding.line) for finding in found] == [("warning", 4)]
    assert 'write "500"' in found[0].message
    file.write_text("rtabmap:\n  Kp/MaxFeatures: 500\n")
    assert check([file]) == ()
