# SPDX-License-Identifier: MIT
"""What ties a graph in the plane to the world outside of the scans: landmarks and poses in a fixed frame (GPS).

Each landmark and the origin of each trajectory's fixed frame is a further pose of the graph, estimated with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.fixed_frames_2d import FixedFrame, fixed_frame_terms
from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.landmarks_2d import LandmarkTerms, landmark_terms, mounted
from slamcli.cartographer.sensor_records_2d import robot_poses, with_records
from slamcli.cartographer.timeline_2d import Timeline
from slamcli.geometry import se3
from slamcli.mapper import Setup
from slamcli.measurements import Landmarks, StampedPose
from slamcli.posegraph import MapState
from slamcli.posegraph.map_state import TrajectoryData


@dataclass(slots=True)
class Outside2d:
    """Collects landmarks and fixed-frame poses of a recording, and puts them into its graph with those of a loaded state."""

    setup: Setup
    _landmarks: list[Landmarks] = field(default_factory=list)
    _fixes: list[StampedPose] = field(default_factory=list)
    _found: LandmarkTerms | None = None
    _frames: tuple[FixedFrame, ...] = ()

    def add(self, measurement: Landmarks | StampedPose) -> None:
        """Take the next measurement."""
        if isinstance(measurement, Landmarks):
            mount = self.setup.T_base_sensor.get(measurement.topic, np.eye(4))
            self._landmarks.append(mounted(measurement, mount, self.setup.base_frame))
        else:
            self._fixes.append(measurement)

    def attach(
        self,
        graph: PoseGraph2d,
        stamps_ns: NDArray[np.int64],
        poses: NDArray[np.float64],
        node_scans: NDArray[np.int64],
    ) -> None:
        """Add terms to the graph, whose last part is the recording.

        Parameters
        ----------
        stamps_ns
            int64 (N,), increasing, of the recording's scans.
        poses
            float64 (N, 3), of these scans in the local frame.
        node_scans
            int64 (K,), of which scans the recording's nodes were made.
        """
        timelines = self._timelines(graph)
        own = graph.parts[-1]
        rows = np.flatnonzero(graph.node_part == len(graph.parts) - 1)
        timelines[own.trajectory] = Timeline.of_scans(rows, own.node_local, stamps_ns, poses, node_scans)
        observations, fixes = self._of_trajectories(graph)
        known = {} if self.setup.state is None else self.setup.state.landmarks
        self._found = landmarks = landmark_terms(graph, timelines, observations, known)
        if landmarks is not None:
            graph.add_terms([landmarks.term], landmarks.poses, landmarks.held)
        elif any(seen.observations for seen in self._landmarks):
            self.setup.log.warn("no landmark was seen with a weight while there were scans: they are not used")
        frames = []
        for trajectory, listed in fixes.items():
            lever = self._lever(listed) if trajectory == graph.parts[-1].trajectory else np.zeros(3)
            frame = self._loaded_frame(trajectory)
            found = fixed_frame_terms(graph, timelines[trajectory], listed, lever, self.setup.log, frame)
            if found is not None:
                frames.append(replace(found, trajectory=trajectory))
                graph.add_terms(found.terms, found.poses)
        self._frames = tuple(frames)

    def kept(self, graph: PoseGraph2d, state: MapState) -> MapState:
        """Return the state of the adjusted graph with what was given and found here."""
        own = graph.parts[-1].trajectory
        extra = graph.extra
        data = dict(state.trajectory_data)
        for frame in self._frames:
            before = data.get(frame.trajectory, TrajectoryData())
            data[frame.trajectory] = replace(before, T_map_fixed_frame=se3.from_se2(extra[frame.row]))
        found = {} if self._found is None else self._found.transforms(extra[: len(self._found.names)])
        topic = self._fixes[0].topic if self._fixes else ""
        mount = np.asarray(self.setup.T_base_sensor.get(topic, np.eye(4)))
        nodes = [node for node in state.nodes if node.id.trajectory == own]
        stamps = np.array([node.stamp_ns for node in nodes], dtype=np.int64)
        turns = [frame.row for frame in self._frames if frame.trajectory == own]
        yaws = se3.to_se2(np.array([node.T_map_node for node in nodes]))[:, 2] - extra[turns[0], 2] if turns else None
        fixes = robot_poses(self._fixes, mount, stamps, yaws)
        return replace(
            state,
            landmarks={**state.landmarks, **found},
            landmark_observations=with_records(state.landmark_observations, own, self._landmarks),
            fixed_frame_poses=with_records(state.fixed_frame_poses, own, fixes),
            trajectory_data=data,
        )

    def summary(self, graph: PoseGraph2d) -> dict[str, Any]:
        """Return figures for ``run.json``; nothing where nothing was used."""
        found: dict[str, Any] = {}
        if self._found is not None:
            found["landmarks"] = len(self._found.names)
        if self._frames:
            distances = np.concatenate([frame.distances_m(graph.extra) for frame in self._frames])
            found["fixes"] = len(distances)
            found["fix_residual_median_m"] = float(np.median(distances))
        return found

    def _timelines(self, graph: PoseGraph2d) -> dict[int, Timeline]:
        """Return those of the loaded trajectories."""
        state, timelines = self.setup.state, {}
        stamps_of = {node.id: node.stamp_ns for node in state.nodes} if state is not None else {}
        for k, part in enumerate(graph.parts[:-1]):
            rows = np.flatnonzero(graph.node_part == k)
            stamps = np.array([stamps_of[key] for key in part.node_ids], dtype=np.int64)
            timelines[part.trajectory] = Timeline.of_nodes(rows, part.node_local, stamps)
        return timelines

    def _of_trajectories(
        self, graph: PoseGraph2d
    ) -> tuple[dict[int, Sequence[Landmarks]], dict[int, Sequence[StampedPose]]]:
        """Return observations and fixes by trajectory, the loaded ones first."""
        state, own = self.setup.state, graph.parts[-1].trajectory
        known = {part.trajectory for part in graph.parts}
        landmarks: dict[int, Sequence[Landmarks]] = {}
        fixes: dict[int, Sequence[StampedPose]] = {}
        if state is not None:
            landmarks = {t: seen for t, seen in sorted(state.landmark_observations.items()) if t in known and t != own}
            fixes = {t: told for t, told in sorted(state.fixed_frame_poses.items()) if t in known and t != own}
        return {**landmarks, own: self._landmarks}, {**fixes, own: self._fixes}

    def _loaded_frame(self, trajectory: int) -> NDArray[np.float64] | None:
        """Return where the fixed frame of a loaded trajectory lies in the map, float64 (3,)."""
        data = None if self.setup.state is None else self.setup.state.trajectory_data.get(trajectory)
        return None if data is None or data.T_map_fixed_frame is None else se3.to_se2(data.T_map_fixed_frame)

    def _lever(self, fixes: Sequence[StampedPose]) -> NDArray[np.float64]:
        """Return the mount of the receiver, float64 (3,)."""
        topic = fixes[0].topic if fixes else ""
        return se3.to_se2(np.asarray(self.setup.T_base_sensor.get(topic, np.eye(4))))
