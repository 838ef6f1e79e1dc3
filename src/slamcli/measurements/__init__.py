# SPDX-License-Identifier: MIT
"""What sensors measured: frozen records, checked on construction.

Stamps are int64 nanoseconds of the message header (the sensor's own time). Arrays are not copied; treat them as
read-only.
"""

from slamcli.measurements.calibration import RigCalibration
from slamcli.measurements.camera import CameraModel
from slamcli.measurements.frames import CameraRig, ImuNoise, RgbdFrame, StereoPair
from slamcli.measurements.geo import GeoFix
from slamcli.measurements.image import Image
from slamcli.measurements.imu import ImuSample
from slamcli.measurements.landmarks import LandmarkObservation, Landmarks
from slamcli.measurements.laser import LaserScan
from slamcli.measurements.motion import FrameTransform, Odometry, SessionStart, StampedPose, StampedTwist
from slamcli.measurements.points import PointCloud

Measurement = (
    LaserScan
    | PointCloud
    | Image
    | StereoPair
    | RgbdFrame
    | ImuSample
    | Odometry
    | StampedPose
    | StampedTwist
    | FrameTransform
    | CameraModel
    | GeoFix
    | Landmarks
    | SessionStart
)

__all__ = [
    "CameraModel",
    "CameraRig",
    "FrameTransform",
    "GeoFix",
    "Image",
    "ImuNoise",
    "ImuSample",
    "LandmarkObservation",
    "Landmarks",
    "LaserScan",
    "Measurement",
    "Odometry",
    "PointCloud",
    "RgbdFrame",
    "RigCalibration",
    "SessionStart",
    "StampedPose",
    "StampedTwist",
    "StereoPair",
]
