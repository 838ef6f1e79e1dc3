# SPDX-License-Identifier: MIT
"""A loop is closed: the newest keyframes go where the old region says, the rest follows, and what was seen twice becomes one.

C. Campos et al., IEEE T-RO 37(6), 2021, doi:10.1109/TRO.2021.3075644, section VI; R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5),
2015, doi:10.1109/TRO.2015.2463671, section VII.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.orbslam3.bundles import adjust_all
from slamcli.orbslam3.essential_graph import essential_pairs, shared_points, spread_correction
from slamcli.orbslam3.fusion import fuse
from slamcli.orbslam3.map_snapshot import MapSnapshot, cost_per_observation, observations_of
from slamcli.orbslam3.place_recognition import PlaceMatch
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.region_matching import region_around
from slamcli.orbslam3.similarities import apply, inverse, rigid_of, scale_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap

Floats = NDArray[np.float64]
_FUSE_RADIUS = 4.0


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
    """Mean share of the bounds (chi2 / 95 %, at most 1) of the observations around the loop, as the map was."""
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
    around = np.unique(np.concatenate([connected, region_around(sparse_map, other, 2 * settings.region_size)]))
    before = cost_per_observation(sparse_map, observations_of(sparse_map, around))
    snapshot = MapSnapshot(sparse_map)
    T_before = sparse_map.T_camera_map.copy()
    shared = shared_points(sparse_map)
    ties = essential_pairs(sparse_map, shared, settings.least_essential)
    S_start = _propagate(sparse_map, keyframe, connected, S_camera_map)
    fused = _fuse_region(sparse_map, match, connected, settings)
    new_ties = _new_ties(sparse_map, shared, connected, keyframe, other, settings.least_essential)
    fixed = np.zeros(sparse_map.num_keyframes, dtype=np.bool_)
    fixed[sparse_map.living_keyframes[0]] = True
    S_after = spread_correction(
        sparse_map, T_before, S_start, ties, new_ties, fixed, fix_scale=settings.fix_scale
    )
    _move(sparse_map, S_start, S_after)
    sparse_map.loop_edges.append((other, keyframe))
    observed = observations_of(sparse_map, around)
    adjust_all(sparse_map)
    after = cost_per_observation(sparse_map, observed)
    if is_worse(before, after, settings):
        snapshot.restore(sparse_map)
        return _refused("the map explains its observations worse with it", before=before, after=after)
    sparse_map.version += 1
    return LoopOutcome(
        closed=True, reason="", num_fused=fused, cost_before=before, cost_after=after,
        length_factor=1.0 / float(scale_of(S_after[keyframe])),
    )  # fmt: skip


def is_worse(before: float, after: float, settings: PlaceSettings) -> bool:
    """Return whether the cost per observation has clearly grown: by the factor, and by what noise does not explain."""
    return after > settings.worst_growth * before + 0.05


def upright_correction(
    T_camera_map: Floats, S_camera_map: Floats, up_map: Floats, settings: PlaceSettings
) -> Floats | None:
    """Return where a camera should be (4, 4) if only its turn about the vertical and its position may change.

    None where the correction tilts the map by more than the bound, or turns it by more than its own: a bad loop (section VI-B).
    """
    correction = inverse(T_camera_map) @ rigid_of(S_camera_map)  # of the map about itself
    turn = correction[:3, :3]
    swing = turn @ up_map
    tilt = float(np.arccos(np.clip(swing @ up_map, -1.0, 1.0)))
    quat = quaternion.from_matrix(turn)
    yaw = 2.0 * float(np.arctan2(quat[:3] @ up_map, quat[3]))
    yaw = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    if tilt > np.sqrt(2.0) * settings.gravity_bound_rad or abs(yaw) > settings.yaw_bound_rad:
        return None
    about = np.concatenate([np.sin(0.5 * yaw) * up_map, [np.cos(0.5 * yaw)]])
    upright = quaternion.to_matrix(about)
    # the point of the map where the camera is believed to be goes to the same place as before
    centre = inverse(rigid_of(S_camera_map))[:3, 3]
    moved = turn @ centre + correction[:3, 3]
    return T_camera_map @ se3.from_rotation_translation(upright, moved - upright @ centre)


def _refused(reason: str, *, before: float = 0.0, after: float = 0.0) -> LoopOutcome:
    return LoopOutcome(
        closed=False, reason=reason, num_fused=0, cost_before=before, cost_after=after, length_factor=1.0
    )


def _connected(sparse_map: SparseMap, keyframe: int) -> Ids:
    """Return the keyframe and those that share points with it, itself first, the strongest next."""
    neighbours, _ = sparse_map.covisible(keyframe)
    return np.concatenate([[keyframe], neighbours]).astype(np.int64)


def _propagate(sparse_map: SparseMap, keyframe: int, connected: Ids, S_camera_map: Floats) -> Floats:
    """Move the connected keyframes and their points rigidly to where the similarity of one puts them; return all S (K, 4, 4)."""
    S = sparse_map.T_camera_map.copy()
    correction = inverse(sparse_map.T_camera_map[keyframe]) @ S_camera_map  # S_before_after of the map
    S[connected] = sparse_map.T_camera_map[connected] @ correction
    ids = sparse_map.points_of(connected)
    sparse_map.positions[ids] = apply(inverse(correction), sparse_map.positions[ids])
    # they go along with the connected keyframe that sees them, not with one far away that saw them first
    owner = np.full(sparse_map.num_points, -1, dtype=np.int64)
    for k in connected[::-1].tolist():
        seen = sparse_map.seen[k]
        owner[seen[seen >= 0]] = k
    sparse_map.reference[ids] = owner[ids]
    sparse_map.T_camera_map[connected] = rigid_of(S[connected])
    return S


def _fuse_region(sparse_map: SparseMap, match: PlaceMatch, connected: Ids, settings: PlaceSettings) -> int:
    """Join what the connected keyframes see with the region's points; return how many points became one."""
    alive = int(np.count_nonzero(sparse_map.point_alive))
    keyframe = match.keyframe
    features = np.flatnonzero(match.points >= 0)
    own, given = sparse_map.seen[keyframe, features].copy(), match.points[features]
    region = sparse_map.points_of(region_around(sparse_map, match.place.keyframe, 2 * settings.region_size))
    sparse_map.seen[keyframe, features[own < 0]] = given[own < 0]
    sparse_map.merge_points(own[own >= 0], given[own >= 0])
    for k in connected.tolist():
        region = np.unique(sparse_map.resolved(region))
        region = region[region >= 0]
        fuse(sparse_map, k, region, _FUSE_RADIUS, T_camera_map=sparse_map.T_camera_map[k], prefer_given=True)
    return alive - int(np.count_nonzero(sparse_map.point_alive))


