# SPDX-License-Identifier: MIT
"""Which way is up at a node."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample
from slamcli.parameters import resolve
from slamcli.rtabmap.gravity import GravityTrack, gravity_link, gravity_track
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
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
    found = track(*(sample(k * 10_000_000, (0.0, 9.81, 0.0)) for k in range(10)), mount=mount).at(52_000_000, np.eye(4))
    assert found is not None
    np.testing.assert_allclose(found[2], mount[:3, :3] @ [0.0, 1.0, 0.0], atol=1e-9)


def test_the_devices_own_orientation_goes_first() -> None:
    quat = quaternion.from_roll_pitch_yaw(0.2, 0.0, 0.0)
    found = track(sample(0, (9.81, 0.0, 0.0), quat)).at(0, np.eye(4))
    assert found is not None
    np.testing.assert_allclose(found, quaternion.to_matrix(quat), atol=1e-12)


def test_where_nothing_is_known() -> None:
    assert track().at(0, np.eye(4)) is None
    assert track(sample(0, (0.0, 0.0, 9.81))).at(60_000_000, np.eye(4)) is None
    assert track(sample(0, (0.0, 0.0, 1.0))).at(0, np.eye(4)) is None  # in g, or no gravity
    old = track(*(sample(k * 1_000_000_000, (0.0, 0.0, 9.81)) for k in range(30)))
    assert old.at(0, np.eye(4)) is None
    assert old.at(29_000_000_000, np.eye(4)) is not None


def test_the_link_is_of_the_node_with_itself() -> None:
    link = gravity_link(7, np.eye(3))
    assert (link.from_id, link.to_id, link.kind) == (7, 7, LinkKind.GRAVITY)
    np.testing.assert_array_equal(link.T_from_to, np.eye(4))


def test_gravity_counts_where_it_can() -> None:
    setup = Setup(T_base_laser={}, T_base_sensor={"/imu": np.eye(4)})
    for given, there in (({}, True), ({"Optimizer/GravitySigma": 0.0}, False), ({"Reg/Force3DoF": True}, False)):
        found = gravity_track(resolve(RtabmapParameters, given), setup)
        assert (found is not None) == there


def test_a_merged_node_takes_its_gravity_along() -> None:
    graph = MapGraph()
    for node_id in (1, 2):
        graph.add_node(GraphNode(id=node_id, map_id=0, stamp_ns=node_id, T_odom_base=np.eye(4)), np.eye(4))
        graph.add_link(gravity_link(node_id, np.eye(3)))
    graph.merge(2, 1)
    assert [(link.from_id, link.to_id) for link in graph.links] == [(1, 1)]


def test_odometry_may_say_which_way_is_up() -> None:
    by_odometry = GravityTrack(resolve(RtabmapParameters, {"Mem/UseOdomGravity": True}), {})
    T = se3.from_position_quaternion(np.ones(3), quaternion.from_roll_pitch_yaw(0.1, 0.2, 0.3))
    np.testing.assert_array_equal(by_odometry.at(0, T), T[:3, :3])
