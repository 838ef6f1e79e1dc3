-- SPDX-License-Identifier: MIT
-- Cartographer's TRAJECTORY_BUILDER_2D with its defaults, for other files to include.
-- Written by .ci/parameter_tables.py from slamcli's declarations.

TRAJECTORY_BUILDER_2D = {
  use_imu_data = true,  -- use the IMU's turning rate and gravity where the recording has an IMU
  min_range = 0.0,  -- nearer readings are left out [m]
  max_range = 30.0,  -- farther readings are missing data [m]
  min_z = -0.8,  -- points of clouds below are left out [m]
  max_z = 2.0,  -- points of clouds above are left out [m]
  -- free space drawn for a reading beyond max_range (not for inf, which is dropped before) [m]
  missing_data_ray_length = 5.0,
  num_accumulated_range_data = 1,  -- messages that make one scan to match
  voxel_filter_size = 0.025,  -- edge of the voxels that thin a scan [m]
  adaptive_voxel_filter = {
    max_length = 0.5,  -- largest edge of a voxel [m]
    min_num_points = 200.0,  -- the edge shrinks until at least this many points are left [points]
    max_range = 50.0,  -- points farther than this are left out [m]
  },
  loop_closure_adaptive_voxel_filter = {
    max_length = 0.9,  -- largest edge of a voxel [m]
    min_num_points = 100.0,  -- the edge shrinks until at least this many points are left [points]
    max_range = 50.0,  -- points farther than this are left out [m]
  },
  use_online_correlative_scan_matching = false,  -- search around the prediction before the alignment
  real_time_correlative_scan_matcher = {
    linear_search_window = 0.1,  -- half width of the search in each direction [m]
    angular_search_window = math.rad(20),  -- half width of the search in heading [rad]
    translation_delta_cost_weight = 0.1,  -- how a score falls with the distance from the prediction
    rotation_delta_cost_weight = 0.1,  -- how a score falls with the angle from the prediction
  },
  ceres_scan_matcher = {
    occupied_space_weight = 1.0,  -- weight of the points on obstacles, shared among them
    translation_weight = 10.0,  -- weight of staying where the robot was predicted
    rotation_weight = 40.0,  -- weight of keeping the heading that was predicted, or that the correlative search found
    ceres_solver_options = {
      use_nonmonotonic_steps = false,
      max_num_iterations = 20,  -- iterations at most
      num_threads = 1,
    },
  },
  motion_filter = {
    max_time_seconds = 5.0,  -- a scan is inserted after this time [s]
    max_distance_meters = 0.2,  -- a scan is inserted after this way [m]
    max_angle_radians = math.rad(1),  -- a scan is inserted after this turn [rad]
  },
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
    num_range_data = 90,  -- scans until the next submap starts; a submap is finished at twice that
    grid_options_2d = {
      grid_type = "PROBABILITY_GRID",  -- occupancy odds, or truncated signed distances
      resolution = 0.05,  -- size of a cell [m]
    },
    range_data_inserter = {
      range_data_inserter_type = "PROBABILITY_GRID_INSERTER_2D",  -- must go with grid_type
      probability_grid_range_data_inserter = {
        insert_free_space = true,  -- cells that a beam crosses become freer
        hit_probability = 0.55,  -- probability that a hit multiplies in
        miss_probability = 0.49,  -- probability that a crossing multiplies in
      },
      tsdf_range_data_inserter = {
        truncation_distance = 0.3,  -- distances are cut here [m]
        maximum_weight = 10.0,  -- weight of a cell at most
        update_free_space = false,  -- also cells before the truncation distance are updated
        normal_estimation_options = {
          num_normal_samples = 4,  -- neighbours at most, half of them on each side
          sample_radius = 0.5,  -- neighbours are not farther than this [m]
        },
        project_sdf_distance_to_scan_normal = true,  -- distance along the surface's normal, not the beam
        update_weight_range_exponent = 0,  -- an update weighs range to minus this power
        -- bandwidth over the angle between beam and normal; 0: no such weight [rad]
        update_weight_angle_scan_normal_to_ray_kernel_bandwidth = 0.5,
        -- bandwidth over the distance from cell to hit; 0: no such weight [m]
        update_weight_distance_cell_to_hit_kernel_bandwidth = 0.5,
      },
    },
  },
}
