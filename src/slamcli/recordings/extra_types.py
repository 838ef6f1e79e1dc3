# SPDX-License-Identifier: MIT
"""Message types that slamcli knows and rosbags' collections of ROS types leave out."""

from __future__ import annotations

from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

_LANDMARK_ENTRY = """string id
geometry_msgs/Pose tracking_from_landmark_transform
float64 translation_weight
float64 rotation_weight"""

# Type name -> definition, dependencies first.
_DEFINITIONS = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "cartographer_ros_msgs/msg/LandmarkEntry": _LANDMARK_ENTRY,
    "cartographer_ros_msgs/msg/LandmarkList": "std_msgs/Header header\ncartographer_ros_msgs/LandmarkEntry[] landmarks",
}


def add_extra_types(store: Typestore) -> Typestore:
    """Return the store, which now knows these types as well."""
    for name, text in _DEFINITIONS.items():
        if name not in store.fielddefs:
            store.register(get_types_from_msg(text, name))
    return store
