# SPDX-License-Identifier: MIT
"""Weighted poses: drawn anew as many as their spread needs, grouped, and told as one pose with its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.localization import _particle_kernels as kernels
from slamcli.localization.amcl_parameters import AmclParameters

_CONVERGED_M = 0.5
"""How far particles may lie from their mean, along x and along y, to count as converged; as in amcl."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One group of particles: where the robot may be."""

    weight: float
    """Share of the whole weight."""
    mean: Array
    """float64 (3,), map frame."""
    covariance: Array
    """float64 (3, 3), x and y in metres, yaw in radians."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What particles say."""

    best: Hypothesis
    """The group with the highest weight."""
    num_groups: int
    covariance: Array
    """float64 (3, 3), of all particles about their common mean: what amcl publishes."""


def resample(
    poses: Array, weights: Array, others: Array, share: float, parameters: AmclParameters, rng: np.random.Generator
) -> Array:
    """Return poses (M, 3) drawn by weight, as many as the KLD criterion asks for.

    Parameters
    ----------
    poses, weights
        float64 (N, 3) and (N,), not all of them 0.
    others, share
        Poses (O, 3) that are taken instead with a probability of `share`, as long as there are some.
    parameters
        Of the filter: kld_err, kld_z and the bounds on the number.
    rng
        What chance comes from.

    References
    ----------
    Fox: Adapting the sample size in particle filters through KLD-sampling, IJRR 2003.
    """
    p = parameters
    drawn = np.empty((p.max_particles, 3))
    limits = np.array([p.kld_err, p.kld_z, p.min_particles, p.max_particles], dtype=np.float64)
    num = kernels.draw(
        poses, np.cumsum(weights), others, float(share), rng.random((p.max_particles, 2)), _table(p.max_particles), limits, drawn
    )  # fmt: skip
    return drawn[:num].copy()


def estimate(poses: Array, weights: Array) -> Estimate:
    """Return what poses (N, 3), N > 0, with weights (N,) say."""
    labels, keys = np.empty(len(poses), dtype=np.int64), _table(len(poses))
    num = kernels.group(poses, keys, np.empty_like(keys), labels)
    sums = np.zeros((num, 5))
    kernels.sum_groups(poses, weights, labels, sums)
    best, whole = int(np.argmax(sums[:, 0])), sums.sum(axis=0)
    mean = _mean(sums[best], poses[0])
    hypothesis = Hypothesis(
        weight=float(sums[best, 0] / whole[0]), mean=mean, covariance=_covariance(poses, weights, labels, best, mean)
    )
    overall = hypothesis.covariance
    if num > 1:
        overall = _covariance(poses, weights, labels, -1, _mean(whole, poses[0]))
    return Estimate(best=hypothesis, num_groups=num, covariance=overall)


def have_converged(poses: Array) -> bool:
    """Whether all poses (N, 3) lie within half a metre of their mean, along x and along y."""
    positions = poses[:, :2]
    return bool((np.abs(positions - positions.mean(axis=0)) <= _CONVERGED_M).all())


def effective_number(weights: Array) -> float:
    """Return 1 / the sum of squared weights (N,), which sum to 1."""
    return float(1.0 / np.dot(weights, weights))


def _mean(sums: Array, first: Array) -> Array:
    weight, x, y, c, s = sums
    return np.array([first[0] + x / weight, first[1] + y / weight, math.atan2(s, c)])


def _covariance(poses: Array, weights: Array, labels: NDArray[np.int64], group: int, mean: Array) -> Array:
    out = np.zeros((3, 3))
    kernels.scatter_about(poses, weights, labels, group, mean, out)
    return out


def _table(num: int) -> NDArray[np.int64]:
    return np.full(1 << max(int(2 * num).bit_length(), 4), -1, dtype=np.int64)


def warm() -> None:
    """Compile the kernels of this module."""
    poses, weights = np.zeros((2, 3)), np.full(2, 0.5)
    poses[1, 0] = 9.0
    estimate(resample(poses, weights, poses, 0.5, AmclParameters(), np.random.default_rng(0)), np.full(5000, 2e-4))
