# SPDX-License-Identifier: MIT
"""When a frame becomes a keyframe."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap

_LEAST = 15
"""Points that a keyframe must see."""
_FEW_CLOSE, _MANY_FREE = 100, 70
"""With depth: fewer close points than the first are tracked, and more than the second could be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyframeSettings:
    """Thresholds; the defaults are those of ORB-SLAM3 for cameras with depth."""

    share: float = 0.75
    """A frame that sees less than this share of its reference keyframe's points becomes a keyframe; 0.9 without depth."""
    share_at_first: float = 0.4
    """The same while there is one keyframe."""
    close_m: float = float("inf")
    least_gap: int = 1
    """Frames between two keyframes at least, unless tracking is weak."""
    most_gap: int = 30
    """Frames after which one is made anyway where less than all of the reference's points are seen: one second."""


def needs_keyframe(
    sparse_map: SparseMap, frame: Frame, last_keyframe: int, tracked: int, settings: KeyframeSettings
) -> bool:
    """Return whether a tracked frame should become a keyframe (ORB-SLAM3, NeedNewKeyFrame, the mapper being idle).

    Parameters
    ----------
    last_keyframe
        Number of the frame that became the newest keyframe.
    tracked
        Points that hold in the frame.
    """
    with_depth = sparse_map.camera.baseline_m > 0
    alive = len(sparse_map.living_keyframes)
    seen = sparse_map.seen[frame.reference]
    ids = seen[seen >= 0]
    observed = sparse_map.count_observations(ids)
    in_reference = int((observed >= (2 if alive <= 2 else 3)).sum())
    share = settings.share_at_first if with_depth and alive < 2 else settings.share
    close, free = 0, 0
    if with_depth:
        near = frame.features.depth < settings.close_m
        close, free = int((near & (frame.points >= 0)).sum()), int((near & (frame.points < 0)).sum())
    hungry = close < _FEW_CLOSE and free > _MANY_FREE
    weak = tracked < 0.25 * in_reference or hungry
    gap = frame.number - last_keyframe
    old = gap >= settings.most_gap and tracked < in_reference
    if gap < 1 or tracked <= _LEAST:
        return False
    return old or weak or (gap >= settings.least_gap and tracked < share * in_reference)
