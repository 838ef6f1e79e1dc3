# SPDX-License-Identifier: MIT
"""Names and defaults of Cartographer's parameters."""

from __future__ import annotations

import math

import pytest

from slamcli.cartographer import CartographerParameters
from slamcli.errors import ConfigError
from slamcli.parameters import as_dict, declarations, resolve

# Facts of the followed system: a selection over all tables.
DEFAULTS = {
    "MAP_BUILDER.num_background_threads": 4,
    "TRAJECTORY_BUILDER.collate_fixed_frame": True,
    "TRAJECTORY_BUILDER_2D.missing_data_ray_length": 5.0,
    "TRAJECTORY_BUILDER_2D.loop_closure_adaptive_voxel_filter.max_length": 0.9,
    "TRAJECTORY_BUILDER_2D.loop_closure_adaptive_voxel_filter.min_num_points": 100.0,
    "TRAJECTORY_BUILDER_2D.adaptive_voxel_filter.min_num_points": 200.0,
    "TRAJECTORY_BUILDER_2D.real_time_correlative_scan_matcher.angular_search_window": math.radians(20),
    "TRAJECTORY_BUILDER_2D.ceres_scan_matcher.rotation_weight": 40.0,
    "TRAJECTORY_BUILDER_2D.ceres_scan_matcher.ceres_solver_options.max_num_iterations": 20,
    "TRAJECTORY_BUILDER_2D.pose_extrapolator.constant_velocity.pose_queue_duration": 0.001,
    "TRAJECTORY_BUILDER_2D.pose_extrapolator.imu_based.gravity_constant": 9.806,
    "TRAJECTORY_BUILDER_2D.submaps.range_data_inserter.tsdf_range_data_inserter.truncation_distance": 0.3,
    "TRAJECTORY_BUILDER_3D.high_resolution_adaptive_voxel_filter.max_range": 15.0,
    "TRAJECTORY_BUILDER_3D.low_resolution_adaptive_voxel_filter.max_length": 4.0,
    "TRAJECTORY_BUILDER_3D.real_time_correlative_scan_matcher.linear_search_window": 0.15,
    "TRAJECTORY_BUILDER_3D.ceres_scan_matcher.occupied_space_weight_1": 6.0,
    "TRAJECTORY_BUILDER_3D.ceres_scan_matcher.ceres_solver_options.max_num_iterations": 12,
    "TRAJECTORY_BUILDER_3D.ceres_scan_matcher.intensity_cost_function_options_0.huber_scale": 0.3,
    "TRAJECTORY_BUILDER_3D.motion_filter.max_angle_radians": 0.004,
    "TRAJECTORY_BUILDER_3D.rotational_histogram_size": 120,
    "TRAJECTORY_BUILDER_3D.submaps.range_data_inserter.num_free_space_voxels": 2,
    "POSE_GRAPH.optimize_every_n_nodes": 90,
    "POSE_GRAPH.constraint_builder.loop_closure_translation_weight": 1.1e4,
    "POSE_GRAPH.constraint_builder.fast_correlative_scan_matcher_3d.min_rotational_score": 0.77,
    "POSE_GRAPH.constraint_builder.ceres_scan_matcher.occupied_space_weight": 20.0,
    "POSE_GRAPH.constraint_builder.ceres_scan_matcher.ceres_solver_options.use_nonmonotonic_steps": True,
    "POSE_GRAPH.constraint_builder.ceres_scan_matcher_3d.occupied_space_weight_1": 30.0,
    "POSE_GRAPH.constraint_builder.ceres_scan_matcher_3d.ceres_solver_options.max_num_iterations": 10,
    "POSE_GRAPH.matcher_rotation_weight": 1.6e3,
    "POSE_GRAPH.optimization_problem.acceleration_weight": 1.1e2,
    "POSE_GRAPH.optimization_problem.rotation_weight": 1.6e4,
    "POSE_GRAPH.optimization_problem.fixed_frame_pose_use_tolerant_loss": False,
    "POSE_GRAPH.optimization_problem.ceres_solver_options.num_threads": 7,
    "POSE_GRAPH.global_sampling_ratio": 0.003,
    "POSE_GRAPH.global_constraint_search_after_n_seconds": 10.0,
}


def test_defaults_are_those_of_the_followed_system():
    values = as_dict(CartographerParameters())
    assert {name: values[name] for name in DEFAULTS} == DEFAULTS
    own = [entry for entry in declarations(CartographerParameters) if not entry.extension]
    assert len(own) == 208
    assert sum(entry.name.startswith("POSE_GRAPH.") for entry in own) == 62
    assert all(entry.help for entry in own)


