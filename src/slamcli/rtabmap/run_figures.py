# SPDX-License-Identifier: MIT
"""What a run tells of itself: figures for ``run.json``, closures that were tried, and words where something is missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slamcli.posegraph.place_closure import PlaceClosure, without_figures
from slamcli.rtabmap.closure_check import KIND_NAMES, ClosureRecord
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.frame_track import FrameTrack, PlacedFrames
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.session import Session
from slamcli.runtime import RunLog
from slamcli.trajectory.gaps import gap_sentence


def stamps_of(database: Database) -> dict[int, int]:
    """Return the stamps of all nodes of a database, nanoseconds, by their ids."""
    nodes = database.nodes()
    return dict(zip(nodes.ids.tolist(), nodes.stamps_ns.tolist(), strict=True))


def place_closures(records: Sequence[ClosureRecord], database: Database) -> tuple[PlaceClosure, ...]:
    """Return the closures that were tried, in their order."""
    stamp_of = stamps_of(database) if records else {}
    return tuple(_closure(record, stamp_of) for record in records)


def _closure(record: ClosureRecord, stamp_of: Mapping[int, int]) -> PlaceClosure:
    node, older = record.to_id, record.from_id
    if record.kind == LinkKind.LANDMARK:  # its link leads from the node
        node, older = older, node
    return PlaceClosure(
        stamp_ns=record.stamp_ns, older_stamp_ns=stamp_of.get(older), node=node, older_node=older,
        kind=KIND_NAMES.get(record.kind, record.kind.name.lower()), accepted=record.accepted, reason=record.reason,
        posterior=record.posterior, num_matches=record.num_matches, num_inliers=record.num_inliers, strain=record.ratio,
    )  # fmt: skip


def summary_of(
    session: Session,
    track: FrameTrack,
    ids: Sequence[int],
    placed: PlacedFrames,
    closures: Sequence[PlaceClosure],
    parameters: RtabmapParameters,
) -> dict[str, Any]:
    """Return the figures for ``run.json``.

    Parameters
    ----------
    ids
        Nodes of the map that is the result.
    closures
        That this run tried.
    """
    graph = session.graph
    kinds = Counter(link.kind for link in graph.links)
    sizes = session.memory.sizes()
    lost = track.num_lost
    refused = Counter(without_figures(one.reason) for one in closures if not one.accepted)
    return {
        "odometry": parameters.slamcli.odometry,
        "frames": len(track.stamps_ns),
        "lost": lost,
        "carried_by_the_recordings_odometry": track.num_carried,
        "in other maps": len(track.stamps_ns) - lost - len(placed.rows),
        "odometry_resets": max(track.num_stretches - 1, 0),
        "nodes": len(session.own_nodes),
        "nodes in the map": len(ids),
        "sessions joined": len({graph.nodes[node_id].map_id for node_id in ids}),
        "sessions": len({node.map_id for node in graph.nodes.values()}),
        "loop_closures": kinds[LinkKind.GLOBAL_CLOSURE],
        "proximity_closures": kinds[LinkKind.LOCAL_SPACE_CLOSURE] + kinds[LinkKind.LOCAL_TIME_CLOSURE],
        "closures_tried": _by_kind(closures),
        "refused_because": dict(sorted(refused.items(), key=lambda item: (-item[1], item[0]))),
        "memory": {
            "short-term nodes": sizes.short_term, "working nodes": sizes.working, "long-term nodes": sizes.long_term,
            "words": sizes.words,
        },
        "database_version": session.keeping.database.version,
    }  # fmt: skip


def _by_kind(closures: Sequence[PlaceClosure]) -> dict[str, dict[str, int]]:
    """Return how many closures of each kind were accepted and refused."""
    counts = Counter((one.kind, one.accepted) for one in closures)
    return {
        kind: {"accepted": counts[kind, True], "refused": counts[kind, False]}
        for kind in sorted({one.kind for one in closures})
    }


def tell_what_is_missing(
    track: FrameTrack, placed: PlacedFrames, graph: MapGraph, own_nodes: Sequence[int], log: RunLog, what: str
) -> None:
    """Warn of frames without a pose in the map, and of maps that no closure ties to it.

    Parameters
    ----------
    what
        What a frame is called.
    """
    has_pose = np.zeros(len(track.stamps_ns), dtype=np.bool_)
    has_pose[placed.rows] = True
    message = gap_sentence(np.array(track.stamps_ns, dtype=np.int64), has_pose, what)
    elsewhere = len(track.stamps_ns) - track.num_lost - len(placed.rows)
    if not message:
        return
    if elsewhere:
        message += (
            f"; {elsewhere} of them lie in other maps: the run made {_num_maps(graph, own_nodes)}, no closure ties them, and the result is the one with most nodes"
            " (the others stay in the database, and a later session may join them)"
        )
    log.warn(message)


def _num_maps(graph: MapGraph, node_ids: Sequence[int]) -> int:
    count, seen = 0, set[int]()
    for node_id in node_ids:
        if node_id not in seen:
            count += 1
            seen.update(graph.component(node_id))
    return count
