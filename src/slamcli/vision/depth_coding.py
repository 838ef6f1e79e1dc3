# SPDX-License-Identifier: MIT
"""Depth images of 16 bits as bytes, by differences and runs of zeros (RVL).

The bytes are framed as RTAB-Map frames them: the word ``DEPTHRVL``, columns and rows as int32, then the 32-bit words of the codec; all little-endian.

References
----------
Wilson, "Fast Lossless Depth Image Compression", ACM ISS 2017, doi:10.1145/3132272.3134144.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.vision._depth_coding_kernels import compress, expand, to_millimetres

MAGIC = b"DEPTHRVL"
_HEADER = struct.Struct("<8sii")
_LARGEST_SIDE = 1 << 15
_WHOLE_MM = 0.01  # float32 metres of 65 m are 0.004 mm off at most


def encode_rvl(values: NDArray[np.uint16]) -> bytes:
    """Return the bytes of uint16 (H, W), such as millimetres with 0 where unknown. Lossless; small steps between neighbours take 4 bits."""
    rows, columns = values.shape
    flat = np.ascontiguousarray(values, dtype=np.uint16).reshape(-1)
    words = np.empty(flat.size + 16, dtype=np.uint32)  # at most 8 nibbles a pixel
    used = compress(flat, words)
    return _HEADER.pack(MAGIC, columns, rows) + words[:used].astype("<u4").tobytes()


def decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """Return uint16 (H, W) from the bytes of `encode_rvl` or of RTAB-Map.

    Raises
    ------
    FormatError
        If the bytes do not begin as they should, or describe another number of pixels than they name.
    """
    if len(data) < _HEADER.size or not data.startswith(MAGIC):
        raise FormatError(f"not an RVL depth image: {len(data)} bytes that do not begin with {MAGIC.decode()}")
    _, columns, rows = _HEADER.unpack_from(data)
    if not (0 < columns <= _LARGEST_SIDE and 0 < rows <= _LARGEST_SIDE):
        raise FormatError(f"RVL depth image of {columns} x {rows} pixels: the bytes are damaged")
    body = data[_HEADER.size :]
    words = np.frombuffer(body[: len(body) // 4 * 4], dtype="<u4").astype(np.uint32)
    values = np.zeros(columns * rows, dtype=np.uint16)
    if not expand(words, values):
        raise FormatError(
            f"RVL depth image of {columns} x {rows} pixels in {len(data)} bytes: the bytes are damaged or end early"
        )
    return values.reshape(rows, columns)


def in_millimetres(depth: NDArray[np.float32], *, rounding: bool = False) -> NDArray[np.uint16] | None:
    """Return float32 (H, W) metres as uint16 millimetres, 0 where unknown (0, negative, NaN or infinite).

    None where a depth is not whole millimetres or more than 65.535 m; with `rounding` the one is rounded and the other unknown.
    """
    flat = np.ascontiguousarray(depth, dtype=np.float32).reshape(-1)
    values = np.empty(flat.size, dtype=np.uint16)
    return values.reshape(depth.shape) if to_millimetres(flat, values, _WHOLE_MM, rounding) else None


def warm() -> None:
    """Compile the kernels."""
    decode_rvl(encode_rvl(np.array([[0, 1000], [1001, 0]], dtype=np.uint16)))
    in_millimetres(np.ones((1, 2), dtype=np.float32))
