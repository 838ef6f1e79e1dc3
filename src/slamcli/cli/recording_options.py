# SPDX-License-Identifier: MIT
"""Options of every command that reads a recording: what is mended while reading."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import click
from click.core import ParameterSource

_OPTIONS = (
    click.option(
        "--time-offset",
        "time_offsets",
        metavar="TOPIC=SEC",
        multiple=True,
        help="Add seconds to the stamps of a topic (any number of times).",
    ),
    click.option(
        "--rename-frame",
        "renamed_frames",
        metavar="OLD=NEW",
        multiple=True,
        help="Read frame OLD as NEW (any number of times).",
    ),
    click.option(
        "--static-tf",
        "static_transforms",
        metavar="PARENT,CHILD,X,Y,Z,YAW,PITCH,ROLL",
        multiple=True,
        help="Add a fixed transform, metres and radians; wins over the recording's (any number of times).",
    ),
    click.option(
        "--urdf",
        "robot_model",
        metavar="FILE",
        help="Take fixed transforms that the recording lacks from a robot model.",
    ),
    click.option(
        "--laser-pose",
        metavar="X,Y,YAW",
        help="Pose of the scanner in the base frame, metres and radians; wins over transforms.",
    ),
    click.option(
        "--camera-info",
        "camera_infos",
        metavar="[TOPIC=]FILE",
        multiple=True,
        help="Take the camera's calibration from a camera_calibration YAML file instead of the recording's.",
    ),
    click.option("--flip-scan", is_flag=True, help="Mirror laser scans (their beams run the other way round)."),
    click.option(
        "--depth-scale",
        "depth_units_per_m",
        type=float,
        metavar="UNITS",
        help="Raw depth units per metre (1000 for millimetres, 5000 for TUM RGB-D).  [default: by encoding]",
    ),
    click.option(
        "--no-return",
        type=click.Choice(["ignore", "free", "max"]),
        default="ignore",
        show_default=True,
        help="Beams without return: ignore them, let them clear space up to the usable range, or take them as hits there.",
    ),
)


_NAMES = (
    "--time-offset",
    "--rename-frame",
    "--static-tf",
    "--urdf",
    "--laser-pose",
    "--camera-info",
    "--flip-scan",
    "--depth-scale",
    "--no-return",
)


def given_mends(context: click.Context) -> dict[str, Any]:
    """Return what the user gave of these options, by the option's name."""
    return {
        option: value
        for parameter in context.command.params
        if (option := parameter.opts[0]) in _NAMES
        and context.get_parameter_source(parameter.name or "") is ParameterSource.COMMANDLINE
        and (value := context.params[parameter.name or ""]) is not None
    }


def recording_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it gets one argument `mends` (`slamcli.recordings.mends.Mends`)."""

    @functools.wraps(function)
    def with_mends(**arguments: Any) -> Any:
        from slamcli.recordings.mend_parsing import parse_mends

        names = {
            "time_offsets",
            "renamed_frames",
            "static_transforms",
            "robot_model",
            "laser_pose",
            "camera_infos",
            "flip_scan",
            "depth_units_per_m",
            "no_return",
        }
        mends = parse_mends(**{name: arguments.pop(name) for name in names})
        return function(mends=mends, **arguments)

    for option in reversed(_OPTIONS):
        with_mends = option(with_mends)
    return with_mends
