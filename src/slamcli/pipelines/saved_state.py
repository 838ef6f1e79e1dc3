# SPDX-License-Identifier: MIT
"""States from files, to go on from; and the map and trajectory that are in one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from slamcli.errors import EstimationError, UsageError
from slamcli.formats.pbstream.reading import read_state
from slamcli.mapper import MappingResult, find_resuming_tier
from slamcli.posegraph import MapState, freeze, merge_states
from slamcli.posegraph.node_trajectory import state_trajectory
from slamcli.runtime import RunLog


def load_states(paths: Sequence[Path], frozen: Sequence[Path], log: RunLog) -> MapState | None:
    """Return the states of all files in one, trajectories numbered in the order of the files, `frozen` after `paths`.

    Returns None if there is no file.

    Raises
    ------
    FormatError
        If a file is no ``.pbstream``, or a damaged one.
    """
    if not paths and not frozen:
        return None
    with log.stage("load state"):
        states = [read_state(path, log=log) for path in paths]
        states += [freeze(read_state(path, log=log)) for path in frozen]
        return merge_states(states)


def check_dimensions(state: MapState | None, *, spatial: bool) -> None:
    """Refuse to go on in space from a map in the plane, or the other way round.

    Raises
    ------
    UsageError
        If the state's submaps have not the dimensions of the run.
    """
    if state is None or not state.submaps:
        return
    is_3d = any(
        submap.high_resolution is not None or submap.rotational_histogram is not None for submap in state.submaps
    )
    if is_3d != spatial:
        has, runs = (3, 2) if is_3d else (2, 3)
        raise UsageError(
            f"the state is a {has}D map, and this run maps in {runs}D: --mode {has}d, or leave the state out"
        )


def result_of(
    state: MapState, algo: str, parameters: Any, *, map_frame: str, base_frame: str, log: RunLog
) -> MappingResult:
    """Return what is in a state as the result of a run: map, trajectory of its nodes, and the state itself.

    The tier `algo` draws the map; `parameters` are its parameters.

    Raises
    ------
    EstimationError
        If there is no node in the state.
    """
    trajectory = state_trajectory(state, frame_id=map_frame, child_frame_id=base_frame)
    drawing = None
    with log.stage("draw map"):
        try:
            drawing = find_resuming_tier(algo, "--load-state").draw(parameters, state, map_frame)
        except EstimationError as error:
            log.warn(str(error))
    grid, cloud = (None, None) if drawing is None else drawing
    return MappingResult(
        trajectory=trajectory, grid=grid, cloud=cloud, keyframes=trajectory, state=state, summary=state_summary(state)
    )


def state_summary(state: MapState) -> dict[str, Any]:
    """Return the numbers of trajectories, nodes, submaps and constraints."""
    kinds = Counter(constraint.kind for constraint in state.constraints)
    return {
        "trajectories": len(state.trajectories),
        "nodes": len(state.nodes),
        "submaps": len(state.submaps),
        "constraints_intra": kinds["intra"],
        "constraints_inter": kinds["inter"],
    }
