# SPDX-License-Identifier: MIT
"""What other packages may build on: the names in each room's `__all__`, pinned in public_names.txt.

A change that is meant: python tests/contracts/test_public_names.py
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from pathlib import Path

import slamcli

PINNED = Path(__file__).with_name("public_names.txt")


def rooms() -> list[str]:
    found = pkgutil.walk_packages(slamcli.__path__, "slamcli.")
    return [module.name for module in found if module.ispkg]


def public_names() -> list[str]:
    return sorted(
        f"{room}.{name}" for room in rooms() for name in getattr(importlib.import_module(room), "__all__", ())
    )


def test_the_public_names_are_those_that_are_pinned():
    assert public_names() == PINNED.read_text().split(), "run: python tests/contracts/test_public_names.py"


def test_every_public_class_and_function_is_documented():
    undocumented = []
    for full in public_names():
        room, _, name = full.rpartition(".")
        thing = getattr(importlib.import_module(room), name)
        if (inspect.isclass(thing) or inspect.isfunction(thing)) and not inspect.getdoc(thing):
            undocumented.append(full)
    assert undocumented == []


if __name__ == "__main__":
    PINNED.write_text("\n".join(public_names()) + "\n")