def test_values_are_reached_under_the_names_of_the_tables():
    p = resolve(
        CartographerParameters,
        {
            "TRAJECTORY_BUILDER_2D.real_time_correlative_scan_matcher.linear_search_window": 0.3,
            "POSE_GRAPH.optimization_problem.huber_scale": "1e2",
            "TRAJECTORY_BUILDER_3D.submaps.num_range_data": 40.0,
            "use_odometry": False,
        },
    )
    assert p.trajectory_builder_2d.real_time_correlative_scan_matcher.linear_search_window == 0.3
    assert p.trajectory_builder_3d.real_time_correlative_scan_matcher.linear_search_window == 0.15
    assert p.pose_graph.optimization_problem.huber_scale == 100.0
    assert p.trajectory_builder_3d.submaps.num_range_data == 40
    assert p.options.use_odometry is False
    assert p.options.use_landmarks is None


def test_trimmers_are_on_when_a_key_of_theirs_is_given():
    p = CartographerParameters()
    assert not p.trajectory_builder.pure_localization_trimmer.is_on
    assert not p.pose_graph.overlapping_submaps_trimmer_2d.is_on
    p = resolve(
        CartographerParameters,
        {
            "TRAJECTORY_BUILDER.pure_localization_trimmer.max_submaps_to_keep": 3,
            "POSE_GRAPH.overlapping_submaps_trimmer_2d.min_covered_area": 4,
        },
    )
    assert p.trajectory_builder.pure_localization_trimmer.is_on
    trimmer = p.pose_graph.overlapping_submaps_trimmer_2d
    assert trimmer.is_on
    filled = trimmer.filled()
    assert (filled.fresh_submaps_count, filled.min_covered_area, filled.min_added_submaps_count) == (1, 4.0, 5)


@pytest.mark.parametrize(("two", "three", "dimensions"), [(1, 0, 2), (0, 1, 3), (0, 0, None), (None, None, None)])
def test_dimensions(two, three, dimensions):
    values = {"MAP_BUILDER.use_trajectory_builder_2d": two, "MAP_BUILDER.use_trajectory_builder_3d": three}
    given = {name: bool(value) for name, value in values.items() if value is not None}
    assert resolve(CartographerParameters, given).map_builder.dimensions == dimensions


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"MAP_BUILDER.use_trajectory_builder_2d": 1, "MAP_BUILDER.use_trajectory_builder_3d": 1}, "set one of them"),
        ({"TRAJECTORY_BUILDER_2D.min_range": 31}, "min_range must be below max_range"),
        ({"TRAJECTORY_BUILDER_3D.max_range": 1}, "min_range must be below max_range"),
        ({"TRAJECTORY_BUILDER_2D.min_z": 3}, "min_z must not be above max_z"),
        ({"TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.grid_type": "TSDF"}, "set it to TSDF_INSERTER_2D"),
        ({"TRAJECTORY_BUILDER.pure_localization_trimmer.max_submaps_to_keep": 1}, "between 2 and"),
        ({"rangefinder_sampling_ratio": 1.5}, "between 0 and 1"),
        ({"TRAJECTORY_BUILDER_2D.max_range": float("inf")}, "between 0.001 and 1e"),
        ({"TRAJECTORY_BUILDER_2D.max_range": float("nan")}, "not a number"),
        ({"POSE_GRAPH.constraint_builder.min_scor": 1}, r"did you mean POSE_GRAPH\.constraint_builder\.min_score"),
        ({"max_range": 1}, r"did you mean TRAJECTORY_BUILDER_2D\.max_range"),
        ({"min_score": 1}, r"did you mean POSE_GRAPH\.constraint_builder\.min_score"),
        (
            {"TRAJECTORY_BUILDER_2D.pure_localization_trimmer.max_submaps_to_keep": 3},
            r"did you mean TRAJECTORY_BUILDER\.pure_localization_trimmer\.max_submaps_to_keep",
        ),
    ],
)
def test_values_that_cannot_be_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        resolve(CartographerParameters, values)


def test_tsdf_is_chosen_by_both_of_its_keys():
    submaps = resolve(
        CartographerParameters,
        {
            "TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.grid_type": "TSDF",
            "TRAJECTORY_BUILDER_2D.submaps.range_data_inserter.range_data_inserter_type": "TSDF_INSERTER_2D",
        },
    ).trajectory_builder_2d.submaps
    assert submaps.grid_options_2d.grid_type == "TSDF"
