# SPDX-License-Identifier: MIT
"""What a layout of data-set folders is: how it is recognised, and what reading it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from slamcli.recordings.containers.damage import Damage
from slamcli.recordings.folders.streams import Stream
from slamcli.runtime import RunLog

TRUTH_TOPIC = "/groundtruth"
"""Where every layout's true poses are: of the main camera, or of the body of EuRoC and TUM-VI."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a layout's reader is given besides the folder."""

    log: RunLog
    damage: Damage
    """Takes what is missing or broken, one line each."""
    depth_units_per_m: float | None = None
    """Value of one metre in depth images; None for the data set's own."""
    remarks: list[tuple[str, bool]] = field(default_factory=list)
    """What is to be said of the calibration once somebody reads it, and whether it is doubtful (a warning)."""

    def remark(self, text: str, *, doubtful: bool = False) -> None:
        """Keep a remark on the calibration: who has another one, or wants the poses alone, need not hear it."""
        self.remarks.append((text, doubtful))


@dataclass(frozen=True, slots=True, kw_only=True)
class DataFolder:
    """A data-set folder, looked through."""

    root: Path
    streams: tuple[Stream, ...]
    size_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """One layout."""

    name: str
    """As `Contents.format` names it."""
    signs: str
    """What must lie in a folder, for messages."""
    find: Callable[[Path], Path | None]
    """Return the folder's root if it has this layout, None if not."""
    read: Callable[[Path, Reading], DataFolder]
    """Look through a folder of this layout (by its root)."""
