# SPDX-License-Identifier: MIT
"""A grid of signed distances that scans were drawn into is the same after a state was saved and loaded, and goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_states import make_state

from slamcli.formats.pbstream.reading import read_state
from slamcli.formats.pbstream.writing import write_state
from slamcli.grids.tsdf_grid import TsdfGrid, TsdfInserter
from slamcli.registration.branch_and_bound import PrecomputedGrids
from slamcli.registration.grid_matching import LeastSquaresMatch, match_least_squares


def corner(shift=0.0):
    t = np.linspace(-1.5, 1.5, 90)
    walls = [np.column_stack([np.full(90, 2.0), t]), np.column_stack([t, np.full(90, 1.4)])]
    return np.concatenate(walls) + shift


@pytest.mark.parametrize("truncation", [0.3, 0.123])
def test_a_drawn_grid_comes_back_as_it_was(tmp_path, truncation):
    inserter = TsdfInserter()
    grid = inserter.insert(
        TsdfGrid.empty(0.05, (0.3, -0.2), truncation, 7.5),
        np.array([0.1, 0.2, 0.3]),
        np.zeros(2),
        corner(),
        np.empty((0, 2)),
    ).cropped()
    state = make_state("tsdf")
    submaps = [replace(submap, grid=grid) for submap in state.submaps]
    write_state(tmp_path / "state.pbstream", replace(state, submaps=tuple(submaps)))
    back = read_state(tmp_path / "state.pbstream").submaps[0].grid
    assert isinstance(back, TsdfGrid)
    np.testing.assert_array_equal(back.tsd, grid.tsd)
    np.testing.assert_array_equal(back.weights, grid.weights)
    np.testing.assert_allclose(back.origin, grid.origin, atol=1e-9)
    assert (back.resolution_m, back.truncation_distance_m, back.max_weight) == (0.05, truncation, 7.5)
    start = np.array([0.14, 0.17, 0.29])
    one, two = (
        match_least_squares(g, corner(), start, start, LeastSquaresMatch(occupied_space_weight=50.0))
        for g in (grid, back)
    )
    np.testing.assert_allclose(one[0], two[0], atol=1e-9)
    window = {"linear_m": 0.2, "angular_rad": 0.1, "min_score": 0.5}
    assert PrecomputedGrids(back, 3).search(corner(), start, **window) is not None
    grown = inserter.insert(back, np.array([0.1, 0.2, 0.3]), np.zeros(2), corner(4.0), np.empty((0, 2)))
    assert np.count_nonzero(grown.tsd) > np.count_nonzero(grid.tsd)
