# SPDX-License-Identifier: MIT
"""Bags of words and the inverted file equal naive twins; candidates follow ORB-SLAM's rules."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.vision.bag_of_words import BagOfWords, bag_of_words, similarity
from slamcli.vision.keyframe_database import KeyframeDatabase
from slamcli.vision.vocabulary import vocabulary

pytestmark = pytest.mark.kernels


def flat_vocabulary(num_words, weighting="tf-idf", weights=None):
    descriptors = np.zeros((num_words + 1, 32), np.uint8)
    descriptors[1:, 0] = np.arange(num_words)
    return vocabulary(
        branching=num_words, depth=1, weighting=weighting, descriptors=descriptors,
        num_children=np.array([num_words] + [0] * num_words),
        weights=np.concatenate([[0.0], np.ones(num_words) if weights is None else weights]),
    )  # fmt: skip


def described(words):
    descriptors = np.zeros((len(words), 32), np.uint8)
    descriptors[:, 0] = words
    return descriptors


def bag(words, weights=None):
    words = np.array(words, np.int64)
    weights = np.ones(len(words)) if weights is None else np.array(weights, float)
    return BagOfWords(words=words, weights=weights / max(weights.sum(), 1e-9), nodes=np.zeros(len(words), np.int64))


def random_bag(generator, num_words):
    words = np.flatnonzero(generator.random(num_words) < 0.3)
    return bag(words, generator.random(len(words)) + 0.1)


def naive_similarity(a, b, num_words):
    dense = np.zeros((2, num_words))
    dense[0, a.words], dense[1, b.words] = a.weights, b.weights
    return 1.0 - 0.5 * np.abs(dense[0] - dense[1]).sum()


def no_neighbours(key):
    return np.zeros(0, np.int64)


def test_a_bag_counts_words_and_adds_up_to_one():
    found = bag_of_words(flat_vocabulary(8, weights=np.array([1, 1, 0, 4, 1, 1, 1, 1.0])), described([3, 1, 1, 2, 2]))
    assert found.words.tolist() == [1, 3]
    assert found.weights == pytest.approx([2 / 6, 4 / 6])
    assert len(found.nodes) == 5


def test_weightings_without_terms_count_a_word_once():
    found = bag_of_words(flat_vocabulary(4, "idf"), described([1, 1, 1, 2]))
    assert found.weights == pytest.approx([0.5, 0.5])


def test_similarity_is_the_l1_score():
    generator = np.random.default_rng(0)
    for _ in range(20):
        a, b = random_bag(generator, 40), random_bag(generator, 40)
        assert similarity(a, b) == pytest.approx(naive_similarity(a, b, 40), abs=1e-12)
    assert similarity(a, a) == pytest.approx(1.0)
    assert similarity(bag([1, 2]), bag([3])) == 0.0
    assert similarity(bag([]), bag([3])) == 0.0


def test_scores_equal_the_naive_twin_while_keyframes_come_and_go():
    generator = np.random.default_rng(1)
    database = KeyframeDatabase(flat_vocabulary(40))
    there = {}
    for step in range(200):
        if there and generator.random() < 0.45:
            key = sorted(there)[int(generator.integers(len(there)))]
            database.erase(key)
            del there[key]
        else:
            key = next(k for k in generator.permutation(60).tolist() if k not in there)
            there[key] = random_bag(generator, 40)
            database.add(key, there[key])
        if step % 10 == 0:
            probe = random_bag(generator, 40)
            common, scores = database.scores(probe)
            assert len(database) == len(there)
            for k in range(len(common)):
                known = there.get(k)
                assert common[k] == (0 if known is None else len(np.intersect1d(known.words, probe.words)))
                assert scores[k] == pytest.approx(0.0 if known is None else naive_similarity(known, probe, 40), abs=1e-12)  # fmt: skip


def test_what_comes_back_does_not_depend_on_the_history():
    generator = np.random.default_rng(2)
    bags = [random_bag(generator, 40) for _ in range(12)]
    probe = random_bag(generator, 40)
    straight, winding = KeyframeDatabase(flat_vocabulary(40)), KeyframeDatabase(flat_vocabulary(40))
    for key in range(12):
        straight.add(key, bags[key])
    for key in reversed(range(12)):
        winding.add(key, bags[key])
        winding.erase(key)
        winding.add(key, bags[key])
    for one, other in zip(straight.scores(probe), winding.scores(probe), strict=True):
        assert one.tobytes() == other.tobytes()


def test_a_key_is_added_once():
    database = KeyframeDatabase(flat_vocabulary(4))
    database.add(2, bag([1]))
    database.erase(7)
    with pytest.raises(DataError, match="there already"):
        database.add(2, bag([1]))
    with pytest.raises(DataError, match="negative"):
        database.add(-1, bag([1]))
    assert 2 in database
    assert 7 not in database


def test_relocalisation_takes_groups_near_the_best():
    database = KeyframeDatabase(flat_vocabulary(30))
    probe = bag(range(10))
    database.add(0, bag(range(10)))  # all ten words
    database.add(1, bag([*range(9), 20, 21]))  # nine, covisible with 0
    database.add(2, bag([*range(8), 22, 23, 24]))  # eight, alone: its group is worth less than 0.75 of the best
    database.add(3, bag(range(7)))  # fewer than 0.8 of ten words: not scored though it is very like
    database.add(4, bag(range(10)))  # as 0, but of another map
    neighbours = {0: [1], 1: [0], 2: [], 3: [], 4: []}
    allowed = np.array([True, True, True, True])
    found = database.relocalisation_candidates(probe, lambda k: np.array(neighbours[k], np.int64), allowed=allowed)
    assert [candidate.key for candidate in found] == [0]
    assert found[0].score == pytest.approx(1.0)
    assert found[0].group_score == pytest.approx(1.0 + 9 / 11)
    assert found[0].num_words == 10
    alone = database.relocalisation_candidates(probe, no_neighbours, allowed=allowed)
    assert [candidate.key for candidate in alone] == [0, 1]
    assert {c.key for c in database.relocalisation_candidates(probe, no_neighbours)} == {0, 1, 4}


def test_places_leave_out_what_is_connected():
    database = KeyframeDatabase(flat_vocabulary(30))
    for key in range(6):
        database.add(key, bag([*range(10 - key), 20 + key]))
    excluded = np.array([True, True])
    found = database.place_candidates(bag(range(10)), no_neighbours, excluded=excluded, limit=2)
    assert [candidate.key for candidate in found] == [2, 3]
    assert database.place_candidates(bag([29]), no_neighbours) == []
    assert KeyframeDatabase(flat_vocabulary(3)).relocalisation_candidates(bag([1]), no_neighbours) == []


def test_equal_groups_stand_in_order_of_their_keys():
    database = KeyframeDatabase(flat_vocabulary(30))
    for key in (4, 1, 3):
        database.add(key, bag(range(5)))
    assert [c.key for c in database.place_candidates(bag(range(5)), no_neighbours)] == [1, 3, 4]
