# SPDX-License-Identifier: MIT
"""Values of the navigation stack's parts that do not go together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from slamcli.errors import ConfigError
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, below, number
from slamcli.native.settings import Setting
from slamcli.navigation.footprint import parse_footprint, radii

_COSTMAPS = ("global_costmap", "local_costmap")
_ASSUMED_RADIUS_M = 0.46


def check_together(settings: Mapping[str, Setting], *, whole: bool) -> Iterator[Finding]:
    """Yield what parts of one move_base say that does not fit each other.

    Parameters
    ----------
    settings
        By names with their sections.
    whole
        Nothing else will be loaded: what is not there is missing.
    """
    yield from _robot(settings, whole)
    for costmap in _COSTMAPS:
        yield from _inflation(below(settings, costmap))
    yield from _window(settings)
    yield from _rates(settings)
    yield from _tolerances(settings)
    yield from _teb(below(settings, "TebLocalPlannerROS"))
    yield from _resets(settings)


def check_finite(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    """Yield infinite values; of those that are not numbers the declarations tell."""
    for setting in settings.values():
        if isinstance(setting.value, float) and math.isinf(setting.value):
            yield at(setting, ERROR, f"{setting.name}={setting.value}: not a finite number")


def check_scanner(settings: Mapping[str, Setting], range_m: float | None) -> Iterator[Finding]:
    """Yield ranges beyond what the scanner sees, if that is known (metres)."""
    if range_m is None:
        return
    for setting in settings.values():
        name = setting.name.rpartition("/")[2]
        value = setting.value
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > range_m:
            continue
        if name == "laser_max_range":
            message = f"laser_max_range {value:g} is beyond the scanner's {range_m:g} m: no effect, amcl takes the smaller one"
            yield at(setting, WARNING, message)
        elif name in ("raytrace_range", "raytrace_max_range", "obstacle_range", "obstacle_max_range"):
            yield at(setting, NOTE, f"{name} {value:g} is beyond the scanner's {range_m:g} m")


def _shape(costmap: Mapping[str, Setting]) -> Setting | None:
    """Return what says how large the robot is."""
    footprint = costmap.get("footprint")
    if footprint is not None and footprint.value not in ("", "[]", [], None):
        return footprint
    return costmap.get("robot_radius")


def _inscribed_m(shape: Setting) -> float:
    """Return the inscribed radius in metres; NaN where it cannot be read."""
    value = shape.value
    if isinstance(value, (int, float)):
        return float(value)
    try:
        corners = parse_footprint(value)
    except ConfigError:
        return math.nan
    return radii(np.array(corners, dtype=np.float64))[0] if corners else math.nan


def _robot(settings: Mapping[str, Setting], whole: bool) -> Iterator[Finding]:
    parts = {name: below(settings, name) for name in _COSTMAPS}
    shapes = {name: _shape(part) for name, part in parts.items() if part}
    if len(shapes) < len(_COSTMAPS):
        return
    for name, shape in shapes.items():
        if shape is None and (whole or any(other is not None for other in shapes.values())):
            first = next(iter(parts[name].values()))
            message = f"{name} has neither robot_radius nor footprint: a radius of {_ASSUMED_RADIUS_M:g} m is assumed"
            yield at(first, WARNING, message)
    one, two = shapes.values()
    if one is not None and two is not None and str(one.value) != str(two.value):
        message = (
            f"the robot is {two.value} in local_costmap and {one.value} in global_costmap: plans may not be drivable"
        )
        yield at(two, WARNING, message)


def _inflation(costmap: Mapping[str, Setting]) -> Iterator[Finding]:
    """Yield an inflation that is narrower than a robot with a footprint (of round ones the costmap's own check tells)."""
    shape = _shape(costmap)
    if shape is None or isinstance(shape.value, (int, float)):
        return
    least = _inscribed_m(shape)
    for name, setting in costmap.items():
        if name.rpartition("/")[2] == "inflation_radius" and number(costmap, name, math.inf) < least:
            message = f"inflation_radius {setting.value:g} is below the inscribed radius {least:.3g} of the footprint: paths may lead through walls"
            yield at(setting, WARNING, message)


def _window(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    local, dwa = below(settings, "local_costmap"), below(settings, "DWAPlannerROS")
    if not dwa or not ("width" in local or "height" in local):
        return
    side = min(number(local, "width", 10.0), number(local, "height", 10.0))
    ahead = number(dwa, "max_vel_trans", 0.55) * number(dwa, "sim_time", 1.7)
    if ahead > 0.5 * side:
        place = local.get("width") or local["height"]
        message = (
            f"DWA looks {ahead:g} m ahead (max_vel_trans times sim_time), and the window ends {0.5 * side:g} m from the robot:"
            " motions that leave it are refused"
        )
        yield at(place, WARNING, message)


def _rates(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    control = number(settings, "controller_frequency", 20.0)
    for costmap, used in (("local_costmap", control), ("global_costmap", max(control, 20.0))):
        name = f"{costmap}/update_frequency"
        if name in settings and number(settings, name, 0.0) > used:
            rate = number(settings, name, 0.0)
            yield at(
                settings[name],
                WARNING,
                f"update_frequency {rate:g} of {costmap} is above the controller's {control:g} Hz: nobody sees the rest",
            )
    frame = settings.get("local_costmap/global_frame")
    if frame is not None and str(frame.value).strip("/") == "map":
        yield at(
            frame,
            WARNING,
            "the local costmap is in frame map, which jumps when localisation corrects itself: usual is odom",
        )


def _tolerances(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    cell = number(settings, "local_costmap/resolution", 0.05)
    for planner in ("DWAPlannerROS", "TebLocalPlannerROS", "TrajectoryPlannerROS"):
        name = f"{planner}/xy_goal_tolerance"
        if name in settings and number(settings, name, math.inf) < cell:
            yield at(
                settings[name],
                WARNING,
                f"xy_goal_tolerance {settings[name].value:g} is below a cell of the local costmap ({cell:g} m): the goal may never be reached",
            )


def _teb(teb: Mapping[str, Setting]) -> Iterator[Finding]:
    place = teb.get("inflation_dist") or teb.get("min_obstacle_dist")
    if place is not None and number(teb, "inflation_dist", 0.6) <= number(teb, "min_obstacle_dist", 0.5):
        yield at(place, WARNING, "inflation_dist is not above min_obstacle_dist: it has no effect")


def _resets(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    listed = settings.get("recovery_behaviors")
    if listed is None:
        for name in ("conservative_reset", "aggressive_reset"):
            setting = settings.get(f"{name}/reset_distance")
            if setting is not None:
                of = "conservative_reset_dist" if name == "conservative_reset" else "four circumscribed radii"
                message = f"move_base overwrites {name}/reset_distance by {of} unless there is a list recovery_behaviors; slamcli takes it"
                yield at(setting, WARNING, message)
        return
    names = (
        [str(entry.get("name")) for entry in listed.value if isinstance(entry, dict)]
        if isinstance(listed.value, list)
        else []
    )
    for name in dict.fromkeys(name for name in names if names.count(name) > 1):
        yield at(listed, ERROR, f"recovery_behaviors has {name!r} twice: move_base takes its default list instead")
