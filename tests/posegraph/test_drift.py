# SPDX-License-Identifier: MIT
"""Drift between submaps: variances along the best known way, against a naive twin."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.posegraph.drift import Ways, relative_sigmas

ARM_M2 = 100.0


def ways(rows):
    first, second, distance, translation, rotation = np.array(rows, dtype=float).reshape(-1, 5).T
    return Ways(
        first=first.astype(np.int64), second=second.astype(np.int64), distance_m=distance,
        translation_m2=translation, rotation_rad2=rotation,
    )  # fmt: skip


def naive(count, known, source):
    """Dijkstra with dictionaries: the twin of the kernel."""
    edges = {i: [] for i in range(count)}
    for a, b, *values in zip(
        known.first.tolist(), known.second.tolist(), known.distance_m, known.translation_m2, known.rotation_rad2,
        strict=True,
    ):  # fmt: skip
        edges[a].append((b, *values))
        edges[b].append((a, *values))
    best, open_ = {source: (0.0, 0.0)}, {source}
    done = set()
    while open_:
        here = min(open_, key=lambda i: best[i][0] + ARM_M2 * best[i][1])
        open_.remove(here)
        done.add(here)
        for other, distance, translation, rotation in edges[here]:
            new = (best[here][0] + translation + best[here][1] * distance**2, best[here][1] + rotation)
            old = best.get(other, (np.inf, np.inf))
            if new[0] + ARM_M2 * new[1] < old[0] + ARM_M2 * old[1]:
                best[other] = new
                if other not in done:
                    open_.add(other)
    return np.array([best.get(i, (np.inf, np.inf)) for i in range(count)])


def test_heading_moves_what_lies_ahead_sideways():
    translation, rotation = relative_sigmas(3, ways([(0, 1, 10.0, 0.04, 0.01), (1, 2, 5.0, 0.01, 0.02)]))
    assert rotation[0].tolist() == pytest.approx([0.0, 0.1, np.sqrt(0.03)])
    assert translation[0].tolist() == pytest.approx([0.0, 0.2, np.sqrt(0.05 + 0.01 * 25)])
    assert translation[2, 0] == pytest.approx(np.sqrt(0.05 + 0.02 * 100))  # the other way the long leg comes last


def test_a_closed_loop_is_the_better_way():
    chain = [(i, i + 1, 5.0, 0.01, 1e-4) for i in range(9)]
    without, _ = relative_sigmas(10, ways(chain))
    with_loop, _ = relative_sigmas(10, ways([*chain, (0, 9, 0.5, 0.0025, 1e-4)]))
    assert with_loop[0, 9] == pytest.approx(0.05)
    assert without[0, 9] > 0.3
    assert (with_loop <= without + 1e-12).all()


def test_what_nothing_ties_is_infinite():
    translation, rotation = relative_sigmas(4, ways([(0, 1, 1.0, 0.1, 0.1), (2, 3, 1.0, 0.1, 0.1)]))
    assert np.isinf(translation[0, 2:]).all()
    assert np.isinf(rotation[:2, 2:]).all()
    assert (np.diag(translation) == 0).all()
    alone, _ = relative_sigmas(1, ways([]))
    assert alone.tolist() == [[0.0]]


@pytest.mark.kernels
@pytest.mark.parametrize("seed", range(6))
def test_as_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 25))
    rows = [
        (*rng.integers(0, count, 2), rng.uniform(0, 20), rng.uniform(0, 0.5), rng.uniform(0, 0.01))
        for _ in range(int(rng.integers(1, 60)))
    ]
    known = ways(rows)
    translation, rotation = relative_sigmas(count, known)
    for source in range(count):
        expected = naive(count, known, source)
        np.testing.assert_allclose(translation[source] ** 2, expected[:, 0], rtol=1e-12)
        np.testing.assert_allclose(rotation[source] ** 2, expected[:, 1], rtol=1e-12)
