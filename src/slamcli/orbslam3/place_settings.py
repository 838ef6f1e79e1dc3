# SPDX-License-Identifier: MIT
"""What must agree before a place counts as seen before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.orbslam3.map_snapshot import Costs


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSettings:
    """Thresholds of place recognition, loop correction and merging; the defaults are those of ORB-SLAM3."""

    fix_scale: bool = True
    """Whether maps have metres (stereo, RGB-D, inertial); a mono map's scale drifts."""
    least_keyframes: int = 12
    """Keyframes of the map before loops are looked for."""
    num_candidates: int = 3
    """Keyframes of the own map, and of other maps, that are looked at."""
    region_size: int = 5
    """Keyframes beside a candidate that count to its region."""
    least_words: int = 20
    """Features of the keyframe that look like points of the region."""
    least_sampled: int = 15
    """Of them, in RANSAC's best similarity."""
    least_projected: int = 50
    """Points of the region that are found where this similarity puts them."""
    least_optimised: int = 20
    """Of them, that the optimised similarity explains in both images."""
    least_wide: int = 80
    """Points of the region that are found where the optimised similarity puts them."""
    num_verified: int = 3
    """Neighbours of the keyframe that must see the region there too, now or as later keyframes."""
    least_in_neighbour: int = 30
    """Points of the region that each of them must find."""
    most_misses: int = 2
    """Later keyframes in a row that may fail to."""
    gravity_bound_rad: float = 0.008
    """Tilt that a loop may ask of an inertial map, which knows where down is."""
    yaw_bound_rad: float = 0.349
    """Turn about the vertical that a loop may ask of an inertial map."""
    scale_range: tuple[float, float] = (0.9, 1.1)
    """In which the scale of an inertial map to be merged must lie."""
    least_essential: int = 100
    """Common points that make two keyframes an edge of the essential graph."""
    worst_growth: float = 1.5
    """Factor by which costs per observation may grow by a correction, besides what the next two add; more, and it is undone."""
    worst_mean: float = 0.06
    """Of the whole map, as a share of the 95 % bounds: a focal length that is 8 % wrong costs as much where a circle closes."""
    worst_keyframe: float = 0.3
    """Of any keyframe: a map that is bent together where it does not belong tears somewhere."""
    seed: int = 0

    def is_worse(self, before: Costs, after: Costs) -> bool:
        """Return whether a map explains what its keyframes see clearly worse: all of it, or somewhere."""
        with np.errstate(invalid="ignore"):
            torn = after.by_keyframe > self.worst_growth * before.by_keyframe + self.worst_keyframe
        return bool(torn.any()) or after.mean > self.worst_growth * before.mean + self.worst_mean
