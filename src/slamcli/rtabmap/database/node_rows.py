# SPDX-License-Identifier: MIT
"""Rows of the tables Node and Data."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.database.blobs import pack_pose, unpack_poses
from slamcli.rtabmap.database.calibration_blobs import pack_camera
from slamcli.rtabmap.database.cell_blobs import pack_cells
from slamcli.rtabmap.database.records import GeoFix, NodeTable, StorageSettings
from slamcli.rtabmap.database.scan_blobs import pack_scan
from slamcli.rtabmap.local_grid import LocalGrid
from slamcli.rtabmap.signature import NodeImages, Signature
from slamcli.vision.image_coding import encode_depth, encode_image

_COARSE_S = 1e6
"""Stamps from here on are kept to the microsecond: float64 seconds tell no more."""
CELL_COLUMNS = (
    "ground_cells",
    "obstacle_cells",
    "empty_cells",
    "cell_size",
    "view_point_x",
    "view_point_y",
    "view_point_z",
)
_DATA = f"INSERT INTO Data(id, image, depth, calibration, scan, scan_info, user_data, {', '.join(CELL_COLUMNS)}) VALUES({', '.join('?' * 14)})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeContent:
    """A node as it is handed over to be written."""

    signature: Signature
    weight: int
    label: str | None = None
    images: NodeImages | None = None
    local_grid: LocalGrid | None = None
    ground_truth: NDArray[np.float64] | None = None
    gps: GeoFix | None = None
    velocity: NDArray[np.float64] | None = None
    """float64 (6,), m/s along x, y, z and rad/s about them, base frame."""


def seconds(stamp_ns: int) -> float:
    """Return a stamp as the database has it."""
    return stamp_ns / 1e9


def nanoseconds(stamp_s: float | None) -> int:
    """Return a stamp of the database, exact to the microsecond."""
    value = float(stamp_s or 0.0)
    return round(value * 1e9) if abs(value) < _COARSE_S else round(value * 1e6) * 1000


def insert_node(connection: sqlite3.Connection, node: NodeContent, settings: StorageSettings) -> None:
    """Write the rows of Node and Data."""
    signature = node.signature
    gps = node.gps
    position = None
    if gps is not None:
        position = struct.pack(
            "<6d",
            seconds(gps.stamp_ns),
            gps.longitude_deg,
            gps.latitude_deg,
            gps.altitude_m,
            gps.accuracy_m,
            gps.bearing_deg,
        )
    row = (
        signature.id, signature.map_id, node.weight, seconds(signature.stamp_ns), pack_pose(signature.T_odom_base),
        pack_pose(node.ground_truth), None if node.velocity is None else np.asarray(node.velocity, dtype="<f4").tobytes(), node.label, position,
    )  # fmt: skip
    columns = "id, map_id, weight, stamp, pose, ground_truth_pose, velocity, label, gps"
    data = data_row(node, settings)
    connection.execute(f"INSERT INTO Node({columns}) VALUES(?,?,?,?,?,?,?,?,?)", row)
    connection.execute(_DATA, data)


def data_row(node: NodeContent, settings: StorageSettings) -> tuple[Any, ...]:
    """Return the values of a row of Data, everything compressed."""
    image, depth, calibration = _packed_images(node.images, settings) if node.images is not None else (None, None, None)
    scan, scan_info, user_data = (
        pack_scan(node.signature.scan) if node.signature.scan is not None else (None, None, None)
    )
    return node.signature.id, image, depth, calibration, scan, scan_info, user_data, *pack_cells(node.local_grid)


def read_nodes(connection: sqlite3.Connection) -> NodeTable:
    """Return all nodes by id."""
    query = "SELECT id, map_id, weight, stamp, pose, ground_truth_pose, label FROM Node ORDER BY id"
    rows = connection.execute(query).fetchall()
    ids, map_ids, weights, stamps, poses, truths, labels = zip(*rows, strict=True) if rows else ((),) * 7
    return NodeTable(
        ids=np.array(ids, dtype=np.int64),
        map_ids=np.array(map_ids, dtype=np.int64),
        weights=np.array([weight or 0 for weight in weights], dtype=np.int64),
        stamps_ns=np.array([nanoseconds(stamp) for stamp in stamps], dtype=np.int64),
        T_odom_base=unpack_poses(list(poses)),
        ground_truth=unpack_poses(list(truths)),
        labels=tuple(labels),
    )


def set_cells(connection: sqlite3.Connection, node_id: int, columns: Sequence[Any]) -> None:
    """Replace a node's local grid."""
    assignments = ", ".join(f"{name}=?" for name in CELL_COLUMNS)
    connection.execute(f"UPDATE Data SET {assignments} WHERE id=?", (*columns, node_id))  # noqa: S608


def _packed_images(images: NodeImages, settings: StorageSettings) -> tuple[bytes, bytes | None, bytes]:
    colour = encode_image(images.colour, settings.image_encoding)
    second = None
    if images.right is not None:
        second = encode_image(images.right, settings.image_encoding)
    elif images.depth is not None:
        second = encode_depth(images.depth, settings.depth_encoding, whole_millimetres=settings.depth_16_bits)
    return colour, second, pack_camera(images.camera, images.T_base_camera, pair=images.right is not None)
