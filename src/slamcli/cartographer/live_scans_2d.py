# SPDX-License-Identifier: MIT
"""Scans as they come, with what is known by then of how the robot moved; `scan_sequence` has whole recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import TrajectoryBuilder2d
from slamcli.cartographer.range_data import RangeData, RangeMeasurement, RangeSensor, sweep_seconds
from slamcli.cartographer.scan_sequence import TANGENT, Motions, slack_of
from slamcli.errors import UsageError
from slamcli.mapper import Setup
from slamcli.measurements import Odometry
from slamcli.registration.beams import Beams
from slamcli.registration.causal_scan_odometry import CausalScanOdometry, CausalStep
from slamcli.registration.voxel_filter import adaptive_voxel_filter


@dataclass(frozen=True, slots=True, eq=False)
class LiveScan:
    """A scan, and how the robot came there."""

    index: int
    step: CausalStep
    data: RangeData
    slack_m: float
    """How uncertain the motion is where the scan did not tell it, else 0."""


class LiveScans2d:
    """Range measurements and odometry in the order in which they come."""

    def __init__(self, parameters: TrajectoryBuilder2d, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        o = parameters.scan_odometry
        self._offset_s = 0.0 if o.time_offset == "auto" else float(o.time_offset)
        self._odometry = CausalScanOdometry(
            parameters.submaps.grid_options_2d.resolution, align=o.enabled, deskew=o.deskew, offset_s=self._offset_s,
            tangent=TANGENT,
        )  # fmt: skip
        self._sensors: dict[str, RangeSensor] = {}
        self.recorded_stamps_ns: list[int] = []
        self.steps: list[CausalStep] = []
        self.slack_m: list[float] = []
        """Of each scan."""

    @property
    def has_wheels(self) -> bool:
        """Whether odometry has come."""
        return self._odometry.wheels.is_known

    @property
    def is_told(self) -> bool:
        """Whether wheels or scans tell the motion."""
        return self.has_wheels or self._parameters.scan_odometry.enabled

    def add(self, odometry: Odometry) -> None:
        """Take the next message of the wheels."""
        self._odometry.add(odometry)

    def take(self, measurement: RangeMeasurement, guess: NDArray[np.float64] | None) -> LiveScan:
        """Return the next scan; `guess` (3,) is the motion to it where neither wheels nor scans tell it."""
        sensor = self._sensor(measurement.topic)
        data: list[RangeData] = []

        def beams(twist: NDArray[np.float64] | None) -> Beams:
            data.append(sensor.range_data(measurement, twist))
            return self._thinned(data[0])

        step = self._odometry.step(measurement.stamp_ns, sweep_seconds(measurement), beams)
        if guess is not None and self.steps:
            step = replace(step, motion=guess)
        scan = LiveScan(
            index=len(self.steps), step=step, data=data[0] if data else sensor.range_data(measurement, step.twist),
            slack_m=0.0 if step.match is None else float(slack_of(step.motion[None], [step.match])[0]),
        )  # fmt: skip
        self.recorded_stamps_ns.append(measurement.stamp_ns)
        self.steps.append(step)
        self.slack_m.append(scan.slack_m)
        return scan

    def motions(self) -> Motions:
        """Return how the robot moved, from scan to scan."""
        return Motions(
            motions=np.array([step.motion for step in self.steps]), slack_m=np.array(self.slack_m),
            steps=[step.match for step in self.steps if step.match is not None], extrapolated=not self.is_told,
            offset_s=self._offset_s,
        )  # fmt: skip

    def _thinned(self, data: RangeData) -> Beams:
        """Return a scan for the scan odometry: matched points thinned to one density, as local SLAM matches them."""
        f, beams = self._parameters.adaptive_voxel_filter, data.as_beams()
        if len(data.returns) == 0:
            return beams
        chosen = adaptive_voxel_filter(data.returns, f.max_length, f.min_num_points, f.max_range)
        return replace(beams, points=data.returns[chosen])

    def _sensor(self, topic: str) -> RangeSensor:
        if topic not in self._sensors:
            mounts = self._setup.T_base_laser
            if topic not in mounts:
                raise UsageError(f"the mount of the sensor on topic {topic!r} is unknown: give --laser-pose x,y,yaw")
            self._sensors[topic] = RangeSensor(self._parameters, mounts[topic], self._setup.no_return)
        return self._sensors[topic]
