# SPDX-License-Identifier: MIT
"""Key points, the system's own switches, what the viewer takes, and slamcli's own parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtractorParameters:
    """``ORBextractor``."""

    num_features: int = parameter(
        1200, "key points per image", name="nFeatures", unit="points", minimum=50, maximum=20000
    )
    scale_factor: float = parameter(
        1.2, "ratio of the sizes of two levels of the image pyramid", name="scaleFactor", minimum=1.01, maximum=2.0
    )
    num_levels: int = parameter(8, "levels of the image pyramid", name="nLevels", unit="levels", minimum=1, maximum=16)
    initial_threshold: int = parameter(
        20, "how much brighter or darker than its centre a corner's circle must be", name="iniThFAST", unit="grey levels",
        minimum=1, maximum=254,
    )  # fmt: skip
    minimum_threshold: int = parameter(
        7, "the same in cells where the first threshold finds none", name="minThFAST", unit="grey levels", minimum=1,
        maximum=254,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemParameters:
    """``System``."""

    load_atlas: str = parameter(
        "", "atlas to begin with; archives of the original (.osa) are not read: give an atlas of slamcli by --load-atlas",
        name="LoadAtlasFromFile", effective=False,
    )  # fmt: skip
    save_atlas: str = parameter(
        "", "where the atlas goes in the end: say it by --save-atlas", name="SaveAtlasToFile", effective=False
    )
    th_far_points: float = parameter(
        0.0, "points farther away are dropped (stereo and RGB-D); 0: none", name="thFarPoints", unit="m", minimum=0.0,
        maximum=1e6,
    )  # fmt: skip


def _drawn(default: float, what: str) -> Any:
    return parameter(default, f"{what} in the viewer: nothing is drawn while mapping", effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerParameters:
    """``Viewer``: accepted and ignored."""

    KeyFrameSize: float = _drawn(0.05, "size of a keyframe")
    KeyFrameLineWidth: float = _drawn(1.0, "line width of a keyframe")
    GraphLineWidth: float = _drawn(0.9, "line width of the graph")
    PointSize: float = _drawn(2.0, "size of a point")
    CameraSize: float = _drawn(0.08, "size of the camera")
    CameraLineWidth: float = _drawn(3.0, "line width of the camera")
    ViewpointX: float = _drawn(0.0, "viewpoint")
    ViewpointY: float = _drawn(-0.7, "viewpoint")
    ViewpointZ: float = _drawn(-1.8, "viewpoint")
    ViewpointF: float = _drawn(500.0, "focal length of the viewpoint")
    imageViewScale: float = _drawn(1.0, "scale of the image")  # noqa: N815 - as the system spells it


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamcliParameters:
    """``slamcli``: what slamcli has and the original has not."""

    vocabulary: str = parameter(
        "auto", "words for place recognition: a vocabulary file (DBoW2 text, .tar.gz, DBoW3 .yml.gz, slamcli's own), auto, slamcli's own, or recording, learnt from it beforehand",
        extension=True,
    )  # fmt: skip
    final_bundle_adjustment: bool = parameter(
        True, "adjust all keyframes and points together at the end (modes with an IMU always do)", extension=True
    )
    keyframe_share: float = parameter(
        0.9, "a frame that sees less than this share of its reference keyframe's points becomes a keyframe (the original with depth: 0.75)",
        minimum=0.1, maximum=1.0, extension=True,
    )  # fmt: skip
    mend_disparities: bool = parameter(
        True,
        "take an error that all disparities share (calibration of a stereo camera) out of the map at the end",
        extension=True,
    )
    check_focal_length: bool = parameter(
        True,
        "find at the end the focal lengths that fit images and depths best, and warn where the calibration has others (RGB-D)",
        extension=True,
    )
    equalise: bool = parameter(False, "equalise local contrast (CLAHE) before key points are found", extension=True)
    depth_weight: float = parameter(
        3.0, "how much better than to a pixel of the virtual baseline a depth sensor's measurements are known (RGB-D; the original: 1)",
        minimum=0.1, maximum=30.0, extension=True,
    )  # fmt: skip
    virtual_baseline: float = parameter(
        0.08, "virtual baseline of RGB-D, where Camera.bf and Stereo.b are not given", unit="m", minimum=1e-3, maximum=10.0,
        extension=True,
    )  # fmt: skip
    view_angle: float = parameter(
        70.0, "key points farther from the optical axis are dropped (mono, RGB-D; wide lenses)", unit="deg", minimum=10.0,
        maximum=85.0, extension=True,
    )  # fmt: skip
    rectified_view_angle: float = parameter(
        50.0, "half the angle of view that rectified stereo images show at most", unit="deg", minimum=10.0, maximum=75.0,
        extension=True,
    )  # fmt: skip
    grid_resolution: float = parameter(
        0.05, "size of a cell of the occupancy grid (with depth)", unit="m", minimum=0.005, maximum=1.0, extension=True
    )
    grid_low: float = parameter(
        0.1,
        "height above the floor from which something is in the way",
        unit="m",
        minimum=-10.0,
        maximum=10.0,
        extension=True,
    )
    grid_high: float = parameter(
        1.5,
        "height above the floor up to which something is in the way",
        unit="m",
        minimum=-10.0,
        maximum=100.0,
        extension=True,
    )
    grid_reach: float = parameter(
        5.0, "range up to which depth draws obstacles", unit="m", minimum=0.1, maximum=100.0, extension=True
    )
    pairing_tolerance: float | None = parameter(
        None, "images of two cameras belong together up to this difference of their stamps; default: 0.02 with depth and 0.005 of stereo, half a frame at most",
        kind=float, unit="s", minimum=0.0, maximum=10.0, extension=True,
    )  # fmt: skip
