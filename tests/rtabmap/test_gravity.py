# SPDX-License-Identifier: MIT
"""Which way is up at a node."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.measurements import ImuSample
from slamcli.rtabmap.gravity import GravityTrack, gravity_link
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.parameters import RtabmapParameters


def sample(stamp_ns: int, force: tuple[float, float, float], quat: np.ndarray | None = None) -> ImuSample:
    return ImuSample(
        stamp_ns=stamp_ns, frame_id="imu", topic="/imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.array(force),
        quat_xyzw=quat,
    )  # fmt: skip


def track(*samples: ImuSample, mount: np.ndarray | None = None) -> GravityTrack:
    made = GravityTrack(RtabmapParameters(), {"/imu": np.eye(4) if mount is None else mount})
    for one in samples:
        made.add(one)
    return made


def test_up_is_told_in_the_base() -> None:
    mount = se3.from_position_quaternion(np.zeros(3), quaternion.from_roll_pitch_yaw(np.pi / 2, 0.0, 0.0))
    found = track(*(sample(k * 10_000_000, (0.0, 9.81, 0.0)) for k in range(10)), mount=mount).at(52_000_000)
    assert found is not None
    np.testing.assert_allclose(found[2], mount[:3, :3] @ [0.0, 1.0, 0.0], atol=1e-9)


def test_the_devices_own_orientation_goes_first() -> None:
    quat = quaternion.from_roll_pitch_yaw(0.2, 0.0, 0.0)
    found = track(sample(0, (9.81, 0.0, 0.0), quat)).at(0)
    assert found is not None
    np.testing.assert_allclose(found, quaternion.to_matrix(quat), atol=1e-12)


def test_where_nothing_is_known() -> None:
    assert track().at(0) is None
    assert track(sample(0, (0.0, 0.0, 9.81))).at(60_000_000) is None
    assert track(sample(0, (0.0, 0.0, 1.0))).at(0) is None  # in g, or no gravity
    old = track(*(sample(k * 1_000_000_000, (0.0, 0.0, 9.81)) for k in range(30)))
    assert old.at(0) is None
    assert old.at(29_000_000_000) is not None


def test_the_link_is_of_the_node_with_itself() -> None:
    link = gravity_link(7, np.eye(3))
    assert (link.from_id, link.to_id, link.kind) == (7, 7, LinkKind.GRAVITY)
    np.testing.assert_array_equal(link.T_from_to, np.eye(4))
