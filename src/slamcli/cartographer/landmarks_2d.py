# SPDX-License-Identifier: MIT
"""Landmarks as poses of a graph in the plane."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.timeline_2d import Timeline
from slamcli.geometry import quaternion, se2, se3
from slamcli.measurements import LandmarkObservation, Landmarks
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkTerms:
    """What landmarks bring into a graph."""

    names: tuple[str, ...]
    poses: NDArray[np.float64]
    """float64 (L, 3), where they are believed to be in the map, in the order of the names."""
    references: NDArray[np.float64]
    """float64 (L, 4, 4), their orientation where the heading is 0, and their height."""
    held: NDArray[np.bool_]
    """bool (L,), those whose place in the map is given and not to be adjusted."""
    term: tuple[PlanarEdges, Loss]

    def transforms(self, poses: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        """Return poses (4, 4) by name from those in the plane (L, 3)."""
        T = se3.from_se2(poses)
        T[:, :3, :3] = T[:, :3, :3] @ self.references[:, :3, :3]
        T[:, 2, 3] = self.references[:, 2, 3]
        return dict(zip(self.names, T, strict=True))


def mounted(seen: Landmarks, T_base_sensor: NDArray[np.float64], base_frame: str) -> Landmarks:
    """Return observations of a sensor (its mount is float64 (4, 4)) as the base would make them."""
    observations = []
    for one in seen.observations:
        T = T_base_sensor @ se3.from_position_quaternion(one.position_m, quaternion.normalise(one.quat_xyzw))
        position, quat = se3.to_position_quaternion(T)
        observations.append(
            LandmarkObservation(
                id=one.id, position_m=position, quat_xyzw=quat, translation_weight=one.translation_weight,
                rotation_weight=one.rotation_weight,
            )
        )  # fmt: skip
    return Landmarks(stamp_ns=seen.stamp_ns, frame_id=base_frame, observations=tuple(observations), topic=seen.topic)


def landmark_terms(
    graph: PoseGraph2d,
    timelines: Mapping[int, Timeline],
    observed: Mapping[int, Sequence[Landmarks]],
    known: Mapping[str, NDArray[np.float64]],
) -> LandmarkTerms | None:
    """Return the landmarks that were seen from anywhere on the trajectories, None for none.

    Parameters
    ----------
    observed
        By trajectory, in the base frame; that of the recording is the last one.
    known
        Poses float64 (4, 4) of landmarks in a loaded map. Those that no loaded trajectory saw stay where they are.

    Notes
    -----
    A landmark's heading in the plane is that of its first observation: how its own axes stand is of no matter (a tag's may
    point into the wall), only how far it seems turned about the vertical since.
    """
    first_index = len(graph.submap) + len(graph.node) + len(graph.extra)
    references: dict[str, NDArray[np.float64]] = {}
    own = max(observed, default=0)
    seen_before = {one.id for k, listed in observed.items() if k != own for seen in listed for one in seen.observations}
    given = {name: T for name, T in known.items() if name not in seen_before}
    numbers: dict[str, int] = {}
    places: list[NDArray[np.float64]] = []
    rows: list[tuple[int, int]] = []
    measured: list[NDArray[np.float64]] = []
    weights: list[tuple[float, float]] = []
    for trajectory, listed in observed.items():
        stamps = np.array([seen.stamp_ns for seen in listed], dtype=np.int64)
        nodes, relative, near = timelines[trajectory].seen_from_nodes(stamps)
        for seen, node, T_node_base, usable in zip(listed, nodes.tolist(), relative, near.tolist(), strict=True):
            for one in seen.observations if usable else ():
                if not (one.translation_weight or one.rotation_weight):
                    continue
                T = se3.from_position_quaternion(one.position_m, quaternion.normalise(one.quat_xyzw))
                rotation = T[:3, :3] @ references.setdefault(one.id, given.get(one.id, T))[:3, :3].T
                yaw = math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
                pose = se2.compose(T_node_base, np.array([T[0, 3], T[1, 3], yaw]))
                number = numbers.setdefault(one.id, len(numbers))
                if number == len(places):
                    place = se2.compose(graph.node[node], pose)
                    places.append(np.append(given[one.id][:2, 3], 0.0) if one.id in given else place)
                rows.append((node + len(graph.submap), first_index + number))
                measured.append(pose)
                weights.append((one.translation_weight, one.rotation_weight))
    if not rows:
        return None
    ends, factors = np.array(rows, dtype=np.int64), np.array(weights)
    edges = PlanarEdges(
        first=ends[:, 0], second=ends[:, 1], measured=np.array(measured), translation_weight=factors[:, 0],
        rotation_weight=factors[:, 1], robust=np.ones(len(ends), np.bool_),
    )  # fmt: skip
    loss = Loss(kind="huber", scale=graph.parameters.optimization_problem.huber_scale)
    return LandmarkTerms(
        names=tuple(numbers), poses=np.array(places), references=np.array([references[name] for name in numbers]),
        held=np.array([name in given for name in numbers], np.bool_), term=(edges, loss),
    )  # fmt: skip
