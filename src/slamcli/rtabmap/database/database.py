# SPDX-License-Identifier: MIT
"""A database of RTAB-Map: the long-term memory on disk."""

from __future__ import annotations

import sqlite3
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.rtabmap.database import feature_rows, link_rows, node_rows, summary_rows
from slamcli.rtabmap.database.cell_blobs import pack_cells
from slamcli.rtabmap.database.connection import OpenFile, open_file, sqlite_errors
from slamcli.rtabmap.database.contents import DatabaseContents
from slamcli.rtabmap.database.records import GeoFix, StorageSettings, StoredGrid
from slamcli.rtabmap.database.write_order import WriteOrder
from slamcli.rtabmap.links import Link
from slamcli.rtabmap.local_grid import LocalGrid
from slamcli.rtabmap.signature import NodeImages, Signature


class Database(DatabaseContents):
    """An open database, written in the order of the calls and readable while it is written.

    Use it as a context manager. What was committed stays in the file whatever happens to the process; leaving the context commits, unless
    an error is on its way. All errors are `FormatError`, one line that names the file.
    """

    def __init__(self, file: OpenFile, settings: StorageSettings, jobs: int) -> None:
        super().__init__(file, WriteOrder(threaded=jobs > 1 and file.mode != "read"))
        self._settings = settings
        # Also where an error or the end of the program comes first:
        self._shut = weakref.finalize(self, _shut, self._order, file)

    @classmethod
    def create(
        cls,
        path: Path | str,
        parameters_text: str,
        *,
        settings: StorageSettings | None = None,
        jobs: int = 1,
        overwrite: bool = False,
    ) -> Self:
        """Return a new database.

        Parameters
        ----------
        path
            Must not exist, unless `overwrite`: then a database there is removed, unless another process uses it.
        parameters_text
            Native parameters, ``Kp/MaxFeatures:500;Kp/...``, for those who read the file.
        settings
            How it is kept.
        jobs
            From 2 on, nodes are compressed and written on a thread.
        overwrite
            Whether a database at the path is replaced.
        """
        return cls._begun(
            open_file(Path(path), "create", settings or StorageSettings(), overwrite=overwrite),
            parameters_text,
            settings,
            jobs,
        )

    @classmethod
    def append(
        cls, path: Path | str, parameters_text: str = "", *, settings: StorageSettings | None = None, jobs: int = 1
    ) -> Self:
        """Return a database that is continued; its tables must be those of 0.18 or later. No parameters: those of the last session."""
        return cls._begun(
            open_file(Path(path), "append", settings or StorageSettings()), parameters_text, settings, jobs
        )

    @classmethod
    def read(cls, path: Path | str) -> Self:
        """Return a database that is only read; it may lie in a read-only folder."""
        return cls(open_file(Path(path), "read", StorageSettings()), StorageSettings(), 1)

    @classmethod
    def _begun(cls, file: OpenFile, parameters_text: str, settings: StorageSettings | None, jobs: int) -> Self:
        database = cls(file, settings or StorageSettings(), jobs)
        try:
            text = parameters_text or ";".join(f"{name}:{value}" for name, value in database.parameters().items())
            database._write(lambda connection: summary_rows.insert_info(connection, text))
            database.commit()
        except BaseException:
            database.close(commit=False)
            raise
        return database

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(commit=kind is None)

    def add_node(
        self,
        signature: Signature,
        *,
        weight: int,
        label: str | None = None,
        images: NodeImages | None = None,
        local_grid: LocalGrid | None = None,
        ground_truth: NDArray[np.float64] | None = None,
        gps: GeoFix | None = None,
        velocity: NDArray[np.float64] | None = None,
    ) -> None:
        """Write a node with everything it has but its links; `ground_truth` float64 (4, 4), `velocity` float64 (6,) base frame."""
        node = node_rows.NodeContent(
            signature=signature, weight=weight, label=label, images=images, local_grid=local_grid, ground_truth=ground_truth, gps=gps,
            velocity=velocity,
        )  # fmt: skip
        self._stamps_ns[signature.id] = signature.stamp_ns

        def insert(connection: sqlite3.Connection) -> None:
            self._file.clock.advance(signature.stamp_ns)
            node_rows.insert_node(connection, node, self._settings)
            feature_rows.insert_features(connection, signature)

        self._write(insert)

    def set_weight(self, node_id: int, weight: int) -> None:
        """Replace a node's weight."""
        self._write(lambda connection: connection.execute("UPDATE Node SET weight=? WHERE id=?", (weight, node_id)))

    def set_label(self, node_id: int, label: str | None) -> None:
        """Replace a node's label, which no other may have."""
        self._write(lambda connection: connection.execute("UPDATE Node SET label=? WHERE id=?", (label, node_id)))

    def set_local_grid(self, node_id: int, cells: LocalGrid) -> None:
        """Replace a node's local grid."""
        self._write(lambda connection: node_rows.set_cells(connection, node_id, pack_cells(cells)))

    def add_links(self, links: Iterable[Link]) -> None:
        """Write links."""
        given = list(links)
        self._write(lambda connection: link_rows.insert_links(connection, given))

    def remove_links(self, pairs: Iterable[tuple[int, int]]) -> None:
        """Remove all links between pairs of nodes (or of a node and a landmark)."""
        given = list(pairs)
        self._write(lambda connection: link_rows.delete_links(connection, given))

    def add_words(self, ids: NDArray[np.int64], descriptors: NDArray[np.uint8]) -> None:
        """Write words of the dictionary: ids (W,), descriptors uint8 (W, B)."""
        given = np.array(ids, dtype=np.int64), np.array(descriptors, dtype=np.uint8)
        self._write(lambda connection: feature_rows.insert_words(connection, self._file.layout, *given))

    def remove_words(self, ids: Iterable[int]) -> None:
        """Remove words of the dictionary."""
        given = [int(word) for word in ids]
        self._write(lambda connection: feature_rows.delete_words(connection, self._file.layout, given))

    def update_word_ids(self, node_id: int, word_ids: NDArray[np.int64]) -> None:
        """Replace the words of a node's key points (N,), in their order; 0 leaves a key point as it is."""
        given = np.array(word_ids, dtype=np.int64)
        self._write(lambda connection: feature_rows.set_word_ids(connection, node_id, given))

    def set_info(
        self,
        parameters_text: str,
        *,
        stm_size: int = 0,
        last_id: int = 0,
        num_words: int = 0,
        working_ids: Sequence[int] | None = None,
    ) -> None:
        """Write what a session ended with; `working_ids` are the nodes in working memory, which the next session may begin with."""
        working = [] if working_ids is None else [int(node) for node in working_ids]

        def insert(connection: sqlite3.Connection) -> None:
            summary_rows.insert_info(
                connection, parameters_text, stm_size=stm_size, last_id=last_id, num_words=num_words
            )
            summary_rows.set_entered(connection, working, self._file.clock.now)

        self._write(insert)

    def add_statistics(
        self, node_id: int, stamp_ns: int, values: Mapping[str, float], working_ids: Sequence[int] | None = None
    ) -> None:
        """Write the figures of the update that made a node; times and memory figures are left out."""
        given = dict(values)
        working = None if working_ids is None else list(working_ids)
        self._write(lambda connection: summary_rows.insert_statistics(connection, node_id, stamp_ns, given, working))

    def set_optimised(
        self, ids: NDArray[np.int64], T_map_base: NDArray[np.float64], T_map_last: NDArray[np.float64] | None
    ) -> None:
        """Write the optimised graph: ids (N,), poses float64 (N, 4, 4), and where the robot was last (4, 4)."""
        given = np.array(ids, dtype=np.int64), np.array(T_map_base, dtype=np.float64)
        self._write(lambda connection: summary_rows.set_optimised(connection, *given, T_map_last))

    def set_grid(self, cells: NDArray[np.int8], *, x_min_m: float, y_min_m: float, resolution_m: float) -> None:
        """Write the assembled map: cells (H, W), -1 unknown, 0 free, 100 occupied, row 0 at the smallest y."""
        grid = StoredGrid(
            cells=np.array(cells, dtype=np.int8), x_min_m=x_min_m, y_min_m=y_min_m, resolution_m=resolution_m
        )
        self._write(lambda connection: summary_rows.set_grid(connection, grid))

    def commit(self) -> None:
        """Make what was written so far last; call it after each node."""
        self._order.do(self._commit)

    def close(self, *, commit: bool = True) -> None:
        """Commit, unless told otherwise, and close the file; a second call does nothing."""
        if not self._shut.alive:
            return
        try:
            if commit and self._file.mode != "read":
                self.commit()
                self._order.wait()
        finally:
            self._shut()

    def _commit(self) -> None:
        with sqlite_errors(self.path):
            if self._file.connection.in_transaction:
                self._file.connection.commit()

    def _write(self, action: Callable[[sqlite3.Connection], object]) -> None:
        if self._file.mode == "read":
            raise FormatError(f"{self.path}: opened for reading only")

        def run() -> None:
            connection = self._file.connection
            with sqlite_errors(self.path):
                if not connection.in_transaction:
                    connection.execute("BEGIN")
                action(connection)

        self._order.do(run)


def _shut(order: WriteOrder, file: OpenFile) -> None:
    """End what is under way, forget what was not committed, and close the file."""
    order.end()
    file.close()
