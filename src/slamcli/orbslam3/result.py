# SPDX-License-Identifier: MIT
"""What a session ends with, in the frames of the robot."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.grids.upright import Upright, upright
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import PointCloud
from slamcli.orbslam3.atlas import visual_atlas
from slamcli.orbslam3.depth_seen import DepthSeen
from slamcli.orbslam3.disparity_offset import DisparityOffset
from slamcli.orbslam3.focal_check import check_focal_lengths
from slamcli.orbslam3.frame_making import FrameMaker
from slamcli.orbslam3.frame_track import final_pose
from slamcli.orbslam3.keyframe_edges import keyframe_graph
from slamcli.orbslam3.keyframe_views import keyframe_views, place_views
from slamcli.orbslam3.session import Session
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.start_refusals import why_none_began
from slamcli.orbslam3.statistics import step_columns, tell_gaps, untracked_share
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


def result_of(session: Session, maker: FrameMaker, setup: Setup, stamps_ns: list[int]) -> MappingResult:
    """Return trajectory, keyframes and points of the largest map of a session.

    Raises
    ------
    EstimationError
        If no frame was tracked.
    """
    frames = Counter(frame.map_number for frame in session.tracked)
    if not frames:
        raise EstimationError("no frame could be tracked: " + why_none_began(session.counts, session.num_frames))
    chosen = min(frames, key=lambda number: (-frames[number], number))
    sparse_map = session.maps[chosen]
    T_base_camera = maker.preparation.T_base_camera
    gravity = session.inertial.gravity(sparse_map) if session.inertial is not None else None
    for complaint in [] if session.inertial is None else session.inertial.complaints(sparse_map):
        setup.log.warn(complaint)
    poses = sparse_map.poses_of_all()
    tracked = [frame for frame in session.tracked if frame.map_number == chosen]
    T_camera = np.array([final_pose(sparse_map, poses, frame, refine=True) for frame in tracked])
    seen = DepthSeen(maker, tracked, T_camera)
    placed = _upright(maker, T_camera, sparse_map, seen, gravity, setup.seed)
    T_map_start = placed.T_map_start
    sparse_map.T_world_map = T_map_start
    T_map_base = T_map_start @ se3.inverse(T_camera) @ se3.inverse(T_base_camera)
    living = sparse_map.living_keyframes
    alive = np.flatnonzero(sparse_map.point_alive)
    T_keyframes = T_map_start @ se3.inverse(poses[living]) @ se3.inverse(T_base_camera)
    steps = step_columns(stamps_ns, [frame.number for frame in tracked], session.steps)
    tell_gaps(steps, len(session.tracked) - len(tracked), setup.log)
    points = sparse_map.positions[alive] @ T_map_start[:3, :3].T + T_map_start[:3, 3]
    return MappingResult(
        trajectory=_trajectory(np.array([stamps_ns[frame.number] for frame in tracked]), T_map_base, setup),
        keyframes=_trajectory(sparse_map.stamp_ns[living], T_keyframes, setup),
        keyframe_graph=keyframe_graph(sparse_map, T_keyframes),
        keyframe_views=keyframe_views(sparse_map),
        place_views=place_views(sparse_map, _joins(session)),
        steps=steps,
        cloud=PointCloud(
            stamp_ns=stamps_ns[tracked[0].number], frame_id=setup.map_frame, points_m=points.astype(np.float32),
            colours=sparse_map.colours[alive],
        ),
        grid=seen.grid(placed, setup.map_frame),
        atlas=None if setup.localise_only else visual_atlas(session.maps),
        summary={
            **dict(sorted((f"{name} made" if name == "keyframes" else name, count) for name, count in session.counts.items())),
            "frames": len(stamps_ns), "tracked": len(tracked), "lost": len(stamps_ns) - len(tracked), "in other maps": len(session.tracked) - len(tracked),
            "relocalised": session.counts["frames relocalised"], "loops closed": session.counts["loops closed"],
            "untracked_share_of_time": untracked_share(steps), "maps": len(frames), "keyframes": len(living), "points": len(alive), "up_from": placed.source,
            **_focal_lengths(session, sparse_map, setup.log),
            **_disparity(session.disparity_offsets.get(chosen)),
            **({} if session.inertial is None else session.inertial.summary(sparse_map)),
            **({"closures": [closure.figures() for closure in session.closures]} if session.closures else {}),
        },
    )  # fmt: skip


def _upright(
    maker: FrameMaker,
    T_camera: NDArray[np.float64],
    sparse_map: SparseMap,
    seen: DepthSeen,
    gravity: NDArray[np.float64] | None,
    seed: int,
) -> Upright:
    """Return the frame of the map: z up, by what is known of it."""
    points = seen.sample() if seen else sparse_map.positions[sparse_map.point_alive]
    on_robot = maker.preparation.rig.base_is_upright
    return upright(
        T_camera,
        points,
        T_base_camera=maker.preparation.T_base_camera if on_robot else None,
        gravity=gravity,
        seed=seed,
        known=sparse_map.T_world_map,
    )


def _joins(session: Session) -> set[tuple[int, int]]:
    """Return the stamps (older, newer) of the keyframes at which maps were joined."""
    stamps = [(one.stamp_ns, one.other_stamp_ns) for one in session.closures if one.merged_map >= 0]
    return {(min(pair), max(pair)) for pair in stamps}


def _disparity(found: DisparityOffset | None) -> dict[str, float]:
    return {} if found is None else {"disparity_offset_px": found.offset_px}


def _trajectory(stamps_ns: NDArray[np.int64], T_map_base: NDArray[np.float64], setup: Setup) -> Trajectory:
    positions, quats = se3.to_position_quaternion(T_map_base)
    return Trajectory(stamps_ns, positions, quats, frame_id=setup.map_frame, child_frame_id=setup.base_frame)


def _focal_lengths(session: Session, sparse_map: SparseMap, log: RunLog) -> dict[str, Any]:
    """Return figures on the focal lengths that the map fits best, and warn where those of the calibration are others."""
    settings = session.settings
    found = check_focal_lengths(sparse_map) if settings.check_focal_length and not settings.localise_only else None
    if found is None:
        return {}
    if found.contradicts:
        log.warn(found.warning())
    return {"focal_length_check": found.figures()}
