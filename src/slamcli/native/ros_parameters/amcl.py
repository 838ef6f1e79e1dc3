# SPDX-License-Identifier: MIT
"""Parameters of ROS amcl (ros-planning/navigation, noetic)."""

from __future__ import annotations

import math

from slamcli.native.ros_parameters.declare import Table, row

_MODELS = ("beam", "likelihood_field", "likelihood_field_prob")
_ODOM_MODELS = ("diff", "omni", "diff-corrected", "omni-corrected")

AMCL: Table = (
    row("min_particles", 100, "Fewest particles.", minimum=1),
    row("max_particles", 5000, "Most particles.", minimum=1),
    row("kld_err", 0.01, "Largest error between the true and the estimated distribution.", minimum=0),
    row("kld_z", 0.99, "Upper standard normal quantile of 1 - p.", minimum=0),
    row("update_min_d", 0.2, "Distance before an update.", "m", minimum=0),
    row("update_min_a", math.pi / 6, "Turn before an update.", "rad", minimum=0),
    row("resample_interval", 2, "Updates between resamplings.", minimum=1),
    row("transform_tolerance", 0.1, "How far the published transform is dated ahead.", "s", minimum=0),
    row("recovery_alpha_slow", 0.001, "Decay rate of the slow average weight; 0 is off.", minimum=0, maximum=0.5),
    row("recovery_alpha_fast", 0.1, "Decay rate of the fast average weight; 0 is off.", minimum=0, maximum=1),
    row("do_beamskip", False, "Skip beams that most particles cannot explain."),
    row("beam_skip_distance", 0.5, "Distance at which a beam disagrees.", "m", minimum=0),
    row("beam_skip_threshold", 0.3, "Share of particles that must agree.", minimum=0, maximum=1),
    row("beam_skip_error_threshold", 0.9, "Share of skipped beams at which none is skipped.", minimum=0, maximum=1),
    row("selective_resampling", False, "Resample only when the effective number of particles is low."),
    row("initial_pose_x", 0.0, "Mean of the first pose.", "m"),
    row("initial_pose_y", 0.0, "Mean of the first pose.", "m"),
    row("initial_pose_a", 0.0, "Mean of the first pose.", "rad"),
    row("initial_cov_xx", 0.25, "Variance of the first pose.", "m²", minimum=0),
    row("initial_cov_yy", 0.25, "Variance of the first pose.", "m²", minimum=0),
    row("initial_cov_aa", (math.pi / 12) ** 2, "Variance of the first pose.", "rad²", minimum=0),
    row("laser_model_type", "likelihood_field", "Sensor model.", choices=_MODELS),
    row("laser_z_hit", 0.95, "Weight of the hit part of the sensor model.", minimum=0, maximum=1),
    row("laser_z_short", 0.1, "Weight of the short part (beam model).", minimum=0, maximum=1),
    row("laser_z_max", 0.05, "Weight of the maximum-range part (beam model).", minimum=0, maximum=1),
    row("laser_z_rand", 0.05, "Weight of the random part.", minimum=0, maximum=1),
    row("laser_sigma_hit", 0.2, "Standard deviation of the hit part.", "m", minimum=0),
    row("laser_lambda_short", 0.1, "Decay of the short part.", minimum=0),
    row("laser_likelihood_max_dist", 2.0, "Distance to obstacles up to which the field is filled.", "m", minimum=0),
    row("laser_min_range", -1.0, "Shortest range that is used; -1 is the scanner's own.", "m"),
    row("laser_max_range", -1.0, "Longest range that is used; -1 is the scanner's own.", "m"),
    row("laser_max_beams", 30, "Beams used of each scan, evenly spaced.", minimum=2),
    row("odom_model_type", "diff", "Motion model.", choices=_ODOM_MODELS),
    row("odom_alpha1", 0.2, "Rotation noise from rotation.", minimum=0),
    row("odom_alpha2", 0.2, "Rotation noise from translation.", minimum=0),
    row("odom_alpha3", 0.2, "Translation noise from translation.", minimum=0),
    row("odom_alpha4", 0.2, "Translation noise from rotation.", minimum=0),
    row("odom_alpha5", 0.2, "Strafing noise (omni).", minimum=0),
    row("odom_frame_id", "odom", "Frame of the odometry."),
    row("base_frame_id", "base_link", "Frame of the robot."),
    row("global_frame_id", "map", "Frame of the map."),
    row("use_map_topic", False, "Take the map from a topic instead of a service."),
    row("first_map_only", False, "Keep the first map that comes."),
    row("tf_broadcast", True, "Publish map to odom."),
    row("gui_publish_rate", -1.0, "Rate at which scans and paths are published; -1 is off.", "Hz"),
    row("save_pose_rate", 0.5, "Rate at which the pose is stored; -1 is off.", "Hz"),
    row("std_warn_level_x", 0.2, "Deviation at which diagnostics warn.", "m", minimum=0),
    row("std_warn_level_y", 0.2, "Deviation at which diagnostics warn.", "m", minimum=0),
    row("std_warn_level_yaw", 0.1, "Deviation at which diagnostics warn.", "rad", minimum=0),
    row("bag_scan_period", -1.0, "Time between scans when replaying a bag (--run-from-bag); -1 is the bag's.", "s"),
)
