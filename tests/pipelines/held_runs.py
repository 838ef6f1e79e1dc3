# SPDX-License-Identifier: MIT
"""Runs of slamcli that wait until a test lets them go: those that name a file beside which ``FILE.pipe`` lies."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
HOLD = """
import os, sys
import click
plain = click.Group.main
def held(self, *arguments, **options):
    for word in sys.argv:
        if os.path.exists(word + ".pipe"):
            open(word + ".pipe").read()
    return plain(self, *arguments, **options)
click.Group.main = held
"""


def holding(folder: Path) -> str:
    """Return a PYTHONPATH with which Python processes that begin as slamcli wait as they are told to."""
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(HOLD)
    return os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])


def hold(file: Path) -> None:
    os.mkfifo(f"{file}.pipe")


def let_go(file: Path) -> None:
    """Let the run go that waits for a file, and those that begin after it."""
    pipe = Path(f"{file}.pipe")
    with pipe.open("w"):
        pipe.unlink()


def until(condition: Callable[[], T], seconds: float = 60.0) -> T:
    """Return what a condition comes to, once it is true."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)
    return found
