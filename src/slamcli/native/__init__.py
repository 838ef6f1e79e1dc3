# SPDX-License-Identifier: MIT
"""The systems' own configuration files."""

from slamcli.native.cartographer_lua import CartographerFile, is_preset, read_cartographer_lua
from slamcli.native.launch import Launch, LaunchNode, read_launch
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.native.settings import Setting, merge

__all__ = [
    "CartographerFile",
    "Launch",
    "LaunchNode",
    "Setting",
    "is_preset",
    "merge",
    "read_cartographer_lua",
    "read_launch",
    "read_ros_yaml",
]
