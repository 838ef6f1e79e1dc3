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
from slamcli.geometry import se2, se3
from slamcli.measurements import LandmarkObservation, Landmarks
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkTerms:
    """What landmarks bring into a graph."""

    names: tuple[str, ...]
    poses: NDArray[np.float64]
    """float64 (L, 3), where they are believed to be in the map, in the order of the names."""
    term: tuple[PlanarEdges, Loss]


def mounted(seen: Landmarks, T_base_sensor: NDArray[np.float64], base_frame: str) -> Landmarks:
    """Return observations of a sensor (its mount is float64 (4, 4)) as the base would make them."""
    observations = []
    for one in seen.observations:
        T = T_base_sensor @ se3.from_position_quaternion(one.position_m, one.quat_xyzw)
        position, quat = se3.to_position_quaternion(T)
        observations.append(
            LandmarkObservation(
                id=one.id, position_m=position, quat_xyzw=quat, translation_weight=one.translation_weight,
                rotation_weight=one.rotation_weight,
            )
        )  # fmt: skip
    return Landmarks(stamp_ns=seen.stamp_ns, frame_id=base_frame, observations=tuple(observations), topic=seen.topic)


def landmark_terms(
    graph: PoseGraph2d, timelines: Mapping[int, Timeline], observed: Mapping[int, Sequence[Landmarks]]
) -> LandmarkTerms | None:
    """Return the landmarks that were seen from anywhere on the trajectories, None for none.

    Parameters
    ----------
    observed
        By trajectory, in the base frame.

    Notes
    -----
    A landmark's heading in the plane is that of its first observation: how its own axes stand is of no matter (a tag's may
    point into the wall), only how far it seems turned about the vertical since.
    """
    first_index = len(graph.submap) + len(graph.node) + len(graph.extra)
    rotations: dict[str, NDArray[np.float64]] = {}
    numbers: dict[str, int] = {}
    places: list[NDArray[np.float64]] = []
    rows: list[tuple[int, int]] = []
    measured: list[NDArray[np.float64]] = []
    weights: list[tuple[float, float]] = []
    for trajectory, listed in observed.items():
        stamps = np.array([seen.stamp_ns for seen in listed], dtype=np.int64)
        nodes, relative, known = timelines[trajectory].seen_from_nodes(stamps)
        for seen, node, T_node_base, usable in zip(listed, nodes.tolist(), relative, known.tolist(), strict=True):
            for one in seen.observations if usable else ():
                T = se3.from_position_quaternion(one.position_m, one.quat_xyzw)
                rotation = T[:3, :3] @ rotations.setdefault(one.id, T[:3, :3]).T
                yaw = math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
                pose = se2.compose(T_node_base, np.array([T[0, 3], T[1, 3], yaw]))
                number = numbers.setdefault(one.id, len(numbers))
                if number == len(places):
                    places.append(se2.compose(graph.node[node], pose))
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
    return LandmarkTerms(names=tuple(numbers), poses=np.array(places), term=(edges, loss))
