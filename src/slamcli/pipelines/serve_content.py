# SPDX-License-Identifier: MIT
"""What the player shows of a result: small facts, and arrays that a browser reads as they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.pipelines.replay import Replay
from slamcli.pipelines.replay_tracks import ReplayImage
from slamcli.pipelines.serve_charts import PlayerClock, add_charts
from slamcli.reports.figures.track import choose_axes
from slamcli.reports.graph_map import residual_classes
from slamcli.trajectory import Trajectory

_MOST_CLOUD_POINTS = 250_000
_MOST_SCAN_POINTS = 4_000_000
_FAR_M = 10_000.0
"""Coordinates beyond it are moved near to zero, where float32 tells millimetres apart."""
_LEAST_GAP_S = 1.0
_GAP_INTERVALS = 5.0
_AXES = "xyz"
_UNMEASURED = 9
"""Class of edges without a residual."""
_GROWTH = {
    "scans": "",
    "visibility": "The recording was not found: the map grows by what can be seen of it from each pose, not by its scans.",
    "none": "",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayerContent:
    """A result as the player takes it."""

    facts: Mapping[str, Any]
    """``replay.json``; ``arrays`` in it tells type, shape and address of each array."""
    arrays: Mapping[str, NDArray[Any]]
    images: tuple[Callable[[int], bytes], ...]
    """Give the JPEG of each image, no wider than a number of pixels."""


def player_content(
    replay: Replay, *, title: str | None = None, scan_points: int = _MOST_SCAN_POINTS, images: int | None = None
) -> PlayerContent:
    """Return what the player shows of a result.

    Parameters
    ----------
    replay
        What happened when.
    title
        Line above the page; None for the name of the result.
    scan_points
        How many points of scans are kept at most; of more every second, third ... scan is.
    images
        How many images of all cameras are kept at most, spread evenly; None for all.
    """
    trajectory = replay.trajectory
    clock = PlayerClock(int(trajectory.stamps_ns[0]))
    first, second = (0, 1) if replay.grid is not None else choose_axes([trajectory])
    axes = [first, second]
    shift = np.where(np.abs(trajectory.positions_m[0, axes]) > _FAR_M, np.round(trajectory.positions_m[0, axes]), 0.0)
    arrays: dict[str, NDArray[Any]] = _poses(trajectory, clock, axes, shift)
    facts: dict[str, Any] = {
        "title": title or replay.name, "algo": replay.algo, "poses": len(trajectory), "duration_s": float(arrays["time"][-1]),
        "gap_s": _gap_s(arrays["time"]), "axes": [_AXES[first], _AXES[second]], "shift_m": shift.tolist(),
        "map": None, "growth": replay.growth, "facts": _told(replay), "notes": [n for n in (_GROWTH[replay.growth],) if n],
    }  # fmt: skip
    if replay.truth is not None and len(replay.truth):
        arrays["truth_time"] = clock.of(replay.truth.stamps_ns)
        arrays["truth"] = _flat(replay.truth.positions_m[:, axes] - shift)
    _add_map(replay, shift, facts, arrays)
    _add_cloud(replay, axes, shift, arrays)
    _add_scans(replay, clock, shift, scan_points, facts, arrays)
    _add_particles(replay, clock, shift, facts, arrays)
    marks = _add_graph(replay, clock, axes, shift, arrays)
    _add_submaps(replay, clock, shift, arrays)
    shown = _add_images(replay, clock, images, facts, arrays)
    facts["charts"], step_marks = add_charts(replay, clock, arrays)
    facts["marks"] = {**marks, **step_marks}
    facts["bounds_m"] = _bounds(facts, arrays)
    facts["arrays"] = {
        name: {"dtype": str(array.dtype), "shape": list(array.shape), "href": f"data/{name}.bin"}
        for name, array in arrays.items()
    }
    return PlayerContent(facts=facts, arrays=arrays, images=shown)


def _flat(points: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(points, dtype=np.float32)


def _poses(
    trajectory: Trajectory, clock: PlayerClock, axes: Sequence[int], shift: NDArray[np.float64]
) -> dict[str, NDArray[Any]]:
    """Return times (N,) and poses (N, 3): two coordinates, and where the front points to in their plane."""
    rotations = quaternion.to_matrix(trajectory.quats_xyzw)
    # A robot's z axis, or a camera's y axis, stands upright on the plane; the one drives along x, the other looks along z.
    upright = np.median(np.abs(rotations[:, 3 - sum(axes), :]), axis=0)
    front = rotations[:, :, 2 if upright[1] > upright[2] else 0]
    yaw = np.arctan2(front[:, axes[1]], front[:, axes[0]])
    poses = np.column_stack([trajectory.positions_m[:, axes] - shift, yaw])
    return {"time": clock.of(trajectory.stamps_ns), "pose": _flat(poses)}


def _gap_s(times: NDArray[np.float64]) -> float:
    """Return from what interval on there is no pose between two others."""
    steps = np.diff(times)
    return max(_LEAST_GAP_S, _GAP_INTERVALS * float(np.median(steps))) if len(steps) else _LEAST_GAP_S


def _told(replay: Replay) -> list[str]:
    """Return what stands under the title."""
    trajectory = replay.trajectory
    began = int(trajectory.stamps_ns[0]) / 1e9
    parts = [replay.algo, f"{len(trajectory):,} poses", f"{trajectory.length_m:.1f} m"]
    if replay.grid is not None:
        grid = replay.grid
        parts.append(f"map of {grid.width:,} × {grid.height:,} cells of {100 * grid.resolution_m:g} cm")
    if began > 1e8:
        parts.append(datetime.fromtimestamp(began, tz=UTC).strftime("begins %Y-%m-%d %H:%M:%S UTC"))
    return [part for part in parts if part]


def _add_map(
    replay: Replay, shift: NDArray[np.float64], facts: dict[str, Any], arrays: dict[str, NDArray[Any]]
) -> None:
    grid = replay.grid
    if grid is None:
        return
    x, y, yaw = grid.origin
    facts["map"] = {
        "width": grid.width, "height": grid.height, "resolution_m": grid.resolution_m,
        "origin": [x - shift[0], y - shift[1], yaw],
    }  # fmt: skip
    arrays["cells"] = grid.cells
    if replay.first_seen is not None:
        arrays["first_seen"] = replay.first_seen.astype(np.int32)


def _add_cloud(
    replay: Replay, axes: Sequence[int], shift: NDArray[np.float64], arrays: dict[str, NDArray[Any]]
) -> None:
    """Keep points by their height in 256 classes, the highest last; the height is along the third axis."""
    if replay.cloud is None or not len(replay.cloud.points_m):
        return
    every = max(1, -(-len(replay.cloud.points_m) // _MOST_CLOUD_POINTS))
    points = replay.cloud.points_m[::every].astype(np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    heights = points[:, 3 - sum(axes)]
    low, high = np.percentile(heights, (1, 99)) if len(heights) else (0.0, 1.0)
    levels = np.clip((heights - low) / max(high - low, 1e-6) * 255, 0, 255).astype(np.uint8)
    order = np.argsort(levels, kind="stable")
    arrays["cloud"] = _flat(points[order][:, axes] - shift)
    arrays["cloud_height"] = levels[order]


def _add_scans(
    replay: Replay, clock: PlayerClock, shift: NDArray[np.float64], most: int, facts: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
) -> None:  # fmt: skip
    """Keep the points as whole multiples of a length in int16: a quarter of the bytes, and finer than a laser."""
    scans = replay.scans
    if scans is None or not len(scans.points_m):
        return
    every = max(1, -(-len(scans.points_m) // most))
    kept = np.arange(0, len(scans.stamps_ns), every)
    lengths = np.diff(scans.offsets)[kept]
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    chosen = np.repeat(scans.offsets[kept] - offsets[:-1], lengths) + np.arange(offsets[-1])
    points = scans.points_m[chosen].astype(np.float64) - shift
    middle = (points.min(axis=0) + points.max(axis=0)) / 2 if len(points) else np.zeros(2)
    unit = max(0.002, float(np.abs(points - middle).max(initial=0.0)) / 32_000)
    facts |= {"scan_unit_m": unit, "scan_origin_m": middle.tolist()}
    arrays["scan_time"] = clock.of(scans.stamps_ns[kept])
    arrays["scan_offset"] = offsets
    arrays["scan_point"] = np.round((points - middle) / unit).astype(np.int16)


def _add_particles(
    replay: Replay,
    clock: PlayerClock,
    shift: NDArray[np.float64],
    facts: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
) -> None:
    particles = replay.particles
    if particles is None or not len(particles.stamps_ns):
        return
    facts["particles"] = int(particles.poses.shape[1])
    arrays["particle_time"] = clock.of(particles.stamps_ns)
    arrays["particle"] = _flat(particles.poses - np.array([*shift, 0.0]))
    arrays["particle_weight"] = _flat(particles.weights)


def _add_graph(
    replay: Replay, clock: PlayerClock, axes: Sequence[int], shift: NDArray[np.float64], arrays: dict[str, NDArray[Any]]
) -> dict[str, list[float]]:
    """Add nodes and edges, each in the order of their times; return when loops were closed."""
    graph = replay.graph
    if graph is None or not len(graph.stamps_ns):
        return {}
    order = clock.order(graph.stamps_ns)
    place = np.empty(len(order), dtype=np.int32)
    place[order] = np.arange(len(order))
    arrays["node_time"] = clock.of(graph.stamps_ns[order])
    arrays["node"] = _flat(graph.positions_m[order][:, axes] - shift)
    if not len(graph.edges):
        return {}
    order = clock.order(graph.edge_stamps_ns)
    arrays["edge"] = place[graph.edges[order]]
    arrays["edge_kind"] = graph.kinds[order]
    arrays["edge_time"] = clock.of(graph.edge_stamps_ns[order])
    classes = residual_classes(graph.residual_m[order], np.nan_to_num(graph.residual_rad[order]))
    arrays["edge_class"] = np.where(np.isnan(graph.residual_m[order]), _UNMEASURED, classes).astype(np.uint8)
    loops = arrays["edge_time"][arrays["edge_kind"] == graph.KINDS.index("loop")]
    return {"closure": np.unique(loops.round(2)).tolist()}


def _add_submaps(
    replay: Replay, clock: PlayerClock, shift: NDArray[np.float64], arrays: dict[str, NDArray[Any]]
) -> None:
    submaps = replay.submaps
    if submaps is None or not np.isfinite(submaps.outlines_m).any():
        return
    order = clock.order(submaps.begun_ns)
    arrays["submap_begun"] = clock.of(submaps.begun_ns[order])
    arrays["submap_finished"] = (submaps.finished_ns[order] - clock.began_ns) / 1e9
    arrays["submap"] = _flat(submaps.outlines_m[order] - shift)


def _add_images(
    replay: Replay, clock: PlayerClock, most: int | None, facts: dict[str, Any], arrays: dict[str, NDArray[Any]]
) -> tuple[Callable[[int], bytes], ...]:
    """Sort the images by their camera; return what gives each."""
    facts["images"] = None
    if not replay.images:
        return ()
    every = 1 if most is None else max(1, -(-len(replay.images) // most))
    topics = list(dict.fromkeys(image.topic for image in replay.images))
    chosen: list[ReplayImage] = []
    entries = []
    for topic in topics:
        of_topic = [image for image in replay.images if image.topic == topic][::every]
        entries.append({"topic": topic, "first": len(chosen), "count": len(of_topic)})
        chosen += of_topic
    facts["images"] = entries
    times = [clock.of(np.array([i.stamp_ns for i in chosen if i.topic == topic], dtype=np.int64)) for topic in topics]
    arrays["image_time"] = np.concatenate(times)
    return tuple(image.jpeg for image in chosen)


def _bounds(facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> list[float]:
    """Return left, low, right and high of everything that is shown: what is known of the map, the ways and the points."""
    points = [arrays["pose"][:, :2], *(arrays[name] for name in ("truth",) if name in arrays)]
    if "cloud" in arrays and len(arrays["cloud"]):
        points.append(np.percentile(arrays["cloud"], (5, 95), axis=0))
    if facts["map"] is not None:
        rows, columns = (np.flatnonzero((arrays["cells"] >= 0).any(axis=axis)) for axis in (1, 0))
        if len(rows):
            ends = np.array([(c, r) for c in (columns[0], columns[-1] + 1) for r in (rows[0], rows[-1] + 1)])
            x, y, yaw = facts["map"]["origin"]
            c, s = np.cos(yaw), np.sin(yaw)
            points.append(ends * facts["map"]["resolution_m"] @ np.array([[c, s], [-s, c]]) + np.array([x, y]))
    everything = np.concatenate([np.asarray(p, dtype=np.float64) for p in points])
    everything = everything[np.isfinite(everything).all(axis=1)]
    return [*everything.min(axis=0).tolist(), *everything.max(axis=0).tolist()]
