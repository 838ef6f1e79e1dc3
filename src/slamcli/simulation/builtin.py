# SPDX-License-Identifier: MIT
"""The worlds that slamcli brings along: ``configs/worlds`` of the source tree, inside the package when it is installed."""

from __future__ import annotations

import difflib
from pathlib import Path

from slamcli.errors import UsageError

_PACKAGE = Path(__file__).resolve().parents[1]
_FOLDERS = (_PACKAGE / "_data" / "configs" / "worlds", _PACKAGE.parents[1] / "configs" / "worlds")


def world_names() -> tuple[str, ...]:
    """Return the names of the built-in worlds, sorted."""
    return tuple(sorted({path.stem for folder in _FOLDERS if folder.is_dir() for path in folder.glob("*.yaml")}))


def find_world(name: str) -> Path:
    """Return the file that `name` means: a file if one is there, else a built-in world.

    A folder is no world, and one that is called like a built-in world (the result of mapping it, say) does not hide that.

    Raises
    ------
    UsageError
        If there is neither; the message names the nearest built-in world.
    """
    path = Path(name)
    if path.exists() and not path.is_dir():
        return path
    for folder in _FOLDERS:
        if (folder / f"{name}.yaml").is_file():
            return folder / f"{name}.yaml"
    if path.is_dir():
        raise UsageError(f"{name} is a folder: name a world file, a map.yaml or one of {', '.join(world_names())}")
    near = difflib.get_close_matches(path.stem, world_names(), n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"built-in worlds are {', '.join(world_names())}"
    raise UsageError(f"no world file and no built-in world {name!r}: {hint}")
