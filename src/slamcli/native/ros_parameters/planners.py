# SPDX-License-Identifier: MIT
"""Parameters of ROS global and local planners (ros-planning/navigation noetic, teb_local_planner)."""

from __future__ import annotations

from slamcli.native.ros_parameters.declare import Table, names, row

NAVFN: Table = (
    row("allow_unknown", True, "Paths may lead through unknown cells."),
    row("planner_window_x", 0.0, "Window of the planner; 0 is the whole map.", "m", minimum=0),
    row("planner_window_y", 0.0, "Window of the planner; 0 is the whole map.", "m", minimum=0),
    row("default_tolerance", 0.0, "How far from the goal a path may end.", "m", minimum=0),
    row("visualize_potential", False, "Publish the potential."),
)

GLOBAL_PLANNER: Table = (
    row("lethal_cost", 253, "Cost of a lethal cell.", minimum=1, maximum=255),
    row("neutral_cost", 50, "Cost of a free cell.", minimum=1, maximum=255),
    row("cost_factor", 3.0, "Factor of the costmap's cost.", minimum=0.01, maximum=5),
    row("use_dijkstra", True, "Dijkstra, otherwise A*."),
    row("use_quadratic", True, "Quadratic approximation of the potential."),
    row("use_grid_path", False, "The path follows cells, otherwise the gradient."),
    row("old_navfn_behavior", False, "Behave as navfn does."),
    row("allow_unknown", True, "Paths may lead through unknown cells."),
    row("default_tolerance", 0.0, "How far from the goal a path may end.", "m", minimum=0),
    row("planner_window_x", 0.0, "Window of the planner.", "m", minimum=0),
    row("planner_window_y", 0.0, "Window of the planner.", "m", minimum=0),
    row("publish_potential", True, "Publish the potential."),
    row("publish_scale", 100, "Scale of the published potential.", minimum=0),
    row("outline_map", True, "Surround the map with obstacles."),
    row(
        "orientation_mode",
        1,
        "0 none, 1 forward, 2 interpolate, 3 both, 4 backward, 5 left, 6 right.",
        minimum=0,
        maximum=6,
    ),
    row("orientation_window_size", 1, "Window over which the orientation is taken.", minimum=1),
)

