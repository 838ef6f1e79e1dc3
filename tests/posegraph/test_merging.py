# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from slamcli.geometry import se3
from slamcli.measurements import ImuSample
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap, TrajectoryData, freeze, merge_states


def state(trajectories: tuple[int, ...], x: float) -> MapState:
    T = se3.from_se2([x, 0.0, 0.0])
    nodes = tuple(
        Node(id=Id(t, 0), stamp_ns=t, T_local_node=T, T_map_node=T, gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]),
             points_m=np.zeros((0, 3), np.float32))
        for t in trajectories
    )  # fmt: skip
    submaps = tuple(
        Submap(id=Id(t, 4), T_local_submap=T, T_map_submap=T, num_range_data=1, finished=True) for t in trajectories
    )
    constraint = Constraint(submap=submaps[0].id, node=nodes[-1].id, T_submap_node=T, translation_weight=1.0,
                            rotation_weight=2.0, kind="inter")  # fmt: skip
    imu = ImuSample(stamp_ns=5, frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.zeros(3))
    return MapState(
        nodes=nodes, submaps=submaps, constraints=(constraint,), imu={trajectories[-1]: (imu,)},
        landmarks={"door": T}, options={trajectories[0]: b"a"}, trajectory_data={trajectories[0]: TrajectoryData()},
    )  # fmt: skip


def test_trajectories_are_numbered_anew() -> None:
    merged = merge_states([state((1, 5), 0.0), freeze(state((0,), 7.0))])
    assert merged.trajectories == (0, 1, 2)
    assert [node.id for node in merged.nodes] == [(0, 0), (1, 0), (2, 0)]
    assert [submap.id for submap in merged.submaps] == [(0, 4), (1, 4), (2, 4)]
    assert [(c.submap, c.node) for c in merged.constraints] == [((0, 4), (1, 0)), ((2, 4), (2, 0))]
    assert merged.frozen == {2}
    assert sorted(merged.imu) == [1, 2]
    assert sorted(merged.options) == sorted(merged.trajectory_data) == [0, 2]
    assert merged.nodes[2].T_map_node[0, 3] == 7.0
    assert merged.landmarks["door"][0, 3] == 0.0  # the first one's pose


def test_one_state_and_none() -> None:
    assert merge_states([state((0,), 1.0)]).trajectories == (0,)
    empty = merge_states([])
    assert empty.trajectories == ()
    assert empty.frozen == frozenset()


def test_a_trajectory_of_sensor_data_alone_keeps_its_place() -> None:
    bare = MapState(nodes=(), submaps=(), constraints=(), options={0: b"a", 3: b"b"})
    merged = merge_states([bare, state((0,), 1.0)])
    assert merged.options == {0: b"a", 1: b"b", 2: b"a"}
    assert merged.trajectories == (2,)
