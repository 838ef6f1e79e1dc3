# SPDX-License-Identifier: MIT
"""The camera of a recording under the names of ORB-SLAM's settings, which ORB-SLAM3 wants in its file."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamcli.errors import InputError
from slamcli.mapper import find_tier
from slamcli.measurements import CameraModel, CameraRig
from slamcli.parameters import as_dict
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.pipelines.config import NativeConfig
from slamcli.pipelines.feeds import find_feed
from slamcli.pipelines.sweep_request import Subject, SweepRequest
from slamcli.recordings import open_recording
from slamcli.recordings.folders import find_layout
from slamcli.runtime import RunLog

_CAMERAS = ("Camera1.fx", "LEFT.K")
_MILLIMETRES = 1000.0
_DATA_SETS = 5000.0
_TUM_DEPTH = ("TUM RGB-D folder", "ICL-NUIM folder")
"""Layouts whose depth is in 1/5000 m."""
_GAPS_S = (0.1, 0.15, 1.0)
"""Times that the tier counts in images."""


def recorded_camera(request: SweepRequest, subject: Subject, config: NativeConfig) -> dict[str, Any]:
    """Return the camera that a recording's runs used, so that the same settings give the same result; empty where none fits.

    One camera, alone or with depth, without distortion or with that of ``PinHole`` or ``KannalaBrandt8``; none where the
    parameters hold one already. The rate is left out if rounding it to whole images per second would change anything.
    """
    if any(name in config.sources for name in _CAMERAS):
        return {}
    try:
        with open_recording(subject.inputs, mends=request.mends, log=RunLog()) as recording:
            feed = find_feed(recording, find_tier(config.algo), config, request.sensors, RunLog())
            if not isinstance(feed, CameraFeed) or feed.rig.mode not in ("mono", "rgbd"):
                return {}
            return _settings(feed.rig, config, _depth_units(request, subject))
    except InputError:
        return {}


def _depth_units(request: SweepRequest, subject: Subject) -> float:
    """Return the raw depth value of one metre: as the mends say, as the layout of a data set has it, else of millimetres."""
    if request.mends.depth_units_per_m is not None:
        return request.mends.depth_units_per_m
    layout = find_layout(subject.inputs[0]) if subject.inputs[0].is_dir() else None
    return _DATA_SETS if layout is not None and layout[0].name in _TUM_DEPTH else _MILLIMETRES


def _settings(rig: CameraRig, config: NativeConfig, depth_units: float) -> dict[str, Any]:
    main = rig.main
    model = _lens(main)
    if not model or not np.array_equal(main.rectification, np.eye(3)):
        return {}
    found: dict[str, Any] = {**model, "Camera.width": main.width, "Camera.height": main.height, "Camera.RGB": 1}
    rate = round(rig.rate_hz)
    if all(round(gap * rate) == round(gap * rig.rate_hz) for gap in _GAPS_S):
        found["Camera.fps"] = float(rate)
    if rig.mode == "rgbd":
        found["RGBD.DepthMapFactor"] = depth_units
        found["Stereo.b"] = rig.baseline_m or as_dict(config.parameters)["slamcli.virtual_baseline"]
    return found


def _lens(main: CameraModel) -> dict[str, Any]:
    K, D = main.intrinsics, main.distortion
    found: dict[str, Any] = {"Camera1.fx": K[0, 0], "Camera1.fy": K[1, 1], "Camera1.cx": K[0, 2], "Camera1.cy": K[1, 2]}
    if main.distortion_model == "equidistant" and len(D) == 4:
        found |= {f"Camera1.k{i + 1}": value for i, value in enumerate(D)}
        kind = "KannalaBrandt8"
    elif main.distortion_model in ("plumb_bob", "") and len(D) <= 5:
        found |= {f"Camera1.{name}": value for name, value in zip(("k1", "k2", "p1", "p2", "k3"), D, strict=False)}
        kind = "PinHole"
    else:
        return {}
    if K[0, 1] != 0.0:
        return {}
    return {"Camera.type": kind, **{name: float(value) for name, value in found.items()}}