DWA: Table = (
    row("max_vel_trans", 0.55, "Highest speed.", "m/s", minimum=0),
    row("min_vel_trans", 0.1, "Lowest speed.", "m/s", minimum=0),
    row("max_vel_x", 0.55, "Highest forward speed.", "m/s"),
    row("min_vel_x", 0.0, "Lowest forward speed; negative drives backwards.", "m/s"),
    row("max_vel_y", 0.1, "Highest sideways speed; 0 for a robot that cannot.", "m/s"),
    row("min_vel_y", -0.1, "Lowest sideways speed.", "m/s"),
    row("max_vel_theta", 1.0, "Highest turn rate.", "rad/s", minimum=0),
    row("min_vel_theta", 0.4, "Lowest turn rate.", "rad/s", minimum=0),
    row("acc_lim_x", 2.5, "Acceleration limit.", "m/s²", minimum=0, maximum=20),
    row("acc_lim_y", 2.5, "Acceleration limit.", "m/s²", minimum=0, maximum=20),
    row("acc_lim_theta", 3.2, "Acceleration limit.", "rad/s²", minimum=0, maximum=20),
    row("acc_lim_trans", 0.1, "Acceleration limit.", "m/s²", minimum=0),
    row("xy_goal_tolerance", 0.1, "Distance from the goal at which it is reached.", "m", minimum=0),
    row("yaw_goal_tolerance", 0.1, "Angle from the goal's at which it is reached.", "rad", minimum=0),
    row("latch_xy_goal_tolerance", False, "Once within the tolerance only turn."),
    row("trans_stopped_vel", 0.1, "Speed below which the robot stands.", "m/s", minimum=0),
    row("theta_stopped_vel", 0.1, "Turn rate below which the robot stands.", "rad/s", minimum=0),
    row("prune_plan", False, "Forget the part of the plan that is behind."),
    row("use_dwa", True, "Dynamic window, otherwise trajectory rollout."),
    row("restore_defaults", False, "Go back to the defaults."),
    row("sim_time", 1.7, "Time that is simulated.", "s", minimum=0),
    row("sim_granularity", 0.025, "Step of the simulation.", "m", minimum=0),
    row("angular_sim_granularity", 0.1, "Step of the simulation.", "rad", minimum=0),
    row("path_distance_bias", 0.6, "Weight of the distance to the path.", minimum=0),
    row("goal_distance_bias", 0.8, "Weight of the distance to the goal.", minimum=0),
    row("occdist_scale", 0.01, "Weight of obstacles.", minimum=0),
    row("twirling_scale", 0.0, "Weight against turning.", minimum=0),
    row("stop_time_buffer", 0.2, "Time to stop before a collision.", "s", minimum=0),
    row("oscillation_reset_dist", 0.05, "Distance that ends an oscillation.", "m", minimum=0),
    row("oscillation_reset_angle", 0.2, "Turn that ends an oscillation.", "rad", minimum=0),
    row("forward_point_distance", 0.325, "Distance of the point ahead that is scored.", "m"),
    row("scaling_speed", 0.25, "Speed from which the footprint grows.", "m/s", minimum=0),
    row("max_scaling_factor", 0.2, "How much the footprint grows.", minimum=0),
    row("vx_samples", 3, "Samples of the forward speed.", minimum=1),
    row("vy_samples", 10, "Samples of the sideways speed.", minimum=1),
    row("vth_samples", 20, "Samples of the turn rate.", minimum=1),
    row("cheat_factor", 1.0, "Factor of the samples' window.", minimum=0),
    row("sum_scores", False, "Add scores up along the trajectory."),
    row("publish_traj_pc", False, "Publish the trajectories."),
    row("publish_cost_grid_pc", False, "Publish the cost grid."),
    row("global_frame_id", "odom", "Frame of what is published."),
)

DWA_OLD_NAMES = {
    "max_trans_vel": "max_vel_trans",
    "min_trans_vel": "min_vel_trans",
    "max_rot_vel": "max_vel_theta",
    "min_rot_vel": "min_vel_theta",
    "trans_stopped_vel": "trans_stopped_vel",
    "rot_stopped_vel": "theta_stopped_vel",
}
"""Names of DWAPlannerROS before release 1.16.0 (kinetic and older)."""

TRAJECTORY_PLANNER: Table = names(
    """acc_lim_x=2.5 acc_lim_y=2.5 acc_lim_theta=3.2 max_vel_x=0.5 min_vel_x=0.1 max_vel_theta=1.0 min_vel_theta=-1.0
    max_rotational_vel=1.0 min_in_place_vel_theta=0.4 min_in_place_rotational_vel=0.4 escape_vel=-0.1
    holonomic_robot=true y_vels='' yaw_goal_tolerance=0.05 xy_goal_tolerance=0.1 latch_xy_goal_tolerance=false
    sim_time=1.0 sim_granularity=0.025 angular_sim_granularity=0.025 vx_samples=3 vtheta_samples=20
    controller_frequency=20.0 meter_scoring=false pdist_scale=0.6 gdist_scale=0.8 path_distance_bias=0.6
    goal_distance_bias=0.8 occdist_scale=0.01 heading_lookahead=0.325 heading_scoring=false
    heading_scoring_timestep=0.8 dwa=true publish_cost_grid_pc=false global_frame_id=odom
    oscillation_reset_dist=0.05 prune_plan=true simple_attractor=false escape_reset_dist=0.1
    escape_reset_theta=1.570796 trans_stopped_vel=0.01 rot_stopped_vel=0.01 stop_time_buffer=0.2"""
)

