# SPDX-License-Identifier: MIT
"""The best set as the system's own configuration file, which gives the best run again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.native.native_text import format_cartographer_lua, format_launch, format_opencv_yaml
from slamcli.native.rtabmap_ini import format_rtabmap_ini
from slamcli.parameters import Declaration, as_dict, declarations
from slamcli.pipelines.config import NativeConfig
from slamcli.pipelines.native_files import CARTOGRAPHER, ORBSLAM3, RTABMAP

_MATRICES = {
    "Stereo.T_c1_c2": (4, 4), "IMU.T_b_c1": (4, 4), "LEFT.K": (3, 3), "LEFT.R": (3, 3), "LEFT.P": (3, 4),
    "RIGHT.K": (3, 3), "RIGHT.R": (3, 3), "RIGHT.P": (3, 4),
}  # fmt: skip
_SCHEMA = "File.version"
_USUAL = ("Stereo.ThDepth", "ORBextractor.", "Viewer.")
"""Settings that ORB-SLAM3 stops without."""
_OF_THE_RECORDING = (
    "use_odometry",
    "use_nav_sat",
    "use_landmarks",
    "num_laser_scans",
    "num_multi_echo_laser_scans",
    "num_point_clouds",
)
"""Options of Cartographer's node that are found from the recording where no file says them."""
_IMU = "TRAJECTORY_BUILDER_2D.use_imu_data"
_BUILDERS = ("MAP_BUILDER.use_trajectory_builder_2d", "MAP_BUILDER.use_trajectory_builder_3d")


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeText:
    """A file that a system reads."""

    suffix: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundInput:
    """What a run found in its recording, as its ``run.json`` says it."""

    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Of the system's parameters those that come from the recording."""
    base_frame: str = ""
    odom_frame: str = ""

    @classmethod
    def of(cls, folder: Path) -> FoundInput:
        """Return what the result in a folder says."""
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        names = (*_OF_THE_RECORDING, *_BUILDERS, _IMU)
        known = {name: run["parameters"][name] for name in names if name in run["parameters"]}
        return cls(
            parameters=known,
            base_frame=str(run["frames"].get("base") or ""),
            odom_frame=str(run["frames"].get("odom") or ""),
        )


def native_text(
    config: NativeConfig, changes: Mapping[str, Any], found: FoundInput, camera: Mapping[str, Any], remark: str
) -> NativeText:
    """Return the file of a set: all that was given by files and options, and the set's changes over them.

    Parameters
    ----------
    config
        The parameters that the changes were made to.
    changes
        By native name.
    found
        What the run found in its recording: Cartographer's node wants it said.
    camera
        The recording's camera under the names of ORB-SLAM's settings, which wants it said too.
    remark
        A line on top, where the format has comments.
    """
    known = as_dict(config.parameters)
    given = {name: known[name] for name in config.sources} | dict(changes)
    declared = {entry.name: entry for entry in declarations(type(config.parameters))}
    values = {name: given[name] for name in declared if name in given and given[name] is not None}
    if config.algo == CARTOGRAPHER:
        return NativeText(suffix=".lua", text=_lua(values, declared, found, remark))
    if config.algo == ORBSLAM3:
        return NativeText(suffix=".yaml", text=_settings(values, declared, camera, remark))
    if config.algo == RTABMAP and all("/" in name for name in values) and not config.remaps:
        return NativeText(suffix=".ini", text=f"; {remark}\n{format_rtabmap_ini(values)}")
    package, kind = ("rtabmap_slam", "rtabmap") if config.algo == RTABMAP else ("gmapping", "slam_gmapping")
    return NativeText(suffix=".launch", text=format_launch(package, kind, values, config.remaps, [remark]))


def _lua(values: Mapping[str, Any], declared: Mapping[str, Declaration], found: FoundInput, remark: str) -> str:
    """Return a whole file of the ROS node: Cartographer stops where an option of the node is missing."""
    options = {name: entry.default for name, entry in declared.items() if "." not in name}
    options |= {name: found.parameters[name] for name in _OF_THE_RECORDING if name in found.parameters}
    if found.base_frame:
        options |= {"tracking_frame": found.base_frame, "published_frame": found.base_frame}
    if found.odom_frame and options["use_odometry"]:  # the robot broadcasts it: Cartographer must not do so too
        options |= {"odom_frame": found.odom_frame, "published_frame": found.odom_frame, "provide_odom_frame": False}
    options |= {name: value for name, value in values.items() if name in options}
    inside = {name: value for name, value in values.items() if name not in options}
    if not any(name in inside for name in _BUILDERS):
        spatial = found.parameters.get(_BUILDERS[1]) is True
        inside = {_BUILDERS[spatial]: True} | inside
    if _IMU not in inside and inside.get(_BUILDERS[0]) is True and found.parameters.get(_IMU) is False:
        inside[_IMU] = False  # with its default the node waits for an IMU that is not there
    absent = {name.rpartition(".")[0] for name, entry in declared.items() if entry.default is None or entry.extension}
    return format_cartographer_lua(
        {name: value for name, value in options.items() if value is not None}, inside,
        absent=sorted(table for table in absent if "." in table), remarks=[remark],
    )  # fmt: skip


def _settings(
    values: Mapping[str, Any], declared: Mapping[str, Declaration], camera: Mapping[str, Any], remark: str
) -> str:
    """Return settings with all that ORB-SLAM3 wants said; what is default is said too."""
    usual = {name: declared[name].default for name in declared if name.startswith(_USUAL)}
    usual = {name: value for name, value in usual.items() if value is not None and value != ""} if camera else {}
    values = {
        name: value for name in declared for value in [{**usual, **camera, **values}.get(name)] if value is not None
    }
    real = [entry.name for entry in declared.values() if entry.kind is float and entry.name != "Camera.fps"]
    whole = {
        name: int(value) if name == "Camera.fps" and value == int(value) else value for name, value in values.items()
    }
    said = {_SCHEMA: "1.0"} | {name: value for name, value in whole.items() if name != _SCHEMA}
    return format_opencv_yaml(said, real=real, matrices=_MATRICES, remarks=[remark])
