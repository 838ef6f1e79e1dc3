# SPDX-License-Identifier: MIT
"""What a map says to the beams of a scan, against a naive twin and in a room."""

import math

import numpy as np
import pytest
from naive_tiles import NaiveView

from slamcli.grids.tiles import TiledMaps
from slamcli.registration.agreement import BeamAgreement, compare_beams

START = np.array([0.1, 0.0])
ANGLES = np.linspace(-math.pi, math.pi, 181)[:-1]


def square(side, angles=ANGLES):
    """Ends of beams from the origin on the walls of a square of half side `side`."""
    reach = side / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    return np.column_stack([reach * np.cos(angles), reach * np.sin(angles)])


@pytest.fixture
def room():
    """A room of 4 x 4 m, seen three times from its middle; cells of 5 cm."""
    maps = TiledMaps(1, 0.05, (-3.0, -3.0, 3.0, 3.0))
    ends = square(2.02)
    for _ in range(3):
        maps.add_scan(np.zeros((1, 3)), np.zeros_like(ends), ends, np.ones(len(ends), bool))
    return maps


def naive(maps, points, start, pose, fullness):
    """Return the four counts, beam by beam and cell by cell."""
    view = NaiveView(maps)
    counts = [0, 0, 0, 0]

    def counted(i, j):
        return maps.cells[view.table[i // 32, j // 32], i % 32, j % 32, :2] if view.inside(i, j) else None

    def full(i, j):
        return view.inside(i, j) and counted(i, j)[1] > fullness * counted(i, j)[0]

    def full_around(i, j, window):
        span = range(-window, window + 1)
        return any(full(i + a, j + b) for a in span for b in span)

    origin = view.place(start[None], pose)[0] / maps.delta
    for end in view.place(points, pose) / maps.delta:
        j, i = (math.floor(value) for value in end)
        kind = 2
        if view.inside(i, j):
            if full_around(i, j, 1):
                kind = 0
            elif counted(i, j)[0] >= 2 and not full_around(i, j, 2):
                kind = 1
        counts[kind] += 1
        length = math.hypot(*(end - origin))
        passed = (origin + (end - origin) * q / length for q in range(5, math.floor(length) - 5))
        cells = [counted(math.floor(y), math.floor(x)) for x, y in passed]
        counts[3] += any(cell is not None and cell[1] >= 2 and cell[1] > 0.5 * cell[0] for cell in cells)
    return BeamAgreement(*counts)


@pytest.mark.kernels
@pytest.mark.parametrize("fullness", [0.1, 0.6])
def test_the_kernel_agrees_with_its_twin(room, fullness):
    rng = np.random.default_rng(7)
    points = square(2.02, rng.uniform(-3, 3, 150)) * rng.choice([0.5, 1.0, 1.02, 1.7, 4.0], 150)[:, None]
    for pose in np.array([[0.0, 0.0, 0.0], [0.31, -0.2, 0.7], [1.4, 1.5, -2.0], [2.6, -2.5, 3.0]]):
        found = compare_beams(room, points, START, pose, fullness=fullness)
        assert found == naive(room, points, START, pose, fullness)
        assert found.num_beams == 150
    assert found.unknown > 0


def test_the_room_confirms_its_own_scan(room):
    found = compare_beams(room, square(2.02), np.zeros(2), np.zeros(3))
    assert (found.share_on_surface, found.share_contradicting, found.share_through) == (1.0, 0.0, 0.0)


def test_a_smaller_room_ends_in_free_space(room):
    found = compare_beams(room, square(1.0), np.zeros(2), np.zeros(3))
    assert found.share_contradicting == 1.0
    assert found.through == 0


def test_a_larger_room_is_seen_through_the_walls(room):
    found = compare_beams(room, square(2.8), np.zeros(2), np.zeros(3))
    assert found.share_through > 0.9
    assert found.on_surface == 0


def test_counts_add_up():
    added = BeamAgreement(1, 2, 3, 4) + BeamAgreement(10, 20, 30, 40)
    assert added == BeamAgreement(11, 22, 33, 44)
    assert added.share_contradicting == pytest.approx(22 / 33)
    assert BeamAgreement(0, 0, 0, 0).share_on_surface == 0.0
