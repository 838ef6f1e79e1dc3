# SPDX-License-Identifier: MIT
"""Trees of binary words: kernels equal naive twins, words are the nearest, damage is refused."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.vision import _vocabulary_kernels as kernels
from slamcli.vision.vocabulary import as_words64, breadth_first, vocabulary
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary

pytestmark = pytest.mark.kernels


def naive_distance(a, b):
    return int(np.unpackbits(a ^ b).sum())


def naive_words(tree, descriptor):
    node, passed = 0, [0]
    while tree.num_children[node]:
        children = range(tree.first_child[node], tree.first_child[node] + tree.num_children[node])
        node = min(children, key=lambda child: (naive_distance(descriptor, tree.descriptors[child]), child))
        passed.append(node)
    return tree.word_of_node[node], tree.weights[node], passed[min(tree.matching_level, len(passed) - 1)]


def naive_vote(group):
    bits = np.unpackbits(group, axis=1)
    return np.packbits(2 * bits.sum(axis=0) >= len(group))


def noisy_copies(generator, prototypes, count, share):
    which = generator.integers(0, len(prototypes), count)
    flips = np.packbits(generator.random((count, 256)) < share, axis=1)
    return which, prototypes[which] ^ flips


def irregular_tree(generator):
    num_children = np.array([3, 2, 0, 4, 0, 2, 0, 3, 0, 0, 0, 0, 0, 0, 0])
    return vocabulary(
        branching=4, depth=3, weighting="tf-idf", descriptors=generator.integers(0, 256, (15, 32), np.uint8),
        num_children=num_children, weights=generator.random(15),
    )  # fmt: skip


def test_distances_count_bits():
    generator = np.random.default_rng(1)
    a = generator.integers(0, 256, (40, 32), np.uint8)
    a[0], a[1] = 0, 255
    words = as_words64(a)
    for i in range(40):
        for j in (0, 1, i, 7):
            assert kernels.distance(words, i, words, j) == naive_distance(a[i], a[j])
    assert kernels.distance(words, 0, words, 1) == 256


def test_words_equal_the_naive_descent():
    generator = np.random.default_rng(2)
    tree = irregular_tree(generator)
    assert tree.levels.tolist() == [0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3]
    descriptors = generator.integers(0, 256, (60, 32), np.uint8)
    found = tree.words(descriptors)
    for i, descriptor in enumerate(descriptors):
        assert (found.words[i], found.weights[i], found.nodes[i]) == naive_words(tree, descriptor)
    assert tree.num_words == 10
    assert found.words.max() < 10


def test_equal_distances_go_to_the_first_child():
    tree = vocabulary(
        branching=3, depth=1, weighting="tf-idf", descriptors=np.zeros((4, 32), np.uint8),
        num_children=np.array([3, 0, 0, 0]), weights=np.ones(4),
    )  # fmt: skip
    assert tree.words(np.full((2, 32), 9, np.uint8)).words.tolist() == [0, 0]


def test_words_of_nothing_are_none():
    found = irregular_tree(np.random.default_rng(3)).words(np.zeros((0, 32), np.uint8))
    assert [len(column) for column in found] == [0, 0, 0]


def test_matching_nodes_are_at_most_32_and_not_the_root():
    def full(branching, depth):
        counts = [branching**level for level in range(depth + 1)]
        sizes = np.repeat([branching] * depth + [0], counts)
        return vocabulary(
            branching=branching, depth=depth, weighting="tf-idf", descriptors=np.zeros((len(sizes), 32), np.uint8),
            num_children=sizes, weights=np.ones(len(sizes)),
        )  # fmt: skip

    levels = [full(*shape).matching_level for shape in ((10, 1), (10, 3), (40, 2), (2, 4), (2, 7), (5, 4))]
    assert levels == [1, 1, 1, 4, 5, 2]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_cluster_is_its_rows_majority(seed):
    generator = np.random.default_rng(seed)
    _, descriptors = noisy_copies(generator, generator.integers(0, 256, (4, 32), np.uint8), 60, 0.1)
    centres, labels = np.zeros((4, 4), np.uint64), np.empty(60, np.int64)
    count = kernels.cluster(as_words64(descriptors), np.arange(60), generator.random(4), 50, centres, labels)
    bytes_ = centres.view(np.uint8)
    for label in range(count):
        assert np.array_equal(bytes_[label], naive_vote(descriptors[labels == label]))
    for i in range(60):
        naive = min(range(count), key=lambda c: (naive_distance(descriptors[i], bytes_[c]), c))
        assert labels[i] == naive


def test_a_tie_of_votes_sets_the_bit():
    descriptors = np.zeros((2, 32), np.uint8)
    descriptors[1, 0] = 0b101
    centres, labels = np.zeros((1, 4), np.uint64), np.empty(2, np.int64)
    kernels.cluster(as_words64(descriptors), np.arange(2), np.zeros(1), 5, centres, labels)
    assert centres.view(np.uint8)[0, 0] == 0b101


def test_training_finds_the_prototypes():
    generator = np.random.default_rng(4)
    prototypes = generator.integers(0, 256, (9, 32), np.uint8)
    images = [noisy_copies(generator, prototypes, 30, 0.03)[1] for _ in range(12)]
    tree = train_vocabulary(images, TrainingSettings(branching=3, depth=4, seed=7))
    which, probes = noisy_copies(generator, prototypes, 200, 0.01)
    nearest = [min(range(9), key=lambda p: naive_distance(prototypes[p], tree.descriptors[n])) for n in np.flatnonzero(tree.num_children == 0)]  # fmt: skip
    assert np.mean(np.array(nearest)[tree.words(probes).words] == which) > 0.95


def test_weights_are_inverse_document_frequencies():
    generator = np.random.default_rng(5)
    a, b, c = generator.integers(0, 256, (3, 32), np.uint8)
    images = [np.array([a, b]), np.array([a, a]), np.array([a, c]), np.array([a])]
    tree = train_vocabulary(images, TrainingSettings(branching=3, depth=1))
    found = tree.words(np.array([a, b, c]))
    assert found.weights.tolist() == [0.0, np.log(4.0), np.log(4.0)]
    assert len(set(found.words.tolist())) == 3


def test_training_is_the_same_again_and_differs_by_seed():
    generator = np.random.default_rng(6)
    images = [generator.integers(0, 256, (40, 32), np.uint8) for _ in range(3)]

    def nodes(seed):
        return train_vocabulary(images, TrainingSettings(branching=4, depth=2, seed=seed)).descriptors

    assert np.array_equal(nodes(3), nodes(3))
    assert not np.array_equal(nodes(3), nodes(4))


def test_equal_descriptors_are_not_split():
    images = [np.repeat(np.arange(2, dtype=np.uint8), 20)[:, None].repeat(32, axis=1)]
    tree = train_vocabulary([*images, images[0][:3]], TrainingSettings(branching=4, depth=5))
    assert tree.num_words == 2
    with pytest.raises(DataError, match="fewer than two differ"):
        train_vocabulary([np.zeros((30, 32), np.uint8)], TrainingSettings())
    with pytest.raises(DataError, match="fewer than two differ"):
        train_vocabulary([], TrainingSettings())


def test_breadth_first_order_of_any_numbering():
    #        0 -> 5, 1;  5 -> 3, 4;  1 -> 2
    nodes, sizes = breadth_first(np.array([0, 0, 1, 5, 5, 0]))
    assert nodes.tolist() == [0, 1, 5, 2, 3, 4]
    assert sizes.tolist() == [2, 1, 2, 0, 0, 0]
    for wrong in ([0, 7], [0, -1], [0, 0, 3, 2]):
        with pytest.raises(DataError, match="vocabulary: "):
            breadth_first(np.array(wrong))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_children": np.array([2, 0, 1])}, "do not add up to 2"),
        ({"num_children": np.array([0, 0, 2])}, "do not add up"),
        ({"num_children": np.array([1, 0, 1])}, "hang in the air"),
        ({"branching": 1}, "2 children and 1 levels where 1 and 1"),
        ({"weights": np.array([0.0, np.nan, 1.0])}, "negative or not a number"),
        ({"weights": np.array([0.0, -1.0, 1.0])}, "negative or not a number"),
        ({"descriptors": np.zeros((3, 31), np.uint8)}, r"uint8 \(3, 31\)"),
    ],
)
def test_what_is_no_tree_is_refused(change, message):
    good = {
        "branching": 2, "depth": 1, "weighting": "tf-idf", "descriptors": np.zeros((3, 32), np.uint8),
        "num_children": np.array([2, 0, 0]), "weights": np.ones(3),
    }  # fmt: skip
    vocabulary(**good)
    with pytest.raises(DataError, match=message):
        vocabulary(**(good | change))


def test_wrong_descriptors_and_settings_are_refused():
    tree = irregular_tree(np.random.default_rng(8))
    for wrong in (np.zeros((3, 31), np.uint8), np.zeros((3, 32), np.int64), np.zeros(32, np.uint8)):
        with pytest.raises(DataError, match=r"not uint8 \(N, 32\)"):
            tree.words(wrong)
    for wrong in ({"branching": 1}, {"depth": 0}, {"depth": 11}, {"seed": -1}):
        with pytest.raises(DataError, match="must be 2 to 256"):
            TrainingSettings(**wrong)
