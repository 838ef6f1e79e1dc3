# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.localization.motion_model`."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def move_turning(poses, motion, sigmas, noise):
    """Move `poses` (N, 3) in place by first turn, way and second turn `motion` (3,) less `noise` (N, 3) times `sigmas` (3,)."""
    for i in range(poses.shape[0]):
        first = motion[0] - sigmas[0] * noise[i, 0]
        way = motion[1] - sigmas[1] * noise[i, 1]
        second = motion[2] - sigmas[2] * noise[i, 2]
        heading = poses[i, 2] + first
        poses[i, 0] += way * math.cos(heading)
        poses[i, 1] += way * math.sin(heading)
        yaw = heading + second
        poses[i, 2] = yaw - 2.0 * math.pi * math.floor((yaw + math.pi) / (2.0 * math.pi))


@njit(cache=True, nogil=True)
def move_sideways(poses, motion, sigmas, noise):
    """Move `poses` (N, 3) in place by bearing, way and turn `motion` (3,); `noise` (N, 3) times `sigmas` (3,) goes along, across and about."""
    for i in range(poses.shape[0]):
        bearing = poses[i, 2] + motion[0]
        along = motion[1] + sigmas[0] * noise[i, 0]
        across = sigmas[1] * noise[i, 1]
        c, s = math.cos(bearing), math.sin(bearing)
        poses[i, 0] += along * c + across * s
        poses[i, 1] += along * s - across * c
        yaw = poses[i, 2] + motion[2] + sigmas[2] * noise[i, 2]
        poses[i, 2] = yaw - 2.0 * math.pi * math.floor((yaw + math.pi) / (2.0 * math.pi))
