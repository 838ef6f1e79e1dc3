# SPDX-License-Identifier: MIT
"""Legacy names of ORB-SLAM's settings (ORB-SLAM2, ORB-SLAM3 before 1.0) and of its ROS nodes."""

from __future__ import annotations

import dataclasses

from slamcli.native.settings import Setting

_LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
LEGACY = {
    **{f"Camera.{name}": f"Camera1.{name}" for name in _LENS},
    "Camera.lappingBegin": "Camera1.overlappingBegin",
    "Camera.lappingEnd": "Camera1.overlappingEnd",
    "Camera2.lappingBegin": "Camera2.overlappingBegin",
    "Camera2.lappingEnd": "Camera2.overlappingEnd",
    "Lapping.left": "Camera1.overlappingBegin",
    "Lapping.right": "Camera1.overlappingEnd",
    "InsertKFsWhenLost": "IMU.InsertKFsWhenLost",
    "Camera.b": "Stereo.b",
    "ThDepth": "Stereo.ThDepth",
    "DepthMapFactor": "RGBD.DepthMapFactor",
    "thFarPoints": "System.thFarPoints",
    "Tbc": "IMU.T_b_c1",
    "Tlr": "Stereo.T_c1_c2",
    "vocabulary": "slamcli.vocabulary",
}
"""Name in schema 1.0 by legacy name."""
NODES = ("orb_slam3", "orb_slam3_ros_node", "orb_slam2", "orb_slam2_ros_node")
NODE_PACKAGES = ("orb_slam3_ros", "orb_slam3_ros_wrapper", "orb_slam2_ros", "ORB_SLAM3", "ORB_SLAM2")


def canonical(name: str) -> str:
    """Return the name in schema 1.0 of a parameter in either schema."""
    return LEGACY.get(name, name)


def renamed(setting: Setting) -> Setting:
    """Return a setting under its name in schema 1.0."""
    return dataclasses.replace(setting, name=canonical(setting.name))
