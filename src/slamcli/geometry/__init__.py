# SPDX-License-Identifier: MIT
"""Poses, rotations, alignment and the frame tree. Frames stand in names: ``p_map = T_map_base @ p_base``."""
