# SPDX-License-Identifier: MIT
"""Any-angle lengths against brute force: a visibility graph over all corners with an independent test of lines."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
import pytest

from slamcli.navigation import _shortest_kernels as kernels
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.shortest_path import ShortestField, shortest_length

pytestmark = pytest.mark.kernels


def window_of(blocked: np.ndarray, resolution: float = 1.0) -> CostWindow:
    return CostWindow(
        costs=np.where(blocked, 253, 7).astype(np.uint8),
        origin_m=(0.0, 0.0),
        resolution_m=resolution,
        frame="map",
        footprint=np.zeros((3, 2)),
        inscribed_radius_m=0.1,
        circumscribed_radius_m=0.1,
    )


def brute_visible(blocked: np.ndarray, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Fine pieces between all crossings of grid lines: the middle of each lies in a free cell, or beside one on an edge."""
    (x0, y0), (x1, y1) = a, b
    cuts = {0.0, 1.0}
    for p, q in ((x0, x1), (y0, y1)):
        if abs(q - p) > 1e-12:
            cuts |= {(k - p) / (q - p) for k in range(math.floor(min(p, q)), math.ceil(max(p, q)) + 1)}
    ts = sorted(t for t in cuts if -1e-12 <= t <= 1 + 1e-12)

    def solid(x: float, y: float) -> bool:
        row, column = math.floor(y), math.floor(x)
        return not (0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]) or bool(blocked[row, column])

    for t0, t1 in itertools.pairwise(ts):
        if t1 - t0 < 1e-9:
            continue
        t = (t0 + t1) / 2
        x, y = x0 + t * (x1 - x0), y0 + t * (y1 - y0)
        sides = [(x + dx, y + dy) for dx in (-1e-6, 1e-6) for dy in (-1e-6, 1e-6)]
        if all(solid(*side) for side in sides):
            return False
    for t in ts[1:-1]:
        x, y = x0 + t * (x1 - x0), y0 + t * (y1 - y0)
        if abs(x - round(x)) < 1e-9 and abs(y - round(y)) < 1e-9 and abs(x1 - x0) > 1e-9 and abs(y1 - y0) > 1e-9:
            flip = (x1 - x0) * (y1 - y0) > 0
            pair = ((0.1, -0.1), (-0.1, 0.1)) if flip else ((0.1, 0.1), (-0.1, -0.1))
            if all(solid(x + dx, y + dy) for dx, dy in pair):
                return False
    return True


def brute_length(blocked: np.ndarray, start: tuple[float, float], goal: tuple[float, float]) -> float:
    """Dijkstra over start, goal and the corners where shortest paths may turn; all lines of sight."""
    free = np.pad(~blocked, 1)
    width, flat = free.shape[1], free.reshape(-1)
    a, b, c, d = free[:-1, :-1], free[:-1, 1:], free[1:, :-1], free[1:, 1:]
    turns = np.argwhere((a.astype(int) + b + c + d == 3) | ((a & d) ^ (b & c)))
    nodes = [start, goal, *((float(x), float(y)) for y, x in turns)]
    best = {0: 0.0}
    queue = [(0.0, 0)]
    closed = set()
    while queue:
        cost, i = heapq.heappop(queue)
        if i == 1:
            return cost
        if i in closed:
            continue
        closed.add(i)
        x, y = nodes[i]
        for j, (p, q) in enumerate(nodes):
            onward = cost + math.hypot(p - x, q - y)
            if j in closed or onward >= best.get(j, math.inf) - 1e-12:
                continue
            if kernels.visible(flat, width, x + 1, y + 1, p + 1, q + 1):
                best[j] = onward
                heapq.heappush(queue, (onward, j))
    return math.inf


