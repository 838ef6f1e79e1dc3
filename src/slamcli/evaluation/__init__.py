# SPDX-License-Identifier: MIT
"""Errors of trajectories and maps against what is true."""

from slamcli.evaluation.alignment import align, transformed
from slamcli.evaluation.pairs import find_pairs
from slamcli.evaluation.pose_errors import PoseErrors, absolute_errors, pair_errors, relative_errors
from slamcli.evaluation.projection import project
from slamcli.evaluation.relations import Relations, RelationsResult, relation_errors
from slamcli.evaluation.statistics import Statistics
from slamcli.evaluation.units import AlignMode, DeltaUnit, PoseRelation

__all__ = [
    "AlignMode",
    "DeltaUnit",
    "PoseErrors",
    "PoseRelation",
    "Relations",
    "RelationsResult",
    "Statistics",
    "absolute_errors",
    "align",
    "find_pairs",
    "pair_errors",
    "project",
    "relation_errors",
    "relative_errors",
    "transformed",
]
