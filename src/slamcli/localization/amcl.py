# SPDX-License-Identifier: MIT
"""Adaptive Monte Carlo Localization as ROS amcl does it: where a robot is on a known map, from odometry and scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.laser_model import Beams, LaserModel, select_beams
from slamcli.localization.likelihood_field import LocalizationMap
from slamcli.localization.motion_model import MotionModel
from slamcli.localization.particles import Estimate, effective_number, estimate, have_converged, resample
from slamcli.measurements import LaserScan

Array = NDArray[np.float64]


class Amcl:
    """A particle filter over poses on one map.

    It starts around the parameters' initial pose; `set_pose` and `scatter` start it anew. Scans of several scanners may come
    in any order; each scanner is known by its topic and frame.

    Raises
    ------
    DataError
        If the map has no free or no occupied cell.

    References
    ----------
    Thrun, Burgard, Fox: Probabilistic Robotics, 2005, tables 8.2 to 8.4. Fox, KLD-sampling, IJRR 2003.
    """

    def __init__(self, parameters: AmclParameters, grid: OccupancyGrid, *, seed: int) -> None:
        self._parameters = parameters
        self._rng = np.random.default_rng(seed)
        self._motion = MotionModel.of(parameters)
        self._laser = LaserModel(parameters, LocalizationMap.of(grid, parameters))
        self._T_map_odom, self._pose_odom = np.zeros(3), np.zeros(3)
        self._filtered_odom: Array | None = None
        self._due: dict[tuple[str, str], bool] = {}
        self._slow, self._fast, self._num_used = 0.0, 0.0, 0
        p = parameters
        self.set_pose(
            np.array([p.initial_pose_x, p.initial_pose_y, p.initial_pose_a]),
            np.diag([p.initial_cov_xx, p.initial_cov_yy, p.initial_cov_aa]),
        )

    @property
    def pose(self) -> Array:
        """float64 (3,), the robot in the map when the last scan was taken."""
        return se2.compose(self._T_map_odom, self._pose_odom)

    @property
    def covariance(self) -> Array:
        """float64 (3, 3), of all particles (metres, radians) when they were last drawn, as amcl publishes it."""
        return self._estimate.covariance.copy()

    @property
    def T_map_odom(self) -> Array:  # noqa: N802 - poses are named so
        """float64 (3,), the odometry's frame in the map."""
        return self._T_map_odom.copy()

    @property
    def particles(self) -> Array:
        """float64 (N, 3), the particles in the map."""
        return self._poses.copy()

    @property
    def weights(self) -> Array:
        """float64 (N,), their weights, which sum to 1."""
        return self._weights.copy()

    @property
    def converged(self) -> bool:
        """Whether all particles lie within half a metre of their mean, along x and along y."""
        return self._converged

    @property
    def estimate(self) -> Estimate:
        """What the particles said when they were last drawn."""
        return self._estimate

    def set_pose(self, pose: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Start anew around a pose (3,) in the map, drawn with a covariance (3, 3); default: initial_cov_xx, yy, aa.

        Raises
        ------
        DataError
            If one of them is not finite, or the covariance is not symmetric and positive semi-definite.
        """
        p = self._parameters
        mean = np.array(pose, dtype=np.float64)
        spread = np.diag([p.initial_cov_xx, p.initial_cov_yy, p.initial_cov_aa]) if covariance is None else covariance
        root = _root(mean, np.array(spread, dtype=np.float64))
        poses = mean + self._rng.standard_normal((p.max_particles, 3)) @ root.T
        poses[:, 2] = se2.wrap_angle(poses[:, 2])
        self._start(poses)

    def scatter(self) -> None:
        """Start anew with particles all over the free cells: the robot may be anywhere (global localisation)."""
        self._start(self._laser.map.random_poses(self._parameters.max_particles, self._rng))

    def set_map(self, grid: OccupancyGrid) -> None:
        """Go on with another map, around the pose and the covariance there were; first_map_only ignores it.

        Raises
        ------
        DataError
            If the map has no free or no occupied cell.
        """
        if self._parameters.first_map_only:
            return
        self._laser = LaserModel(self._parameters, LocalizationMap.of(grid, self._parameters))
        self.set_pose(self.pose, self._estimate.covariance)

    def update(self, pose_odom: ArrayLike, scan: LaserScan, T_base_laser: ArrayLike) -> bool:
        """Take a scan; return whether it was used, which takes enough motion since the last one.

        Parameters
        ----------
        pose_odom
            float64 (3,), the robot in the odometry's frame when the scan was taken.
        scan
            Its readings; those that are NaN are left out. A scan without any reading moves the particles and no more.
        T_base_laser
            The scanner on the robot: float64 (3,) x, y, yaw, or (4, 4), which may also hang upside down.

        Raises
        ------
        DataError
            If the odometry is not finite.
        """
        self._pose_odom = np.array(pose_odom, dtype=np.float64)
        if not np.isfinite(self._pose_odom).all():
            raise DataError(f"odometry at {scan.stamp_ns} ns is not finite: {self._pose_odom.tolist()}")
        scanner = (scan.topic, scan.frame_id)
        first = self._filtered_odom is None
        if not self._is_due(scanner):
            return False
        if self._filtered_odom is not None:
            self._motion.move(self._poses, se2.between(self._filtered_odom, self._pose_odom), self._rng)
        self._filtered_odom, self._due[scanner] = self._pose_odom, False
        beams = select_beams(scan, np.asarray(T_base_laser, dtype=np.float64), self._parameters)
        if not np.isnan(beams.ranges).all():
            self._weigh(beams)
        self._num_used += 1
        resampled = self._num_used % self._parameters.resample_interval == 0
        if resampled:
            self._resample()
        if resampled or first:
            self._tell()
        return True

    def _is_due(self, scanner: tuple[str, str]) -> bool:
        """Whether a scanner's scan is used; enough motion makes one of each scanner be used."""
        p = self._parameters
        if self._filtered_odom is None:
            self._due = dict.fromkeys(self._due, True)
        else:
            moved = np.abs(self._pose_odom - self._filtered_odom)
            turn = abs(float(se2.wrap_angle(moved[2])))
            if moved[0] > p.update_min_d or moved[1] > p.update_min_d or turn > p.update_min_a:
                self._due = dict.fromkeys(self._due, True)
        return self._due.setdefault(scanner, True)

    def _start(self, poses: Array) -> None:
        self._poses, self._weights = poses, np.full(len(poses), 1.0 / len(poses))
        self._slow = self._fast = 0.0
        self._filtered_odom, self._num_used = None, 0
        self._tell()

    def _weigh(self, beams: Beams) -> None:
        p = self._parameters
        weights = self._weights * self._laser.likelihoods(self._poses, beams, converged=self._converged)
        total = float(weights.sum())
        if not total > 0.0:  # nobody explains the scan at all
            self._weights = np.full(len(weights), 1.0 / len(weights))
            return
        self._weights = weights / total
        mean = total / len(weights)
        # Probabilistic Robotics, table 8.3, lines 10 and 11.
        self._slow += (p.recovery_alpha_slow if self._slow else 1.0) * (mean - self._slow)
        self._fast += (p.recovery_alpha_fast if self._fast else 1.0) * (mean - self._fast)

    def _resample(self) -> None:
        p = self._parameters
        if p.selective_resampling and effective_number(self._weights) > 0.5 * len(self._weights):
            return
        share = max(0.0, 1.0 - self._fast / self._slow) if self._slow > 0.0 else 0.0
        others = self._laser.map.random_poses(p.max_particles if share > 0.0 else 0, self._rng)
        self._poses = resample(self._poses, self._weights, others, share, p, self._rng)
        self._weights = np.full(len(self._poses), 1.0 / len(self._poses))
        if share > 0.0:  # else randomness would feed on itself
            self._slow = self._fast = 0.0

    def _tell(self) -> None:
        """Renew the estimate, and where the odometry's frame lies by it."""
        self._estimate = estimate(self._poses, self._weights)
        self._converged = have_converged(self._poses)
        self._T_map_odom = se2.compose(self._estimate.best.mean, se2.inverse(self._pose_odom))


def _root(mean: Array, covariance: Array) -> Array:
    """Return R (3, 3) with R @ R.T the covariance."""
    if mean.shape != (3,) or covariance.shape != (3, 3):
        raise DataError(f"a start is a pose (3,) and a covariance (3, 3), not {mean.shape} and {covariance.shape}")
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
        raise DataError("the pose to start from, or its covariance, is not finite")
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if not np.allclose(covariance, covariance.T) or values[0] < -1e-9 * max(1.0, float(values[-1])):
        raise DataError("the covariance of the start is not symmetric and positive semi-definite")
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
