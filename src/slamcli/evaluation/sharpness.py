# SPDX-License-Identifier: MIT
"""How sharp a map is that points make where a trajectory puts them: what can be said without knowing what is true.

D. Droeschel and S. Behnke, "Efficient Continuous-time SLAM for 3D Lidar-based Online Mapping", ICRA 2018
(doi:10.1109/ICRA.2018.8461000), and J. Razlaw et al., "Evaluation of Registration Methods for Sparse 3D Laser Scans", ECMR 2015:
mean map entropy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation.neighbourhoods import Neighbourhoods, covariances, neighbourhoods
from slamcli.evaluation.seen_points import PlacedPoints, SeenPoints

_RADIUS_M, _WIDEST_M = 0.6, 3.0
_RANGES_PER_RADIUS = 10.0
_CELLS_PER_RADIUS = 12.0
_SHORTEST_GAP_S, _LONGEST_GAP_S, _GAP_SHARE = 1.0, 30.0, 0.1
_QUERIES, _SPATIAL_QUERIES = 20_000, 5_000
_SPATIAL_POINTS = 150_000
"""A ball holds more points than a circle."""
_FEWEST = 6
_LEAST_VARIANCE_M2 = 1e-6
_FLAT = 0.1
"""A neighbourhood is a wall where it is so much thinner (variance) than in the next direction."""
_PARALLEL = 0.94
"""Cosine: two visits saw one wall if what they saw lies in the same direction, within 20 degrees."""
_THICK = 0.25
"""The same for thickness: a double wall is thicker and still a wall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """Lengths and times of the figures; of the recording alone, so that they are the same for whatever is compared."""

    radius_m: float
    """Of a neighbourhood: within it a wall of one visit is compared with that of another."""
    visit_gap_s: float
    """What was seen longer than this before or after was seen on another visit."""
    cell_m: float
    """Of the map that is drawn again."""


def scales_of(seen: SeenPoints) -> Scales:
    """Return the scales for what a sensor saw: 0.6 m in rooms, up to 3 m where the median range is 30 m."""
    ranges = np.linalg.norm(seen.points_m, axis=1)
    median = float(np.median(ranges)) if len(ranges) else 0.0
    radius = min(max(_RADIUS_M, median / _RANGES_PER_RADIUS), _WIDEST_M)
    span_s = float(np.ptp(seen.stamps_ns)) / 1e9 if len(seen.stamps_ns) else 0.0
    gap = min(max(_GAP_SHARE * span_s, _SHORTEST_GAP_S), _LONGEST_GAP_S)
    return Scales(radius_m=radius, visit_gap_s=gap, cell_m=radius / _CELLS_PER_RADIUS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sharpness:
    """Figures of how points lie to each other, and where."""

    mean_entropy: float
    """Mean map entropy, nats: mean of the differential entropies ½ ln det(2πe Σ) of the normal distributions that fit the neighbours
    of each point; each direction's standard deviation counts at least 1 mm. NaN if no point has neighbours."""
    wall_thickness_m: NDArray[np.float64]
    """float64 (W,): twice the standard deviation of the neighbours across each wall: the distance of two equal thin walls."""
    thick_at_m: NDArray[np.float64]
    """float64 (W, 3), where."""
    revisit_offset_m: NDArray[np.float64]
    """float64 (R,): how far, across the wall that one visit saw, the mean of what other visits saw of it lies."""
    revisit_at_m: NDArray[np.float64]
    """float64 (R, 3), where."""
    revisit_stamps_ns: NDArray[np.int64]
    """int64 (R,), when the one visit was."""
    revisit_distance_m: float
    """Mean distance from a point to the nearest point of another visit, of those that have one in their neighbourhood; NaN without."""
    revisited: float
    """Share of the points near which another visit saw something too, 0 to 1."""


def sharpness(placed: PlacedPoints, scales: Scales) -> Sharpness:
    """Return the figures of points."""
    dimensions = 2 if placed.planar else 3
    queries = _QUERIES if placed.planar else _SPATIAL_QUERIES
    if not placed.planar:
        placed = placed.thinned(_SPATIAL_POINTS)
    found = neighbourhoods(placed, radius_m=scales.radius_m, visit_gap_s=scales.visit_gap_s, num_queries=queries)
    everything = found.own + found.others
    enough = everything[:, 0] >= _FEWEST
    spread = covariances(everything[enough])[1][:, :dimensions, :dimensions]
    variances: NDArray[np.float64] = np.linalg.eigvalsh(spread).astype(np.float64)
    wall = variances[:, 0] < _THICK * variances[:, 1]
    offset, rows = _revisit_offsets(found, dimensions)
    seen_again = np.isfinite(found.nearest_m)
    return Sharpness(
        mean_entropy=_mean_entropy(variances, dimensions),
        wall_thickness_m=2.0 * np.sqrt(np.maximum(variances[wall, 0], 0.0)),
        thick_at_m=found.centres_m[enough][wall],
        revisit_offset_m=offset,
        revisit_at_m=found.centres_m[rows],
        revisit_stamps_ns=found.stamps_ns[rows],
        revisit_distance_m=float(found.nearest_m[seen_again].mean()) if seen_again.any() else math.nan,
        revisited=float(seen_again.mean()) if len(seen_again) else 0.0,
    )


def _mean_entropy(variances: NDArray[np.float64], dimensions: int) -> float:
    if not len(variances):
        return math.nan
    product = np.maximum(variances, _LEAST_VARIANCE_M2).prod(axis=1)
    return float(
        (0.5 * np.log((2.0 * math.pi * math.e) ** dimensions * product)).mean()
    )  # eq. 12 of Droeschel and Behnke


def _revisit_offsets(found: Neighbourhoods, dimensions: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the offsets (R,) and of which neighbourhoods (R,) they are: those in which one visit and the others saw parallel walls."""
    rows = np.flatnonzero((found.own[:, 0] >= _FEWEST) & (found.others[:, 0] >= _FEWEST))
    own_mean, own = covariances(found.own[rows])
    other_mean, others = covariances(found.others[rows])
    variances, directions = np.linalg.eigh(own[:, :dimensions, :dimensions])
    spread, turned = np.linalg.eigh(others[:, :dimensions, :dimensions])
    parallel = np.abs(np.einsum("ni,ni->n", directions[:, :, 0], turned[:, :, 0])) > _PARALLEL
    wall = (variances[:, 0] < _FLAT * variances[:, 1]) & (spread[:, 0] < _FLAT * spread[:, 1]) & parallel
    between = (other_mean - own_mean)[:, :dimensions]
    across = np.abs(np.einsum("ni,ni->n", directions[:, :, 0], between))
    return across[wall], rows[wall]
