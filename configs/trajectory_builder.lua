-- SPDX-License-Identifier: MIT
-- Cartographer's TRAJECTORY_BUILDER with its defaults, for other files to include.
-- Written by .ci/parameter_tables.py from slamcli's declarations.

include "trajectory_builder_2d.lua"
include "trajectory_builder_3d.lua"

TRAJECTORY_BUILDER = {
  trajectory_builder_2d = TRAJECTORY_BUILDER_2D,
  trajectory_builder_3d = TRAJECTORY_BUILDER_3D,
  collate_fixed_frame = true,
  collate_landmarks = false,
}
