# SPDX-License-Identifier: MIT
"""Options that name the cameras of a recording and their calibration."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_TOPICS = {
    "rgb": "Colour (or the only) images.",
    "depth": "Depth images of the colour camera.",
    "left": "Images of the left camera.",
    "right": "Images of the right camera.",
    "camera_info": "Calibration of the colour, left or only camera.",
}


def camera_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it gets `cameras` (`slamcli.recordings.camera_topics.CameraNames`) and `camera_files`."""

    @functools.wraps(function)
    def with_cameras(**arguments: Any) -> Any:
        from slamcli.recordings.camera_topics import CameraNames

        names = {role: arguments.pop(f"{role}_topic") for role in _TOPICS}
        return function(cameras=CameraNames(**names), **arguments)

    decorated: Callable[..., Any] = click.option(
        "--camera", "camera_files", metavar="FILE", multiple=True, type=click.Path(path_type=Path),
        help="Calibration of the cameras: camera_calibration, ORB-SLAM or Kalibr YAML; a second file for the right camera or the IMU.",
    )(with_cameras)  # fmt: skip
    for role, text in reversed(_TOPICS.items()):
        option = f"--{role.replace('_', '-')}-topic"
        decorated = click.option(option, metavar="TOPIC", help=f"{text} (orbslam3, rtabmap)")(decorated)
    return decorated
