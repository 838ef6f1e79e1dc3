# SPDX-License-Identifier: MIT
"""Two active submaps: when they begin, what is drawn into them, when they end."""

from __future__ import annotations

import numpy as np
from box_room import seen

from slamcli.cartographer.parameters import Submaps2d
from slamcli.cartographer.submaps_2d import ActiveSubmaps2d
from slamcli.registration.grid_matching import mean_probability


def filled(count, limit=5):
    submaps, pose = ActiveSubmaps2d(Submaps2d(num_range_data=limit)), np.zeros(3)
    held = [[submap.number for submap in submaps.insert(k, pose, seen(pose, 60))] for k in range(count)]
    return submaps, held


def test_submaps_overlap_by_half_and_hold_twice_the_number():
    submaps, held = filled(23)
    assert held == [[0]] * 5 + [[0, 1]] * 5 + [[1, 2]] * 5 + [[2, 3]] * 5 + [[3, 4]] * 3
    assert [submap.num_range_data for submap in submaps.all] == [10, 10, 10, 8, 3]
    assert [submap.finished for submap in submaps.all] == [True, True, True, False, False]
    assert submaps.all[1].nodes == list(range(5, 15))
    assert [submap.number for submap in submaps.active] == [3, 4]


def test_scans_are_matched_with_the_older_one():
    submaps, _ = filled(0)
    assert submaps.matching is None
    for count, number in ((1, 0), (5, 0), (6, 0), (10, 0), (11, 1), (15, 1), (16, 2)):
        submaps, _ = filled(count)
        assert submaps.matching is not None
        assert submaps.matching.number == number


def test_a_finished_submap_is_cropped_and_matches_as_before():
    submaps, _ = filled(9)
    before = submaps.all[0].grid
    submaps.insert(9, np.zeros(3), seen(np.zeros(3), 60))
    after = submaps.all[0].grid
    assert submaps.all[0].finished
    assert after.cells.size < before.cells.size
    points = seen(np.zeros(3), 60).returns
    assert mean_probability(after, points, np.zeros(3)) >= mean_probability(before, points, np.zeros(3)) > 0.7


def test_a_submap_lies_where_its_first_beams_started():
    submaps, pose = ActiveSubmaps2d(Submaps2d(num_range_data=2)), np.array([0.3, -0.2, 0.5])
    data = seen(pose, 60)
    data.start[:] = [0.1, 0.05]
    submaps.insert(0, pose, data)
    expected = [0.3 + 0.1 * np.cos(0.5) - 0.05 * np.sin(0.5), -0.2 + 0.1 * np.sin(0.5) + 0.05 * np.cos(0.5), 0.0]
    np.testing.assert_allclose(submaps.all[0].local_pose, expected, atol=1e-12)


def test_the_parameters_reach_the_grid():
    parameters = Submaps2d(num_range_data=2)
    assert ActiveSubmaps2d(parameters).insert(0, np.zeros(3), seen(np.zeros(3), 60))[0].grid.resolution_m == 0.05
