# SPDX-License-Identifier: MIT
"""Cameras as the database's column Data.calibration holds them.

From 0.18 on: one record after the other, each of int32 version (3), kind (0 one camera, 1 a pair) and lengths, then float64 matrices and
the float32 pose in the base. Before: float32 fx, fy, cx, cy, [baseline,] [width, height,] pose.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.rtabmap.database.blobs import pack_pose, unpack_poses
from slamcli.rtabmap.database.records import StoredCamera
from slamcli.vision.pinhole import Pinhole

_VERSION = (0, 23, 8)
_ONE, _PAIR = 0, 1
_ONE_HEADER = struct.Struct("<11i")
_PAIR_HEADER = struct.Struct("<10i")
_TYPED_FROM = (0, 18)
_SIZED_FROM = (0, 11, 2)
_POSE_FLOATS = 12


def pack_camera(pinhole: Pinhole, T_base_camera: NDArray[np.float64], *, pair: bool) -> bytes:
    """Return the record of an ideal camera, or of a rectified pair at its baseline."""
    if not pair:
        return _pack_one(pinhole, T_base_camera, None)
    left = np.column_stack([pinhole.matrix, np.zeros(3)])
    right = left.copy()
    right[0, 3] = -pinhole.fx * pinhole.baseline_m
    records = [_pack_one(pinhole, T_base_camera, projection) for projection in (left, right)]
    return _PAIR_HEADER.pack(*_VERSION, _PAIR, 0, 0, 0, 0, *map(len, records)) + b"".join(records)


def unpack_cameras(blob: bytes | None, version: tuple[int, ...]) -> tuple[StoredCamera, ...]:
    """Return the cameras of a node, left ones of pairs, none for a node without.

    Raises
    ------
    FormatError
        If the bytes are damaged.
    """
    if not blob:
        return ()
    if version < _TYPED_FROM:
        return _unpack_floats(blob, version)
    cameras = []
    while blob:
        camera, used = _unpack_pair(blob) if _kind(blob) == _PAIR else _unpack_one(blob)
        cameras.append(camera)
        blob = blob[used:]
    return tuple(cameras)


def _pack_one(pinhole: Pinhole, T_base_camera: NDArray[np.float64], projection: NDArray[np.float64] | None) -> bytes:
    num_projection = 0 if projection is None else 12
    header = _ONE_HEADER.pack(*_VERSION, _ONE, pinhole.width, pinhole.height, 9, 0, 0, num_projection, _POSE_FLOATS)
    matrices = pinhole.matrix.astype("<f8").tobytes() + (
        b"" if projection is None else projection.astype("<f8").tobytes()
    )
    return header + matrices + (pack_pose(T_base_camera) or b"")


def _kind(blob: bytes) -> int:
    if len(blob) < _PAIR_HEADER.size:
        raise FormatError(f"a calibration of {len(blob)} bytes: damaged")
    kind = int(struct.unpack_from("<4i", blob)[3])
    if kind not in (_ONE, _PAIR):
        raise FormatError(f"a calibration of unknown kind {kind}: damaged")
    return kind


def _unpack_one(blob: bytes) -> tuple[StoredCamera, int]:
    if len(blob) < _ONE_HEADER.size:
        raise FormatError(f"a calibration of {len(blob)} bytes: damaged")
    *_, width, height, num_k, num_d, num_r, num_p, num_pose = _ONE_HEADER.unpack_from(blob)
    lengths = (num_k, num_d, num_r, num_p)
    used = _ONE_HEADER.size + 8 * sum(lengths) + 4 * num_pose
    known = num_k in (0, 9) and num_r in (0, 9) and num_p in (0, 12) and num_pose in (0, 12) and 0 <= num_d <= 14
    if not known or used > len(blob) or num_k + num_p == 0:
        raise FormatError(f"a calibration with matrices of {lengths} numbers in {len(blob)} bytes: damaged")
    numbers = np.frombuffer(blob, dtype="<f8", count=sum(lengths), offset=_ONE_HEADER.size)
    k, d, r, p = (part if len(part) else None for part in np.split(numbers, np.cumsum(lengths)[:-1]))
    shaped = k if p is None else p
    matrix = np.zeros((3, 3)) if shaped is None else shaped.reshape(3, -1)[:, :3]
    baseline_m = 0.0 if p is None else float(-p[3] / p[0])
    pinhole = Pinhole(
        fx=float(matrix[0, 0]), fy=float(matrix[1, 1]), cx=float(matrix[0, 2]), cy=float(matrix[1, 2]),
        width=width, height=height, baseline_m=baseline_m,
    )  # fmt: skip
    if k is not None and p is not None and k[8] != 1.0:
        k = matrix.reshape(-1)  # 0.23.8 wrote the beginning of P where K belongs
    pose = unpack_poses([blob[used - 48 : used] if num_pose else None])[0]
    camera = StoredCamera(
        pinhole=pinhole,
        T_base_camera=pose if num_pose else np.eye(4),
        intrinsics=None if k is None else k.reshape(3, 3),
        distortion=d,
        rectification=None if r is None else r.reshape(3, 3),
        projection=None if p is None else p.reshape(3, 4),
    )
    return camera, used


def _unpack_pair(blob: bytes) -> tuple[StoredCamera, int]:
    *_, num_r, num_t, num_e, num_f, num_left, num_right = _PAIR_HEADER.unpack_from(blob)
    extrinsics = 8 * (num_r + num_t + num_e + num_f)
    begin = _PAIR_HEADER.size + extrinsics
    used = begin + num_left + num_right
    if min(num_r, num_t, num_e, num_f, num_left, num_right) < 0 or used > len(blob):
        raise FormatError(
            f"a calibration of a pair with records of {num_left} and {num_right} bytes in {len(blob)}: damaged"
        )
    left, _ = _unpack_one(blob[begin : begin + num_left])
    right, _ = _unpack_one(blob[begin + num_left : used])
    return _with_baseline(left, right.pinhole.baseline_m), used


def _with_baseline(camera: StoredCamera, baseline_m: float) -> StoredCamera:
    ideal = camera.pinhole
    pinhole = Pinhole(
        fx=ideal.fx,
        fy=ideal.fy,
        cx=ideal.cx,
        cy=ideal.cy,
        width=ideal.width,
        height=ideal.height,
        baseline_m=baseline_m,
    )
    return StoredCamera(
        pinhole=pinhole, T_base_camera=camera.T_base_camera, intrinsics=camera.intrinsics, distortion=camera.distortion,
        rectification=camera.rectification, projection=camera.projection,
    )  # fmt: skip


def _unpack_floats(blob: bytes, version: tuple[int, ...]) -> tuple[StoredCamera, ...]:
    """Return cameras as they were kept before 0.18."""
    size = 6 if version >= _SIZED_FROM else 4
    numbers = np.frombuffer(blob[: len(blob) // 4 * 4], dtype="<f4").astype(np.float64)
    if len(numbers) in (5 + _POSE_FLOATS, 7 + _POSE_FLOATS) and len(numbers) % (size + _POSE_FLOATS):
        fx, fy, cx, cy, baseline_m = numbers[:5]
        width, height = numbers[5:7] if len(numbers) == 7 + _POSE_FLOATS else (0.0, 0.0)
        rows = [(fx, fy, cx, cy, width, height, baseline_m)]
    elif len(numbers) % (size + _POSE_FLOATS) == 0:
        table = numbers.reshape(-1, size + _POSE_FLOATS)
        rows = [(*row[:4], *(row[4:6] if size == 6 else (0.0, 0.0)), 0.0) for row in table]
    else:
        raise FormatError(f"a calibration of {len(numbers)} numbers: damaged")
    per_camera = len(numbers) // len(rows)
    poses = unpack_poses(
        [numbers[(i + 1) * per_camera - 12 : (i + 1) * per_camera].astype("<f4").tobytes() for i in range(len(rows))]
    )
    return tuple(
        StoredCamera(
            pinhole=Pinhole(
                fx=float(fx),
                fy=float(fy),
                cx=float(cx),
                cy=float(cy),
                width=int(width),
                height=int(height),
                baseline_m=float(baseline_m),
            ),
            T_base_camera=poses[i],
        )
        for i, (fx, fy, cx, cy, width, height, baseline_m) in enumerate(rows)
    )
