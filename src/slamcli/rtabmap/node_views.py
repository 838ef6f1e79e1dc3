# SPDX-License-Identifier: MIT
"""What the cameras saw at the nodes, read from the database when a dense model is made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.database import Database
from slamcli.rtabmap.node_points import with_depth
from slamcli.vision.posed_view import PosedView


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NodeViews:
    """Views of nodes that have depth, or a stereo pair; one is held at a time."""

    database: Path
    ids: NDArray[np.int64]
    """int64 (N,)."""
    T_map_base: NDArray[np.float64]
    """float64 (N, 4, 4), where the nodes are in the end."""
    semi_global: bool = True
    """See `slamcli.vision.stereo_depth`."""

    def __iter__(self) -> Iterator[PosedView]:
        """Go through them in the order of `ids`; the database is opened for as long."""
        with Database.read(self.database) as database:
            for node_id, T_map_base in zip(self.ids.tolist(), self.T_map_base, strict=True):
                images = with_depth(database.read_images(node_id), semi_global=self.semi_global)
                if images is None or images.depth is None:
                    continue
                colour = images.colour
                if colour.ndim == 2:
                    colour = np.repeat(colour[..., None], 3, axis=2)
                T_map_camera = T_map_base @ images.T_base_camera
                yield PosedView(np.ascontiguousarray(colour), images.depth, images.camera, T_map_camera)
