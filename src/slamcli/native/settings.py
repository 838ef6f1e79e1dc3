# SPDX-License-Identifier: MIT
"""One value of a native configuration file, with the place where it stands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError

MAX_FILE_BYTES = 1_000_000
"""Configuration files are small; a larger one is something else, or an attack."""

_PACKAGE = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter that a native file sets."""

    name: str
    """Names of nested maps joined by ``/``: ``global_costmap/inflation_layer/inflation_radius``."""
    value: Any
    """bool, int, float, str, or a list or map of them."""
    file: str
    line: int

    @property
    def source(self) -> str:
        """Where it stands: ``file:line``, or what stands for a file that has no lines (``--set``)."""
        return f"{self.file}:{self.line}" if self.line else self.file


def shipped_folders() -> tuple[Path, ...]:
    """Return where slamcli's own native files are: ``configs`` of the source tree, inside the package if installed."""
    folders = (_PACKAGE / "_data" / "configs", _PACKAGE.parents[1] / "configs")
    return tuple(folder for folder in folders if folder.is_dir())


def find_native(path: Path) -> Path:
    """Return a native file: the one that is there, else slamcli's own of that name; `path` itself if there is none."""
    if path.name == str(path) and not path.exists():
        for folder in shipped_folders():
            if (folder / path).is_file():
                return folder / path
    return path


def merge(settings: Iterable[Setting]) -> Mapping[str, Setting]:
    """Return the settings by name; of two with one name the later wins and takes the later's place."""
    merged: dict[str, Setting] = {}
    for setting in settings:
        merged.pop(setting.name, None)
        merged[setting.name] = setting
    return merged


def read_text(path: Path) -> str:
    """Return the text of a configuration file.

    Raises
    ------
    ConfigError
        If it cannot be read, is not UTF-8 text, or is too large to be a configuration.
    """
    try:
        if not path.is_file():
            raise ConfigError(f"{path}: no such file")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigError(f"{path}: too large for a configuration file (limit {MAX_FILE_BYTES // 1_000_000} MB)")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from error
    except ValueError as error:  # also a NUL in the path
        raise ConfigError(f"{path}: not UTF-8 text: is this a configuration file?") from error
    if "\x00" in text:
        raise ConfigError(f"{path}: holds NUL characters: is this a configuration file?")
    return text
