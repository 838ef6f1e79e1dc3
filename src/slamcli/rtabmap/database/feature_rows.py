# SPDX-License-Identifier: MIT
"""Rows of the tables Feature and Word."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.geometry import se3
from slamcli.rtabmap.database.records import StoredCamera
from slamcli.rtabmap.database.schema import Layout
from slamcli.rtabmap.signature import Signature, no_features
from slamcli.vision.features import Features

PATCH_PX = 31
"""Size of a key point of the finest octave: that of ORB's patch, as RTAB-Map writes it."""
_COLUMNS = "pos_x, pos_y, size, dir, response, octave, depth_x, depth_y, depth_z, word_id, descriptor_size, descriptor"
_INSERT = f"INSERT INTO Feature(node_id, {_COLUMNS}) VALUES({', '.join('?' * 13)})"


def insert_features(connection: sqlite3.Connection, signature: Signature) -> None:
    """Write a node's key points in their order.

    Those that the dictionary did not quantise have word 0 here; RTAB-Map gives them numbers -1, -2 and so on.
    """
    features = signature.features
    count = len(features)
    if not count:
        return
    words: NDArray[np.int64] = np.array(signature.word_ids, dtype=np.int64)
    free = words <= 0
    words[free] = -np.arange(1, np.count_nonzero(free) + 1)
    known = np.isfinite(signature.points).all(axis=1)
    x, y, z = np.where(
        known, signature.points.T, np.nan
    ).tolist()  # SQLite keeps NaN as NULL, which is RTAB-Map's "not known"
    size = features.descriptors.shape[1]
    rows = zip(
        [signature.id] * count, features.pixels[:, 0].tolist(), features.pixels[:, 1].tolist(), (PATCH_PX * features.sigmas).tolist(),
        np.degrees(features.angles).tolist(), features.responses.tolist(), features.octaves.tolist(), x, y, z,
        words.tolist(), [size] * count, map(bytes, np.ascontiguousarray(features.descriptors)), strict=True,
    )  # fmt: skip
    connection.executemany(_INSERT, rows)


def read_features(
    connection: sqlite3.Connection, node_id: int, camera: StoredCamera | None
) -> tuple[Features, NDArray[np.float64], NDArray[np.int64]]:
    """Return a node's key points, their points in the base frame and their words.

    Raises
    ------
    FormatError
        If the descriptors are not binary (SURF, SIFT ...).
    """
    query = f"SELECT {_COLUMNS} FROM Feature WHERE node_id=? ORDER BY rowid"  # noqa: S608
    rows = connection.execute(query, (node_id,)).fetchall()
    if not rows:
        return no_features(), np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    *numbers, words, sizes, descriptors = zip(*rows, strict=True)
    values = np.array(numbers, dtype=np.float64)  # None becomes NaN
    points = np.ascontiguousarray(values[6:9].T)
    pixels = np.ascontiguousarray(values[:2].T)
    depth, right = _seen_from(camera, points, pixels[:, 0])
    features = Features(
        pixels=pixels,
        octaves=values[5].astype(np.int64) & 0xFF,
        angles=np.radians(np.maximum(values[3], 0.0)) % (2.0 * math.pi),
        responses=values[4],
        descriptors=binary_descriptors(sizes, descriptors, "key points"),
        sigmas=np.maximum(values[2] / PATCH_PX, 1.0),
        right=right,
        depth=depth,
        raw_pixels=pixels,
    )
    return features, points, np.maximum(np.array(words, dtype=np.int64), 0)


def set_word_ids(connection: sqlite3.Connection, node_id: int, word_ids: NDArray[np.int64]) -> None:
    """Replace the words of a node's key points, in their order.

    Raises
    ------
    FormatError
        If the node has another number of key points.
    """
    rows = connection.execute(
        "SELECT rowid, word_id FROM Feature WHERE node_id=? ORDER BY rowid", (node_id,)
    ).fetchall()
    if len(rows) != len(word_ids):
        raise FormatError(f"node {node_id} has {len(rows)} key points in the database, not {len(word_ids)}")
    changed = [
        (int(new), row)
        for (row, old), new in zip(rows, word_ids, strict=True)
        if max(int(old), 0) != int(new) and new > 0
    ]
    connection.executemany("UPDATE Feature SET word_id=? WHERE rowid=?", changed)


def insert_words(
    connection: sqlite3.Connection, layout: Layout, ids: NDArray[np.int64], descriptors: NDArray[np.uint8]
) -> None:
    """Write words of the dictionary; words that are there already are replaced."""
    size = descriptors.shape[1] if len(descriptors) else 0
    rows = zip(ids.tolist(), [size] * len(ids), map(bytes, np.ascontiguousarray(descriptors)), strict=True)
    connection.executemany("INSERT OR REPLACE INTO Word(id, descriptor_size, descriptor) VALUES(?,?,?)", rows)
    _forget_index(connection, layout)


def delete_words(connection: sqlite3.Connection, layout: Layout, ids: Iterable[int]) -> None:
    """Remove words of the dictionary."""
    connection.executemany("DELETE FROM Word WHERE id=?", [(int(word),) for word in ids])
    _forget_index(connection, layout)


def read_words(
    connection: sqlite3.Connection, chosen: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Return ids (W,) and descriptors uint8 (W, B) of the dictionary, by id; of chosen words those that are there."""
    query = "SELECT id, descriptor_size, descriptor FROM Word"
    if chosen is None:
        rows = connection.execute(f"{query} ORDER BY id").fetchall()
    else:
        found = (connection.execute(f"{query} WHERE id=?", (word,)).fetchone() for word in np.unique(chosen).tolist())
        rows = [row for row in found if row is not None]
    if not rows:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 32), dtype=np.uint8)
    ids, sizes, descriptors = zip(*rows, strict=True)
    return np.array(ids, dtype=np.int64), binary_descriptors(sizes, descriptors, "words")


def binary_descriptors(sizes: Iterable[Any], blobs: Iterable[Any], what: str) -> NDArray[np.uint8]:
    """Return uint8 (N, B) from equally long blobs; those that are missing are zeros."""
    kept = list(blobs)
    lengths = {len(blob) for blob in kept if blob} or {32}
    length = max(lengths)
    if len(lengths) > 1 or not set(sizes) <= {None, 0, length}:
        raise FormatError(
            f"the descriptors of its {what} are not binary (SURF, SIFT or SuperPoint?); extract them anew from the images"
        )
    missing = bytes(length)
    return np.frombuffer(b"".join([blob or missing for blob in kept]), dtype=np.uint8).reshape(-1, length)


def _forget_index(connection: sqlite3.Connection, layout: Layout) -> None:
    """Drop RTAB-Map's search tree of the dictionary, which no longer fits it: RTAB-Map builds it anew."""
    if layout.has("Admin", "dictionary_index"):
        connection.execute("UPDATE Admin SET dictionary_index=NULL WHERE dictionary_index IS NOT NULL")


def _seen_from(
    camera: StoredCamera | None, points: NDArray[np.float64], columns: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return depth along z and the column in the right image, NaN where unknown."""
    if camera is None:
        return np.full(len(points), np.nan), np.full(len(points), np.nan)
    T_camera_base = se3.inverse(camera.T_base_camera)
    depth = points @ T_camera_base[2, :3] + T_camera_base[2, 3]
    depth = np.where(depth > 0.0, depth, np.nan)
    bf = camera.pinhole.bf
    return depth, columns - bf / depth if bf > 0.0 else np.full(len(points), np.nan)
