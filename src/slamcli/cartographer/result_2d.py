# SPDX-License-Identifier: MIT
"""What a run in the plane ends with."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.closing_2d import BatchClosing2d
from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.local_slam_2d import LocalSlam2d
from slamcli.cartographer.online_closing_2d import OnlineClosing2d
from slamcli.cartographer.scan_sequence import Motions
from slamcli.cartographer.state_2d import state_of_graph
from slamcli.mapper import MappingResult, Setup
from slamcli.posegraph import LoopSearch
from slamcli.posegraph.planar import PlanarSolution
from slamcli.posegraph.rendering import draw_state
from slamcli.trajectory import Trajectory


def mapping_result(
    setup: Setup,
    stamps: list[int],
    motions: Motions,
    local: LocalSlam2d,
    matched: NDArray[np.int64],
    graph: PoseGraph2d,
    closing: BatchClosing2d | OnlineClosing2d,
    solution: PlanarSolution,
    poses: NDArray[np.float64],
) -> MappingResult:
    """Return the result of a run; `poses` (N, 3) are those of all scans in the map, which were recorded at `stamps` (N,)."""
    of_nodes = [stamps[node.scan] for node in local.nodes]
    state = state_of_graph(graph, of_nodes, setup.state)
    with setup.log.stage("draw map"):
        grid = draw_state(state, setup.map_frame)
    newest = graph.node[graph.node_part == len(graph.parts) - 1]
    return MappingResult(
        trajectory=Trajectory.from_se2(stamps, poses, setup.map_frame, setup.base_frame),
        grid=grid,
        steps=_columns(stamps, motions, local, matched),
        summary=_summary(motions, local, graph, closing, solution),
        keyframes=Trajectory.from_se2(of_nodes, newest, setup.map_frame, setup.base_frame),
        state=state,
        loop_searches=_searches(graph, closing),
    )


def _columns(
    stamps: list[int], motions: Motions, local: LocalSlam2d, matched: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    nodes = {node.scan for node in local.nodes}
    columns = {
        "stamp_ns": np.array([stamps[k] for k in matched], dtype=np.int64),
        "scan_index": matched,
        "score": np.array([step.score for step in local.steps]),
        "shift_m": np.array([step.shift_m for step in local.steps]),
        "turn_rad": np.array([step.turn_rad for step in local.steps]),
        "inserted": np.array([int(k) in nodes for k in matched], dtype=np.int64),
    }
    if motions.steps:
        columns["odometry_disagreement"] = np.array([motions.steps[k].disagreement for k in matched])
        columns["scan_odometry_quality"] = np.array([motions.steps[k].quality for k in matched])
    return columns


def _searches(graph: PoseGraph2d, closing: BatchClosing2d | OnlineClosing2d) -> tuple[LoopSearch, ...]:
    submaps = [key for part in graph.parts for key in part.submap_ids]
    nodes = [key for part in graph.parts for key in part.node_ids]
    distance, turn = graph.residuals()
    found = [
        LoopSearch(
            submap=submaps[loop.submap], node=nodes[loop.node], score=loop.score, accepted=True, reason="",
            translation_residual_m=float(distance[k]), rotation_residual_rad=float(turn[k]), round=loop.round,
        )
        for k, loop in enumerate(graph.loops)
        if loop.round > 0
    ]  # fmt: skip
    found += [
        LoopSearch(
            submap=submaps[item.loop.submap], node=nodes[item.loop.node], score=item.loop.score, accepted=False,
            reason=item.rejected, round=item.loop.round,
        )
        for item in closing.rejected
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda search: (search.round, search.submap, search.node, not search.accepted)))


def _summary(
    motions: Motions,
    local: LocalSlam2d,
    graph: PoseGraph2d,
    closing: BatchClosing2d | OnlineClosing2d,
    solution: PlanarSolution,
) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "scans": len(motions.motions),
        "nodes": len(graph.node),
        "submaps": len(graph.submap),
        "constraints_intra": len(graph.membership),
        "constraints_inter": len(graph.loops),
        "loop_trials": closing.num_trials,
        "loops_rejected": dict(sorted(Counter(item.rejected for item in closing.rejected).items())),
        "optimisation_cost_before": solution.cost_before,
        "optimisation_cost_after": solution.cost_after,
        "optimisation_converged": solution.converged,
        "mean_local_score": float(np.mean([step.score for step in local.steps])),
        "time_offset_s": motions.offset_s,
    }
    if motions.steps:
        summary["mean_match_quality"] = float(np.mean([step.quality for step in motions.steps]))
        summary["wide_searches"] = sum(step.searched for step in motions.steps)
    if motions.calibration is not None:
        c = motions.calibration
        summary["wheel_calibration"] = {
            "scale": c.scale, "turn_scale": c.turn_scale, "turn_rad_m": c.turn_rad_m, "stretches": c.num_stretches,
        }  # fmt: skip
    return summary
