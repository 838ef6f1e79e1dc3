# SPDX-License-Identifier: MIT
"""Where the next frame should be."""

from __future__ import annotations

from collections import deque

import numpy as np

from slamcli.geometry import se3
from slamcli.geometry.motion import part_of
from slamcli.rtabmap.local_map import Floats
from slamcli.rtabmap.odometry_settings import OdometrySettings


class MotionGuess:
    """Goes on as the camera moved so far, or as other sensors say."""

    def __init__(self, settings: OdometrySettings, T_base_camera: Floats) -> None:
        self._settings = settings
        self._T_base_camera, self._T_camera_base = T_base_camera, se3.inverse(T_base_camera)
        self._motions: deque[tuple[int, int, Floats]] = deque()
        """Begin and end, ns, of the last motions, and T_cur_prev of the camera."""
        self._last_ns: int | None = None

    def forget(self) -> None:
        """Know nothing of the motion."""
        self._motions.clear()
        self._last_ns = None

    def add(self, stamp_ns: int, T_cur_prev: Floats) -> None:
        """Note how the camera (4, 4) moved up to a frame."""
        if self._last_ns is not None and stamp_ns > self._last_ns:
            self._motions.append((self._last_ns, stamp_ns, T_cur_prev))
        self._last_ns = stamp_ns
        while len(self._motions) > 1 and stamp_ns - self._motions[0][0] > self._settings.smoothing_ns:
            self._motions.popleft()

    def predicted(self, stamp_ns: int, T_camera_odom: Floats, guess: Floats | None) -> Floats:
        """Return where the camera should be at a stamp (4, 4), from its last pose.

        Parameters
        ----------
        guess
            float64 (4, 4), motion T_prev_cur of the base; None: as it was.
        """
        if guess is not None:
            return self._T_camera_base @ se3.inverse(guess) @ self._T_base_camera @ T_camera_odom
        if not self._motions or not self._settings.guess_motion or self._last_ns is None:
            return T_camera_odom
        whole = np.eye(4)
        for _, _, motion in self._motions:
            whole = motion @ whole
        share = (stamp_ns - self._last_ns) / (self._motions[-1][1] - self._motions[0][0])
        return part_of(whole, share) @ T_camera_odom
