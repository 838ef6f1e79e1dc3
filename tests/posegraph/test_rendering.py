# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.posegraph import Id, MapState, Node, Submap
from slamcli.posegraph.node_trajectory import state_trajectory
from slamcli.posegraph.rendering import draw_state

FREE, WALL = 32767, 1


def state_of(*submaps: Submap, nodes: tuple[Node, ...] = ()) -> MapState:
    return MapState(nodes=nodes, submaps=submaps, constraints=())


def submap(number: int, grid: ProbabilityGrid | TsdfGrid | None, local: list[float], in_map: list[float]) -> Submap:
    return Submap(id=Id(0, number), T_local_submap=se3.from_se2(local), T_map_submap=se3.from_se2(in_map),
                  num_range_data=1, finished=True, grid=grid)  # fmt: skip


def test_a_submap_moves_with_its_optimised_pose() -> None:
    # The grid lies in the local frame; the submap was optimised from (1, 0) to (1, 2), turned by 90 degrees about itself.
    grid = ProbabilityGrid(np.array([[FREE, WALL]], np.uint16), 1.0, (1.0, 0.0))
    drawn = draw_state(
        state_of(submap(0, grid, [1.0, 0, 0], [1.0, 2.0, np.pi / 2]), submap(1, None, [0.0] * 3, [0.0] * 3))
    )
    rows, columns = np.nonzero(drawn.cells >= 0)
    centres = drawn.cell_to_map(np.column_stack([rows, columns]))
    found = {tuple(c): int(v) for c, v in zip(centres.round(6).tolist(), drawn.cells[rows, columns], strict=True)}
    assert found == {(0.5, 2.5): 0, (0.5, 3.5): 100}


def test_the_resolution_is_the_finest_without_cartographers_rounding() -> None:
    fine = float(np.float32(0.05))
    grids = [ProbabilityGrid(np.full((4, 4), FREE, np.uint16), resolution, (0.0, 0.0)) for resolution in (0.1, fine)]
    drawn = draw_state(state_of(*(submap(i, grid, [0.0] * 3, [0.0] * 3) for i, grid in enumerate(grids))))
    assert drawn.resolution_m == 0.05


def test_distances_are_drawn_as_walls_and_free_space() -> None:
    # Columns: unknown, behind the wall, on it, in front of it, far in front.
    distances = np.array([-0.2, 0.0, 0.1, 0.3])
    tsd = np.rint((distances + 0.3) / 0.6 * 32766 + 1).astype(np.uint16)
    tsd = np.concatenate([[0], tsd])[None].astype(np.uint16)
    grid = TsdfGrid(tsd, np.full_like(tsd, 5), 0.1, (0.0, 0.0), 0.3, 10.0)
    drawn = draw_state(state_of(submap(0, grid, [0.0] * 3, [0.0] * 3)))
    row = drawn.cells[(drawn.cells >= 0).any(axis=1)][0]
    assert row[row >= 0].tolist() == [100, 0, 0]


def test_a_trajectory_has_the_poses_of_the_nodes() -> None:
    nodes = tuple(
        Node(id=Id(t, i), stamp_ns=100 * t + i, T_local_node=np.eye(4), T_map_node=se3.from_se2([t, i, 0.5]),
             gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]), points_m=np.zeros((0, 3), np.float32))
        for t, i in ((1, 0), (0, 1), (0, 0))
    )  # fmt: skip
    state = state_of(nodes=nodes)
    found = state_trajectory(state, frame_id="world", child_frame_id="robot")
    assert found.stamps_ns.tolist() == [0, 1, 100]
    np.testing.assert_allclose(found.poses_se2, [[0, 0, 0.5], [0, 1, 0.5], [1, 0, 0.5]])
    assert (found.frame_id, found.child_frame_id) == ("world", "robot")
    assert state_trajectory(state, [1]).stamps_ns.tolist() == [100]
    with pytest.raises(EstimationError, match="no node"):
        state_trajectory(state, [2])


def test_a_state_without_planar_grids() -> None:
    with pytest.raises(EstimationError, match="no submap with a planar grid"):
        draw_state(state_of(submap(0, None, [0.0] * 3, [0.0] * 3)))
