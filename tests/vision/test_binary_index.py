# SPDX-License-Identifier: MIT
"""The index over binary descriptors against a naive search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _binary_index_kernels as kernels
from slamcli.vision.binary_index import FAR, BinaryIndex

pytestmark = pytest.mark.kernels


def random_descriptors(number: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    return rng.integers(0, 256, (number, 32), dtype=np.uint8)


def flipped(descriptors: NDArray[np.uint8], bits: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Copies in which so many bits differ."""
    wrong = np.zeros((len(descriptors), 256), np.uint8)
    for row in wrong:
        row[rng.permutation(256)[:bits]] = 1
    return descriptors ^ np.packbits(wrong, axis=1)


def naive_two(queries: NDArray[np.uint8], table: dict[int, NDArray[np.uint8]]) -> tuple[list, list]:
    """The rows and distances of the two nearest, by distance, then by row."""
    rows, distances = [], []
    for query in queries:
        ranked = sorted((int(np.unpackbits(query ^ other).sum()), row) for row, other in table.items())[:2]
        ranked += [(FAR, -1)] * (2 - len(ranked))
        rows.append([row for _, row in ranked])
        distances.append([d for d, _ in ranked])
    return rows, distances


def test_exact_search_is_the_naive_one():
    rng = np.random.default_rng(0)
    index = BinaryIndex()
    words = random_descriptors(30, rng)
    rows = index.add(words)
    queries = np.concatenate([flipped(words[:10], 5, rng), random_descriptors(5, rng), words[:2]])
    found = index.nearest_two(queries, exact=True)
    expected = naive_two(queries, dict(zip(rows.tolist(), words, strict=True)))
    assert found.rows.tolist() == expected[0]
    assert found.distances.tolist() == expected[1]
    assert index.nearest_two(queries).rows.tolist() == expected[0]  # nothing is in the tables yet: all are looked at


def test_tables_find_all_within_their_guarantee():
    """Two descriptors that differ in at most 31 bits share one of 16 parts but for one bit; with 23, a search may not end before."""
    rng = np.random.default_rng(1)
    index = BinaryIndex()
    words = random_descriptors(40, rng)
    rows = index.add(words)
    index._sort()
    for bits in (0, 1, 15, 31):
        found = index.nearest_two(flipped(words, bits, rng))
        assert found.rows[:, 0].tolist() == rows.tolist()
        assert (found.distances[:, 0] == bits).all()


def test_equal_descriptors_are_ordered_by_row():
    index = BinaryIndex()
    index.add(np.zeros((3, 32), np.uint8))
    for exact in (False, True):
        assert index.nearest_two(np.zeros((1, 32), np.uint8), exact=exact).rows.tolist() == [[0, 1]]
    index._sort()
    assert index.nearest_two(np.zeros((1, 32), np.uint8)).rows.tolist() == [[0, 1]]


def test_empty_and_single():
    index = BinaryIndex()
    assert index.nearest_two(np.zeros((2, 32), np.uint8)).rows.tolist() == [[-1, -1]] * 2
    index.add(np.zeros((1, 32), np.uint8))
    found = index.nearest_two(np.full((1, 32), 255, np.uint8))
    assert found.rows.tolist() == [[0, -1]]
    assert found.distances.tolist() == [[256, FAR]]
    assert index.nearest_two(np.zeros((0, 32), np.uint8)).rows.shape == (0, 2)


def test_wrong_descriptors_are_refused():
    index = BinaryIndex()
    with pytest.raises(DataError, match=r"uint8 \(2, 64\), not uint8 \(N, 32\)"):
        index.add(np.zeros((2, 64), np.uint8))
    with pytest.raises(DataError, match="float32"):
        index.nearest_two(np.zeros((2, 32), np.float32))
    with pytest.raises(DataError, match="holds no descriptor"):
        index.remove(np.array([0]))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), steps=st.lists(st.integers(-6, 8), max_size=8), sorting=st.integers(0, 8))
def test_rows_that_come_and_go(seed: int, steps: list[int], sorting: int):
    """Removed rows are never found; rows given away anew hold the new descriptor, though old entries lead there."""
    rng = np.random.default_rng(seed)
    index, table = BinaryIndex(), {}
    for number, step in enumerate(steps):
        if step >= 0:
            words = random_descriptors(step, rng)
            table.update(zip(index.add(words).tolist(), words, strict=True))
        else:
            gone = rng.permutation(sorted(table))[:-step]
            index.remove(gone.astype(np.int64))
            for row in gone:
                del table[int(row)]
        if number == sorting:
            index._sort()
        assert len(index) == len(table)
    if not table:
        return
    rows = sorted(table)
    words = np.array([table[row] for row in rows])
    assert index.descriptors(np.array(rows)).tolist() == words.tolist()
    found = index.nearest_two(flipped(words, 20, rng))
    assert found.rows[:, 0].tolist() == rows
    assert (found.distances[:, 0] == 20).all()
    expected = naive_two(words, table)
    assert index.nearest_two(words, exact=True).rows.tolist() == expected[0]


def test_bits_are_counted():
    with np.errstate(over="ignore"):
        values = np.array([0, 1, 3, 0xFFFFFFFFFFFFFFFF, 0x8000000000000001], np.uint64)
        a, b = np.zeros((1, 4), np.uint64), np.zeros((5, 4), np.uint64)
        b[:, 2] = values
        nearest, distances = np.full((1, 2), -1, np.int64), np.full((1, 2), FAR, np.int64)
        kernels.search_all(a, b, np.array([3, 4]), nearest, distances)
    assert nearest.tolist() == [[4, 3]]
    assert distances.tolist() == [[2, 64]]
