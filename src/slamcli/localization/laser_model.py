# SPDX-License-Identifier: MIT
"""How well particles explain a scan: amcl's three models."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.localization import _weight_kernels as kernels
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.likelihood_field import LocalizationMap
from slamcli.measurements import LaserScan
from slamcli.registration.beams import moved, sweep_times

Array = NDArray[np.float64]


_FARTHEST_M = 1e6
"""Stands for a scanner's greatest range where that is infinite."""


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """The beams of a scan that a filter uses, seen from the robot."""

    origins: Array
    """float64 (B, 2), metres, where the scanner was."""
    bearings: Array
    """float64 (B,), radians about the robot's z axis."""
    ranges: Array
    """float64 (B,), metres; at least `most` where nothing returned, NaN where the scanner did not answer."""
    most: float
    """Range in metres that means no return."""

    @property
    def returned(self) -> NDArray[np.bool_]:
        """Bool (B,), whether a beam met something."""
        return self.ranges < self.most

    def points(self) -> Array:
        """Return float64 (R, 2): where the beams that returned ended, metres."""
        some = self.returned
        angles, ranges = self.bearings[some], self.ranges[some]
        return self.origins[some] + np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


def select_beams(
    scan: LaserScan,
    T_base_laser: Array,
    parameters: AmclParameters,
    *,
    max_beams: int | None = None,
    twist: Array | None = None,
) -> Beams:
    """Return the beams of a scan that are used: `max_beams` (laser_max_beams) of them, evenly spaced.

    Readings no longer than the least range count as no return, as in amcl.

    Parameters
    ----------
    scan
        Any scan; a negative increment is a clockwise one.
    T_base_laser
        float64 (3,) x, y, yaw, or (4, 4), which may also hang upside down.
    parameters
        Of the filter.
    max_beams
        Instead of laser_max_beams.
    twist
        float64 (3,), the robot's velocity (metres and radians per second) during the sweep: beams are put to where they were
        when they were measured, seen from the robot at the scan's stamp.
    """
    p, wanted = parameters, max_beams or parameters.laser_max_beams
    most = min(scan.range_max_m, p.laser_max_range) if p.laser_max_range > 0.0 else scan.range_max_m
    least = max(scan.range_min_m, p.laser_min_range) if p.laser_min_range > 0.0 else scan.range_min_m
    if p.laser_model_type == "likelihood_field_prob":
        step = math.ceil(scan.num_beams / wanted)
    else:
        step = (scan.num_beams - 1) // (wanted - 1)
    every = np.arange(0, scan.num_beams, max(step, 1))
    ranges = scan.ranges_m[every].astype(np.float64)
    most = min(float(most), _FARTHEST_M)
    ranges[ranges <= least] = most
    if not most > 0.0:  # a scanner that says it sees nothing tells nothing
        most, ranges = 1.0, ranges * np.nan
    position, yaw, sense = _mount(T_base_laser)
    bearings: Array = yaw + sense * scan.angles_rad[every]
    origins = np.tile(position, (len(every), 1))
    if twist is not None and scan.time_increment_s != 0.0:
        times = sweep_times(scan)[every]
        origins, bearings = moved(origins, times, twist), bearings + times * twist[2]
    return Beams(origins, bearings, ranges, most)


def _mount(T_base_laser: Array) -> tuple[Array, float, float]:
    """Return position (2,), yaw, and -1 for a scanner that hangs upside down, else 1."""
    mount = np.asarray(T_base_laser, dtype=np.float64)
    if mount.shape == (3,):
        return mount[:2], float(mount[2]), 1.0
    return mount[:2, 3], math.atan2(mount[1, 0], mount[0, 0]), 1.0 if mount[2, 2] >= 0.0 else -1.0


@dataclass(frozen=True, slots=True, eq=False)
class LaserModel:
    """Likelihoods of scans on one map."""

    parameters: AmclParameters
    map: LocalizationMap

    def likelihoods(self, poses: Array, beams: Beams, *, converged: bool) -> Array:
        """Return float64 (N,), how well each of `poses` (N, 3) explains the beams.

        The factor is amcl's: 1 + the sum of cubed likelihoods of the beams, or for likelihood_field_prob their product.

        Parameters
        ----------
        poses
            Particles in the map's frame.
        beams
            Of one scan.
        converged
            Whether the particles agree, which beam skipping asks for.
        """
        p, out = self.parameters, np.empty(len(poses))
        if p.laser_model_type == "beam":
            answered = ~np.isnan(beams.ranges)
            mixture = (p.laser_z_hit, p.laser_z_short, p.laser_z_max, p.laser_z_rand, p.laser_sigma_hit, p.laser_lambda_short)  # fmt: skip
            bearings, ranges = beams.bearings[answered], np.minimum(beams.ranges[answered], beams.most)
            kernels.beam_cubes(
                poses,
                beams.origins[answered],
                bearings,
                ranges,
                self.map.frame,
                self.map.room,
                beams.most,
                mixture,
                out,
            )
            return out
        noise = p.laser_z_rand / beams.most
        if p.laser_model_type == "likelihood_field_prob":
            return self._product(poses, beams, noise, converged)
        kernels.field_cubes(poses, beams.points(), self.map.frame, self.map.field, self.map.far, noise, out)
        return out

    def _product(self, poses: Array, beams: Beams, noise: float, converged: bool) -> Array:
        p, points = self.parameters, beams.points()
        logs, explained = np.empty((len(poses), len(points))), np.zeros(len(points), dtype=np.int64)
        near = p.laser_z_hit * math.exp(-(p.beam_skip_distance**2) / (2.0 * p.laser_sigma_hit**2))
        kernels.field_each(poses, points, self.map.frame, self.map.field, self.map.far, near, noise, logs, explained)
        if p.do_beamskip and converged:
            used = explained > p.beam_skip_threshold * len(poses)
            # amcl counts the beams without a return as skipped too.
            if len(beams.ranges) - used.sum() < p.beam_skip_error_threshold * len(beams.ranges):
                logs = logs[:, used]
        return np.exp(logs.sum(axis=1))


def warm() -> None:
    """Compile the kernels of this module."""
    cells = np.zeros((3, 3), dtype=np.int8)
    cells[2] = OccupancyGrid.OCCUPIED
    scan = LaserScan(
        stamp_ns=0, frame_id="", angle_min_rad=0.0, angle_increment_rad=0.1, range_min_m=0.0, range_max_m=9.0,
        ranges_m=np.ones(2, dtype=np.float32),
    )  # fmt: skip
    for kind in ("likelihood_field", "likelihood_field_prob", "beam"):
        parameters = AmclParameters(laser_model_type=kind)
        model = LaserModel(parameters, LocalizationMap.of(OccupancyGrid(cells, 0.5), parameters))
        model.likelihoods(np.zeros((1, 3)), select_beams(scan, np.zeros(3), parameters), converged=False)
