# SPDX-License-Identifier: MIT
"""The picture of a drive as text."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.reports.terminal_picture import (
    BEAM,
    COLOURS,
    FLOOR,
    NOSE,
    PERSON,
    ROBOT,
    UNKNOWN,
    WALL,
    TerminalScene,
    draw_terminal,
    picture_lines,
)

WORD = dict(zip(COLOURS, " .#*oRN", strict=True))


def letters(text):
    """Return the dots of a picture as lines of letters, two for each line of text."""
    found = []
    for line in text.split("\n"):
        rows = ["", ""]
        above = below = 0
        for style, character in re.findall(r"(\x1b\[[\d;]*m)|(.)", line):
            if style.startswith("\x1b[38"):
                above, below = (int(v) for v in re.fullmatch(r"\x1b\[38;5;(\d+);48;5;(\d+)m", style).groups())
            elif character:
                assert character in "▀ "
                assert character == "▀" or above == below
                rows[0] += WORD[above]
                rows[1] += WORD[below]
        found += rows
    return found


def scene(**changed):
    cells = np.zeros((8, 10), np.int8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = 100, 100, 100, 100
    given = {
        "grid": OccupancyGrid(cells, 0.2), "pose": np.array([0.7, 0.7, 0.0]), "radius_m": 0.09, "beam_ends": np.zeros((0, 2)),
        "discs": np.zeros((0, 5)),
    }  # fmt: skip
    return TerminalScene(**{**given, **changed})


def test_a_small_room_to_the_letter():
    ends, discs = np.array([[1.9, 0.7], [50.0, 0.7]]), np.array([[1.1, 1.1, 0.09, 0.0, 0.0]])
    text = draw_terminal(scene(beam_ends=ends, discs=discs), 12, 5)
    assert letters(text) == [
        "            ",
        " ########## ",
        " #........# ",
        " #....o...# ",
        " #........# ",
        " #..NNN...* ",
        " #........# ",
        " #........# ",
        " ########## ",
        "            ",
    ]
    assert text == draw_terminal(scene(beam_ends=ends, discs=discs), 12, 5)


def test_the_nose_shows_where_the_robot_heads():
    north = letters(draw_terminal(scene(pose=np.array([0.9, 0.7, np.pi / 2]), radius_m=0.3), 12, 5))
    assert [row[3:9] for row in north[2:8]] == ["..N...", "..N...", ".RNR..", ".RRR..", ".RRR..", "..R..."]
    west = letters(draw_terminal(scene(pose=np.array([0.9, 0.7, np.pi]), radius_m=0.3), 12, 5))
    assert "NNNRR" in west[5]


def test_maps_that_are_turned_are_drawn_where_they_lie():
    turned = OccupancyGrid(np.array([[100, 0, 0, 0]], np.int8), 0.2, (0.4, 0.0, np.pi / 2))
    text = letters(draw_terminal(scene(grid=turned, pose=np.array([9.0, 9.0, 0.0])), 4, 3))
    joined = "\n".join(text)
    assert joined.count("#") >= 1
    assert joined.rindex("#") > joined.rindex(".")  # the wall is its southern end


def test_large_maps_are_shown_around_the_robot_but_not_beyond_their_edge():
    grid = OccupancyGrid(np.zeros((500, 500), np.int8), 0.2)
    for x, column in ((50.0, 10), (0.5, 2), (99.5, 17)):
        rows = letters(draw_terminal(scene(grid=grid, pose=np.array([x, 50.0, np.pi / 2])), 20, 5))
        assert " " not in "".join(rows)
        assert {row.index("N") for row in rows if "N" in row} == {column}


def test_nothing_known_yet():
    assert set("".join(letters(draw_terminal(scene(grid=None), 20, 4)))) == {" ", "R", "N"}


def test_lines_of_text_are_cut_and_filled():
    given = dataclasses.replace(scene(), above=("a" * 30,), below=("b", "c"))
    text = draw_terminal(given, 20, 7).split("\n")
    assert len(text) == 7
    assert text[0] == "a" * 20
    assert text[-2:] == ["b" + " " * 19, "c" + " " * 19]


@pytest.mark.parametrize(("columns", "lines"), [(1, 1), (2, 3), (300, 2), (3, 100)])
def test_any_size_of_terminal(columns, lines):
    text = draw_terminal(dataclasses.replace(scene(), above=("above",), below=("below",)), columns, lines)
    assert len(text.split("\n")) == lines


def test_every_kind_of_dot_has_its_colour():
    kinds = [UNKNOWN, FLOOR, WALL, BEAM, PERSON, ROBOT, NOSE]
    dots = np.array([kinds, kinds], np.uint8)
    assert letters(picture_lines(dots)[0]) == [" .#*oRN", " .#*oRN"]
    assert picture_lines(np.full((2, 3), WALL, np.uint8)) == ["\x1b[38;5;252;48;5;252m   \x1b[0m"]
