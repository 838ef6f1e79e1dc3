# SPDX-License-Identifier: MIT
"""One file, read by position and checked against its size before anything is allocated."""

from __future__ import annotations

import os
from pathlib import Path

from slamcli.errors import RecordingError

_WINDOW = 1 << 20


class Source:
    """A file opened for reading at any position; never reads or allocates beyond its end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("rb", buffering=0)
            self.size = os.fstat(self._file.fileno()).st_size
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
        self._window = b""
        self._window_start = 0

    def read(self, position: int, size: int) -> bytes:
        """Return up to `size` bytes from `position`; fewer only at the end of the file."""
        size = max(0, min(size, self.size - position))
        parts: list[bytes] = []
        while size > 0:
            try:
                part = os.pread(self._file.fileno(), size, position)
            except OSError as error:
                raise RecordingError(f"{self.path}: cannot be read at byte {position} ({error.strerror})") from error
            if not part:
                break
            if len(part) == size and not parts:
                return part
            parts.append(part)
            position += len(part)
            size -= len(part)
        return b"".join(parts)

    def peek(self, position: int, size: int) -> tuple[bytes, int]:
        """Return a buffer and the offset in it where `position` lies; `size` bytes follow unless the file ends.

        Serves walks over small records: neighbouring calls share one read.
        """
        offset = position - self._window_start
        if offset < 0 or offset + size > len(self._window):
            self._window = self.read(position, max(size, _WINDOW))
            self._window_start = position
            offset = 0
        return self._window, offset

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._window = b""
