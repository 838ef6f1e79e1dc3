# SPDX-License-Identifier: MIT
"""Speed at which no node is made, and jumps of odometry."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3
from slamcli.parameters import resolve
from slamcli.rtabmap.motion_limits import MotionLimits
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.parameters import RtabmapParameters


def step(stamp_s: float, x: float, yaw: float = 0.0, *, lost: bool = False, anew: bool = False) -> OdometryStep:
    pose = None if lost else se3.from_se2(np.array([x, 0.0, yaw]))
    return OdometryStep(stamp_ns=int(stamp_s * 1e9), T_odom_base=pose, covariance=np.zeros((6, 6)), began_anew=anew)


def limits(**values: float) -> MotionLimits:
    return MotionLimits(resolve(RtabmapParameters, {f"RGBD/{name}": value for name, value in values.items()}).rgbd)


def test_nothing_is_limited_by_default() -> None:
    found = limits()
    assert [found.begins_anew(step(k, 100.0 * k, k)) for k in range(3)] == [False] * 3
    assert not found.too_fast


def test_too_fast() -> None:
    found = limits(LinearSpeedUpdate=0.5, AngularSpeedUpdate=0.3)
    for one, fast in ((step(0, 0), False), (step(1, 0.4), False), (step(2, 1.0), True), (step(3, 1.0, 0.4), True)):
        found.begins_anew(one)
        assert found.too_fast == fast


def test_a_jump_begins_a_map() -> None:
    found = limits(NewMapOdomChangeDistance=1.0)
    steps = [step(0, 0), step(1, 0.9), step(2, 2.0), step(3, 0, lost=True), step(4, 9.0), step(5, 20.0, anew=True)]
    assert [found.begins_anew(one) for one in steps] == [False, False, True, False, False, False]
