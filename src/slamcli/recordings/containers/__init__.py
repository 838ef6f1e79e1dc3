# SPDX-License-Identifier: MIT
"""Containers: ROS 1 bags, ROS 2 bags, MCAP files, read and written as undecoded messages."""

from slamcli.recordings.containers.reader import open_raw
from slamcli.recordings.containers.writer import FORMATS, create_raw

__all__ = ["FORMATS", "create_raw", "open_raw"]
