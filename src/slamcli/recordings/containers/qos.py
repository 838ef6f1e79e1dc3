# SPDX-License-Identifier: MIT
"""Quality of service in ROS 2 bags, as far as it says what ROS 1 calls latched."""

from __future__ import annotations

import re

_TRANSIENT_LOCAL = re.compile(r"durability:\s*(1|transient_local)\b")

# Reliable, transient local, everything else unset: what a latched topic of ROS 1 is in ROS 2.
LATCHED_QOS = """- history: 3
  depth: 0
  reliability: 1
  durability: 1
  deadline:
    sec: 2147483647
    nsec: 4294967295
  lifespan:
    sec: 2147483647
    nsec: 4294967295
  liveliness: 1
  liveliness_lease_duration:
    sec: 2147483647
    nsec: 4294967295
  avoid_ros_namespace_conventions: false
"""


def is_latched(qos: str) -> bool:
    """Return whether a topic with these QoS profiles keeps its last message for late subscribers."""
    return _TRANSIENT_LOCAL.search(qos) is not None
