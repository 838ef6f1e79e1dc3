# SPDX-License-Identifier: MIT
"""Residuals of constraints: zero where poses agree, the offset where they do not, NaN where a part is gone."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import quaternion, se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.posegraph.constraint_residuals import constraint_residuals, rotation_angle

T_MAP_SUBMAP = se3.from_se2([1.0, 2.0, 0.7])
T_MAP_NODE = se3.from_se2([3.0, -1.0, -2.0])


def state(T_submap_node, *, planar=True, tilt=None, submap_number=0):
    grid = ProbabilityGrid(np.zeros((2, 2), dtype=np.uint16), 0.05, (0.0, 0.0)) if planar else None
    gravity = np.array([0.0, 0.0, 0.0, 1.0]) if tilt is None else tilt
    T_map_node = T_MAP_NODE @ se3.from_position_quaternion(np.zeros(3), gravity)
    node = Node(
        id=Id(0, 0), stamp_ns=0, T_local_node=np.eye(4), T_map_node=T_map_node, gravity_alignment_xyzw=gravity,
        points_m=np.zeros((0, 3), dtype=np.float32),
    )  # fmt: skip
    submap = Submap(
        id=Id(0, 0), T_local_submap=np.eye(4), T_map_submap=T_MAP_SUBMAP, num_range_data=1, finished=True, grid=grid
    )
    constraint = Constraint(
        submap=Id(0, submap_number), node=Id(0, 0), T_submap_node=T_submap_node,
        translation_weight=1.0, rotation_weight=1.0, kind="inter",
    )  # fmt: skip
    return MapState(nodes=(node,), submaps=(submap,), constraints=(constraint,))


def test_poses_that_agree_have_no_residual():
    translation, rotation = constraint_residuals(state(np.linalg.inv(T_MAP_SUBMAP) @ T_MAP_NODE))
    assert translation[0] == pytest.approx(0.0, abs=1e-12)
    assert rotation[0] == pytest.approx(0.0, abs=1e-12)


def test_the_offset_is_told_in_metres_and_radians():
    offset = se3.from_se2([0.3, -0.4, 0.05])
    translation, rotation = constraint_residuals(
        state(np.linalg.inv(T_MAP_SUBMAP) @ T_MAP_NODE @ np.linalg.inv(offset))
    )
    assert translation[0] == pytest.approx(0.5)
    assert rotation[0] == pytest.approx(0.05)


def test_the_whole_orientation_counts_in_the_plane_too():
    tilt = quaternion.from_roll_pitch_yaw(0.1, 0.0, 0.0)
    T_submap_node = np.linalg.inv(T_MAP_SUBMAP) @ T_MAP_NODE
    T_tilted = T_submap_node @ se3.from_position_quaternion(np.zeros(3), tilt)
    for planar in (True, False):
        assert constraint_residuals(state(T_submap_node, tilt=tilt, planar=planar))[1][0] == pytest.approx(0.1)
        assert constraint_residuals(state(T_tilted, tilt=tilt, planar=planar))[1][0] == pytest.approx(0.0, abs=1e-9)


def test_what_was_trimmed_is_nan_and_nothing_is_empty():
    translation, rotation = constraint_residuals(state(np.eye(4), submap_number=7))
    assert np.isnan([translation[0], rotation[0]]).all()
    translation, rotation = constraint_residuals(MapState(nodes=(), submaps=(), constraints=()))
    assert translation.shape == rotation.shape == (0,)


def test_angles_of_rotations():
    angles = np.array([0.0, 1e-9, 0.5, np.pi])
    rotations = quaternion.to_matrix(quaternion.from_yaw(angles))
    np.testing.assert_allclose(rotation_angle(rotations), angles, atol=1e-12)
