# SPDX-License-Identifier: MIT
"""Made-up places for tests of the memory: descriptors by place, a graph along a line, and a store in memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.memory_records import Added
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature
from slamcli.vision.features import Features

FEATURES = 20


class StoreInMemory:
    """What a database does for the memory."""

    def __init__(self) -> None:
        self.nodes: dict[int, Signature] = {}
        self.words: dict[int, NDArray[np.uint8]] = {}

    def read_signature(self, node_id: int) -> Signature:
        return self.nodes[node_id]

    def read_words(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        found = np.array([word for word in ids.tolist() if word in self.words], np.int64)
        return found, np.array([self.words[word] for word in found.tolist()], np.uint8).reshape(-1, 32)


def parameters(**groups: dict[str, Any]) -> RtabmapParameters:
    """Parameters with 20 key points an image and 3 nodes in short-term memory, and others as given by group."""
    groups["kp"] = {"max_features": FEATURES, **groups.get("kp", {})}
    groups["mem"] = {"stm_size": 3, **groups.get("mem", {})}
    default = RtabmapParameters()
    return replace(default, **{name: replace(getattr(default, name), **values) for name, values in groups.items()})


def place_features(
    place: int, *, view: int = 0, number: int = FEATURES, pixels: NDArray[Any] | None = None, clutter: int = 0
) -> Features:
    """The key points that show a place: of each view some bits are different; the first `clutter` are seen in many places."""
    rng = np.random.default_rng(1000 + place)
    descriptors = rng.integers(0, 256, (number, 32), dtype=np.uint8)
    many = np.random.default_rng(0).integers(0, 256, (10, 32), dtype=np.uint8)
    descriptors[:clutter] = many[rng.permutation(10)[:clutter]]
    if view:
        noise = np.random.default_rng(view).random((number, 256)) < 0.03
        descriptors ^= np.packbits(noise, axis=1)
    column = np.zeros(number)
    pixels = rng.uniform(0, 640, (number, 2)) if pixels is None else pixels
    return Features(
        pixels=pixels, octaves=np.zeros(number, np.int64), angles=column, responses=column, descriptors=descriptors,
        sigmas=np.ones(number), right=column, depth=column, raw_pixels=pixels,
    )  # fmt: skip


def at(x: float) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


class World:
    """A memory, its graph and its store; the robot goes from place to place."""

    def __init__(self, settings: RtabmapParameters, *, with_store: bool = True) -> None:
        self.store = StoreInMemory()
        self.memory = Memory(settings, self.store if with_store else None)
        self.graph = MapGraph()
        self.next_id = 1
        self.previous: int | None = None

    def see(
        self, place: int, *, x: float | None = None, moved: bool = True, **features: Any
    ) -> tuple[Signature, Added]:
        """Add a node that shows a place, a metre further than the one before unless `x` says where."""
        node, pose = self.next_id, at(float(self.next_id) if x is None else x)
        self.next_id += 1
        seen = place_features(place, **features)
        signature = Signature(
            id=node, map_id=0, stamp_ns=node * 1_000_000_000, T_odom_base=pose, features=seen,
            points=np.full((len(seen), 3), np.nan), word_ids=self.memory.words_of(seen),
        )  # fmt: skip
        self.graph.add_node(GraphNode(id=node, map_id=0, stamp_ns=signature.stamp_ns, T_odom_base=pose), pose)
        if self.previous is not None:
            self.tie(self.previous, node)
        added = self.memory.add(signature, self.graph, moved=moved)
        self.store.nodes[node] = signature
        words, descriptors = self.memory.dictionary.take_made()
        self.store.words.update(zip(words.tolist(), descriptors, strict=True))
        for gone, kept in [(added.merged_id, added.kept_id)] * (added.merged_id is not None) + list(added.reduced):
            self.graph.merge(gone, kept)
        self.previous = added.kept_id
        return signature, added

    def tie(self, a: int, b: int, kind: LinkKind = LinkKind.NEIGHBOR) -> None:
        self.graph.add_link(Link(from_id=a, to_id=b, kind=kind, T_from_to=np.eye(4), information=np.eye(6)))
