# SPDX-License-Identifier: MIT
"""Two maps of the atlas turn out to show the same place and become one.

C. Campos et al., IEEE T-RO 37(6), 2021, doi:10.1109/TRO.2021.3075644, section VI-B: join, fuse, weld, carry the change to the rest, adjust.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.orbslam3.bundles import adjust, adjust_all
from slamcli.orbslam3.essential_graph import essential_pairs, shared_points, spread_correction
from slamcli.orbslam3.gravity_bounds import upright_joint
from slamcli.orbslam3.map_motion import carry_along, rescale_culled
from slamcli.orbslam3.map_snapshot import Costs, costs, observations_of
from slamcli.orbslam3.place_index import Place
from slamcli.orbslam3.place_recognition import PlaceMatch
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.region_fusion import fuse_region
from slamcli.orbslam3.region_matching import region_around
from slamcli.orbslam3.similarities import apply, inverse, rigid_of, scale_of
from slamcli.orbslam3.sparse_map import Ids, SparseMap

Floats = NDArray[np.float64]
_ROUNDS = (20, 20)
"""Iterations of the last bundle adjustment; a long way may be left when what does not fit is thrown out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MergeOutcome:
    """What became of two maps."""

    sparse_map: SparseMap | None
    """The old map's keyframes and points, then the newer map's, in the old map's frame; None: they stay two."""
    reason: str
    """Why they stay two; empty if they do not."""
    keyframe_offset: int
    """To be added to the numbers of the newer map's keyframes."""
    point_offset: int
    """To be added to the numbers of its points."""
    num_fused: int
    cost_before: float
    """Mean share of the bounds, as `map_snapshot.costs` has it, of the map that has the larger one."""
    cost_after: float
    length_factor: float
    """By which lengths in the newer map were multiplied (mono)."""


def merge_maps(
    old: SparseMap,
    newer: SparseMap,
    match: PlaceMatch,
    settings: PlaceSettings,
    *,
    up_old: Floats | None = None,
    up_newer: Floats | None = None,
) -> MergeOutcome:
    """Return one map of two; both stay as they are.

    Parameters
    ----------
    match
        Of a keyframe of the newer map with a region of the old one.
    up_old, up_newer
        float64 (3,), unit vectors against gravity in maps of inertial sessions; None: unknown. Where both are known, the
        verticals are laid on one another, and a match that contradicts them or has another scale is refused.
    """
    centred = se3.from_rotation_translation(np.eye(3), newer.centres[match.keyframe])
    S_old_newer = inverse(match.S_camera_other) @ newer.T_camera_map[match.keyframe]
    if up_old is not None and up_newer is not None:
        upright = upright_joint(S_old_newer @ centred, up_old, up_newer, settings)
        if upright is None:
            return _refused("it contradicts gravity, or the scale that the IMU gives")
        S_old_newer = upright @ inverse(centred)
    near_old = region_around(old, match.place.keyframe, 2 * settings.region_size)
    near_newer = region_around(newer, match.keyframe, 2 * settings.region_size)
    apart = [costs(one, observations_of(one, one.living_keyframes)) for one in (old, newer)]
    merged, offset, point_offset = _joined(old, newer, S_old_newer)
    keyframe = match.keyframe + offset
    _hang(merged, keyframe, match.place.keyframe, offset)
    here = replace(match, keyframe=keyframe, place=Place(0, match.place.keyframe))
    window = np.unique(np.concatenate([near_old, near_newer + offset]))
    T_before = merged.T_camera_map.copy()
    ties = essential_pairs(merged, shared_points(merged), settings.least_essential)
    fused = fuse_region(merged, here, near_newer + offset, settings)
    observed = observations_of(merged, merged.living_keyframes)
    _weld(merged, window, T_before, ties, settings)
    merged.loop_edges.append((match.place.keyframe, keyframe))
    adjust_all(merged, rounds=_ROUNDS)
    before = Costs(max(one.mean for one in apart), np.concatenate([one.by_keyframe for one in apart]))
    after = costs(merged, observed)
    if settings.is_worse(before, after):
        return _refused("the maps explain their observations worse as one", before=before.mean, after=after.mean)
    merged.version = max(old.version, newer.version) + 1
    return MergeOutcome(
        sparse_map=merged, reason="", keyframe_offset=offset, point_offset=point_offset, num_fused=fused, cost_before=before.mean,
        cost_after=after.mean, length_factor=float(scale_of(S_old_newer)),
    )  # fmt: skip


def _refused(reason: str, *, before: float = 0.0, after: float = 0.0) -> MergeOutcome:
    return MergeOutcome(
        sparse_map=None, reason=reason, keyframe_offset=0, point_offset=0, num_fused=0, cost_before=before, cost_after=after,
        length_factor=1.0,
    )  # fmt: skip


def _joined(old: SparseMap, newer: SparseMap, S_old_newer: Floats) -> tuple[SparseMap, int, int]:
    """Return both maps as one, in the old one's frame, and the offsets of the newer one's keyframes and points."""
    merged = SparseMap(old.camera, old.scales)
    merged.append(old)
    merged.T_world_map = old.T_world_map
    offset, point_offset = merged.append(newer)
    merged.T_camera_map[offset:] = rigid_of(newer.T_camera_map @ inverse(S_old_newer))
    merged.positions[point_offset:] = apply(S_old_newer, newer.positions)
    factors = np.ones(merged.num_keyframes)
    factors[offset:] = scale_of(S_old_newer)
    rescale_culled(merged, factors)
    merged.refresh_points(np.flatnonzero(merged.point_alive))
    return merged, offset, point_offset


def _hang(merged: SparseMap, keyframe: int, parent: int, offset: int) -> None:
    """Make a keyframe of the newer map the top of its spanning tree, and hang it on one of the old map."""
    above = parent
    while keyframe >= offset:
        following = int(merged.parent[keyframe])
        merged.parent[keyframe] = above
        above, keyframe = keyframe, following


def _weld(merged: SparseMap, window: Ids, T_before: Floats, ties: Ids, settings: PlaceSettings) -> None:
    """Adjust where the maps meet, and carry what that changes to all other keyframes of both."""
    adjust(merged, window, rounds=(5, 10))
    fixed = np.zeros(merged.num_keyframes, dtype=np.bool_)
    fixed[window] = True
    none = np.empty((0, 2), dtype=np.int64)
    S_start = merged.T_camera_map.copy()
    S_after = spread_correction(merged, T_before, S_start, ties, none, fixed, fix_scale=settings.fix_scale)
    carry_along(merged, S_start, S_after)
