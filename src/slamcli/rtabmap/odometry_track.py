# SPDX-License-Identifier: MIT
"""Where every frame was by odometry, while its keyframes still move."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.local_map import Floats, Keyframe
from slamcli.rtabmap.motion_filter import MotionFilter
from slamcli.rtabmap.odometry_settings import OdometrySettings


class OdometryTrack:
    """Frames by their poses beside keyframes; or, where motion is filtered, as they were given out."""

    def __init__(self, settings: OdometrySettings, T_base_camera: Floats) -> None:
        self._T_camera_base = se3.inverse(T_base_camera)
        self._filter = MotionFilter(settings) if settings.filters_motion else None
        self._stamps_ns: list[int] = []
        self._references: list[int] = []
        self._T_frame_reference: list[Floats] = []
        self._T_camera_odom: list[Floats] = []
        """Of all keyframes there have been."""
        self._given: list[Floats] = []
        """T_odom_base by the filter."""

    def settle(self, keyframes: Iterable[Keyframe]) -> None:
        """Take over where keyframes are now; new ones are the last."""
        for keyframe in keyframes:
            if keyframe.number == len(self._T_camera_odom):
                self._T_camera_odom.append(keyframe.T_camera_odom)
            self._T_camera_odom[keyframe.number] = keyframe.T_camera_odom

    def add(self, stamp_ns: int, reference: Keyframe, T_camera_odom: Floats, *, begins: bool = False) -> None:
        """Append a frame; `begins`: a stretch that has no motion from the frame before."""
        before = self._raw(-1) if self._stamps_ns else np.eye(4)
        self._append(stamp_ns, reference.number, T_camera_odom @ se3.inverse(reference.T_camera_odom))
        if self._filter is not None:
            seconds = (stamp_ns - self._stamps_ns[-2]) / 1e9 if len(self._stamps_ns) > 1 else 0.0
            now = self._raw(-1)
            last = self._given[-1] if self._given else before
            if begins:
                self._filter.forget()
                self._given.append(last if self._given else now)
            else:
                self._given.append(last @ self._filter.filtered(se3.inverse(before) @ now, seconds))

    def repeat(self, stamp_ns: int) -> None:
        """Append a frame that is where the one before was."""
        self._append(stamp_ns, self._references[-1], self._T_frame_reference[-1])
        if self._filter is not None:
            self._given.append(self._given[-1])

    def newest(self) -> Floats:
        """Return T_odom_base (4, 4) of the last frame."""
        return self._given[-1] if self._filter is not None else self._raw(-1)

    def poses(self) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps (F,) and T_odom_base (F, 4, 4) of all frames."""
        stamps = np.array(self._stamps_ns, dtype=np.int64)
        if self._filter is not None:
            return stamps, np.array(self._given).reshape(-1, 4, 4)
        return stamps, np.array([self._raw(row) for row in range(len(stamps))]).reshape(-1, 4, 4)

    def _append(self, stamp_ns: int, reference: int, T_frame_reference: Floats) -> None:
        self._stamps_ns.append(stamp_ns)
        self._references.append(reference)
        self._T_frame_reference.append(T_frame_reference)

    def _raw(self, row: int) -> Floats:
        T_camera_odom = self._T_frame_reference[row] @ self._T_camera_odom[self._references[row]]
        return se3.inverse(T_camera_odom) @ self._T_camera_base
