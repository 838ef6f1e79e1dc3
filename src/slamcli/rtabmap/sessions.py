# SPDX-License-Identifier: MIT
"""How a run begins: with an empty memory, or with what a database holds of earlier sessions."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from slamcli.errors import ConfigError
from slamcli.mapper import Setup
from slamcli.rtabmap.closing import Closing
from slamcli.rtabmap.database import Database, StorageSettings
from slamcli.rtabmap.dictionary_file import Words, read_dictionary
from slamcli.rtabmap.fixed_map import FixedMap
from slamcli.rtabmap.fronts import Front
from slamcli.rtabmap.hypothesis import LoopDetector
from slamcli.rtabmap.keeping import Keeping, parameters_text
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.session import Session


def open_session(parameters: RtabmapParameters, setup: Setup, front: Front) -> Session:
    """Return a session whose database is open; the session closes it.

    Raises
    ------
    FormatError
        If the database cannot be used.
    ConfigError
        If the dictionary is fixed, and there is none.
    """
    words = _fixed_words(parameters, setup)
    database = _database(parameters, setup)
    memory = Memory(parameters, database)
    memory.dictionary.add_words(*words)
    graph = MapGraph()
    all_placed = True
    if setup.database is not None and setup.database.append:
        all_placed = restore(database, graph, memory)
    if not all_placed:
        optimise_maps(graph, Closing(parameters, memory, front.camera, front.T_base_camera, setup.seed))
    known = () if parameters.mem.incremental_memory else graph.T_map_base
    fixed = FixedMap(tuple(known), sigma=parameters.rgbd.localization_prior_error)
    closing = Closing(parameters, memory, front.camera, front.T_base_camera, setup.seed, fixed)
    keeping = Keeping(database, parameters)
    detector = LoopDetector(parameters, memory, seed=setup.seed)
    return Session(
        parameters, memory=memory, graph=graph, detector=detector, closing=closing, keeping=keeping, log=setup.log
    )


def _fixed_words(parameters: RtabmapParameters, setup: Setup) -> Words:
    """The words of a dictionary that does not grow: of a file, or of the database that is continued."""
    kp = parameters.kp
    if kp.incremental_dictionary:
        return np.zeros(0, np.int64), np.zeros((0, 32), np.uint8)
    if kp.dictionary_path:
        return read_dictionary(kp.dictionary_path)
    if setup.database is not None and setup.database.append:
        return read_dictionary(setup.database.path)
    raise ConfigError("Kp/IncrementalDictionary is false, but there are no words: Kp/DictionaryPath names the file")


def restore(database: Database, graph: MapGraph, memory: Memory) -> bool:
    """Put nodes, links and poses of earlier sessions into the graph, and what memory begins with into memory.

    Returns
    -------
    Whether the database has an optimised pose of every node. A run that was killed leaves none, and maps that were not its result have none.
    """
    nodes, optimised = database.nodes(), database.optimised()
    placed = {} if optimised is None else dict(zip(optimised.ids.tolist(), optimised.T_map_base, strict=True))
    links = database.links()
    linked = {end for link in links for end in (link.from_id, link.to_id)}
    for row, node_id in enumerate(nodes.ids.tolist()):
        known = np.isfinite(nodes.T_odom_base[row]).all()
        if nodes.weights[row] >= 0 and known and (node_id in linked or node_id in placed or len(nodes) == 1):
            T_odom_base = nodes.T_odom_base[row]
            node = GraphNode(
                id=node_id, map_id=int(nodes.map_ids[row]), stamp_ns=int(nodes.stamps_ns[row]), T_odom_base=T_odom_base
            )
            graph.add_node(node, placed.get(node_id, T_odom_base))
    for link in links:
        if link.from_id in graph.nodes and (link.to_id in graph.nodes or link.to_id < 0):
            graph.add_link(link)
    words, _ = database.words()
    kept = {
        node_id: int(weight)
        for node_id, weight in zip(nodes.ids.tolist(), nodes.weights.tolist(), strict=True)
        if node_id in graph.nodes
    }
    working = [node_id for node_id in database.last_working_ids().tolist() if node_id in graph.nodes]
    memory.restore(kept, working or list(graph.nodes), last_word=int(words.max(initial=0)))
    return graph.nodes.keys() <= placed.keys()


def optimise_maps(graph: MapGraph, closing: Closing) -> None:
    """Optimise every map of the graph by itself."""
    waiting = set(graph.nodes)
    while waiting:
        ids = graph.component(min(waiting))
        optimised = closing.optimise(ids, graph)
        graph.place(optimised.ids, optimised.T_map_base)
        waiting -= set(ids)


def storage_settings(parameters: RtabmapParameters) -> StorageSettings:
    """Return how nodes are kept in the file."""
    mem, sqlite = parameters.mem, parameters.db_sqlite3
    return StorageSettings(
        image_encoding=mem.image_compression_format, depth_encoding=mem.depth_compression_format,
        depth_16_bits=mem.save_depth_16_format, cache_pages=sqlite.cache_size, journal_mode=sqlite.journal_mode,
        synchronous=sqlite.synchronous, temp_store=sqlite.temp_store, in_memory=sqlite.in_memory,
    )  # fmt: skip


def _database(parameters: RtabmapParameters, setup: Setup) -> Database:
    choice, settings = setup.database, storage_settings(parameters)
    if choice is None:  # nobody asked for one: it lives as long as the run
        path = Path(tempfile.mkdtemp(prefix="slamcli-")) / "rtabmap.db"
        return Database.create(path, parameters_text(parameters), settings=settings, jobs=setup.jobs)
    if choice.append:
        return Database.append(choice.path, parameters_text(parameters), settings=settings, jobs=setup.jobs)
    return Database.create(choice.path, parameters_text(parameters), settings=settings, jobs=setup.jobs)
