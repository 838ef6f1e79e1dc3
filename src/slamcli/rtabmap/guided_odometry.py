# SPDX-License-Identifier: MIT
"""Visual odometry that the recording's odometry guides, and that it carries over stretches in which nothing is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.given_odometry import GivenOdometry, motion_covariance
from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.visual_odometry import VisualOdometry
from slamcli.vision.features import Features

Floats = NDArray[np.float64]


class GuidedOdometry:
    """Asks the images first; where they do not tell, the wheels do.

    Where visual odometry begins anew it does so in a frame of its own: the motion of the wheels since the last frame that was
    seen ties both frames together.
    """

    def __init__(self, visual: VisualOdometry, wheels: GivenOdometry) -> None:
        self._visual, self._wheels = visual, wheels
        self._T_odom_visual: Floats = np.eye(4)
        """From the frame that visual odometry is in now."""
        self._frames_of: dict[int, Floats] = {}
        """The same when each frame was seen, by its stamp."""
        self._carried: dict[int, tuple[int, Floats]] = {}
        """Frames that wheels carried on to: the last one that was seen, and the motion since."""
        self._last: tuple[int, Floats] | None = None
        """Stamp and pose T_odom_base of the last frame that was seen."""

    def step(self, stamp_ns: int, features: Features) -> OdometryStep:
        """Return where the next frame was taken."""
        motion = self._motion(stamp_ns)
        found = self._visual.step(stamp_ns, features, motion)
        seen = found.T_odom_base
        if seen is None:
            return found if motion is None or self._last is None else self._carry(found, motion)
        if found.began_anew and motion is not None and self._last is not None:
            self._T_odom_visual = self._last[1] @ motion @ se3.inverse(seen)
            found = replace(found, covariance=motion_covariance(motion), began_anew=False)
        found = replace(found, adds_up=found.keyframe)
        pose = self._T_odom_visual @ seen
        self._frames_of[stamp_ns] = self._T_odom_visual
        self._last = (stamp_ns, pose)
        return replace(found, T_odom_base=pose)

    def track(self) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps (F,) and poses T_odom_base (F, 4, 4) of all frames that have one, as known in the end."""
        stamps, poses = self._visual.track()
        placed = {
            stamp: self._frames_of[stamp] @ pose
            for stamp, pose in zip(stamps.tolist(), poses, strict=True)
            if stamp in self._frames_of
        }
        for stamp, (seen, motion) in self._carried.items():
            if seen in placed:
                placed[stamp] = placed[seen] @ motion
        ordered = sorted(placed)
        return np.array(ordered, dtype=np.int64), np.array([placed[stamp] for stamp in ordered]).reshape(-1, 4, 4)

    def is_carried(self, stamp_ns: int) -> bool:
        """Return whether the wheels alone told where a frame was taken."""
        return stamp_ns in self._carried

    def _motion(self, stamp_ns: int) -> Floats | None:
        """Return the motion of the wheels since the last frame that was seen; None where they do not tell."""
        if self._last is None:
            return None
        then, now = self._wheels.at(self._last[0]), self._wheels.at(stamp_ns)
        return None if then is None or now is None else se3.inverse(then) @ now

    def _carry(self, lost: OdometryStep, motion: Floats) -> OdometryStep:
        if self._last is None:
            return lost
        self._carried[lost.stamp_ns] = (self._last[0], motion)
        pose = self._last[1] @ motion
        return replace(lost, T_odom_base=pose, covariance=motion_covariance(motion), adds_up=False, carried=True)
