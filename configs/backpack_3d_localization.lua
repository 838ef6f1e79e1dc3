-- SPDX-License-Identifier: MIT
-- Localisation in a map that was loaded before (--load-state): only the newest submaps are kept.

include "backpack_3d.lua"

TRAJECTORY_BUILDER.pure_localization_trimmer = {
  max_submaps_to_keep = 3,
}
POSE_GRAPH.optimize_every_n_nodes = 100

return options
