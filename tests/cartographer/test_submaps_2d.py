# SPDX-License-Identifier: MIT
"""Two active submaps: when they begin, what is drawn into them, when they end."""

from __future__ import annotations

import numpy as np
import pytest
from box_room import seen

from slamcli.cartographer.parameters import Submaps2d, TsdfInserter
from slamcli.cartographer.parameters.trajectory_builder_2d import GridOptions2d, NormalEstimation, RangeDataInserter2d
from slamcli.cartographer.submaps_2d import ActiveSubmaps2d, note_of
from slamcli.errors import ConfigError
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid
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


def tsdf(**options):
    return Submaps2d(
        num_range_data=2,
        grid_options_2d=GridOptions2d(grid_type="TSDF", resolution=0.1),
        range_data_inserter=RangeDataInserter2d(
            range_data_inserter_type="TSDF_INSERTER_2D", tsdf_range_data_inserter=TsdfInserter(**options)
        ),
    )


def drawn(parameters):
    return ActiveSubmaps2d(parameters).insert(0, np.zeros(3), seen(np.zeros(3), 60))[0].grid


def test_the_parameters_choose_the_grid():
    assert isinstance(drawn(Submaps2d()), ProbabilityGrid)
    assert drawn(Submaps2d(grid_options_2d=GridOptions2d(resolution=0.2))).resolution_m == 0.2
    grid = drawn(tsdf(truncation_distance=0.4, maximum_weight=6.0))
    assert isinstance(grid, TsdfGrid)
    assert (grid.resolution_m, grid.truncation_distance_m, grid.max_weight) == (0.1, 0.4, 6.0)


@pytest.mark.parametrize(
    "options",
    [
        {"update_free_space": True},
        {"project_sdf_distance_to_scan_normal": False},
        {"update_weight_range_exponent": 1},
        {"update_weight_angle_scan_normal_to_ray_kernel_bandwidth": 0.0},
        {"update_weight_distance_cell_to_hit_kernel_bandwidth": 0.1},
        {"normal_estimation_options": NormalEstimation(num_normal_samples=1)},
        {"normal_estimation_options": NormalEstimation(sample_radius=0.05)},
    ],
    ids=str,
)
def test_every_option_of_signed_distances_reaches_the_grid(options):
    plain, changed = drawn(tsdf()), drawn(tsdf(**options))
    assert (
        plain.tsd.shape != changed.tsd.shape
        or (plain.tsd != changed.tsd).any()
        or (plain.weights != changed.weights).any()
    )


def test_a_grid_and_an_inserter_that_do_not_go_together_are_refused():
    with pytest.raises(
        ConfigError, match="PROBABILITY_GRID_INSERTER_2D does not go with grid_type TSDF: set it to TSDF_INSERTER_2D"
    ):
        Submaps2d(grid_options_2d=GridOptions2d(grid_type="TSDF"))


def test_a_map_that_knows_only_bands_is_announced():
    assert note_of(Submaps2d()) == note_of(tsdf(update_free_space=True)) == ""
    assert "free space is known within 0.4 m of surfaces only" in note_of(tsdf(truncation_distance=0.4))
