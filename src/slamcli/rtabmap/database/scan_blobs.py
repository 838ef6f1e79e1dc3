# SPDX-License-Identifier: MIT
"""Scans as the database's columns scan, scan_info and user_data hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.geometry import se3
from slamcli.rtabmap.database.blobs import pack_matrix, pack_pose, unpack_matrix, unpack_pose
from slamcli.rtabmap.signature import NodeScan

XY, XYZ = 1, 5
_PLANAR = (1, 2, 3, 4)
_CHANNELS = {1: 2, 2: 3, 3: 5, 4: 6, 5: 3, 6: 4, 7: 4, 8: 6, 9: 7, 10: 7, 11: 5}
_BY_CHANNELS = {2: 1, 3: 5, 4: 7, 5: 3, 6: 8, 7: 10}
"""Before 0.16.1 the number of channels told the format."""
_RAYS_FROM, _FORMAT_FROM = (0, 18), (0, 16, 1)
_OPEN_ENDS = b"slamcli open ends\n"
_FLAT_M = 1e-4


def pack_scan(scan: NodeScan) -> tuple[bytes | None, bytes, bytes | None]:
    """Return the columns scan, scan_info and user_data.

    Points are kept in the sensor's frame: two numbers each for a planar scan whose points lie in the sensor's plane, three otherwise. Ends
    of rays that met nothing have no column of RTAB-Map's: they are kept as user data, which it leaves alone.
    """
    T_sensor_base = se3.inverse(scan.T_base_sensor)
    points = scan.points @ T_sensor_base[:3, :3].T + T_sensor_base[:3, 3]
    flat = scan.planar and bool(np.abs(points[:, 2]).max(initial=0.0) < _FLAT_M)
    kept = points[:, :2] if flat else points[:, :3]
    info = np.array([XY if flat else XYZ, 0.0, scan.range_max_m, 0.0, 0.0, 0.0, len(points)], dtype="<f4").tobytes()
    blob = pack_matrix(kept.astype("<f4")[None]) if len(kept) else None
    ends = None
    if scan.open_ends is not None and len(scan.open_ends):
        data = np.frombuffer(_OPEN_ENDS + np.ascontiguousarray(scan.open_ends, dtype="<f4").tobytes(), dtype="u1")
        ends = pack_matrix(data[None])
    return blob, info + (pack_pose(scan.T_base_sensor) or b""), ends


def unpack_scan(
    blob: bytes | None, info: bytes | None, user_data: bytes | None, version: tuple[int, ...]
) -> NodeScan | None:
    """Return a node's scan, or None for a node without. Points at infinity and at the sensor are left out.

    Raises
    ------
    FormatError
        If the bytes are damaged.
    """
    if not blob and not info:
        return None
    form, range_max_m, T_base_sensor = _unpack_info(info, version)
    matrix = unpack_matrix(blob) if blob else np.zeros((1, 0, 3), dtype="<f4")
    channels = matrix.shape[2] if matrix.ndim == 3 else 1
    form = form or (_BY_CHANNELS.get(channels, 0) if blob else XYZ)
    if form not in _CHANNELS or (blob and _CHANNELS[form] != channels) or matrix.dtype != np.float32:
        raise FormatError(
            f"a scan of format {form} with {channels} numbers ({matrix.dtype}) for each point: damaged or of a newer version"
        )
    planar = form in _PLANAR
    values = matrix.reshape(-1, channels)[:, : 2 if planar else 3].astype(np.float64)
    values = values[np.isfinite(values).all(axis=1) & (np.abs(values) > 0.0).any(axis=1)]
    points = np.column_stack([values, np.zeros(len(values))]) if planar else values
    base = (points @ T_base_sensor[:3, :3].T + T_base_sensor[:3, 3]).astype(np.float32)
    return NodeScan(
        points=base,
        planar=planar,
        T_base_sensor=T_base_sensor,
        range_max_m=range_max_m,
        open_ends=_unpack_ends(user_data),
    )


def _unpack_info(info: bytes | None, version: tuple[int, ...]) -> tuple[int, float, NDArray[np.float64]]:
    """Return format (0: not told), longest range and the sensor's pose in the base."""
    if not info:
        return 0, 0.0, np.eye(4)
    numbers = np.frombuffer(info[: len(info) // 4 * 4], dtype="<f4")
    head = 7 if version >= _RAYS_FROM else 3 if version >= _FORMAT_FROM and len(numbers) == 15 else 2
    if len(numbers) != head + 12:
        raise FormatError(
            f"scan_info of {len(info)} bytes in a database of version {'.'.join(map(str, version))}: damaged"
        )
    pose = unpack_pose(info[4 * head :])
    T_base_sensor = np.eye(4) if pose is None else pose
    if head == 7:
        return int(numbers[0]), float(numbers[2]), T_base_sensor
    return (int(numbers[2]) if head == 3 else 0), float(numbers[1]), T_base_sensor


def _unpack_ends(user_data: bytes | None) -> NDArray[Any] | None:
    """Return the ends that `pack_scan` kept; None where the user data is somebody else's."""
    if not user_data:
        return None
    try:
        data = unpack_matrix(user_data).tobytes()
    except FormatError:
        return None
    if not data.startswith(_OPEN_ENDS):
        return None
    return np.frombuffer(data[len(_OPEN_ENDS) :], dtype="<f4").reshape(-1, 3).astype(np.float32)
