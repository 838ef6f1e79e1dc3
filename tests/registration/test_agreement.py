# SPDX-License-Identifier: MIT
"""Beams that a map confirms or contradicts, against a naive twin of the kernel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.grids.tiles import TiledMaps
from slamcli.registration.agreement import BeamAgreement, compare_beams

CELL = 0.05


def counts_of(maps: TiledMaps) -> dict[tuple[int, int], tuple[float, float]]:
    """Visits and hits of all cells that were visited, by row and column from the map's corner."""
    cells = {}
    for i, j in zip(*np.nonzero(maps.tables[0]), strict=True):
        tile = maps.cells[maps.tables[0][i, j]]
        for r, c in zip(*np.nonzero(tile[..., 0]), strict=True):
            cells[int(i) * 32 + int(r), int(j) * 32 + int(c)] = (float(tile[r, c, 0]), float(tile[r, c, 1]))
    return cells


def naive_compare(maps: TiledMaps, points: np.ndarray, start: np.ndarray, pose: np.ndarray) -> BeamAgreement:
    """The kernel's twin, cell by cell in a dictionary."""
    cells, corner = counts_of(maps), np.array(maps.origin)

    def full(i: int, j: int) -> bool:
        visits, hits = cells.get((i, j), (0.0, 0.0))
        return hits > np.float32(0.1) * np.float32(visits) and hits > 0

    def near(i: int, j: int, window: int) -> bool:
        return any(full(a, b) for a in range(i - window, i + window + 1) for b in range(j - window, j + window + 1))

    turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
    counts = [0, 0, 0, 0]
    s = (turn @ start + pose[:2] - corner) / CELL
    for point in points:
        e = (turn @ point + pose[:2] - corner) / CELL
        i, j = math.floor(e[1]), math.floor(e[0])
        if near(i, j, 1):
            counts[0] += 1
        elif cells.get((i, j), (0.0, 0.0))[0] >= 2 and not near(i, j, 2):
            counts[1] += 1
        else:
            counts[2] += 1
        length = float(np.linalg.norm(e - s))
        for q in range(5, math.floor(length) - 5):
            x, y = s + (e - s) * q / length
            visits, hits = cells.get((math.floor(y), math.floor(x)), (0.0, 0.0))
            if hits >= 2 and hits > 0.5 * visits:
                counts[3] += 1
                break
    return BeamAgreement(*counts)


def walled_map() -> TiledMaps:
    """A wall at x = 2 seen three times from the origin."""
    maps = TiledMaps(1, CELL, (-1.0, -1.0, 1.0, 1.0))
    y = np.linspace(-1.5, 1.5, 61)
    ends = np.column_stack([np.full(61, 2.02), y])
    for _ in range(3):
        maps.add_scan(np.zeros((1, 3)), np.zeros((1, 2)), ends, np.ones(61, np.bool_))
    return maps


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.1), (-0.7, 0.1, 1.4), (30.0, 0.0, 0.0)])
def test_the_kernel_counts_as_its_naive_twin_does(pose: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-1.0, 4.0, 80), rng.uniform(-2.0, 2.0, 80)])
    start = np.array([0.1, -0.05])
    found = compare_beams(walled_map(), points, start, np.array(pose))
    assert found == naive_compare(walled_map(), points, start, np.array(pose))
    assert found.num_beams == 80


def test_beams_on_before_and_behind_a_wall() -> None:
    maps = walled_map()
    on = compare_beams(maps, np.array([[2.02, 0.0], [2.02, 0.5]]), np.zeros(2), np.zeros(3))
    assert (on.on_surface, on.in_free, on.unknown, on.through) == (2, 0, 0, 0)
    before = compare_beams(maps, np.array([[1.0, 0.0]]), np.zeros(2), np.zeros(3))
    assert (before.in_free, before.share_contradicting) == (1, 1.0)
    behind = compare_beams(maps, np.array([[3.5, 0.0]]), np.zeros(2), np.zeros(3))
    assert (behind.unknown, behind.through, behind.share_through) == (1, 1, 1.0)


def test_no_beams_agree_with_nothing() -> None:
    none = compare_beams(walled_map(), np.zeros((0, 2)), np.zeros(2), np.zeros(3))
    assert (none.num_beams, none.share_on_surface, none.share_contradicting, none.share_through) == (0, 0.0, 0.0, 0.0)
    assert none + BeamAgreement(1, 2, 3, 4) == BeamAgreement(1, 2, 3, 4)
