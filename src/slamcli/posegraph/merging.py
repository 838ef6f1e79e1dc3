# SPDX-License-Identifier: MIT
"""Several states in one: their trajectories are numbered anew, one state after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from slamcli.posegraph.map_state import Id, MapState

T = TypeVar("T")


def merge_states(states: Sequence[MapState]) -> MapState:
    """Return one state with the trajectories of all, numbered from 0 in the order of the states and their numbers.

    Poses stay as they are: each state keeps its own map frame, until constraints between their trajectories tie them
    together. Of a landmark that several states know the first one's pose is taken. What was frozen stays frozen.
    """
    parts = []
    first = 0
    for state in states:
        numbers = {old: first + new for new, old in enumerate(_known(state))}
        first += len(numbers)
        parts.append(_renumbered(state, numbers))
    return MapState(
        nodes=tuple(node for part in parts for node in part.nodes),
        submaps=tuple(submap for part in parts for submap in part.submaps),
        constraints=tuple(constraint for part in parts for constraint in part.constraints),
        frozen=frozenset().union(*(part.frozen for part in parts)),
        imu=_joined([part.imu for part in parts]),
        odometry=_joined([part.odometry for part in parts]),
        fixed_frame_poses=_joined([part.fixed_frame_poses for part in parts]),
        landmarks={name: pose for part in reversed(parts) for name, pose in part.landmarks.items()},
        landmark_observations=_joined([part.landmark_observations for part in parts]),
        trajectory_data=_joined([part.trajectory_data for part in parts]),
        options=_joined([part.options for part in parts]),
    )


def freeze(state: MapState) -> MapState:
    """Return the state with all its trajectories frozen: the optimisation must not move them."""
    return replace(state, frozen=frozenset(state.trajectories))


def _known(state: MapState) -> list[int]:
    """Return every trajectory that something in the state belongs to."""
    tables = (state.imu, state.odometry, state.fixed_frame_poses, state.landmark_observations, state.trajectory_data)
    return sorted({*state.trajectories, *state.frozen, *state.options, *(key for table in tables for key in table)})


def _renumbered(state: MapState, numbers: dict[int, int]) -> MapState:
    def moved(key: Id) -> Id:
        return Id(numbers[key.trajectory], key.number)

    def keyed(table: dict[int, T]) -> dict[int, T]:
        return {numbers[key]: value for key, value in sorted(table.items())}

    return replace(
        state,
        nodes=tuple(replace(node, id=moved(node.id)) for node in state.nodes),
        submaps=tuple(replace(submap, id=moved(submap.id)) for submap in state.submaps),
        constraints=tuple(replace(c, submap=moved(c.submap), node=moved(c.node)) for c in state.constraints),
        frozen=frozenset(numbers[key] for key in state.frozen),
        imu=keyed(state.imu),
        odometry=keyed(state.odometry),
        fixed_frame_poses=keyed(state.fixed_frame_poses),
        landmark_observations=keyed(state.landmark_observations),
        trajectory_data=keyed(state.trajectory_data),
        options=keyed(state.options),
    )


def _joined(tables: Sequence[dict[int, T]]) -> dict[int, T]:
    return {key: value for table in tables for key, value in table.items()}
