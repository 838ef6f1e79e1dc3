# SPDX-License-Identifier: MIT
"""Scores a trajectory against true relations between poses."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import EstimationError
from slamcli.evaluation import Relations, RelationsResult, relation_errors
from slamcli.evaluation.statistics import Statistics
from slamcli.formats.relations import read_relations
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class RelationsScore:
    """A trajectory against true relations."""

    trajectory: Trajectory
    relations: Relations
    result: RelationsResult

    def figures(self) -> dict[str, float]:
        """Return every figure that a threshold can be set on, by its key."""
        found: dict[str, float] = {}
        for name, statistics in self._statistics().items():
            found |= statistics.figures(f"relations.{name}")
        found["relations.matched"] = self.result.num_matched
        found["relations.coverage"] = self.result.num_matched / self.result.num_relations
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return everything as one document."""
        statistics = {name: s.as_dict() for name, s in self._statistics().items()}
        counts = {
            "count": self.result.num_relations,
            "matched": self.result.num_matched,
            "unmatched": self.result.num_relations - self.result.num_matched,
            "coverage": self.result.num_matched / self.result.num_relations,
        }
        return {
            "kind": "relations",
            "poses": {"estimate": len(self.trajectory)},
            "relations": counts | statistics,
        }

    def _statistics(self) -> dict[str, Statistics]:
        result = self.result
        return {
            "trans": result.trans,
            "rot": result.rot_deg,
            "trans_squared": result.trans_squared,
            "rot_squared": result.rot_squared_deg,
        }


def evaluate_relations(
    estimate: PathLike,
    relations: PathLike,
    *,
    max_gap_s: float = 0.5,
    estimate_times: PathLike | None = None,
    time_unit: str = "auto",
    mends: Mends | None = None,
    log: RunLog | None = None,
) -> RelationsScore:
    """Return the errors of an estimated trajectory over true relations.

    Parameters
    ----------
    estimate
        See `slamcli.pipelines.trajectories.load_trajectory`.
    relations
        A relations file: see `slamcli.formats.relations`.
    max_gap_s
        Largest distance in time from a relation's time to the nearest pose, seconds.
    estimate_times, time_unit, mends, log
        As in :func:`slamcli.pipelines.evaluate.evaluate_trajectory`.

    Raises
    ------
    InputError
        If an input cannot be read.
    EstimationError
        If no relation has poses at both of its times.
    """
    log = log or RunLog()
    with log.stage("load"):
        trajectory = load_trajectory(estimate, times=estimate_times, unit=time_unit, mends=mends, log=log)
        true = read_relations(relations, log=log, unit=time_unit)
    with log.stage("measure"):
        result = relation_errors(trajectory, true, max_gap_s=max_gap_s)
    if not result.num_matched:
        times = np.concatenate([true.first_ns, true.second_ns]) / 1e9
        stamps = trajectory.stamps_s
        raise EstimationError(
            f"none of {len(true)} relations has poses within {max_gap_s:g} s of its times: the relations cover"
            f" {times.min():.6f} to {times.max():.6f} s, {trajectory.source} {stamps.min():.6f} to {stamps.max():.6f} s"
        )
    if result.num_matched < len(true):
        log.warn(
            f"{len(true) - result.num_matched} of {len(true)} relations are unmatched: no pose within {max_gap_s:g} s of"
            " one of their times"
        )
    backward = int((np.diff(trajectory.stamps_ns) < 0).sum())
    if backward:
        log.note(f"{trajectory.source}: {backward} stamps run backwards; poses are taken by their stamps")
    return RelationsScore(trajectory=trajectory, relations=true, result=result)
