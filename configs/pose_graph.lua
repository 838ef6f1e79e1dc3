-- SPDX-License-Identifier: MIT
-- Cartographer's POSE_GRAPH with its defaults, for other files to include.
-- Written by .ci/parameter_tables.py from slamcli's declarations.

POSE_GRAPH = {
  -- search loops and optimise after this many nodes, as it goes (live) or where batch_search is not enabled (2D); 0: only at the end
  optimize_every_n_nodes = 90,
  constraint_builder = {
    sampling_ratio = 0.3,  -- share of the pairs of node and submap that are tried
    max_constraint_distance = 15.0,  -- pairs farther apart are not tried [m]
    min_score = 0.55,  -- least mean probability of a match
    global_localization_min_score = 0.6,  -- least mean probability of a match without a prior pose
    loop_closure_translation_weight = 11000.0,  -- weight of a loop closure's translation
    loop_closure_rotation_weight = 100000.0,  -- weight of a loop closure's rotation
    log_matches = true,
    fast_correlative_scan_matcher = {
      -- half width of the search in each direction, where batch_search (which has its own windows) is not enabled [m]
      linear_search_window = 7.0,
      -- half width of the search in heading, where batch_search is not enabled [rad]
      angular_search_window = math.rad(30),
      branch_and_bound_depth = 7,  -- grids of halved resolution [levels]
    },
    ceres_scan_matcher = {
      occupied_space_weight = 20.0,  -- weight of the points on obstacles, shared among them
      translation_weight = 10.0,  -- weight of staying where the robot was predicted
      rotation_weight = 1.0,  -- weight of keeping the heading that was predicted, or that the correlative search found
      ceres_solver_options = {
        use_nonmonotonic_steps = true,
        max_num_iterations = 10,  -- iterations at most
        num_threads = 1,
      },
    },
    fast_correlative_scan_matcher_3d = {
      branch_and_bound_depth = 8,  -- grids of halved resolution [levels]
      full_resolution_depth = 3,  -- grids that keep the finest voxels [levels]
      min_rotational_score = 0.77,  -- headings whose histogram fits worse are not searched
      min_low_resolution_score = 0.55,  -- candidates that fit the coarse grid worse are dropped
      linear_xy_search_window = 5.0,  -- half width of the search in x and y [m]
      linear_z_search_window = 1.0,  -- half width of the search in z [m]
      angular_search_window = math.rad(15),  -- half width of the search in heading [rad]
    },
    ceres_scan_matcher_3d = {
      occupied_space_weight_0 = 5.0,  -- weight of the points on obstacles of the high resolution grid
      occupied_space_weight_1 = 30.0,  -- weight of the points on obstacles of the low resolution grid
      intensity_cost_function_options_0 = {
        weight = 0.5,
        huber_scale = 0.3,
        intensity_threshold = 40.0,
      },
      translation_weight = 10.0,  -- weight of staying where the search started
      rotation_weight = 1.0,  -- weight of keeping the orientation that was predicted
      only_optimize_yaw = false,  -- leave roll and pitch as predicted
      ceres_solver_options = {
        use_nonmonotonic_steps = false,
        max_num_iterations = 10,  -- iterations at most
        num_threads = 1,
      },
    },
  },
  matcher_translation_weight = 500.0,  -- weight of a node's translation in the submaps that it is part of
  matcher_rotation_weight = 1600.0,  -- weight of a node's rotation in the submaps that it is part of
  optimization_problem = {
    huber_scale = 10.0,  -- loop closures with a larger weighted residual count linearly
    acceleration_weight = 110.0,  -- weight of the IMU's acceleration (3D)
    rotation_weight = 16000.0,  -- weight of the IMU's turning rate (3D)
    local_slam_pose_translation_weight = 100000.0,  -- weight of local SLAM between consecutive nodes
    local_slam_pose_rotation_weight = 100000.0,  -- weight of local SLAM between consecutive nodes
    odometry_translation_weight = 100000.0,  -- weight of odometry between consecutive nodes
    odometry_rotation_weight = 100000.0,  -- weight of odometry between consecutive nodes
    fixed_frame_pose_translation_weight = 10.0,  -- weight of a GPS fix
    fixed_frame_pose_rotation_weight = 100.0,  -- weight of a fixed-frame orientation
    fixed_frame_pose_use_tolerant_loss = false,  -- fixes within a tolerance cost little
    fixed_frame_pose_tolerant_loss_param_a = 1.0,  -- where the tolerant loss begins to rise
    fixed_frame_pose_tolerant_loss_param_b = 1.0,  -- how soft the tolerant loss begins to rise
    log_solver_summary = false,
    use_online_imu_extrinsics_in_3d = true,  -- also estimate how the IMU is mounted (3D)
    fix_z_in_3d = false,  -- keep heights as local SLAM has them (3D)
    ceres_solver_options = {
      use_nonmonotonic_steps = false,
      max_num_iterations = 50,  -- iterations at most
      num_threads = 7,
    },
  },
  max_num_final_iterations = 200,  -- iterations of the last optimisation
  global_sampling_ratio = 0.003,
  log_residual_histograms = true,
  global_constraint_search_after_n_seconds = 10.0,
}
