# SPDX-License-Identifier: MIT
"""Scores a trajectory against a true trajectory: load, match, align, measure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation import (
    AlignMode,
    DeltaUnit,
    PoseErrors,
    PoseRelation,
    absolute_errors,
    align,
    find_pairs,
    pair_errors,
    project,
)
from slamcli.evaluation.segments import (
    KITTI_LENGTHS_M,
    KittiErrors,
    SubtrajectoryErrors,
    kitti_errors,
    subtrajectory_errors,
    subtrajectory_lengths,
)
from slamcli.evaluation.statistics import Statistics
from slamcli.geometry.alignment import Similarity
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.runtime import RunLog
from slamcli.trajectory import Matched, Trajectory, associate, crop_time, downsample, motion_filter
from slamcli.trajectory.association import SyncMethod

PathLike = str | os.PathLike[str]
Part = Literal["ape", "rpe", "segments"]

_FEW = 0.5


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


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorOptions:
    """What is measured; defaults as evo's, except that the estimate is aligned."""

    align: AlignMode = AlignMode.SE3
    num_to_align: int = -1
    relation: PoseRelation = PoseRelation.TRANS_PART
    plane: str | None = None
    delta: float = 1.0
    delta_unit: DeltaUnit = DeltaUnit.FRAMES
    all_pairs: bool = False
    delta_tol: float = 0.1
    pairs_from_reference: bool = False
    parts: tuple[Part, ...] = ("ape", "rpe", "segments")
    segment_lengths_m: tuple[float, ...] = ()
    """Lengths of segments; empty: KITTI's, and shares of the path for sub-trajectories."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryScore:
    """A trajectory against a true one."""

    options: ErrorOptions
    matched: Matched
    """The poses that belong together, the estimate as it was."""
    reference: Trajectory
    """Matched reference, projected if asked for."""
    aligned: Trajectory
    """Matched estimate, aligned and projected."""
    alignment: Similarity
    coverage_time: float
    """Time from the first to the last matched pose over the time span of the reference; 1 without stamps."""
    coverage_poses: float
    """Matched poses over the poses of the sparser trajectory."""
    ape: PoseErrors | None = None
    ape_rot: PoseErrors | None = None
    rpe: PoseErrors | None = None
    rpe_rot: PoseErrors | None = None
    kitti: KittiErrors | None = None
    subtrajectories: tuple[SubtrajectoryErrors, ...] = ()

    def figures(self) -> dict[str, float]:
        """Return every figure that a threshold can be set on, by its key."""
        found: dict[str, float] = {}
        named = {"ate": self.ape, "ate_rot": self.ape_rot, "rpe": self.rpe, "rpe_rot": self.rpe_rot}
        for name, errors in named.items():
            if errors is not None:
                found |= flat(name, errors.statistics)
        if self.kitti is not None:
            found["kitti.trans_percent"] = float(self.kitti.trans_percent.mean())
            found["kitti.rot_deg_per_m"] = float(self.kitti.rot_deg_per_m.mean())
        if self.subtrajectories:
            for name in ("rel_trans_perc", "rel_rot_deg_per_m"):
                means = [record.statistics()[name].mean for record in self.subtrajectories]
                found[f"segments.{name}"] = float(np.mean(means))
        found["coverage.time"] = self.coverage_time
        found["coverage.poses"] = self.coverage_poses
        found["matched"] = len(self.matched)
        found["scale"] = self.alignment.scale
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return everything as one document."""
        document: dict[str, Any] = {
            "kind": "trajectory",
            "poses": {
                "estimate": self.matched.num_estimate,
                "reference": self.matched.num_reference,
                "matched": len(self.matched),
            },
            "coverage": {"time": self.coverage_time, "poses": self.coverage_poses},
            "length_m": {"estimate": self.matched.estimate.length_m, "reference": self.matched.reference.length_m},
            "alignment": {
                "mode": self.options.align.value,
                "num_poses": self.options.num_to_align,
                "scale": self.alignment.scale,
                "matrix": self.alignment.matrix,
            },
        }
        for name, errors in (
            ("ate", self.ape),
            ("ate_rot", self.ape_rot),
            ("rpe", self.rpe),
            ("rpe_rot", self.rpe_rot),
        ):
            if errors is not None:
                document[name] = _described(errors)
        if self.rpe is not None:
            document["rpe"] |= {
                "delta": self.options.delta,
                "delta_unit": self.options.delta_unit.name.lower(),
                "all_pairs": self.options.all_pairs,
            }
        if self.kitti is not None:
            document["kitti"] = _kitti_document(self.kitti)
        if self.subtrajectories:
            document["segments"] = [
                {"length_m": record.length_m} | {name: s.as_dict() for name, s in record.statistics().items()}
                for record in self.subtrajectories
            ]
        return document


def evaluate_trajectory(
    estimate: PathLike,
    reference: PathLike,
    *,
    match: MatchOptions | None = None,
    errors: ErrorOptions | None = None,
    estimate_times: PathLike | None = None,
    reference_times: PathLike | None = None,
    time_unit: str = "auto",
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
        est = load_trajectory(estimate, times=estimate_times, unit=time_unit, log=log)
        ref = load_trajectory(reference, times=reference_times, unit=time_unit, log=log)
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


def flat(name: str, statistics: Statistics) -> dict[str, float]:
    """Return statistics as figures ``name.rmse``, ``name.mean`` and so on."""
    return {f"{name}.{key}": value for key, value in statistics.as_dict().items() if key != "count"}


def _described(errors: PoseErrors) -> dict[str, Any]:
    return {
        "pose_relation": errors.relation.value,
        "unit": errors.relation.unit,
        **errors.statistics.as_dict(),
    }


def _kitti_document(kitti: KittiErrors) -> dict[str, Any]:
    lengths: Sequence[float] = np.unique(kitti.length_m).tolist()
    rows = [
        {
            "length_m": length,
            "trans_percent": float(kitti.trans_percent[kitti.length_m == length].mean()),
            "rot_deg_per_m": float(kitti.rot_deg_per_m[kitti.length_m == length].mean()),
            "count": int((kitti.length_m == length).sum()),
        }
        for length in lengths
    ]
    return {
        "trans_percent": float(kitti.trans_percent.mean()),
        "rot_deg_per_m": float(kitti.rot_deg_per_m.mean()),
        "count": len(kitti.first),
        "lengths": rows,
    }
