# SPDX-License-Identifier: MIT
"""RTAB-Map's own database files, read and written: the long-term memory on disk, schema of version 0.23.8."""

from slamcli.rtabmap.database.connection import Mode
from slamcli.rtabmap.database.counting import Counts
from slamcli.rtabmap.database.database import Database
from slamcli.rtabmap.database.probing import count_committed_nodes, is_database, is_in_use
from slamcli.rtabmap.database.records import (
    GeoFix,
    NodeStatistics,
    NodeTable,
    OptimisedPoses,
    StorageSettings,
    StoredCamera,
    StoredGrid,
)

__all__ = [
    "Counts",
    "Database",
    "GeoFix",
    "Mode",
    "NodeStatistics",
    "NodeTable",
    "OptimisedPoses",
    "StorageSettings",
    "StoredCamera",
    "StoredGrid",
    "count_committed_nodes",
    "is_database",
    "is_in_use",
]
