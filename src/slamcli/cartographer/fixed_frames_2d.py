# SPDX-License-Identifier: MIT
"""Poses in a fixed frame (GPS, another system's) as terms of a graph in the plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import CELL_M, PoseGraph2d
from slamcli.cartographer.parameters import OptimizationProblem
from slamcli.cartographer.sensor_records_2d import tells_orientation
from slamcli.cartographer.timeline_2d import Timeline
from slamcli.geometry import se2
from slamcli.measurements import StampedPose
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges
from slamcli.runtime import RunLog

_RIGID = 1e4
"""Weight per metre and radian of the antenna's place on the robot."""
_LEAST_SIGMA_M = 0.01
_LEAST_SHOWN_M = 0.1
_ALIGNED_WAY_M = 100.0
"""Way over which dead reckoning is good enough to lay the fixed frame on the map."""
_SPREAD_SIGMAS = 3.0
_USUAL_WEIGHT = 10.0
"""Default of ``fixed_frame_pose_translation_weight``."""
_ALIKE_S = 10.0
_UNTOLD_SIGMA_M = 1.0
_OUTLIER_SIGMAS = 3.0
_ROUNDS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedFrame:
    """What the fixes of one trajectory bring into its graph: the frame's origin, then the antenna at each fix."""

    row: int
    """Of the frame among the graph's extra poses; the antennas' follow."""
    poses: NDArray[np.float64]
    """float64 (1 + K, 3), where they are believed to be in the map."""
    told: NDArray[np.float64]
    """float64 (K, 3), what the fixes say, in the frame."""
    terms: tuple[tuple[PlanarEdges, Loss], ...]
    trajectory: int = 0

    def distances_m(self, extra: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far each fix (K,) is from the antenna in the adjusted graph, metres."""
        antennas = extra[self.row + 1 : self.row + 1 + len(self.told)]
        return np.hypot(*(se2.between(extra[self.row], antennas)[:, :2] - self.told[:, :2]).T)


def fixed_frame_terms(
    graph: PoseGraph2d,
    timeline: Timeline,
    fixes: Sequence[StampedPose],
    lever: NDArray[np.float64],
    log: RunLog,
    frame: NDArray[np.float64] | None = None,
) -> FixedFrame | None:
    """Return the terms of fixes, None with a warning where they cannot tell how their frame lies.

    One fix for each node is taken, the nearest in time. A fix whose deviation is told weighs as a loop of that precision would
    (where the original gives all fixes one weight, so small that they bend nothing): ``fixed_frame_pose_translation_weight``
    is relative to its default then. Far off fixes count little (Cauchy), or as the tolerant loss says where that is asked
    for. Orientations count where they are told.

    Parameters
    ----------
    fixes
        In recorded order; whether one tells an orientation: see `tells_orientation`.
    lever
        float64 (3,), pose of the antenna in the base frame.
    frame
        float64 (3,), where the fixed frame lies in a loaded map, whose fixes have no deviations: they are what that map shows.
    """
    o = graph.parameters.optimization_problem
    chosen = _one_for_each_node(timeline, fixes)
    if not chosen:
        if fixes:
            log.warn("no fix was measured while there were scans: they are not used")
        return None
    listed = [fixes[k] for k in chosen]
    nodes, relative, _ = timeline.seen_from_nodes(np.array([fix.stamp_ns for fix in listed], dtype=np.int64))
    antennas = se2.compose(relative, np.broadcast_to(lever, relative.shape))
    believed = se2.compose(graph.node[nodes], antennas)
    told = np.array([fix.pose_se2 for fix in listed])
    sigmas = np.array([_sigma_m(fix) for fix in listed])
    if frame is not None:
        sigmas = np.where(np.isnan(sigmas), _shown_sigma_m(frame, told, believed), sigmas)
    weights = _weights(graph, sigmas, np.array([fix.stamp_ns for fix in listed], dtype=np.int64))
    typical = float(np.nanmedian(sigmas)) if np.isfinite(sigmas).any() else _UNTOLD_SIGMA_M
    turned = np.array([tells_orientation(fix) for fix in listed])
    frame = _lay_on(told, believed, typical) if frame is None else frame
    if frame is None and not turned.any():
        log.warn(
            f"the {len(listed)} fixes lie too close together to tell directions: they are not used (deviation {typical:.2g} m)"
        )
        return None
    if frame is None:
        first = int(np.flatnonzero(turned)[0])
        frame = se2.compose(believed[first], se2.inverse(told[first]))
    row = len(graph.extra)
    origin = len(graph.submap) + len(graph.node) + row
    places = origin + 1 + np.arange(len(listed))
    rigid = PlanarEdges(
        first=nodes + len(graph.submap), second=places, measured=antennas, translation_weight=np.full(len(nodes), _RIGID),
        rotation_weight=np.full(len(nodes), _RIGID), robust=np.zeros(len(nodes), np.bool_),
    )  # fmt: skip
    seen = PlanarEdges(
        first=np.full(len(nodes), origin), second=places, measured=told, translation_weight=weights,
        rotation_weight=np.where(turned, o.fixed_frame_pose_rotation_weight, 0.0), robust=np.ones(len(nodes), np.bool_),
    )  # fmt: skip
    poses = np.concatenate([frame[None], believed])
    return FixedFrame(
        row=row,
        poses=poses,
        told=told,
        terms=((rigid, Loss()), (seen, _loss(o, _OUTLIER_SIGMAS * typical * float(np.median(weights))))),
    )


def _one_for_each_node(timeline: Timeline, fixes: Sequence[StampedPose]) -> list[int]:
    """Return the indices of the fixes to take, in recorded order."""
    if not fixes:
        return []
    stamps = np.array([fix.stamp_ns for fix in fixes], dtype=np.int64)
    nodes, _, known = timeline.seen_from_nodes(stamps)
    stamp_of = dict(zip(timeline.rows.tolist(), timeline.node_stamps_ns.tolist(), strict=True))
    best: dict[int, tuple[int, int]] = {}
    for k in np.flatnonzero(known).tolist():
        node = int(nodes[k])
        apart = abs(int(stamps[k]) - stamp_of[node])
        if node not in best or apart < best[node][0]:
            best[node] = (apart, k)
    return sorted(k for _, k in best.values())


def _sigma_m(fix: StampedPose) -> float:
    """Return the deviation of a fix in one direction, metres; NaN where it is not told."""
    if fix.covariance is None:
        return math.nan
    variance = 0.5 * float(fix.covariance[0, 0] + fix.covariance[1, 1])
    return max(_LEAST_SIGMA_M, math.sqrt(variance)) if math.isfinite(variance) and variance > 0 else math.nan


def _shown_sigma_m(frame: NDArray[np.float64], told: NDArray[np.float64], believed: NDArray[np.float64]) -> float:
    """Return the deviation in one direction of fixes (K, 3) from where a map has the antenna."""
    off = se2.transform_points(frame, told[:, :2]) - believed[:, :2]
    return max(_LEAST_SHOWN_M, float(np.median(np.hypot(*off.T))) / math.sqrt(2.0 * math.log(2.0)))


def _weights(graph: PoseGraph2d, sigmas: NDArray[np.float64], stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how much fixes (K,) weigh, 1/m.

    Errors of receivers stay alike for seconds: fixes within 10 s count as one.
    """
    p = graph.parameters
    given = p.optimization_problem.fixed_frame_pose_translation_weight
    as_loops = p.constraint_builder.loop_closure_translation_weight * CELL_M * given / _USUAL_WEIGHT
    period_s = float(np.median(np.diff(stamps_ns))) / 1e9 if len(stamps_ns) > 1 else _ALIKE_S
    alike = math.sqrt(max(1.0, _ALIKE_S / max(period_s, 1e-3)))
    return np.where(np.isnan(sigmas), given, as_loops / alike / sigmas)


def _lay_on(told: NDArray[np.float64], believed: NDArray[np.float64], sigma_m: float) -> NDArray[np.float64] | None:
    """Return the pose (3,) of the fixed frame in the map that lays fixes on the antenna's first 100 m; None where they tell none."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(believed[:, :2], axis=0).T))])
    for part in (way <= _ALIGNED_WAY_M, way >= 0.0):
        source, target = told[part, :2], believed[part, :2]
        spread = math.sqrt(float(((target - target.mean(axis=0)) ** 2).sum()))
        if len(target) >= 3 and spread > _SPREAD_SIGMAS * sigma_m:
            return _aligned(source, target)
    return None


def _aligned(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose (3,) that lays source points (N, 2) on target points; the half that fits worst counts little.

    Horn, JOSA A 1987, in the plane, reweighted (Geman and McClure) by the median of the residuals.
    """
    weights = np.ones(len(source))
    pose = np.zeros(3)
    for _ in range(_ROUNDS):
        total = weights.sum()
        middle, there = weights @ source / total, weights @ target / total
        a, b = source - middle, target - there
        yaw = math.atan2(
            float((weights * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum()),
            float((weights * (a * b).sum(axis=1)).sum()),
        )
        turned = se2.transform_points(np.array([0.0, 0.0, yaw]), middle[None])[0]
        pose = np.array([*(there - turned), yaw])
        residuals = np.hypot(*(se2.transform_points(pose, source) - target).T)
        scale = max(float(np.median(residuals)), 1e-6)
        weights = (1.0 + (residuals / (2.0 * scale)) ** 2) ** -2
    return pose


def _loss(o: OptimizationProblem, outlier: float) -> Loss:
    if o.fixed_frame_pose_use_tolerant_loss:
        return Loss(
            kind="tolerant", scale=max(o.fixed_frame_pose_tolerant_loss_param_a, 1e-9),
            sharpness=o.fixed_frame_pose_tolerant_loss_param_b,
        )  # fmt: skip
    return Loss(kind="cauchy", scale=outlier)
