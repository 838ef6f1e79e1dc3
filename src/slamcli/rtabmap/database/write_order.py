# SPDX-License-Identifier: MIT
"""Work that is done in the order it was given, here or on a thread of its own."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

Action = Callable[[], None]


class WriteOrder:
    """Actions in order. On a thread, the caller goes on; what fails is raised by the next call, and what follows it is left undone."""

    def __init__(self, *, threaded: bool, depth: int = 32) -> None:
        self._queue: queue.Queue[Action | None] = queue.Queue(depth)
        self._error: BaseException | None = None
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="rtabmap-database", daemon=True)
            self._thread.start()

    def do(self, action: Action) -> None:
        """Have an action done after all before it; waits where too many are waiting."""
        self._raise()
        if self._thread is None:
            action()
        else:
            self._queue.put(action)

    def wait(self) -> None:
        """Return when everything is done."""
        if self._thread is not None:
            self._queue.join()
        self._raise()

    def end(self) -> None:
        """End the thread when everything is done; errors stay for `wait`."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while True:
            action = self._queue.get()
            try:
                if action is None:
                    return
                if self._error is None:
                    action()
            except BaseException as error:  # noqa: BLE001 - raised again on the caller's thread
                self._error = error
            finally:
                self._queue.task_done()

    def _raise(self) -> None:
        error = self._error
        if error is not None:
            raise error
