# SPDX-License-Identifier: MIT
"""Likelihoods by hand and against a naive twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import DataError
from slamcli.rtabmap import _place_kernels as kernels  # noqa: F401  (its twins are `naive_scores` and `naive_predict`)
from slamcli.rtabmap.likelihood import InvertedFile, adjusted, similarity, word_bag

pytestmark = pytest.mark.kernels


def bag(*words: int):
    return word_bag(np.array(words, np.int64))


def filed(**places: list[int]) -> InvertedFile:
    file = InvertedFile()
    for name, words in places.items():
        file.add(int(name[1:]), bag(*words))
    return file


def naive_scores(query: list[int], places: dict[int, list[int]]) -> list[float]:
    """The sum of the paper's section III-D, place by place."""
    sums = []
    for words in places.values():
        total = 0.0
        for word in sorted(set(query) - {0}):
            shown = sum(word in other for other in places.values())
            seen = [w for w in words if w]
            if shown and word in seen:
                total += seen.count(word) / len(seen) * math.log10(len(places) / shown)
        sums.append(total)
    return sums


def naive_similarity(a: list[int], b: list[int]) -> float:
    a, b = [w for w in a if w], [w for w in b if w]
    return sum(min(a.count(w), b.count(w)) for w in set(a)) / max(len(a), len(b)) if a and b else 0.0


def test_tf_idf_by_hand():
    """Four places, N = 4; word 1 in two of them, word 2 in one, word 3 in all."""
    file = filed(p1=[1, 1, 3, 3], p2=[1, 3], p3=[2, 3, 0, 0], p4=[3])
    scores, _ = file.scores(bag(1, 2, 3, 3, 9), np.array([1, 2, 3, 4]))
    assert scores == pytest.approx([2 / 4 * math.log10(2), 1 / 2 * math.log10(2), 1 / 2 * math.log10(4), 0.0])


def test_similarity_by_hand():
    """The example in RTAB-Map's own source: 5 pairs of 6 and 7 key points."""
    a, b = bag(1, 2, 3, 4, 6, 6), bag(1, 1, 2, 4, 5, 6, 6)
    assert similarity(a, b) == similarity(b, a) == 5 / 7
    assert similarity(a, a) == 1.0
    assert similarity(a, bag(0, 0)) == similarity(bag(), bag()) == 0.0
    file = InvertedFile()
    file.add(1, a)
    assert file.scores(b, np.array([1]))[1].tolist() == [5 / 7]


def test_likelihoods_that_stand_out():
    """Scores 1, 1, 1 and 5: mean 2, deviation 2; 5 is above 4, none else."""
    values = adjusted(np.array([1.0, 0.0, 5.0, 1.0, 1.0]))
    assert values == pytest.approx([2 / 2 + 1, 1, 1, (5 - (2 - 0.0001)) / 2, 1, 1])
    values = adjusted(np.array([1.0, 0.0, 5.0, 1.0, 1.0]), ratio=1)
    assert values == pytest.approx([2 / (5 - 2) + 1, 1, 1, (5 - 2) / 2, 1, 1])


@pytest.mark.parametrize("ratio", [0, 1])
@pytest.mark.parametrize("scores", [[], [0.0, 0.0], [0.3], [0.3, 0.3, 0.3]])
def test_likelihoods_that_are_alike(scores: list[float], ratio: int):
    values = adjusted(np.array(scores), ratio=ratio)
    assert values[0] == 2.0
    # A single score is above the mean of itself plus no deviation in no case.
    assert values[1:].tolist() == [1.0] * len(scores)


@settings(max_examples=40, deadline=None)
@given(
    places=st.lists(st.lists(st.integers(0, 12), max_size=10), min_size=1, max_size=8),
    query=st.lists(st.integers(0, 14), max_size=10),
    gone=st.sets(st.integers(1, 8)),
)
def test_inverted_file_is_the_naive_one(places: list[list[int]], query: list[int], gone: set[int]):
    """Also after places went, and others took what they left."""
    file = InvertedFile()
    for place, words in enumerate(places, 1):
        file.add(place, bag(*words))
    for place in gone:
        file.remove(place)
    kept = {place: words for place, words in enumerate(places, 1) if place not in gone}
    for place, words in enumerate(places, 101):
        file.add(place, bag(*words[::2]))
        kept[place] = words[::2]
    assert len(file) == len(kept)
    scores, common = file.scores(bag(*query), np.array(list(kept)))
    assert scores == pytest.approx(naive_scores(query, kept), abs=1e-12)
    assert common == pytest.approx([naive_similarity(query, words) for words in kept.values()])


def test_memory_of_the_file_is_bounded():
    """A place that comes when another goes takes its room."""
    file = InvertedFile()
    for place in range(300):
        file.add(place, bag(*range(20 * place, 20 * place + 40)))
        file.remove(place - 10)
    assert len(file) == 10
    assert len(file._following) <= 2048
    assert len(file._lists) <= 600


def test_a_place_is_filed_once():
    file = filed(p1=[1])
    with pytest.raises(DataError, match="place 1 is there already"):
        file.add(1, bag(2))
    file.remove(7)
    assert 1 in file
    assert 7 not in file
