-- SPDX-License-Identifier: MIT
-- Cartographer's MAP_BUILDER with its defaults, for other files to include.
-- Written by .ci/parameter_tables.py from slamcli's declarations.

include "pose_graph.lua"

MAP_BUILDER = {
  pose_graph = POSE_GRAPH,
  use_trajectory_builder_2d = false,
  use_trajectory_builder_3d = false,
  num_background_threads = 4,
  collate_by_trajectory = false,
}
