# SPDX-License-Identifier: MIT
"""An exact room of boxes: what a scanner sees from a pose, and a drive through it."""

from __future__ import annotations

import math

import numpy as np

from slamcli.cartographer.range_data import RangeData
from slamcli.geometry import se2

BOXES = np.array([(-3.02, -2.03, 4.13, 3.08), (1.26, 1.22, 4.13, 3.08), (-1.53, 0.47, -1.02, 1.08)])
"""Low x, low y, high x, high y: the room, a corner that is cut off, a pillar."""


def returns(pose, beams=180, noise=None):
    """End points (N, 2) of beams to all sides in the frame of a pose."""
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    u = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    best = np.full(beams, np.inf)
    for box in BOXES:
        for axis in (0, 1):
            for line in (box[axis], box[axis + 2]):
                with np.errstate(divide="ignore", invalid="ignore"):
                    r = (line - pose[axis]) / u[:, axis]
                    across = pose[1 - axis] + r * u[:, 1 - axis]
                hit = (r > 1e-9) & (across >= box[1 - axis]) & (across <= box[3 - axis])
                best = np.where(hit & (r < best), r, best)
    if noise is not None:
        best = best + noise.normal(0, 0.005, beams)
    return best[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def seen(pose, beams=180, noise=None):
    return RangeData(np.zeros(2), returns(pose, beams, noise), np.empty((0, 2)))


def drive(count, turns=1.0):
    """Stamps (N,), 0.1 s apart, and true poses (N, 3), the first one at zero heading, around the pillar."""
    phase = np.linspace(0, 2 * math.pi * turns, count) - math.pi / 2
    x, y = -1.25 + 1.0 * np.cos(phase), 0.65 + 1.3 * np.sin(phase)
    yaw = np.arctan2(1.3 * np.cos(phase), -np.sin(phase))
    return np.arange(count) * 100_000_000, np.column_stack([x, y, yaw])


def motions(poses, scale=1.0, turn=1.0, bias=0.0):
    """Motion (N, 3) that leads to each pose, too long, too wide or drawn to a side."""
    between = se2.between(poses[:-1], poses[1:]) * np.array([scale, scale, turn]) + np.array([0.0, 0.0, bias])
    return np.vstack([np.zeros(3), between])
