# SPDX-License-Identifier: MIT
"""The Rao-Blackwellised particle filter (Grisetti, Stachniss and Burgard, T-RO 2007; ROS gmapping)."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.gmapping.motion import MotionModel
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.grids.tiles import TiledMaps
from slamcli.registration.beams import Beams
from slamcli.registration.tile_matching import HillClimb, SurfaceAlignment, match_particles, sample_likelihoods

_FREE_CHECK_CELLS = math.sqrt(2)
_CLIMB_BEFORE_ALIGNING = 2
"""Halvings of the hill climb before the alignment with the walls: what is left is within its reach."""
_ALIGNMENT = SurfaceAlignment(max_iterations=6)
_PRIOR_WIDTH = 10.0
"""Standard deviations of the motion model that count as one where the alignment is held to the prediction."""
_LEAST_SIGMAS = np.array([0.2, 0.2, 0.1])
"""Least standard deviations (metres, radians) by which the alignment is held where walls do not hold it, as in a corridor."""
_MOST_SAMPLES = 20_000
_KLD_BIN = np.array([0.1, 0.1, math.radians(2.0)])


@dataclass(slots=True)
class StepRecord:
    """What one processed scan did to the filter."""

    index: int
    """Index of the scan among all scans."""
    poses: NDArray[np.float64]
    """float64 (N, 3), poses of all particles."""
    parents: NDArray[np.int64]
    """int64 (N,), each particle's index in the step before."""
    neff: float
    best_score: float
    log_likelihood: float
    resampled: bool
    fallbacks: int
    """Particles whose match did not reach minimumScore."""
    num_beams: int
    weights: NDArray[np.float64]
    """float64 (N,), how much each particle weighed before it was resampled; they sum up to one."""


