# SPDX-License-Identifier: MIT
"""How images are prepared, as the parameters say."""

from __future__ import annotations

import math

from slamcli.measurements import CameraRig
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.vision.preparation import PreparationSettings


def preparation_settings(parameters: OrbSlam3Parameters, rig: CameraRig) -> PreparationSettings:
    """Return how images are prepared for these parameters."""
    camera, own = parameters.device.camera, parameters.slamcli
    width, height = camera.new_width, camera.new_height
    if width is None and height is None and camera.image_scale != 1.0:
        width = max(16, round(rig.main.width * camera.image_scale))
    return PreparationSettings(
        width=width, height=height, equalise=own.equalise, virtual_baseline_m=own.virtual_baseline,
        view_angle_rad=math.radians(own.view_angle), rectified_view_angle_rad=math.radians(own.rectified_view_angle),
    )  # fmt: skip
