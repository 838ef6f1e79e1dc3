# SPDX-License-Identifier: MIT
"""A process and all that it started: how much memory they hold, and their end.

Linux tells of both under /proc; elsewhere psutil does, where it is installed.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import signal
from collections.abc import Iterator
from pathlib import Path

_PROC = Path("/proc")


@functools.cache
def can_be_measured() -> bool:
    """Whether this system tells how much memory another process holds."""
    return _has_proc() or importlib.util.find_spec("psutil") is not None


def tree_memory_bytes(process: int) -> int:
    """Return the resident memory of a process and its descendants, in bytes; memory that they share counts for each.

    What has ended counts nothing, and so does everything where `can_be_measured` is False.
    """
    return sum(map(_memory_bytes, tree(process)))


def tree(process: int) -> list[int]:
    """Return the ids of a process and of its descendants, the process first."""
    found = [process]
    for one in found:
        found += _children(one)
    return found


def end_tree(process: int) -> None:
    """Kill a process, its group and its descendants, those in groups of their own too."""
    for one in reversed(tree(process)):
        with contextlib.suppress(OSError):
            os.kill(one, signal.SIGKILL)
    with contextlib.suppress(OSError):
        os.killpg(process, signal.SIGKILL)


def physical_memory_bytes() -> int:
    """Return how much memory this machine has, or this container if that is less."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    for limit in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with contextlib.suppress(OSError, ValueError):  # "max" where there is no limit
            whole = min(whole, int(Path(limit).read_text(encoding="ascii")))
    return whole


@functools.cache
def _has_proc() -> bool:
    return (_PROC / "self" / "task" / str(os.getpid()) / "children").exists()


def _children(process: int) -> Iterator[int]:
    if not _has_proc():
        yield from _children_by_psutil(process)
        return
    with contextlib.suppress(OSError):  # it has ended
        for thread in os.listdir(_PROC / str(process) / "task"):  # noqa: PTH208 - names are what is needed
            with contextlib.suppress(OSError):
                text = (_PROC / str(process) / "task" / thread / "children").read_text(encoding="ascii")
                yield from map(int, text.split())


def _memory_bytes(process: int) -> int:
    if not _has_proc():
        return _memory_by_psutil(process)
    try:
        resident = (_PROC / str(process) / "statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(resident) * os.sysconf("SC_PAGE_SIZE")


def _children_by_psutil(process: int) -> list[int]:
    try:
        import psutil
    except ImportError:
        return []
    try:
        return [child.pid for child in psutil.Process(process).children()]
    except psutil.Error:
        return []


def _memory_by_psutil(process: int) -> int:
    try:
        import psutil
    except ImportError:
        return 0
    try:
        return int(psutil.Process(process).memory_info().rss)
    except psutil.Error:
        return 0
