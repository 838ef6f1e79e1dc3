# SPDX-License-Identifier: MIT
"""A terminal as a screen to draw on and a keyboard to read, restored whatever happens."""

from __future__ import annotations

import codecs
import contextlib
import os
import select
import signal
import sys
import termios
from types import FrameType, TracebackType
from typing import Any, Self

from slamcli.errors import UsageError

_ENTER = "\x1b[?1049h\x1b[?25l\x1b[2J"
"""The other screen, no cursor, empty."""
_LEAVE = "\x1b[0m\x1b[?25h\x1b[?1049l"
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Terminal:
    """The terminal behind stdin and stderr (stdout is for data); a context manager.

    Within it no key acts by itself, CTRL-C included: all are read. A signal that asks to end, and a terminal that goes away,
    set `ended`; what the block then does is not interrupted.

    Raises
    ------
    UsageError
        On entering, if either is no terminal, or one that cannot place its cursor.
    """

    def __init__(self) -> None:
        self.ended = False
        """Whether a signal asked to end, or the terminal has gone."""
        self._saved: list[Any] = []
        self._handlers: dict[int, Any] = {}
        self._decoder = codecs.getincrementaldecoder("utf-8")(errors="replace")
        self._size = (0, 0)

    @staticmethod
    def is_there() -> bool:
        """Return whether there is one."""
        try:
            return os.isatty(0) and os.isatty(2) and os.environ.get("TERM", "") not in ("", "dumb")
        except OSError:
            return False

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines now, at least 1."""
        try:
            found = os.get_terminal_size(2)
        except OSError:
            return 80, 24
        return max(found.columns, 1), max(found.lines, 1)

    def show(self, text: str) -> None:
        """Show lines from the top left corner; what was there is overwritten."""
        size = self.size
        clear = "\x1b[2J" if size != self._size else ""
        self._size = size
        self._write(clear + "\x1b[H" + text.replace("\n", "\r\n"))

    def read(self, seconds: float) -> str:
        """Return what was typed, after `seconds` at most; empty: nothing."""
        try:
            if not select.select([0], [], [], max(seconds, 0.0))[0]:
                return ""
            data = os.read(0, 4096)
        except InterruptedError:
            return ""
        except OSError:
            data = b""
        if not data:
            self.ended = True
        return self._decoder.decode(data)

    def __enter__(self) -> Self:
        if not self.is_there():
            raise UsageError("no terminal to draw on and to read keys from")
        sys.stderr.flush()
        self._saved = termios.tcgetattr(0)
        for number in _SIGNALS:
            self._handlers[number] = signal.signal(number, self._end)
        try:
            self._make_raw()
            self._write(_ENTER)
        except BaseException:
            self._restore()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    def _make_raw(self) -> None:
        """No line editing, no echo, no signals, no flow control by keys; output as it is."""
        mode = termios.tcgetattr(0)
        mode[0] &= ~(termios.IXON | termios.ICRNL | termios.INLCR | termios.ISTRIP)
        mode[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(0, termios.TCSAFLUSH, mode)

    def _restore(self) -> None:
        self._write(_LEAVE)
        with contextlib.suppress(termios.error, OSError):  # a terminal that has gone needs nothing
            termios.tcsetattr(0, termios.TCSAFLUSH, self._saved)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _write(self, text: str) -> None:
        data = text.encode()
        while data:
            try:
                data = data[os.write(2, data) :]
            except BlockingIOError:
                select.select([], [2], [], 0.1)
            except OSError:
                self.ended = True
                return

    def _end(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        self.ended = True
