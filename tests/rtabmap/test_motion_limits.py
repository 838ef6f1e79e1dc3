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


def test_a_step_that_nothing_makes_is_told() -> None:
    found = limits()
    for k in range(20):  # ten frames a second at 0.5 m/s, and 3 m between two of them
        found.begins_anew(step(0.1 * k, 0.05 * k + (3.0 if k > 9 else 0.0)))
    assert found.jumps.startswith("the odometry jumps 1 times, first by 3.0 m at 1.000 s")


def test_a_car_does_not_jump() -> None:
    found = limits()
    for k in range(30):  # at 35 m/s when the recording begins, braking at 8 m/s^2, frames missing
        if k not in (12, 13):
            found.begins_anew(step(0.1 * k, 3.5 * k - 0.04 * k**2, lost=k == 20))
    assert found.jumps == ""