TEB: Table = names(
    """teb_autosize=true dt_ref=0.3 dt_hysteresis=0.1 min_samples=3 max_samples=500 odom_topic=odom map_frame=odom
    global_plan_overwrite_orientation=true allow_init_with_backwards_motion=false global_plan_viapoint_sep=-1.0
    via_points_ordered=false max_global_plan_lookahead_dist=1.0 global_plan_prune_distance=1.0 exact_arc_length=false
    force_reinit_new_goal_dist=1.0 force_reinit_new_goal_angular=1.570796 feasibility_check_no_poses=5
    feasibility_check_lookahead_distance=-1.0 publish_feedback=false min_resolution_collision_check_angular=3.141593
    control_look_ahead_poses=1 prevent_look_ahead_poses_near_goal=0
    max_vel_x=0.4 max_vel_x_backwards=0.2 max_vel_y=0.0 max_vel_trans=0.0 max_vel_theta=0.3 acc_lim_x=0.5 acc_lim_y=0.5
    acc_lim_theta=0.5 min_turning_radius=0.0 wheelbase=1.0 cmd_angle_instead_rotvel=false is_footprint_dynamic=false
    use_proportional_saturation=false xy_goal_tolerance=0.2 yaw_goal_tolerance=0.2 free_goal_vel=false
    trans_stopped_vel=0.1 theta_stopped_vel=0.1 complete_global_plan=true
    min_obstacle_dist=0.5 inflation_dist=0.6 dynamic_obstacle_inflation_dist=0.6 include_dynamic_obstacles=true
    include_costmap_obstacles=true costmap_obstacles_behind_robot_dist=1.5 obstacle_poses_affected=25
    legacy_obstacle_association=false obstacle_association_force_inclusion_factor=1.5
    obstacle_association_cutoff_factor=5.0 costmap_converter_plugin='' costmap_converter_rate=5.0
    costmap_converter_spin_thread=true obstacle_proximity_ratio_max_vel=1.0 obstacle_proximity_lower_bound=0.0
    obstacle_proximity_upper_bound=0.5 no_inner_iterations=5 no_outer_iterations=4 optimization_activate=true
    optimization_verbose=false penalty_epsilon=0.05 weight_max_vel_x=2.0 weight_max_vel_y=2.0 weight_max_vel_theta=1.0
    weight_acc_lim_x=1.0 weight_acc_lim_y=1.0 weight_acc_lim_theta=1.0 weight_kinematics_nh=1000.0
    weight_kinematics_forward_drive=1.0 weight_kinematics_turning_radius=1.0 weight_optimaltime=1.0
    weight_shortest_path=0.0 weight_obstacle=50.0 weight_inflation=0.1 weight_dynamic_obstacle=50.0
    weight_dynamic_obstacle_inflation=0.1 weight_velocity_obstacle_ratio=0.0 weight_viapoint=1.0
    weight_prefer_rotdir=50.0 weight_adapt_factor=2.0 obstacle_cost_exponent=1.0
    enable_homotopy_class_planning=true enable_multithreading=true simple_exploration=false max_number_classes=5
    max_number_plans_in_current_class=1 selection_cost_hysteresis=1.0 selection_prefer_initial_plan=0.95
    selection_obst_cost_scale=100.0 selection_viapoint_cost_scale=1.0 selection_alternative_time_cost=false
    selection_dropping_probability=0.0 obstacle_keypoint_offset=0.1 obstacle_heading_threshold=0.45
    roadmap_graph_no_samples=15 roadmap_graph_area_width=6.0 roadmap_graph_area_length_scale=1.0
    h_signature_prescaler=1.0 h_signature_threshold=0.1 switching_blocking_period=0.0 viapoints_all_candidates=true
    visualize_hc_graph=false visualize_with_time_as_z_axis_scale=0.0 delete_detours_backwards=true
    detours_orientation_tolerance=1.570796 length_start_orientation_vector=0.4 max_ratio_detours_duration_best_duration=3.0
    shrink_horizon_backup=true shrink_horizon_min_duration=10.0 oscillation_recovery=true oscillation_v_eps=0.1
    oscillation_omega_eps=0.1 oscillation_recovery_min_duration=10.0 oscillation_filter_duration=10.0
    divergence_detection_enable=false divergence_detection_max_chi_squared=10.0
    footprint_model/type=point footprint_model/radius=0.0 footprint_model/front_offset=0.0
    footprint_model/front_radius=0.0 footprint_model/rear_offset=0.0 footprint_model/rear_radius=0.0"""
)
