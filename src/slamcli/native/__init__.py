# SPDX-License-Identifier: MIT
"""The systems' own configuration files."""

from slamcli.native.launch import Launch, LaunchNode, read_launch
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.native.settings import Setting, merge

__all__ = ["Launch", "LaunchNode", "Setting", "merge", "read_launch", "read_ros_yaml"]
