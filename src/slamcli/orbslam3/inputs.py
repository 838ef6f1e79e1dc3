# SPDX-License-Identifier: MIT
"""In which mode ORB-SLAM3 runs on what a recording offers."""

from __future__ import annotations

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.runtime import RunLog

MODES = ("mono", "stereo", "rgbd", "mono-inertial", "stereo-inertial", "rgbd-inertial")
ROLES = frozenset({"images", "imu"})
_BEST_FIRST = ("stereo", "rgbd", "mono")
_NEEDS = {
    "mono": "a camera's images",
    "stereo": "images of a left and a right camera (--left-topic, --right-topic)",
    "rgbd": "colour and depth images (--rgb-topic, --depth-topic)",
}


def plan_inputs(parameters: OrbSlam3Parameters, offer: SensorOffer, log: RunLog) -> InputPlan:
    """Return the mode to run in: what the user asks for, else the best that the recording has.

    Raises
    ------
    RecordingError, UsageError
        If there are no images, or not those of the mode that is asked for.
    """
    cameras, _, inertial = (offer.mode or "").partition("-")
    if not offer.cameras:
        raise RecordingError("no camera images that orbslam3 could use")
    if cameras and cameras not in offer.cameras:
        raise UsageError(f"--mode {offer.mode} needs {_NEEDS[cameras]}; the recording has {_what(offer)}")
    if inertial and not offer.imu:
        raise UsageError(f"--mode {offer.mode} needs an IMU topic (--imu-topic), and the recording has none")
    use_imu = bool(inertial) or (not offer.mode and offer.imu and (offer.imu_calibrated or "imu" in offer.named))
    mode = cameras or next(mode for mode in _BEST_FIRST if mode in offer.cameras)
    if not offer.mode:
        log.note(
            f"mode {mode}{'-inertial' if use_imu else ''}, as the recording has {_what(offer)} (choose with --mode)"
        )
        if offer.imu and not use_imu:
            log.note(
                "the IMU is left out, as its noise or its place at the camera is not known"
                f" (--mode {mode}-inertial uses it, with the noise of IMU.NoiseGyro and the like)"
            )
    return InputPlan(
        parameters=parameters,
        num_laser_scans=0,
        spatial=True,
        odometry=False,
        imu=use_imu,
        camera_mode=mode,
        map_frame=parameters.map_frame,
    )


def _what(offer: SensorOffer) -> str:
    names = {"mono": "one camera", "stereo": "a stereo pair", "rgbd": "colour with depth"}
    kinds = [
        names[kind] for kind in _BEST_FIRST if kind in offer.cameras and (kind != "mono" or len(offer.cameras) == 1)
    ]
    return " and ".join([*kinds, *(["an IMU"] if offer.imu else [])])
