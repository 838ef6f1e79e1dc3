# SPDX-License-Identifier: MIT
"""The nodes that are in memory: signatures, weights, words and the inverted file, in step with each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.dictionary import Dictionary
from slamcli.rtabmap.likelihood import InvertedFile, WordBag, word_bag
from slamcli.rtabmap.memory_store import LongTermStore
from slamcli.rtabmap.signature import Signature

Ids = NDArray[np.int64]


class HeldPlaces:
    """Nodes of short-term and working memory, by id."""

    def __init__(self, dictionary: Dictionary) -> None:
        self.signatures: dict[int, Signature] = {}
        self.bags: dict[int, WordBag] = {}
        self.file = InvertedFile()
        self.weights: dict[int, int] = {}
        """Of all nodes, those in long-term memory too."""
        self._dictionary = dictionary
        self._changed: dict[int, None] = {}

    def take(self, signature: Signature, *, weight: int) -> None:
        """Hold a node, whose words are in the dictionary."""
        bag = word_bag(signature.word_ids)
        self._dictionary.refer(signature.word_ids)
        self.file.add(signature.id, bag)
        self.signatures[signature.id], self.bags[signature.id] = signature, bag
        self.weights[signature.id] = weight

    def release(self, node: int) -> None:
        """Hold a node no more; its weight is kept."""
        signature = self.signatures.pop(node)
        self._dictionary.release(signature.word_ids)
        self.file.remove(node)
        del self.bags[node]

    def set_weight(self, node: int, weight: int) -> None:
        """Change a node's weight."""
        if self.weights[node] != weight:
            self.weights[node] = weight
            self._changed[node] = None

    def take_changed_weights(self) -> list[tuple[int, int]]:
        """Return nodes whose weights changed since the last call, with the weights."""
        changed = [(node, self.weights[node]) for node in self._changed if node in self.weights]
        self._changed = {}
        return changed

    def read_back(self, node: int, store: LongTermStore) -> None:
        """Hold a node as it was written. Words that were forgotten become those that look the same by now, or come back."""
        signature = store.read_signature(node)
        words = [word for word in np.unique(signature.word_ids).tolist() if word > 0 and word not in self._dictionary]
        if words:
            signature = replace(signature, word_ids=self._known(signature.word_ids, np.array(words, np.int64), store))
        self.take(signature, weight=self.weights.get(node, 0))

    def _known(self, word_ids: Ids, missing: Ids, store: LongTermStore) -> Ids:
        """The words of key points as the dictionary has them, after missing ones were read; 0 for those that were never written."""
        found, descriptors = store.read_words(missing)
        now = self._dictionary.nearest(descriptors)
        self._dictionary.add_words(found[now == 0], descriptors[now == 0])
        become = dict.fromkeys(missing.tolist(), 0)
        become |= {old: new or old for old, new in zip(found.tolist(), now.tolist(), strict=True)}
        return np.array([become.get(word, word) for word in word_ids.tolist()], np.int64)

    def alike(self, node_id: int, places: Sequence[int]) -> list[int]:
        """Return those of some places that share words with a node at hand, the likeliest first; none for a node without words."""
        ids = np.array(places, dtype=np.int64)
        if node_id not in self.bags or node_id not in self.file or not len(ids):
            return []
        sums, _ = self.file.scores(self.bags[node_id], ids)
        return [int(ids[row]) for row in np.lexsort((-ids, -sums)).tolist() if sums[row] > 0.0]
