# SPDX-License-Identifier: MIT
"""Every parameter of ORB-SLAM3's settings files under the name of schema 1.0, and slamcli's own, declared once.

Legacy names (``Camera.fx``, ``ThDepth``, ``DepthMapFactor``, ``Tbc`` …) are read as these; see `slamcli.native.orbslam_names`.
"""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.orbslam3.parameters.cameras import (
    CameraParameters,
    DeviceParameters,
    ImuParameters,
    LensParameters,
    RectificationParameters,
    RgbdParameters,
    StereoParameters,
)
from slamcli.orbslam3.parameters.system import (
    ExtractorParameters,
    SlamcliParameters,
    SystemParameters,
    ViewerParameters,
)
from slamcli.parameters import group, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbSlam3Parameters:
    """All groups; native names begin with the group, those of the settings file's top level with nothing."""

    version: str = parameter(
        "1.0", "schema of the settings file: both are read, whatever it says", name="File.version", effective=False
    )
    map_frame: str = parameter("map", "name of the map's frame (of the ROS node)", name="world_frame_id")
    device: DeviceParameters = group(DeviceParameters(), name="")
    extractor: ExtractorParameters = group(ExtractorParameters(), name="ORBextractor")
    system: SystemParameters = group(SystemParameters(), name="System")
    loop_closing: bool = parameter(
        True, "whether places that are seen again close loops and join maps", name="loopClosing"
    )
    viewer: ViewerParameters = group(ViewerParameters(), name="Viewer")
    slamcli: SlamcliParameters = group(SlamcliParameters(), name="slamcli")


__all__ = [
    "CameraParameters",
    "DeviceParameters",
    "ExtractorParameters",
    "ImuParameters",
    "LensParameters",
    "OrbSlam3Parameters",
    "RectificationParameters",
    "RgbdParameters",
    "SlamcliParameters",
    "StereoParameters",
    "SystemParameters",
    "ViewerParameters",
]
