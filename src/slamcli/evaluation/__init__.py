# SPDX-License-Identifier: MIT
"""Errors of trajectories and maps against ground truth."""
