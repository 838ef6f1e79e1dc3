# SPDX-License-Identifier: MIT
"""Scores a trajectory against a true trajectory: load, match, align, measure."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation import (
    PoseRelation,
    absolute_errors,
    align,
    find_pairs,
    pair_errors,
    project,
)
from slamcli.evaluation.segments import (
    KITTI_LENGTHS_M,
    kitti_errors,
    subtrajectory_errors,
    subtrajectory_lengths,
)
from slamcli.geometry.alignment import Similarity
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.trajectory_score import ErrorOptions, TrajectoryScore
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog
from slamcli.trajectory import Matched, Trajectory, associate, crop_time, downsample, motion_filter
from slamcli.trajectory.association import SyncMethod

PathLike = str | os.PathLike[str]

_FEW = 0.5

__all__ = ["ErrorOptions", "MatchOptions", "TrajectoryScore", "evaluate_trajectory", "score_trajectory"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchOptions:
    """How poses of two trajectories are paired; defaults as evo's."""

    max_diff_s: float = 0.01
    offset_s: float = 0.0
    method: SyncMethod = "nearest_time"
    start_s: float | None = None
    """The reference is cropped to stamps from here on."""
    end_s: float | None = None
    downsample: int | None = None
    """Largest number of poses of either trajectory."""
    motion_filter: tuple[float, float] | None = None
    """Distance in metres and angle in radians between kept poses of either trajectory."""


def evaluate_trajectory(
    estimate: PathLike,
    reference: PathLike,
    *,
    match: MatchOptions | None = None,
    errors: ErrorOptions | None = None,
    estimate_times: PathLike | None = None,
    reference_times: PathLike | None = None,
    time_unit: str = "auto",
    mends: Mends | None = None,
    log: RunLog | None = None,
) -> TrajectoryScore:
    """Return the errors of an estimated trajectory against a true one.

    Parameters
    ----------
    estimate, reference
        See `slamcli.pipelines.trajectories.load_trajectory`.
    match, errors
        How poses are paired, and what is measured.
    estimate_times, reference_times
        Files of stamps for KITTI files.
    time_unit
        Unit of the stamps of files.
    mends
        What is mended while a recording is read.
    log
        Takes notes and warnings.

    Raises
    ------
    InputError
        If an input cannot be read, or options contradict each other.
    EstimationError
        If no poses match, or the alignment or an error is not determined.
    """
    log = log or RunLog()
    with log.stage("load"):
        est = load_trajectory(estimate, times=estimate_times, unit=time_unit, mends=mends, log=log)
        ref = load_trajectory(reference, times=reference_times, unit=time_unit, mends=mends, log=log)
    return score_trajectory(est, ref, match=match, errors=errors, log=log)


def score_trajectory(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    match: MatchOptions | None = None,
    errors: ErrorOptions | None = None,
    log: RunLog | None = None,
) -> TrajectoryScore:
    """Return the errors of an estimated trajectory against a true one; see :func:`evaluate_trajectory`."""
    match, errors, log = match or MatchOptions(), errors or ErrorOptions(), log or RunLog()
    with log.stage("match"):
        matched = _match(estimate, reference, match, log)
    with log.stage("align"):
        aligned, alignment = align(matched, errors.align, num_poses=errors.num_to_align)
        ref = matched.reference
        if errors.plane is not None:
            ref, aligned = project(ref, errors.plane), project(aligned, errors.plane)
    span = float(np.ptp(reference.stamps_s)) if reference.timed and len(reference) > 1 else 0.0
    with log.stage("measure"):
        return TrajectoryScore(
            options=errors,
            matched=matched,
            reference=ref,
            aligned=aligned,
            alignment=alignment,
            coverage_time=float(np.ptp(matched.reference.stamps_s)) / span if span > 0 else 1.0,
            coverage_poses=len(matched) / min(matched.num_estimate, matched.num_reference),
            **_absolute(ref, aligned, errors),
            **_relative(ref, aligned, errors, log),
            **_segments(matched, ref, aligned, alignment, errors, log),
        )


def _match(estimate: Trajectory, reference: Trajectory, options: MatchOptions, log: RunLog) -> Matched:
    if not (estimate.timed and reference.timed) and (options.start_s is not None or options.end_s is not None):
        raise UsageError("a time range needs stamps: KITTI files have none without a times file")
    if options.downsample is not None:
        estimate, reference = downsample(estimate, options.downsample), downsample(reference, options.downsample)
    if options.motion_filter is not None:
        if not (estimate.timed and reference.timed):
            raise UsageError("a motion filter needs stamps: without them poses are paired line by line")
        estimate = motion_filter(estimate, *options.motion_filter)
        reference = motion_filter(reference, *options.motion_filter)
    reference = crop_time(reference, options.start_s, options.end_s)
    matched = associate(
        reference, estimate, max_diff_s=options.max_diff_s, offset_s=options.offset_s, method=options.method
    )
    if not (estimate.timed or reference.timed):
        log.note("no stamps in either file: poses are paired line by line")
    sparser = min(len(estimate), len(reference))
    if len(matched) < _FEW * sparser:
        log.warn(
            f"only {len(matched)} of {sparser} poses have a partner within {options.max_diff_s:g} s: figures rest on a part"
            " of the run (a larger --t-max-diff, or the clocks' --t-offset, may match more)"
        )
    return matched


def _absolute(ref: Trajectory, aligned: Trajectory, options: ErrorOptions) -> dict[str, Any]:
    if "ape" not in options.parts or options.relation is PoseRelation.POINT_DISTANCE_ERROR_RATIO:
        return {}
    return {
        "ape": absolute_errors(ref, aligned, options.relation),
        "ape_rot": absolute_errors(ref, aligned, PoseRelation.ANGLE_DEG),
    }


def _relative(ref: Trajectory, aligned: Trajectory, options: ErrorOptions, log: RunLog) -> dict[str, Any]:
    if "rpe" not in options.parts:
        return {}
    try:
        pairs = find_pairs(
            ref if options.pairs_from_reference else aligned,
            options.delta,
            options.delta_unit,
            all_pairs=options.all_pairs,
            rel_tol=options.delta_tol,
        )
        rpe, rpe_rot = pair_errors(ref, aligned, pairs, (options.relation, PoseRelation.ANGLE_DEG))
    except EstimationError as error:
        if options.parts == ("rpe",):
            raise
        log.warn(f"no relative error: {error}")
        return {}
    return {"rpe": rpe, "rpe_rot": rpe_rot}


def _segments(
    matched: Matched, ref: Trajectory, aligned: Trajectory, alignment: Similarity, options: ErrorOptions, log: RunLog
) -> dict[str, Any]:
    if "segments" not in options.parts:
        return {}
    kitti = kitti_errors(ref, aligned, lengths_m=options.segment_lengths_m or KITTI_LENGTHS_M)
    lengths = options.segment_lengths_m or subtrajectory_lengths(matched.reference)
    sub = subtrajectory_errors(matched.reference, matched.estimate, lengths, scale=alignment.scale) if lengths else ()
    found: dict[str, Any] = {"subtrajectories": sub}
    if len(kitti.first):
        found["kitti"] = kitti
    elif options.segment_lengths_m or options.parts == ("segments",):
        longest = min(options.segment_lengths_m or KITTI_LENGTHS_M)
        log.warn(f"no segment of {longest:g} m: the reference is {ref.length_m:.1f} m long where it is matched")
    return found
