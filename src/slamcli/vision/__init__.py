# SPDX-License-Identifier: MIT
"""What camera tiers see with: lenses, ORB features, matching, bags of words, two-view geometry, bundle adjustment.

Everything behind the lens (`slamcli.vision.pinhole`) works on the ideal pinhole camera: undistorted pixels of the left or
only camera, x to the right, y down, z ahead (REP 103 optical frame). Poses are ``T_camera_map``: p_camera = T_camera_map @ p_map.
"""
