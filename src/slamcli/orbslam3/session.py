# SPDX-License-Identifier: MIT
"""Frames in, maps out: the state machine of tracking and the mapping that each keyframe sets off."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry.motion import part_of
from slamcli.orbslam3.bundles import adjust_all
from slamcli.orbslam3.disparity_offset import DisparityOffset, apply_offset, find_disparity_offset, with_offset
from slamcli.orbslam3.frame import Frame, repeats
from slamcli.orbslam3.frame_track import TrackedFrame, after_merge, rescaled, scaled, tracked_frame
from slamcli.orbslam3.inertial_mapping import InertialMapping
from slamcli.orbslam3.inertial_state import Imu
from slamcli.orbslam3.initialisation import MonocularStart, start_with_depth
from slamcli.orbslam3.keyframe_rules import needs_keyframe
from slamcli.orbslam3.local_mapping import LocalMapping
from slamcli.orbslam3.loop_closing import Closure
from slamcli.orbslam3.places import Places
from slamcli.orbslam3.point_creation import points_from_depth
from slamcli.orbslam3.second_look import second_look
from slamcli.orbslam3.session_settings import SessionSettings
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.tracking import LocalTrack, count_sightings, track_keyframe, track_local_map, track_motion
from slamcli.vision.bag_of_words import BagOfWords
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.vocabulary import Vocabulary

_LEAST_HELD = 30
"""Points of the local map that must hold for a frame to count as tracked."""
_SURELY_HELD = 100
"""With fewer, keyframes are tried besides the motion model, and what holds most points wins: batch work has the time."""
_LEAST_SHARE = 0.07
"""Of the points that should be seen at the pose of a frame that was lost, as many must be: about a quarter of the share at which points are culled."""
_LEAST_WAITING = 5
"""Frames that are looked for in the map before another is begun."""
_THOROUGH_EVERY = 5
"""Every fifth of them by descriptors too, which takes long on large maps."""
_MOST_UNTRACKED = 500
_NOTHING = LocalTrack(held=0, visible=np.empty(0, dtype=np.int64))


class Session:
    """Tracks frame after frame, and maps.

    When the track is lost, every frame is looked for in the map. After a while another map is begun, with the frames since the
    track was lost; the two become one when a place of the old one is seen again.
    """

    def __init__(
        self,
        camera: Pinhole,
        scales: NDArray[np.float64],
        settings: SessionSettings,
        vocabulary: Vocabulary | None = None,
        imu: Imu | None = None,
        given: Sequence[SparseMap] = (),
    ) -> None:
        """`given` are maps to go on from; they are changed."""
        self.camera, self.scales, self.settings = camera, scales, settings
        self.counts: Counter[str] = Counter()
        self.closures: list[Closure] = []
        """Loops that were closed and maps that were joined."""
        self._places = Places(vocabulary, settings.places, settings.lost, self.counts)
        self.maps: list[SparseMap] = list(given)
        for number in range(len(self.maps)):
            self._places.learn(self.maps, number)
        self.tracked: list[TrackedFrame] = []
        self.untracked: dict[int, Frame] = {}
        """Frames that have no pose, by number; the last 500."""
        self.num_frames = 0
        self.disparity_offsets: dict[int, DisparityOffset] = {}
        """What was found to be wrong of all disparities, by map."""
        self.steps: dict[int, tuple[int, int, int]] = {}
        """Per frame, by number: points that hold, keyframes alive, points alive."""
        self._waiting: list[Frame] = []
        """Frames since the track was lost."""
        self.inertial = InertialMapping(imu, self.counts) if imu is not None else None
        self._mapping = LocalMapping(settings.mapping, self.counts, self.inertial)
        self._last: Frame | None = None
        self._beside_reference = np.eye(4)
        """T_camera_keyframe of the last frame and its reference keyframe, whose pose mapping may change."""
        self._velocity: NDArray[np.float64] | None = None
        """float64 (4, 4), motion of the camera within `_velocity_ns`."""
        self._velocity_ns = 1
        self._last_keyframe = 0
        self._new_map()

    @property
    def map(self) -> SparseMap:
        """The map that is being built."""
        return self.maps[-1]

    def take(self, frame: Frame) -> None:
        """Track the next frame; make it a keyframe where the map needs one."""
        self.num_frames += 1
        self._take(frame)

    def _take(self, frame: Frame, *, again: bool = False) -> None:
        """`again`: the frame was looked for in the maps before."""
        last = self._last
        if last is not None and self.inertial is None and not self._waiting and repeats(last, frame):
            self._repeat(frame)
            return
        held = self._begin(frame, again=again) if last is None else self._track(last, frame) or self._look_for(frame)
        held = held or self._reckon(frame)
        self.steps[frame.number] = (held, int(self.map.keyframe_alive.sum()), int(self.map.point_alive.sum()))
        if held:
            self._keep(frame)
        else:
            self._lose(frame)

    def _repeat(self, frame: Frame) -> None:
        """Place a frame that is the last one over again; the motion goes on from that one."""
        one = replace(self.tracked[-1], number=frame.number, stamp_ns=frame.stamp_ns)
        self.tracked.append(one)
        self.steps[frame.number] = next(reversed(self.steps.values()))
        self.counts["frames that repeat the one before"] += 1

    def _lose(self, frame: Frame) -> None:
        """Keep a frame without a pose; begin another map when the track has been lost for too long."""
        if self.tracked and self.tracked[-1].number == frame.number:  # the IMU gave it one
            return
        self.untracked[frame.number] = frame
        while len(self.untracked) > _MOST_UNTRACKED:
            del self.untracked[min(self.untracked)]
        if self._last is None:
            return
        self._waiting.append(frame)
        if len(self._waiting) < _LEAST_WAITING or frame.stamp_ns - self._last.stamp_ns < self.settings.patience_ns:
            return
        waiting, self._waiting = self._waiting, []
        if not self.settings.localise_only:
            self.counts["maps begun after the track was lost"] += 1
            self._new_map()
            for other in waiting:
                other.points[:] = -1
                self._take(other, again=True)

    def _reckon(self, frame: Frame) -> int:
        """Give a lost frame the pose that the IMU says; return how many points it shows if it could begin anew there."""
        if (
            self.inertial is None
            or self._last is None
            or (T := self.inertial.predicted(self.map, frame.stamp_ns)) is None
        ):
            return 0
        frame.T_camera_map, frame.reference = T, int(self.map.living_keyframes[-1])
        frame.points[:] = -1
        if self.settings.reckons_keyframes and self.inertial.begins_anew(frame, self.settings.least_start):
            self._add_keyframe(frame)
            self.counts["keyframes where the IMU alone told the pose"] += 1
        else:
            self.tracked.append(tracked_frame(self.map, len(self.maps) - 1, frame))
        self.counts["frames posed by the IMU alone"] += 1
        return frame.num_points

    def _look_for(self, frame: Frame) -> int:
        """Find a lost frame in the map, or now and then in the others; return how many points hold, 0 if it is nowhere."""
        thorough = len(self._waiting) % _THOROUGH_EVERY == 0
        others = reversed(range(len(self.maps) - 1)) if thorough else ()
        numbers = (len(self.maps) - 1, *others)
        return next((held for number in numbers if (held := self._relocalise(frame, number, thorough=thorough))), 0)

    def _relocalise(self, frame: Frame, number: int, *, thorough: bool) -> int:
        """Find a frame in a map by what it looks like, and go on in that map; return how many points hold, 0 if it is not there."""
        found = self._places.find(self.maps, number, frame, thorough=thorough)
        if found.T_camera_map is None or found.points is None:
            return 0
        kept = (frame.T_camera_map, frame.points, frame.reference)
        frame.T_camera_map, frame.points = found.T_camera_map, found.points.copy()
        track = track_local_map(self.maps[number], frame, self.settings.tracking)
        if track.held < max(_LEAST_HELD, _LEAST_SHARE * len(track.visible)):
            frame.T_camera_map, frame.points, frame.reference = kept
            return 0
        self._activate(number)
        self._velocity = None
        self.counts["frames relocalised"] += 1
        return track.held

    def _activate(self, number: int) -> None:
        """Go on in another map: it changes places with the newest."""
        newest = len(self.maps) - 1
        if number == newest:
            return
        self.maps[number], self.maps[newest] = self.maps[newest], self.maps[number]
        self._places.swap(number, newest)
        self._places.forget()
        self._mapping.forget()
        moved = {number: newest, newest: number}
        self.tracked = [replace(one, map_number=moved.get(one.map_number, one.map_number)) for one in self.tracked]

    def _new_map(self) -> None:
        if not self.maps or self.map.num_keyframes:
            self.maps.append(SparseMap(self.camera, self.scales))
        self._start = MonocularStart(self.settings.seed, self._words, self.counts)
        self._last, self._velocity = None, None
        self._mapping.forget()
        self._places.forget()

    def _words(self, frame: Frame) -> BagOfWords | None:
        return self._places.words(frame)

    def _begin(self, frame: Frame, *, again: bool) -> int:
        """Find the frame in another map, or start the map with it if that can be; return how many points it sees."""
        if not again and (held := self._look_for(frame)):
            return held
        if self.settings.localise_only:
            return 0
        if self.camera.baseline_m > 0:
            began = start_with_depth(
                self.map, frame, self.settings.close_m, self.settings.least_start, self._words(frame), self.counts
            )
        else:
            began = self._start.take(self.map, frame)
        if not began:
            return 0
        self._last_keyframe = frame.number
        self._places.learn(self.maps, len(self.maps) - 1)
        return frame.num_points

    def _track(self, last: Frame, frame: Frame) -> int:
        """Find out where the frame was taken; return how many points of the map hold, 0 if it is lost."""
        last.T_camera_map = self._beside_reference @ self.map.pose_of(last.reference)
        self.map.resolve(last)
        best = self._by_motion(last, frame)
        if best.held < _SURELY_HELD:
            best = self._by_keyframes(last, frame, best)
        if best.held < _LEAST_HELD:
            self.counts["frames lost"] += 1
            return 0
        self._set_velocity(last, frame)
        if self.settings.localise_only:
            return best.held
        count_sightings(self.map, frame, best.visible)
        if self._wants_keyframe(frame, best.held):
            self._add_keyframe(frame)
        return best.held

    def _by_motion(self, last: Frame, frame: Frame) -> LocalTrack:
        """Track the frame from where the IMU or the motion so far puts it."""
        predicted = self._predicted(last, frame)
        if predicted is None or not track_motion(self.map, last, frame, predicted, self.settings.tracking):
            return _NOTHING
        return track_local_map(self.map, frame, self.settings.tracking)

    def _by_keyframes(self, last: Frame, frame: Frame, best: LocalTrack) -> LocalTrack:
        """Track the frame from what keyframes look like, and keep what holds most points: that or `best`, which it stands at."""
        kept = (frame.T_camera_map, frame.points.copy(), frame.reference)
        found = False
        for keyframe in self._nearby(last):
            if not track_keyframe(self.map, keyframe, last.T_camera_map, frame, self.settings.tracking):
                continue
            track = track_local_map(self.map, frame, self.settings.tracking)
            if track.held > best.held:
                best, found = track, True
                kept = (frame.T_camera_map, frame.points.copy(), frame.reference)
            if best.held >= _SURELY_HELD:
                break
        frame.T_camera_map, frame.points, frame.reference = kept
        self.counts["frames tracked without motion model"] += found
        return best

    def _predicted(self, last: Frame, frame: Frame) -> NDArray[np.float64] | None:
        """Return where the frame should be: as the IMU says, else at the velocity so far; None without either."""
        if self.inertial is not None:
            predicted = self.inertial.predicted(self.map, frame.stamp_ns)
            if predicted is not None:
                return predicted
        if self._velocity is None:
            return None
        share = (frame.stamp_ns - last.stamp_ns) / self._velocity_ns
        return part_of(self._velocity, share) @ last.T_camera_map

    def _wants_keyframe(self, frame: Frame, held: int) -> bool:
        if needs_keyframe(self.map, frame, self._last_keyframe, held, self.settings.keyframes):
            return True
        return self.inertial is not None and self.inertial.wants_keyframe(self.map, frame, held)

    def _nearby(self, last: Frame) -> list[int]:
        """Return keyframes to try: the last frame's reference, the newest, and the neighbours of the former."""
        around, _ = self.map.covisible(last.reference)
        newest = int(self.map.living_keyframes[-1])
        return list(dict.fromkeys([last.reference, newest, *around[:3].tolist()]))

    def _add_keyframe(self, frame: Frame) -> None:
        keyframe = self.map.add_keyframe(frame, frame.reference, self._words(frame))
        fresh = np.empty(0, dtype=np.int64)
        if self.camera.baseline_m > 0:
            fresh = points_from_depth(
                self.map, keyframe, self.settings.close_m, frame.colours, self.settings.farthest_m
            )
        self._mapping.insert(self.map, keyframe, fresh, frame.colours)
        if self.inertial is not None:
            self._rescale(len(self.maps) - 1, self.inertial.after_keyframe(self.map, keyframe))
        keyframe = self._recognise(keyframe)
        frame.points = self.map.seen[keyframe, : len(frame.features)].copy()
        frame.T_camera_map = self.map.T_camera_map[keyframe].copy()
        frame.reference = keyframe
        self._last_keyframe = frame.number
        self.counts["keyframes"] += 1

    def _recognise(self, keyframe: int) -> int:
        """Close the loop or join the maps if the keyframe shows a known place; return its number then."""
        maps = list(self.maps)
        closure = self._places.insert(self.maps, keyframe, self._up())
        if closure is None:
            return keyframe
        self._follow(closure, maps)
        return keyframe + closure.keyframe_offset

    def _follow(self, closure: Closure, before: list[SparseMap]) -> None:
        """Keep up with a correction of the maps, which were those `before`."""
        self.closures.append(closure)
        if self._velocity is not None:
            self._velocity = self._velocity.copy()
            self._velocity[:3, 3] *= closure.length_factor
        if closure.merged_map >= 0:
            newest = len(self.maps) - 1
            self.tracked = [after_merge(frame, closure, newest) for frame in self.tracked]
            if self.inertial is not None:
                joined = before[closure.merged_map], before[newest]
                self.inertial.join(*joined, self.map, closure.keyframe_offset)
            self._mapping.forget()
        if self.inertial is not None and self.inertial.aligned(self.map):
            self.inertial.finish(self.map)  # the correction was made by the cameras alone

    def _rescale(self, number: int, scale: float) -> None:
        """Keep up with a map whose lengths became `scale` times as long."""
        if scale == 1.0:
            return
        self.tracked = [rescaled(frame, number, scale) for frame in self.tracked]
        self._places.settle_scale()
        if number == len(self.maps) - 1:
            self._beside_reference = scaled(self._beside_reference, scale)
            self._velocity = None if self._velocity is None else scaled(self._velocity, scale)

    def _up(self) -> list[NDArray[np.float64] | None] | None:
        return None if self.inertial is None else [self.inertial.up(sparse_map) for sparse_map in self.maps]

    def _keep(self, frame: Frame) -> None:
        self.untracked.pop(frame.number, None)
        self._waiting = []
        self.tracked.append(tracked_frame(self.map, len(self.maps) - 1, frame))
        self._last = frame
        self._beside_reference = self.tracked[-1].T_frame_reference

    def _set_velocity(self, last: Frame, frame: Frame) -> None:
        self._velocity = frame.T_camera_map @ np.linalg.inv(last.T_camera_map)
        self._velocity_ns = max(frame.stamp_ns - last.stamp_ns, 1)

    def finish(self) -> None:
        """Close what could still be closed, adjust every map as a whole, and look again for frames that have no pose."""
        if not self.settings.localise_only:
            self._settle()
        found = second_look(self.maps, self.tracked, self.untracked, self.settings.tracking, _LEAST_HELD)
        self.counts["frames found at a second look"] += len(found)
        for one in found:
            del self.untracked[one.number]
        self.tracked = sorted([*self.tracked, *found], key=lambda one: one.number)

    def _mend_disparities(self, number: int) -> None:
        """Take an error that all disparities of a map share out of it."""
        found = find_disparity_offset(self.maps[number])
        if found is not None:
            apply_offset(self.maps[number], found.offset_px)
            self.tracked = [with_offset(f, found.offset_px) if f.map_number == number else f for f in self.tracked]
            self.disparity_offsets[number] = found

    def _settle(self) -> None:
        maps = list(self.maps)
        if (closure := self._places.finish(self.maps, self._up())) is not None:
            self._follow(closure, maps)
        for number in range(len(self.maps) - 1):
            self._activate(number)  # each map once the newest
            maps = list(self.maps)
            if (closure := self._places.join(self.maps)) is not None:
                self._follow(closure, maps)
        for number, sparse_map in enumerate(self.maps):
            if len(sparse_map.living_keyframes) > 1:
                if self.settings.mend_disparities:
                    self._mend_disparities(number)
                scale = self.inertial.finish(sparse_map) if self.inertial is not None else None
                if scale is not None:
                    self._rescale(number, scale)
                elif self.settings.final_bundle_adjustment:
                    adjust_all(sparse_map)
            if self.inertial is not None:
                self.tracked = self.inertial.carried(self.tracked, number, sparse_map)
