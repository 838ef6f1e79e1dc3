# SPDX-License-Identifier: MIT
"""Where a frame has what colour."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.reports.figures.map import UNKNOWN_COLOUR
from slamcli.reports.figures.plane import View
from slamcli.reports.film_painter import TRANSPARENT, FilmPainter, palette
from slamcli.reports.snapshot import CostPatch, Snapshot

VIEW = View(0.0, 0.0, 0.05, 200, 160)  # 10 m by 8 m
NONE = np.zeros((0, 2))
HEADER = 30


def grid() -> OccupancyGrid:
    cells = np.zeros((160, 200), dtype=np.int8)
    cells[:, 0] = 100
    cells[:, 150:] = -1
    return OccupancyGrid(cells, 0.05)


def snapshot(**changes) -> Snapshot:
    values = dict(
        time_s=3.0, pose=np.array([2.0, 3.0, 0.0]), speed=np.array([0.3, 0.0, 0.4]), estimate=None, scan_m=NONE, particles_m=NONE,
        patch=None, plan_m=NONE, local_plan_m=NONE, people=np.zeros((0, 5)), goal=None, state="controlling", map_number=0,
    )  # fmt: skip
    return Snapshot(**{**values, **changes})


def paint(shot: Snapshot, grids=None) -> np.ndarray:
    square = 0.3 * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    trail = np.array([[0.0, 1.0, 1.0], [2.0, 1.0, 2.0], [9.0, 1.0, 7.0]])
    return FilmPainter([grid()] if grids is None else grids, VIEW, square, trail).paint(shot)


def colour(frame, x, y):
    """Return the colour of the pixel at x, y metres."""
    return tuple(palette()[frame[HEADER + 160 - 1 - int(y / 0.05), int(x / 0.05)]].tolist())


def test_map_robot_and_trail_lie_where_they_are():
    frame = paint(snapshot())
    assert frame.shape == (214, 200)  # the view, 30 rows above it and 24 below
    assert colour(frame, 5.0, 5.0) == (255, 255, 255)
    assert colour(frame, 0.02, 5.0) == (24, 24, 24)
    assert colour(frame, 9.0, 5.0) == UNKNOWN_COLOUR
    assert colour(frame, 2.0, 3.2) == (64, 72, 84)  # the body, beside its nose
    assert (0, 158, 115) in {colour(frame, x, 1.5) for x in (0.96, 1.0)}  # two pixels wide, on the edge of one
    assert colour(frame, 1.0, 5.0) == (255, 255, 255)  # not driven yet
    assert not (frame == TRANSPARENT).any()


def test_without_a_map_everything_is_unknown():
    assert colour(paint(snapshot(map_number=-1), grids=[]), 5.0, 5.0) == UNKNOWN_COLOUR


def test_a_turned_costmap_tints_what_is_free_and_nothing_else():
    costs = np.zeros((40, 40), dtype=np.uint8)
    costs[:, 20:] = 200
    costs[39, 39] = 254
    patch = CostPatch(costs=costs, T_map_corner=np.array([8.0, 2.0, np.pi / 2]), resolution_m=0.05)
    frame = paint(snapshot(patch=patch))
    # Columns of the patch run upwards in the map: its far half is y from 3 to 4, over x from 6 to 8.
    assert colour(frame, 7.0, 3.5) not in {(255, 255, 255), UNKNOWN_COLOUR}
    assert colour(frame, 7.0, 2.5) == (255, 255, 255)
    assert colour(frame, 7.9, 3.5) == colour(frame, 7.0, 3.5)  # over the unknown too
    assert colour(frame, 6.02, 3.97) == (176, 84, 150)


def test_a_costmap_outside_of_the_view_is_left_out():
    far = CostPatch(costs=np.full((4, 4), 200, np.uint8), T_map_corner=np.array([50.0, 2.0, 0.3]), resolution_m=0.05)
    np.testing.assert_array_equal(paint(snapshot(patch=far)), paint(snapshot()))


def test_points_lines_people_and_goal():
    frame = paint(
        snapshot(
            scan_m=np.array([[5.0, 6.0], [np.nan, 0.0], [99.0, 99.0]]),
            particles_m=np.array([[6.0, 6.0]]),
            plan_m=np.array([[3.0, 1.0], [6.0, 1.0]]),
            local_plan_m=np.array([[3.0, 2.0], [4.0, 2.0]]),
            people=np.array([[4.0, 5.0, 0.3, 0.0, -1.0]]),
            goal=np.array([6.0, 4.0, 0.0]),
            estimate=np.array([2.5, 3.0, 0.0]),
        )
    )
    pens = palette()
    assert colour(frame, 5.0, 6.0) == tuple(pens[43])
    assert colour(frame, 6.01, 5.99) == tuple(pens[44])
    assert colour(frame, 4.5, 1.0) == tuple(pens[41])
    assert colour(frame, 3.5, 2.0) == tuple(pens[42])
    assert colour(frame, 4.0, 5.2) == tuple(pens[45])
    assert colour(frame, 4.0, 4.3) == tuple(pens[46])
    assert colour(frame, 6.3, 4.0) == tuple(pens[50])
    assert colour(frame, 2.8, 2.8) == tuple(pens[49])


@pytest.mark.parametrize("state", ["", "aborted: " + "a long reason " * 40])
def test_the_header_takes_any_words(state):
    frame = paint(snapshot(state=state))
    assert frame[:28].max() <= 15
    assert frame[:28].any()


def test_below_the_map_stands_what_colours_mean_as_far_as_there_is_room():
    frame = paint(snapshot())
    assert {40, 41} <= set(np.unique(frame[-23:]).tolist())  # driven and plan
    assert 50 not in frame[-23:]  # the goal finds no room on 200 pixels
    wide = FilmPainter([grid()], View(0.0, 0.0, 0.05, 720, 160), np.zeros((4, 2)), np.zeros((1, 3))).paint(snapshot())
    assert {40, 41, 42, 43, 44, 45, 49, 50} <= set(np.unique(wide[-23:]).tolist())
