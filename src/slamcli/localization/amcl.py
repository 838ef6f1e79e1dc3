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
from slamcli.localization.recovery import Averages, draw_near_candidates
from slamcli.localization.refinement import agreement, fit_of, refine_pose, tells_enough
from slamcli.measurements import LaserScan

_GATHERED_SHARE = 0.9
"""Of scattered particles, how many are put to where the first scan fits."""
_UNDECIDED_SHARE, _DECIDED_WEIGHT = 0.1, 0.8
"""While no group of scattered particles has so much weight, this share goes on being drawn from the scan."""
_LEAST_SHARE, _CLEARLY_BETTER = 0.15, 0.15
"""Particles are not drawn elsewhere for less than this share, or where the scan does not fit better by so much."""
_CONFIRMED = 2
"""So many searches one after the other must find a better place before a robot that is followed is looked for there."""
_MOST_VAIN = 4
"""Searches in vain double the pause between them, at most so often: people around the robot are no reason to search at each scan."""
_SHORTEST_STEP_S, _LONGEST_STEP_S = 0.01, 0.5
"""Scans closer together or farther apart do not tell how fast the robot is."""

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
        self._T_map_odom, self._pose_odom, self._fitted_odom = np.zeros(3), np.zeros(3), np.zeros(3)
        self._filtered_odom: Array | None = None
        self._due: dict[tuple[str, str], bool] = {}
        self._averages = Averages(parameters)
        self._stamp_ns, self._previous_odom = 0, np.zeros(3)
        self._velocity: Array | None = None
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
    def num_particles(self) -> int:
        """How many particles there are."""
        return len(self._poses)

    @property
    def fit(self) -> float:
        """How well the last scan used lies on walls at the pose told: 1 if all its readings do, 0 if none or none was used."""
        return self._fit

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
        self._scattered = True

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
        p, mount, scanner = self._parameters, np.asarray(T_base_laser, dtype=np.float64), (scan.topic, scan.frame_id)
        twist = self._twist(scan)
        if not self._is_due(scanner):
            if p.refine and self._has_moved(self._fitted_odom, p.refine_min_d, p.refine_min_a):
                self._fit_scan(select_beams(scan, mount, p, max_beams=p.refine_beams, twist=twist).points(), self.pose)
            return False
        tracked, first = self.pose, self._filtered_odom is None
        if self._filtered_odom is not None:
            self._motion.move(self._poses, se2.between(self._filtered_odom, self._pose_odom), self._rng)
        self._filtered_odom, self._due[scanner] = self._pose_odom, False
        beams = select_beams(scan, mount, p, twist=twist)
        points = select_beams(scan, mount, p, max_beams=p.refine_beams, twist=twist).points()
        if first and self._scattered:
            self._gather(points)
        if not np.isnan(beams.ranges).all():
            self._weigh(beams)
        self._num_used += 1
        resampled = self._num_used % p.resample_interval == 0
        if resampled:
            self._resample(points)
        if resampled or first or p.refine:
            self._tell()
        self._fit_scan(points, tracked)
        if p.proposals == "scan" and tells_enough(points):
            self._averages.observe(self._fit)
        return True

    def _is_due(self, scanner: tuple[str, str]) -> bool:
        """Whether a scanner's scan is used; enough motion makes one of each scanner be used."""
        p = self._parameters
        if self._filtered_odom is None:
            self._due = dict.fromkeys(self._due, True)
        else:
            if self._has_moved(self._filtered_odom, p.update_min_d, p.update_min_a):
                self._due = dict.fromkeys(self._due, True)
        return self._due.setdefault(scanner, True)

    def _has_moved(self, since: Array, way_m: float, turn_rad: float) -> bool:
        """Whether the odometry is farther along x or y, or is turned by more, than at `since` (3,)."""
        dx, dy, turn = np.abs(self._pose_odom - since)
        return bool(dx > way_m or dy > way_m or abs(float(se2.wrap_angle(turn))) > turn_rad)

    def _start(self, poses: Array) -> None:
        self._poses, self._weights = poses, np.full(len(poses), 1.0 / len(poses))
        self._averages.clear()
        self._fit, self._pause, self._vain, self._promising = 0.0, 0, 0, 0
        self._filtered_odom, self._num_used, self._scattered = None, 0, False
        self._tell()

    def _weigh(self, beams: Beams) -> None:
        weights = self._weights * self._laser.likelihoods(self._poses, beams, converged=self._converged)
        total = float(weights.sum())
        if not total > 0.0:  # nobody explains the scan at all
            self._weights = np.full(len(weights), 1.0 / len(weights))
            return
        self._weights = weights / total
        if self._parameters.proposals == "uniform":
            self._averages.observe(total / len(weights))

    def _resample(self, points: Array) -> None:
        p = self._parameters
        if p.selective_resampling and effective_number(self._weights) > 0.5 * len(self._weights):
            return
        share, others = self._others(points)
        self._poses = resample(self._poses, self._weights, others, share, p, self._rng)
        self._weights = np.full(len(self._poses), 1.0 / len(self._poses))

    def _others(self, points: Array) -> tuple[float, Array]:
        """Return the share of particles that are drawn elsewhere, and enough poses (O, 3) for them."""
        p, share = self._parameters, self._averages.share
        if p.proposals == "uniform":
            if share > 0.0:  # else randomness would feed on itself
                self._averages.clear()
            return share, self._laser.map.random_poses(p.max_particles if share > 0.0 else 0, self._rng)
        share = max(share, _UNDECIDED_SHARE) if self._scattered else share
        if share < _LEAST_SHARE:
            self._pause = self._vain = self._promising = 0
        self._pause = max(self._pause - 1, 0)
        if share < _LEAST_SHARE or self._pause or not tells_enough(points):
            return 0.0, np.empty((0, 3))
        better_than, map_ = 0.0, self._laser.map
        if not self._scattered:
            here = agreement(map_, points, self.pose[None], np.array([self._fit]))
            better_than = float(here[0]) + _CLEARLY_BETTER
        others = draw_near_candidates(map_, points, better_than, p, self._rng)
        self._vain = 0 if len(others) else min(self._vain + 1, _MOST_VAIN)
        self._pause = 2**self._vain - 1
        self._promising = self._promising + 1 if len(others) else 0
        if not self._scattered and self._promising < _CONFIRMED:
            return 0.0, others[:0]
        return share, others

    def _gather(self, points: Array) -> None:
        """Put most of the scattered particles to where the first scan fits."""
        if self._parameters.proposals == "uniform" or not tells_enough(points):
            return
        near = draw_near_candidates(self._laser.map, points, 0.0, self._parameters, self._rng)
        num = int(_GATHERED_SHARE * len(near))
        self._poses[:num] = near[:num]

    def _tell(self) -> None:
        """Renew the estimate, and where the odometry's frame lies by it."""
        self._estimate = estimate(self._poses, self._weights)
        self._converged = have_converged(self._poses)
        self._scattered = self._scattered and self._estimate.best.weight < _DECIDED_WEIGHT
        self._T_map_odom = se2.compose(self._estimate.best.mean, se2.inverse(self._pose_odom))
        self._told_odom = self._pose_odom

    def _fit_scan(self, points: Array, tracked: Array) -> None:
        """Lay the scan on the walls, from the particles' mean and from where the robot was `tracked` to; keep how well it fits."""
        p, best, map_ = self._parameters, self._estimate.best, self._laser.map
        self._fitted_odom = self._pose_odom
        if not tells_enough(points) or not (p.refine or p.proposals == "scan"):
            return
        refined = None
        if p.refine:
            mean = se2.compose(best.mean, se2.between(self._told_odom, self._pose_odom))
            refined = refine_pose(map_, points, mean, best.covariance, [mean, tracked])
        if refined is not None:
            self._T_map_odom = se2.compose(refined.pose, se2.inverse(self._pose_odom))
        self._fit = refined.fit if refined is not None else fit_of(map_, points, self.pose)

    def _twist(self, scan: LaserScan) -> Array | None:
        """Return the robot's velocity (3,) since the scan before, None where that is unknown or not wanted."""
        sweep_s, seconds = abs(scan.time_increment_s) * scan.num_beams, (scan.stamp_ns - self._stamp_ns) * 1e-9
        if not self._parameters.deskew or sweep_s > _LONGEST_STEP_S:
            return None
        if not abs(seconds) < _SHORTEST_STEP_S:  # else it is another scanner's scan of the same time
            known = 0.0 < seconds < _LONGEST_STEP_S
            self._velocity = se2.between(self._previous_odom, self._pose_odom) / seconds if known else None
            self._previous_odom, self._stamp_ns = self._pose_odom, scan.stamp_ns
        return self._velocity


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
