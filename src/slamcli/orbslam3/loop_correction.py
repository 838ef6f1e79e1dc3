# SPDX-License-Identifier: MIT
"""A loop is closed: the newest keyframes go where the old region says, the rest follows, and what was seen twice becomes one.

C. Campos et al., IEEE T-RO 37(6), 2021, doi:10.1109/TRO.2021.3075644, section VI; R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5),
2015, doi:10.1109/TRO.2015.2463671, section VII.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.bundles import adjust_all
from slamcli.orbslam3.essential_graph import essential_pairs, shared_points, spread_correction
from slamcli.orbslam3.gravity_bounds import upright_correction
from slamcli.orbslam3.map_motion import carry_along, propagate
from slamcli.orbslam3.map_snapshot import MapSnapshot, costs, observations_of
from slamcli.orbslam3.place_recognition import PlaceMatch
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.region_fusion import fuse_region
from slamcli.orbslam3.similarities import scale_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap

Floats = NDArray[np.float64]
_ROUNDS = (20, 20)
"""Iterations of the last bundle adjustment; a long way may be left when what does not fit is thrown out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopOutcome:
    """What became of a loop."""

    closed: bool
    """Otherwise the map is as it was."""
    reason: str
    """Why it is not; empty if it is."""
    num_fused: int
    """Points that were one thing seen twice."""
    cost_before: float
    """Mean share of the bounds (chi2 / 95 %, at most 1) of all observations, as the map was."""
    cost_after: float
    length_factor: float
    """By which lengths around the newest keyframe were multiplied (mono); 1 if not closed."""


def correct_loop(
    sparse_map: SparseMap,
    match: PlaceMatch,
    settings: PlaceSettings,
    *,
    up_map: Floats | None = None,
) -> LoopOutcome:
    """Close a loop in a map, or leave the map as it was if that makes it worse.

    Parameters
    ----------
    match
        Of a keyframe of the map with a region of the same map.
    up_map
        float64 (3,), unit vector against gravity in the map of an inertial session; None: unknown. Where it is known, only the
        turn about it and the position are corrected, and a loop that asks for a tilt is a bad one.
    """
    keyframe, other = match.keyframe, match.place.keyframe
    S_camera_map = match.S_camera_other
    if up_map is not None:
        T_corrected = upright_correction(sparse_map.T_camera_map[keyframe], S_camera_map, up_map, settings)
        if T_corrected is None:
            return _refused("it asks for a tilt or turn that the IMU rules out")
        S_camera_map = T_corrected
    connected = _connected(sparse_map, keyframe)
    before = costs(sparse_map, observations_of(sparse_map, sparse_map.living_keyframes))
    snapshot = MapSnapshot(sparse_map)
    T_before = sparse_map.T_camera_map.copy()
    shared = shared_points(sparse_map)
    ties = essential_pairs(sparse_map, shared, settings.least_essential)
    S_start = propagate(sparse_map, keyframe, connected, S_camera_map)
    fused = fuse_region(sparse_map, match, connected, settings)
    new_ties = _new_ties(sparse_map, shared, connected, keyframe, other, settings.least_essential)
    fixed = np.zeros(sparse_map.num_keyframes, dtype=np.bool_)
    fixed[sparse_map.living_keyframes[0]] = True
    S_after = spread_correction(sparse_map, T_before, S_start, ties, new_ties, fixed, fix_scale=settings.fix_scale)
    carry_along(sparse_map, S_start, S_after)
    sparse_map.loop_edges.append((other, keyframe))
    observed = observations_of(sparse_map, sparse_map.living_keyframes)
    adjust_all(sparse_map, rounds=_ROUNDS)
    after = costs(sparse_map, observed)
    if settings.is_worse(before, after):
        snapshot.restore(sparse_map)
        return _refused("the map explains its observations worse with it", before=before.mean, after=after.mean)
    sparse_map.version += 1
    return LoopOutcome(
        closed=True, reason="", num_fused=fused, cost_before=before.mean,
        cost_after=after.mean,
        length_factor=1.0 / float(scale_of(S_after[keyframe])),
    )  # fmt: skip


def _refused(reason: str, *, before: float = 0.0, after: float = 0.0) -> LoopOutcome:
    return LoopOutcome(
        closed=False, reason=reason, num_fused=0, cost_before=before, cost_after=after, length_factor=1.0
    )


def _connected(sparse_map: SparseMap, keyframe: int) -> Ids:
    """Return the keyframe and those that share points with it, itself first, the strongest next."""
    neighbours, _ = sparse_map.covisible(keyframe)
    return np.concatenate([[keyframe], neighbours]).astype(np.int64)


def _new_ties(sparse_map: SparseMap, shared_before: Ids, connected: Ids, keyframe: int, other: int, least: int) -> Ids:
    """Return the pairs (L, 2) of connected and other keyframes that fusion tied: the loop's own, and strong ones."""
    shared = shared_points(sparse_map)
    inside = np.zeros(sparse_map.num_keyframes, dtype=np.bool_)
    inside[connected] = True
    fresh = (shared >= least) & (shared_before < shared) & inside[:, None] & ~inside[None, :]
    fresh[keyframe, other] = True
    pairs = np.sort(np.argwhere(fresh), axis=1)
    return np.unique(pairs, axis=0).astype(np.int64)
