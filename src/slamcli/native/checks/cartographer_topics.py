# SPDX-License-Identifier: MIT
"""Topics that a launch file remaps against those that Cartographer's node subscribes to."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from slamcli.native.cartographer_lua import CartographerFile
from slamcli.native.checks.findings import WARNING, Finding
from slamcli.native.launch import LaunchNode

_RANGES = {
    "scan": "num_laser_scans",
    "echoes": "num_multi_echo_laser_scans",
    "points2": "num_point_clouds",
}
_SWITCHES = {"odom": "use_odometry", "fix": "use_nav_sat", "landmark": "use_landmarks"}
_MOST_SENSORS = 100


def check_topics(node: LaunchNode, found: CartographerFile) -> Iterator[Finding]:
    """Yield a warning for each sensor's topic that is remapped, though the node does not subscribe to it."""
    values = {setting.name: setting.value for setting in found.settings}
    subscribed, reasons = _subscriptions(values)
    for name in node.remaps:
        topic = name.strip("/")
        kind = re.sub(r"_[0-9]+$", "", topic)
        if kind in reasons and topic not in subscribed:
            message = f"the node does not subscribe to {topic!r}, which is remapped: {reasons[kind]}"
            yield Finding(WARNING, node.file, node.line, message)


def _subscriptions(values: Mapping[str, Any]) -> tuple[set[str], dict[str, str]]:
    """Return the topics that the node subscribes to, and by kind of topic what decides on it."""
    subscribed: set[str] = set()
    reasons = {}
    for kind, key in _RANGES.items():
        count = values.get(key)
        number = int(max(0, min(count, _MOST_SENSORS))) if isinstance(count, (int, float)) and count == count else 0
        names = [kind] if number == 1 else [f"{kind}_{i + 1}" for i in range(number)]
        subscribed |= set(names)
        reasons[kind] = f"{key} is {count}, so that it takes {', '.join(names) or 'none'}"
    for kind, key in _SWITCHES.items():
        subscribed |= {kind} if values.get(key) is True else set()
        reasons[kind] = f"{key} is not true"
    imu = values.get("MAP_BUILDER.use_trajectory_builder_3d") or values.get("TRAJECTORY_BUILDER_2D.use_imu_data")
    subscribed |= {"imu"} if imu else set()
    reasons["imu"] = "TRAJECTORY_BUILDER_2D.use_imu_data is not true"
    return subscribed, reasons
