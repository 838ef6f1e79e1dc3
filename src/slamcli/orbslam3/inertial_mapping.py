# SPDX-License-Identifier: MIT
"""What an IMU adds to a session: predictions, keyframes in time, alignment, adjustment with its samples."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.frame_track import TrackedFrame
from slamcli.orbslam3.inertial_bundles import adjust_all_inertially, adjust_local_inertially
from slamcli.orbslam3.inertial_frames import carried_frames
from slamcli.orbslam3.inertial_start import align_map, set_clock
from slamcli.orbslam3.inertial_state import Imu, MapInertia
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.posegraph.imu_preintegration import InertialState, predict, preintegrate

Floats = NDArray[np.float64]
_ADJUSTED_S = (5.0, 15.0, 25.0, 40.0, 60.0, 80.0)
"""Seconds after the alignment at which the whole map is adjusted again: twice, and then while the scale still settles."""
_GAP_S, _GAP_AT_FIRST_S, _GAP_AT_REST_S = 0.5, 0.25, 1.0
"""Time after which a keyframe is made anyway: with an aligned map, before that, and before that without motion."""
_CULLED_GAP_S = 1.0
"""Keyframes are kept where culling would leave a longer time without one."""
_KEPT_AT_FIRST = 40
"""Up to so many keyframes none is culled before the map is aligned: the alignment needs them."""
_LEAST_HELD = 15
LONGEST_RECKONING_S = 5.0
"""Time for which the IMU alone carries a lost camera on (ORB-SLAM3: recently lost)."""


class InertialMapping:
    """The IMU of a session and what is known about it along each of its maps."""

    def __init__(self, imu: Imu, counts: Counter[str]) -> None:
        self.imu, self._counts = imu, counts
        self._of: dict[int, tuple[SparseMap, MapInertia]] = {}

    def of(self, sparse_map: SparseMap) -> MapInertia:
        """Return what is known along a map."""
        if id(sparse_map) not in self._of:
            self._of[id(sparse_map)] = (sparse_map, MapInertia())
        inertia = self._of[id(sparse_map)][1]
        inertia.follow(sparse_map)
        return inertia

    def aligned(self, sparse_map: SparseMap) -> bool:
        """Return whether a map knows gravity."""
        return self.of(sparse_map).gravity_map is not None

    def gravity(self, sparse_map: SparseMap) -> Floats | None:
        """Return gravity float64 (3,), pointing down in a map; None if it is not known."""
        return self.of(sparse_map).gravity_map

    def summary(self, sparse_map: SparseMap) -> dict[str, Any]:
        """Return figures for ``run.json``."""
        inertia, counts = self.of(sparse_map), self.imu.buffer.counts()
        out: dict[str, Any] = {"imu_samples": counts.used}
        wrong = {"repeated": counts.repeated, "late": counts.late, "not finite": counts.not_finite, "gaps": counts.gaps}
        out |= {f"imu_samples_{name.replace(' ', '_')}": number for name, number in wrong.items() if number}
        known = inertia.known(sparse_map)
        if inertia.gravity_map is not None and len(known):
            middle = np.median(inertia.biases(known), axis=0)
            out["imu_gyroscope_bias_rad_s"] = [round(float(v), 6) for v in middle[:3]]
            out["imu_accelerometer_bias_m_s2"] = [round(float(v), 5) for v in middle[3:]]
        return out

    def complaints(self, sparse_map: SparseMap) -> list[str]:
        """Return what a user should know about the IMU of a map."""
        inertia, counts = self.of(sparse_map), self.imu.buffer.counts()
        out = []
        if not counts.used:
            out.append("no IMU sample could be used: the map is what the cameras see alone")
        elif inertia.gravity_map is None:
            rest = "" if self.imu.fixed_scale else ", and its metre is unknown"
            out.append(f"the IMU was not used, {inertia.objection}: the map is what the cameras see alone{rest}")
        if self.imu.buffer.offset_ns:
            ahead = self.imu.buffer.offset_ns * 1e-6
            out.append(
                f"the IMU's clock is {abs(ahead):.1f} ms {'ahead of' if ahead > 0 else 'behind'} the camera's, by how both turn: put right"
            )
        lost = counts.repeated + counts.late + counts.not_finite
        if lost:
            out.append(
                f"{lost} IMU samples were left out: {counts.repeated} repeated, {counts.late} late, {counts.not_finite} not finite"
            )
        if counts.gaps:
            out.append(f"IMU samples are missing in {counts.gaps} places, for {counts.longest_gap_s:.2f} s at most")
        return out

    def up(self, sparse_map: SparseMap) -> Floats | None:
        """Return the unit vector (3,) against gravity in a map; None if it is not known."""
        gravity = self.gravity(sparse_map)
        return None if gravity is None else -gravity / np.linalg.norm(gravity)

    def join(self, old: SparseMap, newer: SparseMap, merged: SparseMap, offset: int) -> None:
        """Keep what is known along two maps that became one: the older one's keyframes, and `offset` further the newer one's."""
        joined = self.of(old).joined(self.of(newer), old, newer, merged, offset, fixed_scale=self.imu.fixed_scale)
        self._of[id(merged)] = (merged, joined)

    def begins_anew(self, frame: Frame, least: int) -> bool:
        """Return whether a frame that matches nothing can be a keyframe of points from its depth alone."""
        close = np.isfinite(frame.features.depth)
        return bool(self.imu.fixed_scale and close.sum() >= least)

    def predicted(
        self, sparse_map: SparseMap, stamp_ns: int, *, longest_s: float = LONGEST_RECKONING_S
    ) -> Floats | None:
        """Return T_camera_map (4, 4) at a time, from the newest keyframe on; None if the IMU cannot tell."""
        inertia = self.of(sparse_map)
        known = inertia.known(sparse_map)
        if inertia.gravity_map is None or not len(known):
            return None
        keyframe = known[-1:]
        begin = int(sparse_map.stamp_ns[keyframe[0]])
        if not 0 < stamp_ns - begin <= longest_s * 1e9:
            return None
        biases, last = inertia.biases(keyframe)[0], self.imu.buffer.last_ns
        samples = self.imu.buffer.samples(begin)
        motion = preintegrate(samples, np.array([begin]), np.array([stamp_ns]), biases, self.imu.noise)
        if last is None or motion.gaps_s[0] > 0.3:
            return None
        T_map_imu = np.linalg.inv(sparse_map.T_camera_map[keyframe[0]]) @ self.imu.T_camera_imu
        state = InertialState(T_map_imu=T_map_imu, velocity_map=inertia.velocities(keyframe)[0], biases=biases)
        return np.asarray(self.imu.T_camera_imu @ np.linalg.inv(predict(state, motion, inertia.gravity_map).T_map_imu))

    def wants_keyframe(self, sparse_map: SparseMap, frame: Frame, held: int) -> bool:
        """Return whether it is time for a keyframe."""
        newest = int(sparse_map.living_keyframes[-1])
        seconds = (frame.stamp_ns - int(sparse_map.stamp_ns[newest])) * 1e-9
        if held < _LEAST_HELD:
            return False
        if self.aligned(sparse_map):
            return seconds >= _GAP_S - 1e-3
        return seconds >= (_GAP_AT_FIRST_S if _moved(sparse_map, newest, frame) else _GAP_AT_REST_S) - 1e-3

    def may_cull(self, sparse_map: SparseMap, keyframe: int) -> bool:
        """Return whether keyframes around one are close enough in time for it to go."""
        stamps = np.sort(sparse_map.stamp_ns[sparse_map.living_keyframes])
        at = int(np.searchsorted(stamps, sparse_map.stamp_ns[keyframe]))
        if at in {0, len(stamps) - 1} or (len(stamps) < _KEPT_AT_FIRST and not self.aligned(sparse_map)):
            return False
        return bool(stamps[at + 1] - stamps[at - 1] <= _CULLED_GAP_S * 1e9)

    def adjust_local(self, sparse_map: SparseMap, keyframe: int) -> bool:
        """Adjust what is around the newest keyframe; return False if the map is not aligned yet: it is for the cameras then."""
        if not self.aligned(sparse_map):
            return False
        self._begin_state(sparse_map, keyframe)
        adjust_local_inertially(sparse_map, self.of(sparse_map), self.imu)
        return True

    def after_keyframe(self, sparse_map: SparseMap, keyframe: int) -> float:
        """Align the map if it can be, or adjust it as a whole when it is time; return by how much it was scaled."""
        inertia = self.of(sparse_map)
        if inertia.gravity_map is None:
            scale = align_map(sparse_map, inertia, self.imu)
            if scale is None:
                return 1.0
            adjust_all_inertially(sparse_map, inertia, self.imu, rounds=(10, 10))
            self._counts["maps aligned with the IMU"] += 1
            return scale
        seconds = (int(sparse_map.stamp_ns[keyframe]) - inertia.began_ns) * 1e-9
        if inertia.adjusted < len(_ADJUSTED_S) and seconds >= _ADJUSTED_S[inertia.adjusted]:
            inertia.adjusted += 1
            set_clock(sparse_map, self.imu)
            inertia.complete(sparse_map, sparse_map.living_keyframes, self.imu)
            adjust_all_inertially(sparse_map, inertia, self.imu, rounds=(5, 10))
        return 1.0

    def finish(self, sparse_map: SparseMap) -> float | None:
        """Adjust a whole map for the last time; return by how much it was scaled, or None if it is for the cameras alone."""
        inertia, scale = self.of(sparse_map), 1.0
        if inertia.gravity_map is None:
            found = align_map(sparse_map, inertia, self.imu, last=True)
            if found is None:
                return None
            scale = found
            self._counts["maps aligned with the IMU"] += 1
        inertia.complete(sparse_map, sparse_map.living_keyframes, self.imu)
        adjust_all_inertially(sparse_map, inertia, self.imu)
        return scale

    def carried(self, frames: list[TrackedFrame], number: int, sparse_map: SparseMap) -> list[TrackedFrame]:
        """Return all frames, those of map `number` that only the IMU posed at where it says now (see `carried_frames`)."""
        return carried_frames(frames, number, sparse_map, self.of(sparse_map), self.imu)

    def _begin_state(self, sparse_map: SparseMap, keyframe: int) -> None:
        """Give a new keyframe the velocity that its predecessor and the samples in between say, and its biases."""
        inertia = self.of(sparse_map)
        living = sparse_map.living_keyframes
        inertia.complete(sparse_map, living[living != keyframe], self.imu)
        known = inertia.known(sparse_map)
        before = known[sparse_map.stamp_ns[known] < sparse_map.stamp_ns[keyframe]][-1:]
        biases, gravity = inertia.biases(before), inertia.gravity
        begin, end = sparse_map.stamp_ns[before[0]], sparse_map.stamp_ns[keyframe]
        motion = preintegrate(
            self.imu.buffer.samples(int(begin)), np.array([begin]), np.array([end]), biases, self.imu.noise
        )
        T_map_imu = np.linalg.inv(sparse_map.T_camera_map[before[0]]) @ self.imu.T_camera_imu
        state = InertialState(T_map_imu=T_map_imu, velocity_map=inertia.velocities(before)[0], biases=biases[0])
        velocity = predict(state, motion, gravity).velocity_map
        inertia.set(sparse_map, np.array([keyframe]), velocity[None], biases)


def _moved(sparse_map: SparseMap, keyframe: int, frame: Frame) -> bool:
    """Return whether a frame is a degree or a hundredth of the depth away from a keyframe."""
    T = frame.T_camera_map @ np.linalg.inv(sparse_map.T_camera_map[keyframe])
    ids = frame.points[frame.points >= 0]
    pose = frame.T_camera_map
    depth = float(np.median(sparse_map.positions[ids] @ pose[2, :3] + pose[2, 3])) if len(ids) else 1.0
    turned = np.arccos(np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1))
    return bool(turned > np.radians(1.0) or np.linalg.norm(T[:3, 3]) > 0.01 * depth)
