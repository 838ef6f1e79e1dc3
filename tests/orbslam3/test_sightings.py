# SPDX-License-Identifier: MIT
"""The table of observations and its lists against naive twins that read the whole table."""

import itertools

import numpy as np
import pytest

from slamcli.orbslam3.sightings import SightingTable

POINTS = 12


def naive_of(seen, points):
    """Who sees each of some points, by a look at every cell."""
    return [[tuple(cell) for cell in np.argwhere(seen == point).tolist()] for point in points]


def naive_move(seen, target):
    """Every observation of p becomes one of target[p]; a keyframe that sees the target already keeps that cell."""
    for row in seen:
        for i, p in enumerate(row.tolist()):
            if p >= 0 and target[p] != p:
                row[i] = -1 if target[p] in row[row >= 0] else target[p]


def table_of(seen, num_points=POINTS):
    table = SightingTable()
    table.add_points(num_points)
    for row in seen:
        table.add_keyframe(row)
    return table


def rows_of(table, points):
    offsets, keyframes, features = table.of(points)
    cells = list(zip(keyframes.tolist(), features.tolist(), strict=True))
    return [cells[a:b] for a, b in itertools.pairwise(offsets)]


def check(table, seen):
    every = np.arange(POINTS)
    np.testing.assert_array_equal(table.seen, seen)
    assert rows_of(table, every) == naive_of(seen, every)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_lists_follow_every_write(rng):
    seen = rng.integers(-1, POINTS, (6, 9))
    table = table_of(seen)
    check(table, seen)
    for _ in range(50):
        n = int(rng.integers(0, 8))
        keyframes, features, points = rng.integers(0, 6, n), rng.integers(0, 9, n), rng.integers(-1, POINTS, n)
        table.write(keyframes, features, points)
        for k, i, p in zip(keyframes, features, points, strict=True):
            seen[k, i] = p
        check(table, seen)
    table.write(2, np.arange(9), -1)  # a keyframe that was culled
    seen[2] = -1
    check(table, seen)
    assert rows_of(table, np.empty(0, dtype=np.int64)) == []


def test_counts_are_those_by_hand(rng):
    seen, right = rng.integers(-1, POINTS, (6, 9)), np.where(rng.random((6, 9)) < 0.5, np.nan, 3.0)
    table, points = table_of(seen), np.array([7, 2, 11])
    worth = np.where(np.isnan(right), 1, 2)
    assert table.count(points, right).tolist() == [int(((seen == p) * worth).sum()) for p in points]
    assert table.count_shared(points).tolist() == [int(np.isin(row, points).sum()) for row in seen]


def test_points_that_are_joined_move_as_in_the_naive_twin(rng):
    for _ in range(30):
        seen = rng.integers(-1, POINTS, (6, 9))
        table = table_of(seen)
        gone = rng.permutation(POINTS)[: rng.integers(0, 6)]
        replaced_by = np.full(POINTS, -1)
        kept = np.setdiff1d(np.arange(POINTS), gone)
        replaced_by[gone] = rng.choice(kept, len(gone))
        table.move(gone, replaced_by)
        naive_move(seen, np.where(replaced_by >= 0, replaced_by, np.arange(POINTS)))
        check(table, seen)


def test_chains_end_where_the_last_point_stands():
    table = table_of(np.array([[0, 1, -1], [1, 2, -1], [2, 3, 1]]), 4)
    table.move(np.array([0, 1]), np.array([1, 2, -1, -1]))
    assert table.seen.tolist() == [[2, -1, -1], [-1, 2, -1], [2, 3, -1]]
    table.clear(np.array([2]))
    assert table.seen.tolist() == [[-1, -1, -1], [-1, -1, -1], [-1, 3, -1]]
    assert rows_of(table, np.array([3, 2])) == [[(2, 1)], []]


def test_a_wider_keyframe_and_another_table_come_behind(rng):
    one, other = rng.integers(-1, POINTS, (3, 4)), rng.integers(-1, 5, (2, 7))
    table = table_of(one)
    table.add_keyframe(other[0])
    seen = np.full((4, 7), -1)
    seen[:3, :4], seen[3] = one, other[0]
    check(table, seen)
    table.add_points(5)
    table.append(table_of(other, 5), POINTS)
    whole = np.concatenate([seen, np.where(other >= 0, other + POINTS, -1)])
    np.testing.assert_array_equal(table.seen, whole)
    assert rows_of(table, np.arange(POINTS + 5)) == naive_of(whole, np.arange(POINTS + 5))


def test_what_was_kept_comes_back_and_marks_tell_of_news(rng):
    seen = rng.integers(-1, POINTS, (6, 9))
    table = table_of(seen)
    table.changed[:] = False
    table.write(1, np.array([3]), seen[1, 3])  # no news
    assert not table.changed.any()
    before = seen[1, 3]
    table.write(1, np.array([3]), (before + 1) % POINTS)
    assert set(np.flatnonzero(table.changed).tolist()) == {(before + 1) % POINTS} | ({before} - {-1})
    table.restore(seen)
    assert table.changed.all()
    check(table, seen)
    with pytest.raises(ValueError, match="read-only"):
        table.seen[0, 0] = 3
