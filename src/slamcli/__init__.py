# SPDX-License-Identifier: MIT
"""From a robot's recording to a map, a trajectory, a score and a path, without ROS."""

__version__ = "0.1.0"
