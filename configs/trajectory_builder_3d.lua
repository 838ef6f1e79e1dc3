-- SPDX-License-Identifier: MIT
-- Cartographer's TRAJECTORY_BUILDER_3D with its defaults, for other files to include.
-- Written by .ci/parameter_tables.py from slamcli's declarations.

TRAJECTORY_BUILDER_3D = {
  min_range = 1.0,  -- nearer points are left out [m]
  max_range = 60.0,  -- farther points are left out [m]
  num_accumulated_range_data = 1,  -- messages that make one scan to match
  voxel_filter_size = 0.15,  -- edge of the voxels that thin a scan [m]
  high_resolution_adaptive_voxel_filter = {
    max_length = 2.0,  -- largest edge of a voxel [m]
    min_num_points = 150.0,  -- the edge shrinks until at least this many points are left [points]
    max_range = 15.0,  -- points farther than this are left out [m]
  },
  low_resolution_adaptive_voxel_filter = {
    max_length = 4.0,  -- largest edge of a voxel [m]
    min_num_points = 200.0,  -- the edge shrinks until at least this many points are left [points]
    max_range = 60.0,  -- points farther than this are left out [m]
  },
  use_online_correlative_scan_matching = false,  -- search around the prediction before the alignment
  real_time_correlative_scan_matcher = {
    linear_search_window = 0.15,  -- half width of the search in each direction [m]
    angular_search_window = math.rad(1),  -- half width of the search in heading [rad]
    translation_delta_cost_weight = 0.1,  -- how a score falls with the distance from the prediction
    rotation_delta_cost_weight = 0.1,  -- how a score falls with the angle from the prediction
  },
  ceres_scan_matcher = {
    occupied_space_weight_0 = 1.0,  -- weight of the points on obstacles of the high resolution grid
    occupied_space_weight_1 = 6.0,  -- weight of the points on obstacles of the low resolution grid
    intensity_cost_function_options_0 = {
      weight = 0.5,
      huber_scale = 0.3,
      intensity_threshold = 40.0,
    },
    translation_weight = 5.0,  -- weight of staying where the search started
    rotation_weight = 400.0,  -- weight of keeping the orientation that was predicted
    only_optimize_yaw = false,  -- leave roll and pitch as predicted
    ceres_solver_options = {
      use_nonmonotonic_steps = false,
      max_num_iterations = 12,  -- iterations at most
      num_threads = 1,
    },
  },
  motion_filter = {
    max_time_seconds = 0.5,  -- a scan is inserted after this time [s]
    max_distance_meters = 0.1,  -- a scan is inserted after this way [m]
    max_angle_radians = 0.004,  -- a scan is inserted after this turn [rad]
  },
  rotational_histogram_size = 120,  -- buckets over half a turn of the histogram of directions
  imu_gravity_time_constant = 10.0,
  pose_extrapolator = {
    use_imu_based = false,
    constant_velocity = {
      imu_gravity_time_constant = 10.0,  -- time over which the direction of gravity is averaged [s]
      pose_queue_duration = 0.001,  -- poses kept to estimate velocities from, at least this long [s]
    },
    imu_based = {
      pose_queue_duration = 5.0,
      gravity_constant = 9.806,
      pose_translation_weight = 1.0,
      pose_rotation_weight = 1.0,
      imu_acceleration_weight = 1.0,
      imu_rotation_weight = 1.0,
      odometry_translation_weight = 1.0,
      odometry_rotation_weight = 1.0,
      solver_options = {
        use_nonmonotonic_steps = false,
        max_num_iterations = 10,
        num_threads = 1,
      },
    },
  },
  submaps = {
    high_resolution = 0.1,  -- edge of a voxel of the fine grid [m]
    high_resolution_max_range = 20.0,  -- farther points do not enter the fine grid [m]
    low_resolution = 0.45,  -- edge of a voxel of the coarse grid [m]
    num_range_data = 160,  -- scans until the next submap starts; a submap is finished at twice that
    range_data_inserter = {
      hit_probability = 0.55,  -- probability that a hit multiplies in
      miss_probability = 0.49,  -- probability that a crossing multiplies in
      num_free_space_voxels = 2,  -- voxels before a hit that become freer
      intensity_threshold = 40.0,
    },
  },
  use_intensities = false,
}
