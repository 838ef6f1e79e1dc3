# SPDX-License-Identifier: MIT
"""Measurements that are read and decoded on another thread while the last ones are worked on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from typing import TypeVar

from slamcli.runtime import RunLog

T = TypeVar("T")
AHEAD = 6
"""Measurements that wait at most: memory stays constant, and a slow one does not stop the other thread at once."""
_END = object()
_POLL_S = 0.1


def read_ahead(make: Callable[[RunLog], Iterator[T]], log: RunLog, number: int = AHEAD) -> Iterator[T]:
    """Yield what an iterator yields, made and run on a thread of its own, at most `number` items ahead.

    The order is that of the iterator. What it says goes to a log of its own that joins `log` at the end, so that the
    order of warnings does not depend on timing. An error that it raises is raised here, after the items before it.

    Parameters
    ----------
    make
        Returns the iterator; it is given the log to use.
    """
    waiting: queue.Queue[object] = queue.Queue(maxsize=number)
    stop = threading.Event()
    own = RunLog()
    failed: list[BaseException] = []

    def put(item: object) -> bool:
        while not stop.is_set():
            try:
                waiting.put(item, timeout=_POLL_S)
            except queue.Full:
                continue
            return True
        return False

    def work() -> None:
        try:
            for item in make(own):
                if not put(item):
                    return
        except BaseException as error:  # noqa: BLE001 - raised again on the other thread
            failed.append(error)
        finally:
            put(_END)

    thread = threading.Thread(target=work, name="read-ahead", daemon=True)
    thread.start()
    try:
        while (item := waiting.get()) is not _END:
            yield item  # type: ignore[misc]
    finally:
        stop.set()
        thread.join()
        for warning in own.warnings:
            log.warn(warning)
        for note in own.notes:
            log.note(note)
        log.counts.update(own.counts)
    if failed:
        raise failed[0]
