# SPDX-License-Identifier: MIT
"""Strokes, marks and text on pixels."""

import numpy as np
import pytest

from slamcli.reports.figures import raster


@pytest.fixture
def white():
    return np.full((60, 80, 3), 255, dtype=np.uint8)


def test_stroke_has_its_width_and_colour(white):
    raster.stroke(white, [(10, 30), (70, 30)], (200, 0, 0), 4.0)
    column = white[:, 40]
    assert (255.0 - column[:, 1]).sum() / 255 == pytest.approx(4, rel=0.02)
    assert tuple(column[30]) == (200, 0, 0)
    assert (column[:, 1] < 128).sum() == 4


def test_stroke_does_not_darken_where_it_crosses_itself(white):
    raster.stroke(white, [(10, 30), (70, 30), (40, 30), (40, 5), (40, 55)], (0, 0, 0), 6.0, opacity=0.5)
    assert white.min() == 128


def test_later_parts_lie_on_top(white):
    points = [(10, 30), (70, 30), (70, 31), (10, 31)]
    raster.stroke(white, points, [(255, 0, 0), (255, 0, 0), (0, 0, 255), (0, 0, 255)], 4.0)
    assert tuple(white[30, 30]) == (0, 0, 255)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), [(-500, -500)], [(-1e6, 30), (1e6, 30)], [(0, 0), (80, 60)]])
def test_what_lies_outside_is_left_out(white, points):
    raster.stroke(white, points, (0, 0, 0), 3.0)
    assert white.shape == (60, 80, 3)


@pytest.mark.parametrize("radius", [3.0, 11.9, 12.1, 25.0])
def test_disc_area(white, radius):
    raster.disc(white, (40.0, 30.0), radius, (0, 0, 0))
    assert (255 - white[..., 0].astype(float)).sum() / 255 == pytest.approx(np.pi * radius**2, rel=0.02)


@pytest.mark.parametrize("width", [1e3, 1e9])
def test_a_stroke_wider_than_the_image_fills_it(white, width):
    raster.stroke(white, [(0, 0), (80, 60)], (1, 2, 3), width)
    assert (white == (1, 2, 3)).all()


def test_large_and_small_discs_meet(white):
    other = white.copy()
    raster.stroke(white, [(10, 10), (70, 50)], (0, 0, 0), 23.9)
    raster.stroke(other, [(10, 10), (70, 50)], (0, 0, 0), 24.1)
    assert np.abs(white.astype(int) - other).mean() < 3


@pytest.mark.parametrize("at", [(0, 0), (75, 55), (-20, -5), (500, 500)])
def test_text_is_clipped(white, at):
    raster.text(white, at, "wall", 14, (0, 0, 0))
    assert white.shape == (60, 80, 3)


def test_text_anchors(white):
    raster.text(white, (40, 30), "x", 20, (0, 0, 0), "mm")
    rows, columns = np.nonzero(white[..., 0] < 128)
    assert columns.mean() == pytest.approx(40, abs=1.5)
    assert rows.mean() == pytest.approx(31, abs=4)
    assert raster.text_width("", 12) == 0


def test_png_round_trip(white):
    import io

    from PIL import Image

    white[3, 5] = (1, 2, 3)
    assert (np.asarray(Image.open(io.BytesIO(raster.png(white)))) == white).all()
