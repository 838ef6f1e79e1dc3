# SPDX-License-Identifier: MIT
"""What an error is measured on, and in which unit."""

from __future__ import annotations

from enum import StrEnum


class PoseRelation(StrEnum):
    """The part of an error pose E that is measured; names as evo's ``--pose_relation``."""

    FULL = "full"
    """Frobenius norm of ``E - I`` (4 x 4), no unit."""
    TRANS_PART = "trans_part"
    """Norm of the translation of E, metres."""
    ROT_PART = "rot_part"
    """Frobenius norm of ``R - I`` (3 x 3), no unit."""
    ANGLE_DEG = "angle_deg"
    """Angle of the rotation of E, degrees."""
    ANGLE_RAD = "angle_rad"
    """Angle of the rotation of E, radians."""
    POINT_DISTANCE = "point_distance"
    """Absolute: distance of the positions. Relative: difference of the distances that were covered. Metres."""
    POINT_DISTANCE_ERROR_RATIO = "point_distance_error_ratio"
    """Relative only: the difference of the distances over the true one, percent."""

    @property
    def unit(self) -> str:
        """The unit of the errors: ``m``, ``deg``, ``rad``, ``%`` or empty."""
        return {
            PoseRelation.TRANS_PART: "m",
            PoseRelation.POINT_DISTANCE: "m",
            PoseRelation.ANGLE_DEG: "deg",
            PoseRelation.ANGLE_RAD: "rad",
            PoseRelation.POINT_DISTANCE_ERROR_RATIO: "%",
        }.get(self, "")


class DeltaUnit(StrEnum):
    """What separates the two poses of a relative error; the letters f, m, d, r are evo's."""

    FRAMES = "f"
    METRES = "m"
    DEGREES = "d"
    RADIANS = "r"
    SECONDS = "s"


class AlignMode(StrEnum):
    """How the estimate is laid on the reference before the comparison."""

    NONE = "none"
    SE3 = "se3"
    SIM3 = "sim3"
    SCALE = "scale"
    """The scale of Sim(3), without its rotation and translation (evo's ``--correct_scale`` without ``--align``)."""
    POSYAW = "posyaw"
    """Position and rotation about z."""
    ORIGIN = "origin"
    """The first matched poses are laid on each other."""
