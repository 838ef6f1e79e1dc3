# SPDX-License-Identifier: MIT
"""Odometry from scans: each scan is aligned with a local map of the recent past, starting from what the wheels say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.tiles import TiledMaps
from slamcli.registration.beams import Beams
from slamcli.registration.tile_matching import SurfaceAlignment, surface_aligner

Pose = tuple[float, float, float]

_KEYFRAME_M, _KEYFRAME_RAD = 0.2, 0.1
_KEYFRAMES_PER_MAP = 40
_MIN_POINTS = 10
_POOR_QUALITY = 0.6
_CLEAR_GAIN = 0.1
"""How much better than the prediction's match a wide search must be to be believed."""
_WIDE_YAWS_RAD = np.arange(-0.6, 0.61, 0.1)
_WIDE_PRIOR = 0.01


@dataclass(frozen=True, slots=True)
class ScanStep:
    """One scan's place after the previous one."""

    pose: Pose
    quality: float
    """0 to 1: share of the beams that lie on a known surface."""
    disagreement: float
    """Distance from the predicted pose in standard deviations of the motion model, rotation or translation."""
    searched: bool
    """Whether the prediction did not match and a wide search was made."""
    information: NDArray[np.float64] | None = None
    """float64 (3, 3), what the points alone tell of x, y and yaw, along the axes of the base at this pose; None where
    they were not matched."""


def compose(a: Pose, b: Pose) -> Pose:
    """Return the pose a followed by the motion b (scalars: this runs once a scan)."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], math.remainder(a[2] + b[2], math.tau)


def between(a: Pose, b: Pose) -> Pose:
    """Return the motion that leads from pose a to pose b, seen from a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, -s * dx + c * dy, math.remainder(b[2] - a[2], math.tau)


class ScanOdometry:
    """Aligns scans one after the other; drifts slowly, and knows no loops.

    Two local maps overlap: scans are matched with the older one, which holds 40 to 80 keyframes, and drawn into both, so
    that there is always a map with a past (as the two active submaps of Hess et al., ICRA 2016). Where a match is poor,
    the heading is searched over 0.6 rad to both sides, with hardly any trust in the prediction: wheels slip, and clocks
    differ. `tangent` is the share of what points tell along a surface that is believed (`SurfaceAlignment`).
    """

    def __init__(self, delta: float, pose: Pose = (0.0, 0.0, 0.0), *, tangent: float = 1.0) -> None:
        self._delta = delta
        self.pose = pose
        self._keyframe: Pose | None = None
        self._maps = [self._new_map()]
        self._ages = [0]
        self._usual = SurfaceAlignment(tangent=tangent)
        self._rough = SurfaceAlignment(window=2, noise_m=0.04, tangent=tangent)

    def step(self, beams: Beams, motion: Pose, *, known: bool = True) -> ScanStep:
        """Place the next scan; `motion` is predicted since the last one, by wheels if `known`, else by a guess."""
        predicted = compose(self.pose, motion)
        step = ScanStep(predicted, 0.0, 0.0, False)
        if len(beams.points) >= _MIN_POINTS and self._keyframe is not None:
            step = self._match(beams, predicted, _sigmas(motion) if known else (0.2, 0.3))
        self.pose = step.pose
        self._remember(beams)
        return step

    def _match(self, beams: Beams, predicted: Pose, sigmas: tuple[float, float]) -> ScanStep:
        prior = np.array(predicted)
        information = np.array([sigmas[0] ** -2, sigmas[0] ** -2, sigmas[1] ** -2])
        normal = np.zeros((3, 3))
        align = surface_aligner(self._maps[0], beams.points, self._usual, normal)
        *pose, quality = align(prior, prior, information)
        told = normal - np.diag(information)
        searched = quality < _POOR_QUALITY
        if searched:
            *found, found_quality = self._search(beams, predicted, _WIDE_PRIOR * information)
            if found_quality > quality + _CLEAR_GAIN:
                pose, quality = found, found_quality
                align(np.array(pose), np.array(pose), information)
                told = normal - np.diag(information)
        x, y, yaw = pose
        shift = math.hypot(x - predicted[0], y - predicted[1]) / sigmas[0]
        turn = abs(math.remainder(yaw - predicted[2], math.tau)) / sigmas[1]
        wrapped = math.remainder(yaw, math.tau)
        return ScanStep((x, y, wrapped), quality, max(shift, turn), searched, _about(told, yaw))

    def _search(
        self, beams: Beams, predicted: Pose, information: NDArray[np.float64]
    ) -> tuple[float, float, float, float]:
        """Return the best match over headings around the prediction and, if it is far off, around where the robot was."""
        rough = surface_aligner(self._maps[0], beams.points, self._rough)
        align = surface_aligner(self._maps[0], beams.points, self._usual)
        prior, stood_still = np.array(predicted), np.array(self.pose)
        dx, dy, turn = between(self.pose, predicted)
        centres = [prior, stood_still] if math.hypot(dx, dy) > _KEYFRAME_M or abs(turn) > _KEYFRAME_RAD else [prior]
        best = (*predicted, 0.0)
        for start in (centre + np.array([0.0, 0.0, yaw]) for centre in centres for yaw in _WIDE_YAWS_RAD):
            *pose, _ = rough(start, prior, information)
            trial = align(np.array(pose), prior, information)
            if trial[3] > best[3]:
                best = trial
        return best

    def _remember(self, beams: Beams) -> None:
        if self._keyframe is not None:
            dx, dy, turn = between(self._keyframe, self.pose)
            if math.hypot(dx, dy) <= _KEYFRAME_M and abs(turn) <= _KEYFRAME_RAD:
                return
        self._keyframe = self.pose
        pose = np.array([self.pose])
        for index, local in enumerate(self._maps):
            local.add_scan(pose, beams.start, beams.ends, beams.hit)
            self._ages[index] += 1
        if self._ages[-1] >= _KEYFRAMES_PER_MAP:
            fresh = self._new_map()
            fresh.add_scan(pose, beams.start, beams.ends, beams.hit)
            self._maps, self._ages = [*self._maps, fresh][-2:], [*self._ages, 1][-2:]

    def _new_map(self) -> TiledMaps:
        x, y, _ = self.pose
        return TiledMaps(1, self._delta, (x - 20.0, y - 20.0, x + 20.0, y + 20.0))


def _about(upper: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Return a normal matrix (3, 3), given by its upper triangle along the map's axes, along those of the base."""
    full = np.triu(upper) + np.triu(upper, 1).T
    c, s = math.cos(yaw), math.sin(yaw)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return axes.T @ full @ axes


def _sigmas(motion: Pose) -> tuple[float, float]:
    """Standard deviations of wheel odometry between two scans: translation in metres, rotation in radians."""
    distance, turn = math.hypot(motion[0], motion[1]), abs(motion[2])
    return 0.005 + 0.1 * distance + 0.03 * turn, 0.01 + 0.1 * distance + 0.2 * turn
