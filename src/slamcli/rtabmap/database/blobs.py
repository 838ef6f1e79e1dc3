# SPDX-License-Identifier: MIT
"""Values of a database's columns as bytes: poses, matrices and text.

All numbers are little-endian. A *matrix* is OpenCV's: zlib bytes, then rows, columns and OpenCV's type as int32.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError

_TAIL = struct.Struct("<iii")
_DEPTHS = ("u1", "i1", "<u2", "<i2", "<i4", "<f4", "<f8")
_LARGEST = 1 << 31
INT8, INT32 = 1, 4


def pack_pose(T: NDArray[np.float64] | None) -> bytes | None:
    """Return 12 float32, the upper three rows of T (4, 4); None stays None."""
    return None if T is None else np.ascontiguousarray(T[:3], dtype="<f4").tobytes()


def unpack_poses(blobs: list[bytes | None]) -> NDArray[np.float64]:
    """Return float64 (N, 4, 4) with rotations made orthonormal; NaN where there is no pose.

    RTAB-Map's null pose is no blob, or zeros.
    """
    poses = np.full((len(blobs), 4, 4), np.nan)
    known = [i for i, blob in enumerate(blobs) if blob is not None and len(blob) == 48]
    if known:
        upper = (
            np.frombuffer(b"".join(blobs[i] or b"" for i in known), dtype="<f4").reshape(-1, 3, 4).astype(np.float64)
        )
        given = np.isfinite(upper).all(axis=(1, 2)) & (np.abs(upper[:, :, :3]).max(axis=(1, 2)) > 0.0)
        rows = np.array(known)[given]
        poses[rows] = np.eye(4)
        poses[rows, :3, 3] = upper[given, :, 3]
        poses[rows, :3, :3] = _orthonormal(upper[given, :, :3])
    return poses


def unpack_pose(blob: bytes | None) -> NDArray[np.float64] | None:
    """Return float64 (4, 4), or None where there is no pose."""
    pose = unpack_poses([blob])[0]
    return pose if np.isfinite(pose).all() else None


def pack_matrix(values: NDArray[Any], kind: int | None = None) -> bytes:
    """Return the compressed matrix of values (R, C) or (R, C, channels) of OpenCV's depths; `kind` overrides OpenCV's type."""
    depth = _DEPTHS.index(values.dtype.newbyteorder("<").str.replace("|", "")) if kind is None else 0
    channels = values.shape[2] if values.ndim == 3 else 1
    code = depth + ((channels - 1) << 3) if kind is None else kind
    return zlib.compress(np.ascontiguousarray(values).tobytes()) + _TAIL.pack(values.shape[0], values.shape[1], code)


def unpack_matrix(blob: bytes) -> NDArray[Any]:
    """Return (R, C) or (R, C, channels).

    Raises
    ------
    FormatError
        If the bytes are damaged.
    """
    if len(blob) < _TAIL.size:
        raise FormatError(f"a compressed matrix of {len(blob)} bytes: damaged")
    rows, columns, code = _TAIL.unpack(blob[-_TAIL.size :])
    depth, channels = code & 7, (code >> 3) + 1
    if (
        rows < 0
        or columns < 0
        or depth >= len(_DEPTHS)
        or not 0 < channels <= 512
        or rows * columns * channels > _LARGEST
    ):
        raise FormatError(f"a compressed matrix of {rows} x {columns} and type {code}: damaged")
    kind = np.dtype(_DEPTHS[depth])
    try:
        data = zlib.decompressobj().decompress(blob, rows * columns * channels * kind.itemsize + 1)
    except zlib.error as error:
        raise FormatError(f"a compressed matrix of {len(blob)} bytes: damaged ({error})") from error
    if len(data) != rows * columns * channels * kind.itemsize:
        raise FormatError(
            f"a compressed matrix with {len(data)} bytes where {rows} x {columns} x {channels} {kind} were expected: damaged"
        )
    values = np.frombuffer(data, dtype=kind)
    return values.reshape(rows, columns, channels) if channels > 1 else values.reshape(rows, columns)


def pack_text(text: str) -> bytes:
    """Return the compressed text, with the zero byte that ends it in C."""
    data = np.frombuffer(text.encode() + b"\0", dtype="i1")
    return pack_matrix(data[None, :])


def unpack_text(blob: bytes) -> str:
    """Return the text of `pack_text`."""
    return unpack_matrix(blob).tobytes().split(b"\0", 1)[0].decode("utf-8", "replace")


def _orthonormal(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest rotations (N, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    flips = np.ones((len(matrices), 3))
    flips[:, 2] = np.linalg.det(u @ vt)
    return (u * flips[:, None, :]) @ vt