@pytest.mark.parametrize("seed", range(4))
def test_visible_equals_the_brute_check(seed: int) -> None:
    random = np.random.default_rng(seed)
    blocked = random.random((7, 9)) < 0.2
    free = np.pad(~blocked, 1).reshape(-1)
    for _ in range(300):
        a, b = (tuple(float(v) for v in random.integers([0, 0], [10, 8])) for _ in range(2))
        if seed % 2:
            a = tuple(float(v) for v in random.uniform([0, 0], [9, 7]))
            if blocked[int(a[1]), int(a[0])]:
                continue
        expected = brute_visible(blocked, a, b)
        assert kernels.visible(free, 11, a[0] + 1, a[1] + 1, b[0] + 1, b[1] + 1) == expected, (a, b)


@pytest.mark.parametrize(
    ("share", "radius", "shape", "mean", "most"),
    [(0.25, 0, (9, 11), 0.002, 0.03), (0.02, 2, (40, 44), 1e-4, 1e-3), (0.008, 4, (50, 50), 1e-4, 1e-3)],
)
def test_lengths_are_those_of_visibility_graphs(
    share: float, radius: int, shape: tuple[int, int], mean: float, most: float
) -> None:
    """Exact on inflated maps, a little long in clutter of single cells."""
    excess = []
    for seed in range(7):
        random = np.random.default_rng(seed)
        solid = np.argwhere(random.random(shape) < share)
        rows, columns = np.indices(shape)
        blocked = (np.hypot(rows[..., None] - solid[:, 0], columns[..., None] - solid[:, 1]) <= radius).any(axis=2)
        cells = np.argwhere(~blocked)
        points = cells[random.permutation(len(cells))[:5], ::-1] + random.uniform(0.1, 0.9, (5, 2))
        field = ShortestField(window_of(blocked), points[0])
        for goal in points[1:]:
            expected = brute_length(blocked, tuple(points[0].tolist()), tuple(goal.tolist()))
            length, alone = field.length(goal), shortest_length(window_of(blocked), points[0], goal)
            if math.isinf(expected):
                assert math.isinf(length)
                assert math.isinf(alone)
                continue
            excess += [length / expected - 1.0, alone / expected - 1.0]
    assert len(excess) > 15
    assert min(excess) > -1e-9
    assert max(excess) < most
    assert np.mean(excess) < mean


def test_open_floor_is_straight_and_scales_with_the_resolution() -> None:
    window = window_of(np.zeros((40, 40), dtype=bool), 0.05)
    assert shortest_length(window, (0.11, 0.12), (1.9, 1.33)) == pytest.approx(math.dist((0.11, 0.12), (1.9, 1.33)))
    assert shortest_length(window, (0.11, 0.12), (2.1, 1.33)) == math.inf
    assert shortest_length(window, (0.11, 0.12), (0.11, 0.12)) == 0.0


def test_round_a_wall_the_path_touches_its_corner() -> None:
    blocked = np.zeros((10, 10), dtype=bool)
    blocked[:8, 5] = True
    expected = math.dist((1.5, 1.5), (5, 8)) + 1 + math.dist((6, 8), (8.5, 1.5))
    assert shortest_length(window_of(blocked), (1.5, 1.5), (8.5, 1.5)) == pytest.approx(expected, rel=1e-9)
    field = ShortestField(window_of(blocked), (1.5, 1.5))
    assert field.length((8.5, 1.5)) == pytest.approx(expected, rel=1e-9)
    blocked[8:, 5] = True
    assert shortest_length(window_of(blocked), (1.5, 1.5), (8.5, 1.5)) == math.inf


def test_unknown_cells_and_a_blocked_start() -> None:
    window = window_of(np.zeros((6, 9), dtype=bool))
    window.costs[:, 4] = 255
    assert shortest_length(window, (1.5, 1.5), (7.5, 1.5)) == math.inf
    assert shortest_length(window, (1.5, 1.5), (7.5, 1.5), allow_unknown=True) == pytest.approx(6.0)
    window.costs[:, 4] = 0
    window.costs[1, 1] = 254
    assert shortest_length(window, (1.5, 1.5), (7.5, 1.5)) == pytest.approx(6.0)
    assert shortest_length(window, (7.5, 1.5), (1.5, 1.5)) == math.inf
