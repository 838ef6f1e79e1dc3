# SPDX-License-Identifier: MIT
"""Errors of trajectories and maps against what is true."""

from slamcli.evaluation.relations import Relations, RelationsResult, relation_errors
from slamcli.evaluation.statistics import Statistics

__all__ = ["Relations", "RelationsResult", "Statistics", "relation_errors"]
