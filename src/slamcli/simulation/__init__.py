# SPDX-License-Identifier: MIT
"""Worlds, sensors, the robot and the recordings they make."""
