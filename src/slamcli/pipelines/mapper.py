# SPDX-License-Identifier: MIT
"""The tier's mapper: sensors are turned into frames with odometry, some of which become nodes of the memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.mapper import MappingResult, Setup
from slamcli.measurements import Measurement, SessionStart
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.fronts import Front, front_of
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.node_rate import NodeRate
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.result import result_of
from slamcli.rtabmap.session import Session
from slamcli.rtabmap.sessions import open_session
from slamcli.rtabmap.signature import no_features


class RtabmapMapper:
    """RTAB-Map: odometry frame by frame, and a memory that is updated at Rtabmap/DetectionRate."""

    def __init__(self, parameters: RtabmapParameters, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        self._front: Front = front_of(parameters, setup)
        self._session: Session = open_session(parameters, setup, self._front)
        self._track = FrameTrack()
        self._rate = NodeRate(parameters.rtabmap.detection_rate)
        self._begins = True
        self._covariance: NDArray[np.float64] = np.zeros((6, 6))

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement."""
        if isinstance(measurement, SessionStart):
            self._end_recording()
            self._front = front_of(self._parameters, self._setup)
            self._begins = True
            return
        for moment in self._front.take(measurement):
            self._take(moment)

    def finish(self) -> MappingResult:
        """End the run and return its result.

        Raises
        ------
        EstimationError
            If nothing became a node.
        """
        self._end_recording()
        if not self._session.graph.nodes:
            raise EstimationError(f"rtabmap: {self._front.why_nothing()}")
        with self._setup.log.stage("optimise"):
            self._session.finish(self._track)
        with self._setup.log.stage("maps"):
            return result_of(self._session, self._track, self._parameters, self._setup)

    def _end_recording(self) -> None:
        for moment in self._front.finish():
            self._take(moment)
        refined = self._front.refined()
        if refined is not None:
            self._track.refine(*refined)

    def _take(self, moment: Moment) -> None:
        step = moment.step
        begins = step.T_odom_base is not None and (self._begins or step.began_anew)
        self._track.add(step, begins=begins)
        if step.T_odom_base is None:
            return
        self._begins = False
        self._covariance = np.zeros((6, 6)) if begins else self._covariance + step.covariance
        if not (self._rate.due(step.stamp_ns) or begins):
            return
        features = no_features() if moment.features is None else moment.features
        node = NodeInput(
            stamp_ns=step.stamp_ns, T_odom_base=step.T_odom_base, covariance=self._covariance, began_anew=begins,
            features=features, points=self._front.points(features), scan=moment.scan,
            images=None if moment.prepared is None else self._front.images(moment.prepared),
        )  # fmt: skip
        node_id = self._session.update(node)
        if node_id is not None:
            self._track.mark_node(node_id)
            self._covariance = np.zeros((6, 6))
