# SPDX-License-Identifier: MIT
"""The container of a ``.pbstream``: magic, then gzip'd messages with their compressed sizes."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from slamcli.errors import FormatError

MAGIC = bytes.fromhex("db01f55b7b1f1d7b")

_MAX_MESSAGE_BYTES = 256 << 20
_FREE_BYTES = 1 << 30
_MOST_FOLD = 20
"""A file of n bytes may unpack to 1 GiB + 20 n in all, and to 256 MiB in one message: grids of states shrink about five
times, and a file made to fill the memory a thousand times."""
_GZIP = 31
_FAST = 1


def is_pbstream(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a ``.pbstream``: a file that is named so, or begins as one."""
    path = Path(path)
    if not path.is_file():
        return False
    if path.suffix.lower() == ".pbstream":
        return True
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def read_messages(path: str | os.PathLike[str]) -> Iterator[tuple[int, bytes]]:
    """Yield the position in the file and the unpacked bytes of each message.

    Raises
    ------
    FormatError
        If the file cannot be read, is no ``.pbstream``, ends in the middle of a message, or unpacks to too much.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if stream.read(len(MAGIC)) != MAGIC:
                raise FormatError(f"{path}: not a Cartographer state (.pbstream): its first bytes are not those of one")
            left = _FREE_BYTES + _MOST_FOLD * size
            while stream.tell() < size:
                at = stream.tell()
                data = _unpack(_frame(stream, size, path), at, path)
                left -= len(data)
                if left < 0:
                    raise FormatError(
                        f"{path}: unpacks to over {_FREE_BYTES + _MOST_FOLD * size} bytes; the file is broken"
                    )
                yield at, data
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror or error}") from error


def _frame(stream: IO[bytes], size: int, path: Path) -> bytes:
    at = stream.tell()
    length = int.from_bytes(stream.read(8), "little")
    if size - at < 8 or length > size - stream.tell():
        raise FormatError(f"{path}, byte {at}: the file ends in the middle of a message; it was cut off")
    return stream.read(length)


def _unpack(packed: bytes, at: int, path: Path) -> bytes:
    stream = zlib.decompressobj(_GZIP)
    try:
        data = stream.decompress(packed, _MAX_MESSAGE_BYTES + 1)
    except zlib.error as error:
        raise FormatError(f"{path}, byte {at}: a message is not gzip data ({error})") from error
    if len(data) > _MAX_MESSAGE_BYTES:
        raise FormatError(f"{path}, byte {at}: a message unpacks to over {_MAX_MESSAGE_BYTES >> 20} MiB")
    if not stream.eof:
        raise FormatError(f"{path}, byte {at}: the gzip data of a message is cut off")
    return data


def write_message(stream: IO[bytes], data: bytes) -> None:
    """Append one message; the same bytes for the same data (no time or name goes into the gzip header)."""
    packer = zlib.compressobj(_FAST, zlib.DEFLATED, _GZIP)
    packed = packer.compress(data) + packer.flush()
    stream.write(len(packed).to_bytes(8, "little"))
    stream.write(packed)
