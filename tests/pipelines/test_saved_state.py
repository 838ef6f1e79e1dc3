# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.formats.pbstream.writing import write_state
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.mapper import find_resuming_tier
from slamcli.pipelines.saved_state import check_dimensions, load_states, state_summary
from slamcli.posegraph import Id, MapState, Submap
from slamcli.runtime import RunLog

FLAT = ProbabilityGrid(np.ones((2, 2), np.uint16), 0.05, (0.0, 0.0))
VOXELS = HybridGrid(np.zeros((1, 3), np.int32), np.ones(1, np.uint16), 0.1)


def state(**content) -> MapState:
    T = np.eye(4)
    submap = Submap(id=Id(0, 0), T_local_submap=T, T_map_submap=T, num_range_data=1, finished=True, **content)
    return MapState(nodes=(), submaps=(submap,), constraints=())


def test_a_state_of_other_dimensions_is_refused() -> None:
    flat, spatial = state(grid=FLAT), state(high_resolution=VOXELS)
    check_dimensions(flat, spatial=False)
    check_dimensions(spatial, spatial=True)
    check_dimensions(None, spatial=True)
    check_dimensions(MapState(nodes=(), submaps=(), constraints=()), spatial=True)
    with pytest.raises(UsageError, match="the state is a 2D map, and this run maps in 3D: --mode 2d"):
        check_dimensions(flat, spatial=True)
    with pytest.raises(UsageError, match="the state is a 3D map, and this run maps in 2D: --mode 3d"):
        check_dimensions(spatial, spatial=False)


def test_only_tiers_with_states_take_them() -> None:
    assert find_resuming_tier("cartographer", "--load-state").resumes
    with pytest.raises(UsageError, match="--load-state: gmapping has no state"):
        find_resuming_tier("gmapping", "--load-state")


def test_states_are_joined_and_frozen_as_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.pbstream"
    write_state(path, state(grid=FLAT))
    joined = load_states([path], [path, path], RunLog())
    assert joined is not None
    assert joined.trajectories == (0, 1, 2)
    assert joined.frozen == {1, 2}
    assert load_states([], [], RunLog()) is None
    assert state_summary(joined)["submaps"] == 3