def _new_ties(
    sparse_map: SparseMap, shared_before: Ids, connected: Ids, keyframe: int, other: int, least: int
) -> Ids:
    """Return the pairs (L, 2) of connected and other keyframes that fusion tied: the loop's own, and strong ones."""
    shared = shared_points(sparse_map)
    inside = np.zeros(sparse_map.num_keyframes, dtype=np.bool_)
    inside[connected] = True
    fresh = (shared >= least) & (shared_before < shared) & inside[:, None] & ~inside[None, :]
    fresh[keyframe, other] = True
    pairs = np.sort(np.argwhere(fresh), axis=1)
    return np.unique(pairs, axis=0).astype(np.int64)


def _move(sparse_map: SparseMap, S_start: Floats, S_after: Floats) -> None:
    """Move keyframes to where the graph puts them, points along with the keyframe they refer to."""
    alive = np.flatnonzero(sparse_map.point_alive)
    owner = sparse_map.reference[alive]
    change = inverse(S_after) @ S_start  # of the map around each keyframe
    sparse_map.positions[alive] = apply(change[owner], sparse_map.positions[alive])
    living = sparse_map.living_keyframes
    sparse_map.T_camera_map[living] = rigid_of(S_after[living])
    _rescale_culled(sparse_map, S_after)
    sparse_map.refresh_points(alive)


def _rescale_culled(sparse_map: SparseMap, S_after: Floats) -> None:
    """Let culled keyframes hang on their parents in the parents' new units."""
    factors = 1.0 / scale_of(S_after)
    for k in np.flatnonzero(~sparse_map.keyframe_alive).tolist():
        anchor = int(sparse_map.parent[k])
        while not sparse_map.keyframe_alive[anchor]:
            anchor = int(sparse_map.parent[anchor])
        sparse_map.T_camera_parent[k, :3, 3] *= factors[anchor]
