# SPDX-License-Identifier: MIT
"""The tier's mapper: frames are prepared on other threads, tracked and mapped in their order."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

from slamcli.errors import CalibrationError, UsageError
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import CameraRig, Image, ImuSample, Measurement, RgbdFrame, StereoPair
from slamcli.orbslam3.atlas import sparse_maps
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.frame_making import FrameMaker
from slamcli.orbslam3.inertial_state import Imu
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.orbslam3.result import result_of
from slamcli.orbslam3.session import Session
from slamcli.orbslam3.settings import session_settings

_AHEAD = 4
"""Frames whose key points are found before they are needed."""


class OrbSlam3Mapper:
    """Visual SLAM in batch: what a keyframe sets off is done before the next frame is looked at."""

    def __init__(self, parameters: OrbSlam3Parameters, setup: Setup) -> None:
        if setup.rig is None:
            raise UsageError("orbslam3: no camera; name its topic (--rgb-topic, --left-topic and --right-topic)")
        if setup.atlas is not None and setup.rig.inertial and not setup.localise_only:
            raise UsageError(
                "orbslam3: an atlas keeps nothing of an IMU, so an inertial mode can find frames in its maps (--localise-only) "
                f"but not go on mapping there: take --mode {setup.rig.mode}"
            )
        self._setup, self._log = setup, setup.log
        self._maker = FrameMaker(parameters, setup.rig)
        self._imu = _imu(setup.rig, self._maker)
        self._session = Session(
            self._maker.camera,
            self._maker.scales,
            replace(
                session_settings(parameters, setup.rig, self._maker.camera, setup.seed),
                localise_only=setup.localise_only,
            ),
            vocabulary=setup.vocabulary,
            given=() if setup.atlas is None else sparse_maps(setup.atlas, self._maker.camera, self._maker.scales),
            imu=self._imu,
        )
        self._workers = ThreadPoolExecutor(1) if setup.jobs > 1 else None
        self._waiting: deque[Future[Frame] | _Done] = deque()
        self._stamps_ns: list[int] = []

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement."""
        if isinstance(measurement, (StereoPair, RgbdFrame, Image)):
            number = len(self._stamps_ns)
            self._stamps_ns.append(measurement.stamp_ns)
            if self._workers is None:
                self._waiting.append(_Done(self._maker.make(number, measurement)))
            else:
                self._waiting.append(self._workers.submit(self._maker.make, number, measurement))
            while len(self._waiting) > _AHEAD:
                self._session.take(self._waiting.popleft().result())
        elif isinstance(measurement, ImuSample) and self._imu is not None:
            self._imu.buffer.add(measurement)

    def finish(self) -> MappingResult:
        """End the run and return its result."""
        while self._waiting:
            self._session.take(self._waiting.popleft().result())
        if self._workers is not None:
            self._workers.shutdown()
        with self._log.stage("adjust"):
            self._session.finish()
        return result_of(self._session, self._maker, self._setup, self._stamps_ns)


def _imu(rig: CameraRig, maker: FrameMaker) -> Imu | None:
    """Return the IMU of a rig that uses one.

    Raises
    ------
    CalibrationError
        If nobody said where it is mounted.
    """
    if not rig.inertial:
        return None
    T_camera_imu = maker.preparation.T_camera_imu
    if T_camera_imu is None:
        raise CalibrationError(
            "orbslam3: where the IMU is mounted beside the camera is unknown: give IMU.T_b_c1, or a mode without inertial"
        )
    return Imu(T_camera_imu=T_camera_imu, given_noise=rig.imu_noise, fixed_scale=maker.camera.baseline_m > 0)


class _Done:
    """What is there already, in the place of what another thread makes."""

    def __init__(self, frame: Frame) -> None:
        self._frame = frame

    def result(self) -> Frame:
        """Return it."""
        return self._frame
