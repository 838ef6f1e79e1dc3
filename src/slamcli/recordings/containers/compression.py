# SPDX-License-Identifier: MIT
"""Decompression that cannot be talked into filling the memory."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any

import lz4.frame
import zstandard

MAX_CHUNK_BYTES = 512 << 20
"""Largest decompressed block that is believed; writers use 1 to 16 MB."""
_STEP = 4 << 20


class DecompressionError(Exception):
    """A compressed block is damaged; `partial` holds what came out before the damage."""

    def __init__(self, message: str, partial: bytes = b"") -> None:
        super().__init__(message)
        self.partial = partial


def decompress(data: bytes, compression: str, size: int | None) -> bytes:
    """Return the decompressed block.

    Parameters
    ----------
    data
        The compressed bytes.
    compression
        ``""`` or ``none``, ``bz2``, ``lz4`` or ``zstd``.
    size
        Decompressed size that the container declares, None where it declares none.

    Raises
    ------
    DecompressionError
        If the block is damaged, is larger than declared or than `MAX_CHUNK_BYTES`, or the compression is unknown.
    """
    if compression in ("", "none"):
        if size is not None and len(data) != size:
            raise DecompressionError(f"{len(data)} bytes where {size} are declared", data[:size])
        return data
    limit = MAX_CHUNK_BYTES if size is None else size
    if limit > MAX_CHUNK_BYTES:
        raise DecompressionError(f"declares {limit} bytes, more than any writer packs into one chunk")
    factory = _FACTORIES.get(compression)
    if factory is None:
        raise DecompressionError(f"compression {compression!r} is not one of none, bz2, lz4, zstd")
    out = factory(data, limit)
    if size is not None and len(out) != size:
        raise DecompressionError(f"decompresses to {len(out)} bytes where {size} are declared", out)
    return out


def _incremental(make: Callable[[], Any], errors: tuple[type[Exception], ...]) -> Callable[[bytes, int], bytes]:
    """Make a bounded decompressor of an object with `decompress(data, max_length)`, `eof` and `needs_input`."""

    def run(data: bytes, limit: int) -> bytes:
        parts: list[bytes] = []
        total = 0
        machine = make()
        while True:
            try:
                part = machine.decompress(data, min(_STEP, limit + 1 - total))
            except errors as error:
                raise DecompressionError(str(error) or "damaged", b"".join(parts)) from error
            data = b""
            parts.append(part)
            total += len(part)
            if machine.eof:
                return b"".join(parts) if len(parts) > 1 else part
            if total > limit:
                raise DecompressionError(f"decompresses to more than {limit} bytes", b"".join(parts)[:limit])
            if not part and machine.needs_input:
                raise DecompressionError("ends early", b"".join(parts))

    return run


def _unzstd(data: bytes, limit: int) -> bytes:
    try:
        declared = zstandard.frame_content_size(data)
        if 0 <= declared <= limit:
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
    except (zstandard.ZstdError, MemoryError):
        pass  # read it piece by piece instead, up to the damage
    parts: list[bytes] = []
    total = 0
    try:
        with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(
            data, read_across_frames=False
        ) as stream:
            while part := stream.read(min(_STEP, limit + 1 - total)):
                parts.append(part)
                total += len(part)
                if total > limit:
                    raise DecompressionError(f"decompresses to more than {limit} bytes", b"".join(parts)[:limit])
    except (zstandard.ZstdError, MemoryError) as error:
        raise DecompressionError(str(error) or "damaged", b"".join(parts)) from error
    return b"".join(parts)


_FACTORIES: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": _incremental(bz2.BZ2Decompressor, (OSError, ValueError, EOFError)),
    "lz4": _incremental(lz4.frame.LZ4FrameDecompressor, (RuntimeError, ValueError, EOFError, MemoryError)),
    "zstd": _unzstd,
}
