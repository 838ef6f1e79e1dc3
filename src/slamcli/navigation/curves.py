# SPDX-License-Identifier: MIT
"""Shortest curves of bounded curvature between poses: Dubins (forward) and Reeds-Shepp (forward and in reverse)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.navigation import _curve_kernels as kernels

CurveFamily = Literal["dubins", "reeds_shepp"]
CURVE_FAMILIES: tuple[CurveFamily, ...] = ("dubins", "reeds_shepp")


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Circular arcs and straight pieces from one pose on."""

    start: NDArray[np.float64]
    """float64 (3,): x, y, yaw."""
    lengths_m: NDArray[np.float64]
    """float64 (K,), K <= 5; negative in reverse, none is zero."""
    turns: NDArray[np.int64]
    """int64 (K,): 1 left, -1 right, 0 straight."""
    turning_radius_m: float

    @property
    def length_m(self) -> float:
        """Way along the curve, forward and in reverse."""
        return float(np.abs(self.lengths_m).sum())

    def sample(self, spacing_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return poses float64 (N, 3) at most `spacing_m` apart, ends of segments included, and directions (N,).

        A direction is that of the motion that leads to the pose, 1 or -1; the first pose has that of the second.
        """
        radius = self.turning_radius_m
        poses, directions = [np.array(self.start, dtype=np.float64)], []
        for length, turn in zip(self.lengths_m.tolist(), self.turns.tolist(), strict=True):
            x, y, yaw = poses[-1] / (radius, radius, 1.0)
            pieces = max(1, math.ceil(abs(length) / spacing_m - 1e-9))
            for k in range(1, pieces + 1):
                px, py, phi = kernels.advance(x, y, yaw, turn, length / radius * k / pieces)
                poses.append(np.array([px * radius, py * radius, phi]))
                directions.append(1 if length > 0 else -1)
        sampled = np.array(poses)
        sampled[:, 2] = se2.wrap_angle(sampled[:, 2])
        return sampled, np.array([*directions[:1], *directions] or [1], dtype=np.int64)


def shortest_curve(start: ArrayLike, goal: ArrayLike, turning_radius_m: float, family: CurveFamily) -> Curve:
    """Return the shortest curve of a family from one pose (3,) to another.

    Raises
    ------
    DataError
        If a pose is not three finite numbers or the radius is not positive.

    References
    ----------
    Dubins: On Curves of Minimal Length with a Constraint on Average Curvature, 1957.
    Reeds, Shepp: Optimal Paths for a Car That Goes Both Forwards and Backwards, 1990.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    if first.shape != (3,) or last.shape != (3,) or not (np.isfinite(first).all() and np.isfinite(last).all()):
        raise DataError("curve: poses are x, y, yaw, three finite numbers each")
    if not (math.isfinite(turning_radius_m) and turning_radius_m > 0.0):
        raise DataError(f"curve: turning radius {turning_radius_m:g} m is not positive")
    x, y, phi = se2.between(first, last)
    lengths, turns = np.zeros(5), np.zeros(5, dtype=np.int64)
    solve = kernels.dubins if family == "dubins" else kernels.reeds_shepp
    solve(float(x / turning_radius_m), float(y / turning_radius_m), float(phi), lengths, turns)
    used = np.abs(lengths) > 1e-9
    return Curve(first.copy(), lengths[used] * turning_radius_m, turns[used], turning_radius_m)


def warm() -> None:
    """Compile the kernels of this module."""
    for family in CURVE_FAMILIES:
        shortest_curve((0.0, 0.0, 0.0), (1.0, 2.0, 0.5), 1.0, family).sample(0.1)
