# SPDX-License-Identifier: MIT
"""What is written to the database as it happens, so that a killed run leaves all but the last node."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from slamcli.grids import OccupancyGrid
from slamcli.parameters import as_dict
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.feature_selection import rows_of
from slamcli.rtabmap.links import Link
from slamcli.rtabmap.local_grid import LocalGrid
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.update_record import UpdateRecord


class Keeping:
    """Writes nodes, links, words and statistics; one transaction a node."""

    def __init__(self, database: Database, parameters: RtabmapParameters) -> None:
        self.database = database
        self._mem, self._working_state = parameters.mem, parameters.rtabmap.save_wm_state

    def add(self, signature: Signature, node: NodeInput) -> None:
        """Write a node."""
        label = f"map{signature.map_id}" if node.began_anew and self._mem.map_labels_added else None
        kept = signature if self._mem.raw_descriptors_kept else _words_alone(signature)
        self.database.add_node(kept, weight=0, label=label, images=node.images if self._mem.bin_data_kept else None)

    def link(self, links: Sequence[Link]) -> None:
        """Write links."""
        self.database.add_links(links)

    def unlink(self, links: Iterable[Link]) -> None:
        """Remove links."""
        self.database.remove_links([(link.from_id, link.to_id) for link in links])

    def end_update(self, memory: Memory, record: UpdateRecord) -> None:
        """Write what an update changed beside nodes and links, and end its transaction."""
        words, descriptors = memory.dictionary.take_made()
        if len(words):
            self.database.add_words(words, descriptors)
        for node_id, weight in memory.take_changed_weights():
            self.database.set_weight(node_id, weight)
        working = sorted([*memory.working, *memory.short_term]) if self._working_state else None
        self.database.add_statistics(record.node, record.stamp_ns, _statistics(record), working)
        self.database.commit()

    def keep_grid(self, node_id: int, grid: LocalGrid) -> None:
        """Write what a node saw of the floor."""
        self.database.set_local_grid(node_id, grid)

    def finish(
        self,
        graph: MapGraph,
        memory: Memory,
        parameters: RtabmapParameters,
        ids: Sequence[int],
        grid: OccupancyGrid | None,
    ) -> None:
        """Write the optimised poses of some nodes, the map, and what the next session begins with; close the file."""
        poses = np.array([graph.T_map_base[node_id] for node_id in ids]).reshape(-1, 4, 4)
        self.database.set_optimised(np.array(ids, dtype=np.int64), poses, poses[-1] if len(poses) else None)
        if grid is not None:
            x_m, y_m = grid.origin[0], grid.origin[1]
            self.database.set_grid(grid.cells, x_min_m=x_m, y_min_m=y_m, resolution_m=grid.resolution_m)
        sizes = memory.sizes()
        self.database.set_info(
            parameters_text(parameters), stm_size=sizes.short_term, last_id=max(graph.nodes, default=0),
            num_words=sizes.words, working_ids=[*memory.working, *memory.short_term],
        )  # fmt: skip
        self.database.close()


def _words_alone(signature: Signature) -> Signature:
    """Return a node without the key points that are no words."""
    rows = np.flatnonzero(signature.word_ids > 0)
    return replace(
        signature, features=rows_of(signature.features, rows), points=signature.points[rows],
        word_ids=signature.word_ids[rows],
    )  # fmt: skip


def parameters_text(parameters: RtabmapParameters) -> str:
    """Return parameters as RTAB-Map's databases keep them: ``name:value;`` one after the other, its own names only."""
    values = as_dict(parameters)
    own = {name: value for name, value in values.items() if "/" in name}
    return ";".join(f"{name}:{_written(value)}" for name, value in sorted(own.items()))


def _written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _statistics(record: UpdateRecord) -> dict[str, float]:
    """Return the figures under RTAB-Map's names."""
    return {
        "Loop/Accepted_hypothesis_id/": record.loop_closure,
        "Loop/Highest_hypothesis_id/": record.hypothesis,
        "Loop/Highest_hypothesis_value/": record.posterior,
        "Loop/Visual_inliers/": record.loop_inliers,
        "Loop/Id/": record.loop_closure,
        "Memory/Short_time_memory_size/": record.short_term,
        "Memory/Working_memory_size/": record.working,
        "Memory/Signatures_retrieved/": record.retrieved,
        "Memory/Signatures_removed/": record.transferred,
        "Keypoint/Dictionary_size/words": record.words,
    }
