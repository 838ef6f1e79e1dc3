# SPDX-License-Identifier: MIT
"""Some of the closures that were tried by looks, with what was matched, for the pictures of the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.registration import Registration
from slamcli.rtabmap.signature import Signature

_MOST = 32
"""Of each kind; of more every second, fourth and so on is kept."""
_MOST_MATCHES = 200

SightKind = Literal["loop", "near", "refused"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """Two nodes that were compared."""

    older: int
    newer: int
    kind: SightKind
    pixels_older: NDArray[np.float32]
    """float32 (M, 2), of the matches that the motion explains, in the images of the nodes; none where no motion was found."""
    pixels_newer: NDArray[np.float32]
    """float32 (M, 2), row by row."""
    reason: str = ""
    """Why it was refused."""


class Sights:
    """Keeps a bounded number of them, spread over the run."""

    def __init__(self) -> None:
        self._kept: dict[SightKind, list[Sight]] = {"loop": [], "near": [], "refused": []}
        self._every: dict[SightKind, int] = dict.fromkeys(self._kept, 1)
        self._offered: dict[SightKind, int] = dict.fromkeys(self._kept, 0)

    def of(self, kind: SightKind) -> list[Sight]:
        """Return those of a kind, in the order in which they were tried."""
        return list(self._kept[kind])

    def offer(
        self, older: Signature | None, newer: Signature | None, kind: LinkKind, found: Registration, reason: str
    ) -> None:
        """Take a closure, unless it is one too many or says nothing about what is seen; a node that memory has let go is None."""
        if older is None or newer is None or not (len(older.features) and len(newer.features)):
            return
        group: SightKind = "refused" if reason else "loop" if kind == LinkKind.GLOBAL_CLOSURE else "near"
        number = self._offered[group]
        self._offered[group] += 1
        if number % self._every[group]:
            return
        rows = found.matches[:: max(1, -(-len(found.matches) // _MOST_MATCHES))]
        self._kept[group].append(
            Sight(
                older=older.id, newer=newer.id, kind=group, reason=reason,
                pixels_older=older.features.pixels[rows[:, 0]].astype(np.float32),
                pixels_newer=newer.features.pixels[rows[:, 1]].astype(np.float32),
            )
        )  # fmt: skip
        if len(self._kept[group]) > _MOST:
            self._kept[group] = self._kept[group][::2]
            self._every[group] *= 2