@dataclass(slots=True)
class ParticleFilter:
    """Particles that each carry a trajectory and a map.

    `move` and `update` are the paper's algorithm 1: sample the motion, match the scan, weigh, resample, draw.
    """

    parameters: GmappingParameters
    rng: np.random.Generator
    start: NDArray[np.float64]
    """float64 (3,), pose of the first scan in the map."""
    executor: ThreadPoolExecutor | None = None
    jobs: int = 1
    steps: list[StepRecord] = field(default_factory=list)
    poses: NDArray[np.float64] = field(init=False)
    maps: TiledMaps = field(init=False)
    _log_weights: NDArray[np.float64] = field(init=False)
    _weight_sums: NDArray[np.float64] = field(init=False)
    _parents: NDArray[np.int64] = field(init=False)
    _motion_model: MotionModel = field(init=False)
    _matching: HillClimb = field(init=False)
    _since_update: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        p, n = self.parameters, self.parameters.particles
        x, y, _ = self.start
        bounds = (x + p.xmin, y + p.ymin, x + p.xmax, y + p.ymax)
        self.maps = TiledMaps(n, p.delta, bounds, self.executor, self.jobs)
        self.poses = np.tile(self.start, (n, 1))
        self._log_weights, self._weight_sums = np.zeros(n), np.zeros(n)
        self._parents = np.arange(n)
        self._motion_model = MotionModel.of(p, p.scan_odometry_noise if p.scan_odometry else 1.0)
        self._matching = matching_settings(p)
        self._since_update = np.zeros(3)

    def move(self, motion: NDArray[np.float64]) -> None:
        """Sample each particle's motion (3,) since the last scan (T-RO 2007, section II)."""
        self.poses = self._motion_model.sample(self.poses, motion, self.rng)
        self._since_update += self._motion_model.sigmas(motion) ** 2

    def update(self, index: int, beams: Beams) -> None:
        """Match, weigh, resample and draw one scan."""
        count = len(self.poses)
        record = StepRecord(
            index, self.poses, self._parents, float(count), 0.0, 0.0, False, 0, len(beams.points),
            np.full(count, 1.0 / count),
        )  # fmt: skip
        if self.steps:
            self._match(beams, record)
        self.maps.add_scan(self.poses, beams.start, beams.ends, beams.hit)
        record.poses = self.poses.copy()
        self._parents = np.arange(len(self.poses))
        self.steps.append(record)
        if len(self.steps) > 1:
            self._resample(record)
        self._since_update = np.zeros(3)

    def best_path(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return scan indices (K,) and poses (K, 3) of the particle with the greatest weight over its whole history."""
        particle = int(self._parents[int(np.argmax(self._weight_sums))])
        poses = np.empty((len(self.steps), 3))
        for k in range(len(self.steps) - 1, -1, -1):
            poses[k] = self.steps[k].poses[particle]
            particle = int(self.steps[k].parents[particle])
        return np.array([step.index for step in self.steps], dtype=np.int64), poses

    def best_pose(self) -> NDArray[np.float64]:
        """Return the newest pose (3,) of that particle, as it was matched."""
        return self.poses[int(np.argmax(self._weight_sums))].copy()

    def _match(self, beams: Beams, record: StepRecord) -> None:
        predicted = self.poses.copy()
        surface = _ALIGNMENT if self.parameters.match == "surface" else None
        information = 1.0 / np.maximum(_PRIOR_WIDTH**2 * self._since_update, _LEAST_SIGMAS**2)
        scores, likelihoods = match_particles(
            self.maps, beams.points, beams.directions, self.poses, self._matching, surface, information
        )
        if self.parameters.proposal == "improved":
            likelihoods = self._draw_from_proposal(beams, predicted)
        self._log_weights += likelihoods
        self._weight_sums += likelihoods
        record.best_score = float(scores.max())
        record.log_likelihood = float(likelihoods.max())
        record.fallbacks = int((scores <= self.parameters.minimumScore).sum())

    def _draw_from_proposal(self, beams: Beams, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Draw each pose from the Gaussian around its optimum; returns log eta (T-RO 2007, equations 14 to 19)."""
        p = self.parameters
        count = (2 * p.llsamplerange / p.llsamplestep + 1) ** 2 * (2 * p.lasamplerange / p.lasamplestep + 1)
        if count > _MOST_SAMPLES:
            raise ConfigError(
                f"llsamplerange, llsamplestep, lasamplerange and lasamplestep ask for {count:.3g} samples of each particle; "
                f"at most {_MOST_SAMPLES} are possible"
            )
        linear = np.arange(-p.llsamplerange, p.llsamplerange + p.llsamplestep / 2, p.llsamplestep)
        angular = np.arange(-p.lasamplerange, p.lasamplerange + p.lasamplestep / 2, p.lasamplestep)
        offsets = np.stack(np.meshgrid(linear, linear, angular, indexing="ij"), axis=-1).reshape(-1, 3)
        logs = sample_likelihoods(self.maps, beams.points, beams.directions, self.poses, offsets, self._matching)
        deviation = self.poses[:, None, :] + offsets - predicted[:, None, :]
        deviation[..., 2] = np.remainder(deviation[..., 2] + np.pi, 2 * np.pi) - np.pi
        spread = np.maximum(self._since_update, 1e-6)
        spread[:2] = spread[:2].max()  # along and across the robot differ, and the robot has turned since
        logs = logs - 0.5 * (deviation**2 / spread).sum(axis=-1)  # eq. 14: p(z | m, x) p(x | x', u)
        top = logs.max(axis=1)
        weights = np.exp(logs - top[:, None])
        eta = weights.sum(axis=1)  # eq. 18
        weights /= eta[:, None]
        mean = weights @ offsets  # eq. 16
        centred = offsets[None] - mean[:, None, :]
        covariance = np.einsum("nk,nki,nkj->nij", weights, centred, centred) + np.eye(3) * 1e-12  # eq. 17
        noise = self.rng.standard_normal(self.poses.shape)
        self.poses = self.poses + mean + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), noise)
        return top + np.log(eta)  # eq. 19

    def _resample(self, record: StepRecord) -> None:
        gain = 1.0 / (self.parameters.ogain * len(self.poses))
        weights = np.exp(gain * (self._log_weights - self._log_weights.max()))
        weights /= weights.sum()
        record.weights = weights
        record.neff = float(1.0 / (weights**2).sum())  # eq. 20
        if record.neff >= self.parameters.resampleThreshold * len(self.poses):
            return
        count = self._next_count(weights)
        parents = systematic_draw(weights, count, float(self.rng.random()))
        self.maps.resample(parents)
        self.poses, self._weight_sums = self.poses[parents], self._weight_sums[parents]
        self._log_weights = np.zeros(count)
        self._parents = parents
        record.resampled = True

    def _next_count(self, weights: NDArray[np.float64]) -> int:
        """Return the number of particles after resampling: fixed, or by KLD sampling (Fox, IJRR 2003, equation 8)."""
        p = self.parameters
        if p.adaptive_particles == "none":
            return p.particles
        drawn = systematic_draw(weights, p.particles, 0.5)
        bins = len(np.unique(np.floor(self.poses[drawn] / _KLD_BIN), axis=0))
        if bins < 2:
            return min(p.min_particles, p.particles)
        k = bins - 1
        wanted = k / (2 * p.kld_err) * (1 - 2 / (9 * k) + math.sqrt(2 / (9 * k)) * p.kld_z) ** 3
        return int(np.clip(math.ceil(wanted), min(p.min_particles, p.particles), p.particles))


def matching_settings(parameters: GmappingParameters) -> HillClimb:
    """Return the settings of the scan match that the parameters ask for."""
    p = parameters
    free_check = _FREE_CHECK_CELLS * p.delta if p.free_check else 0.0
    return HillClimb(
        window=p.kernelSize, free_check_m=free_check, sigma=p.sigma, lsigma=p.lsigma, lstep_m=p.lstep, astep_rad=p.astep,
        iterations=min(p.iterations, _CLIMB_BEFORE_ALIGNING) if p.match == "surface" else p.iterations, minimum_score=p.minimumScore,
    )  # fmt: skip


def systematic_draw(weights: NDArray[np.float64], count: int, offset: float) -> NDArray[np.int64]:
    """Return `count` indices drawn with low variance: one comb of equal steps over the cumulated weights (offset in [0, 1))."""
    comb = (offset + np.arange(count)) / count
    last = int(np.flatnonzero(weights)[-1])  # rounding may leave the sum short of one
    return np.minimum(np.searchsorted(np.cumsum(weights), comb, side="right"), last).astype(np.int64)
