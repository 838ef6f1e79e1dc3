# SPDX-License-Identifier: MIT
"""What a trajectory scored against a true one, and how it was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from slamcli.evaluation import AlignMode, DeltaUnit, PoseErrors, PoseRelation
from slamcli.evaluation.segments import KittiErrors, SubtrajectoryErrors
from slamcli.geometry.alignment import Similarity
from slamcli.trajectory import Matched, Trajectory

Part = Literal["ape", "rpe", "segments"]


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
                found |= errors.statistics.figures(name)
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
