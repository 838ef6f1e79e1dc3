# SPDX-License-Identifier: MIT
"""What an open database is asked."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.rtabmap.database import feature_rows, link_rows, node_rows, summary_rows
from slamcli.rtabmap.database.blobs import unpack_pose
from slamcli.rtabmap.database.calibration_blobs import unpack_cameras
from slamcli.rtabmap.database.cell_blobs import unpack_cells
from slamcli.rtabmap.database.connection import Mode, OpenFile, sqlite_errors
from slamcli.rtabmap.database.counting import Counts, read_counts
from slamcli.rtabmap.database.records import NodeStatistics, NodeTable, OptimisedPoses, StoredCamera, StoredGrid
from slamcli.rtabmap.database.scan_blobs import unpack_scan
from slamcli.rtabmap.database.stored_images import read_images
from slamcli.rtabmap.database.write_order import WriteOrder
from slamcli.rtabmap.links import Link
from slamcli.rtabmap.local_grid import LocalGrid
from slamcli.rtabmap.signature import NodeImages, NodeScan, Signature

Result = TypeVar("Result")


class DatabaseContents:
    """The reading half of `Database`: every question waits until all that was written before it is written."""

    def __init__(self, file: OpenFile, order: WriteOrder) -> None:
        self._file = file
        self._order = order
        self._stamps_ns: dict[int, int] = {}
        """Of nodes that were written since the file was opened: the file has them to the microsecond."""

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    @property
    def mode(self) -> Mode:
        """How it was opened."""
        return self._file.mode

    @property
    def version(self) -> str:
        """Version of RTAB-Map whose schema it has."""
        return self._file.layout.text

    def nodes(self) -> NodeTable:
        """Return all nodes by id."""
        return self._read(node_rows.read_nodes)

    def read_signature(self, node_id: int) -> Signature:
        """Return a node as it was written, without its images; poses of scans and cameras to float32.

        Raises
        ------
        FormatError
            If there is no such node, or its descriptors are not binary.
        """
        return self._read(lambda connection: self._signature(connection, node_id), node_id)

    def read_signatures(self, node_ids: Iterable[int]) -> list[Signature]:
        """Return several nodes."""
        return [self.read_signature(node_id) for node_id in node_ids]

    def read_images(self, node_id: int, camera: int = 0) -> NodeImages | None:
        """Return what a camera of a node saw; None for a node without images. With several cameras the first is 0."""
        return self._read(lambda connection: read_images(connection, self._file.layout, node_id, camera), node_id)

    def read_cameras(self, node_id: int) -> tuple[StoredCamera, ...]:
        """Return the cameras of a node (also where its images were not kept)."""
        version = self._file.layout.version
        query = "SELECT calibration FROM Data WHERE id=?"
        cameras = self._of_node(node_id, query, lambda row: unpack_cameras(row[0], version))
        return () if cameras is None else cameras

    def read_scan(self, node_id: int) -> NodeScan | None:
        """Return a node's scan, base frame; None for a node without."""
        version = self._file.layout.version
        query = "SELECT scan, scan_info, user_data FROM Data WHERE id=?"
        return self._of_node(node_id, query, lambda row: unpack_scan(row[0], row[1], row[2], version))

    def read_local_grid(self, node_id: int) -> LocalGrid | None:
        """Return the cells that a node saw; None for a node without."""
        names = ", ".join(node_rows.CELL_COLUMNS)
        return self._of_node(node_id, f"SELECT {names} FROM Data WHERE id=?", unpack_cells)  # noqa: S608

    def links(self, node_id: int | None = None) -> list[Link]:
        """Return all links, or those of one node, each once and in the order they were written."""
        return self._read(lambda connection: link_rows.read_links(connection, node_id), node_id)

    def words(self) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Return ids (W,) and descriptors uint8 (W, B) of the dictionary, by id."""
        return self._read(feature_rows.read_words)

    def read_words(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Return those of some words that are there, as `words` does."""
        return self._read(lambda connection: feature_rows.read_words(connection, ids))

    def counts(self) -> Counts:
        """Return how much it holds."""
        return self._read(read_counts)

    def parameters(self) -> dict[str, str]:
        """Return native names and values of the last session."""
        return self._read(summary_rows.read_parameters)

    def last_working_ids(self) -> NDArray[np.int64]:
        """Return the nodes (N,) that were in working memory when the last session ended, as RTAB-Map decides it."""
        return self._read(summary_rows.read_last_working)

    def read_statistics(self) -> list[NodeStatistics]:
        """Return the figures of all updates, by node."""
        return self._read(summary_rows.read_statistics)

    def optimised(self) -> OptimisedPoses | None:
        """Return the optimised graph; None where there is none."""
        return self._read(summary_rows.read_optimised)

    def grid(self) -> StoredGrid | None:
        """Return the assembled map; None where there is none."""
        return self._read(summary_rows.read_grid)

    def _signature(self, connection: sqlite3.Connection, node_id: int) -> Signature:
        row = connection.execute("SELECT map_id, stamp, pose FROM Node WHERE id=?", (node_id,)).fetchone()
        if row is None:
            raise FormatError("there is no such node")
        data = connection.execute(
            "SELECT calibration, scan, scan_info, user_data FROM Data WHERE id=?", (node_id,)
        ).fetchone()
        calibration, scan, scan_info, user_data = data or (None,) * 4
        version = self._file.layout.version
        cameras = unpack_cameras(calibration, version)
        features, points, word_ids = feature_rows.read_features(connection, node_id, cameras[0] if cameras else None)
        pose = unpack_pose(row[2])
        return Signature(
            id=node_id,
            map_id=int(row[0]),
            stamp_ns=self._stamps_ns.get(node_id, node_rows.nanoseconds(row[1])),
            T_odom_base=np.full((4, 4), np.nan) if pose is None else pose,
            features=features,
            points=points,
            word_ids=word_ids,
            scan=unpack_scan(scan, scan_info, user_data, version),
        )

    def _of_node(self, node_id: int, query: str, unpack: Callable[[Sequence[Any]], Result]) -> Result | None:
        def found(connection: sqlite3.Connection) -> Result | None:
            row = connection.execute(query, (node_id,)).fetchone()
            return None if row is None else unpack(row)

        return self._read(found, node_id)

    def _read(self, action: Callable[[sqlite3.Connection], Result], node_id: int | None = None) -> Result:
        """Return what is found; whatever is wrong with it names the file, and the node if it is one's."""
        self._order.wait()
        where = f"{self.path}: " if node_id is None else f"{self.path}: node {node_id}: "
        with sqlite_errors(self.path):
            try:
                return action(self._file.connection)
            except FormatError as error:
                raise FormatError(f"{where}{error}") from error
            except UnicodeError:
                raise
            except (TypeError, ValueError, OverflowError) as error:  # SQLite's columns hold values of any kind
                raise FormatError(
                    f"{where}a value that does not belong there, the database is damaged ({error})"
                ) from error
