# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.parameters.map_builder import PureLocalizationTrimmer
from slamcli.cartographer.parameters.pose_graph import OverlappingSubmapsTrimmer2d
from slamcli.cartographer.trimming import trimmed
from slamcli.geometry import se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.mapper import MappingResult, Setup
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.trajectory import Trajectory

DEFAULT = CartographerParameters()


def a_result(trajectory: int = 0) -> MappingResult:
    """Six submaps side by side, the last three over the first three."""
    grid = ProbabilityGrid(np.ones((20, 20), np.uint16), 0.1, (0.0, 0.0))
    submaps = tuple(
        Submap(id=Id(trajectory, k), T_local_submap=np.eye(4), T_map_submap=se3.from_se2([2.0 * (k % 3), 0.0, 0.0]),
               num_range_data=2, finished=True, grid=grid)
        for k in range(6)
    )  # fmt: skip
    nodes = tuple(
        Node(id=submap.id, stamp_ns=k, T_local_node=np.eye(4), T_map_node=np.eye(4), points_m=np.zeros((0, 3), np.float32),
             gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]))
        for k, submap in enumerate(submaps)
    )  # fmt: skip
    constraints = tuple(
        Constraint(submap=node.id, node=node.id, T_submap_node=np.eye(4), kind="intra", translation_weight=1.0, rotation_weight=1.0)
        for node in nodes
    )  # fmt: skip
    state = MapState(nodes=nodes, submaps=submaps, constraints=constraints)
    return MappingResult(trajectory=Trajectory.from_se2([0], [[0.0, 0.0, 0.0]]), state=state)


def test_without_trimmers_the_result_is_left_alone() -> None:
    result = a_result()
    assert trimmed(result, DEFAULT, Setup(T_base_laser={})) is result
    bare = MappingResult(trajectory=result.trajectory)
    assert trimmed(bare, DEFAULT, Setup(T_base_laser={})) is bare


def test_pure_localisation_keeps_the_newest_submaps_of_the_new_trajectory() -> None:
    builder = replace(
        DEFAULT.trajectory_builder, pure_localization_trimmer=PureLocalizationTrimmer(max_submaps_to_keep=2)
    )
    parameters = replace(DEFAULT, trajectory_builder=builder)
    loaded = a_result(0).state
    new = a_result(1)
    assert loaded is not None
    assert new.state is not None
    both = replace(new.state, nodes=loaded.nodes + new.state.nodes, submaps=loaded.submaps + new.state.submaps,
                   constraints=loaded.constraints + new.state.constraints)  # fmt: skip
    left = trimmed(replace(new, state=both), parameters, Setup(T_base_laser={}, state=loaded))
    assert left.state is not None
    assert [tuple(submap.id) for submap in left.state.submaps[6:]] == [(1, 4), (1, 5)]
    assert len(left.state.submaps) == 8
    assert left.summary["trimmed_submaps"] == 4


def test_covered_submaps_are_dropped_and_the_map_is_drawn_anew() -> None:
    trimmer = OverlappingSubmapsTrimmer2d(min_covered_area=1.0)
    parameters = replace(DEFAULT, pose_graph=replace(DEFAULT.pose_graph, overlapping_submaps_trimmer_2d=trimmer))
    setup = Setup(T_base_laser={})
    left = trimmed(a_result(), parameters, setup)
    assert left.state is not None
    assert [submap.id.number for submap in left.state.submaps] == [3, 4, 5]
    assert left.grid is not None
    assert (left.grid.cells == 100).sum() == 20 * 60
    assert setup.log.notes == ["3 submaps were trimmed from the state, 3 are left"]
