# SPDX-License-Identifier: MIT
"""Cartographer's trimmers, at the end of a run: in batch nothing has to be dropped while it goes on."""

from __future__ import annotations

from dataclasses import replace

from slamcli.cartographer.parameters import CartographerParameters
from slamcli.mapper import MappingResult, Setup
from slamcli.posegraph.rendering import draw_state
from slamcli.posegraph.trimming import keep_newest, trim_overlapping


def trimmed(result: MappingResult, parameters: CartographerParameters, setup: Setup) -> MappingResult:
    """Return the result with the submaps that the trimmers leave: in its state, and in the plane in its map.

    Trajectory and keyframes stay: they were found with all submaps.
    """
    before = result.state
    if before is None:
        return result
    state = before
    overlapping = parameters.pose_graph.overlapping_submaps_trimmer_2d
    if overlapping.is_on and parameters.map_builder.dimensions != 3:
        filled = overlapping.filled()
        state = trim_overlapping(
            state, filled.fresh_submaps_count, filled.min_covered_area, filled.min_added_submaps_count
        )
    newest = parameters.trajectory_builder.pure_localization_trimmer
    if newest.is_on and state.trajectories:
        loaded = setup.state.trajectories if setup.state is not None else ()
        state = keep_newest(state, max(loaded, default=-1) + 1, newest.max_submaps_to_keep)
    dropped = len(before.submaps) - len(state.submaps)
    if not dropped:
        return result
    setup.log.note(f"{dropped} submaps were trimmed from the state, {len(state.submaps)} are left")
    grid = result.grid
    if any(submap.grid is not None for submap in state.submaps):
        with setup.log.stage("draw map"):
            grid = draw_state(state, setup.map_frame)
    return replace(result, state=state, grid=grid, summary={**result.summary, "trimmed_submaps": dropped})
