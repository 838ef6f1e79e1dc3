# SPDX-License-Identifier: MIT
"""The desktop's own programs."""

from __future__ import annotations

import os
import sys

import click


def show(address: str) -> bool:
    """Open a file or an address with the desktop's program for it, and return whether there is a desktop."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    return click.launch(address) == 0
