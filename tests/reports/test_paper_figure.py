# SPDX-License-Identifier: MIT
"""Figures for papers: sizes, fonts, vectors, bytes, and what lies where."""

from __future__ import annotations

import io
import re
import zlib

import numpy as np
import pytest
from PIL import Image

from slamcli.grids import OccupancyGrid
from slamcli.reports.paper_figure import PaperOptions, paper_figure
from slamcli.trajectory import Trajectory

_PT_PER_CM = 72 / 2.54


def walk(shift_m=0.0):
    poses = np.column_stack([np.linspace(0.5, 9.5, 50), np.full(50, 2.0 + shift_m), np.zeros(50)])
    return Trajectory.from_se2(np.arange(50) * 10**9, poses)


def hall():
    cells = np.zeros((40, 100), np.int8)
    cells[:, [0, -1]] = cells[[0, -1]] = 100
    cells[10:20, 40:60] = -1
    return OccupancyGrid(cells, 0.1)


@pytest.mark.parametrize("suffix", [".pdf", ".svg", ".png"])
def test_the_same_input_gives_the_same_bytes_without_a_date(suffix):
    made = [paper_figure(suffix, [("a", walk()), ("b", walk(0.5))], grid=hall()) for _ in range(2)]
    assert made[0] == made[1]
    assert not re.search(rb"CreationDate|<dc:date|20\d\d-\d\d-\d\d", made[0])


@pytest.mark.parametrize("width_cm", [8.8, 18.0])
def test_the_page_is_as_wide_as_asked_and_both_axes_have_one_scale(width_cm):
    data = paper_figure(".pdf", [("a", walk())], grid=hall(), options=PaperOptions(width_cm=width_cm))
    left, bottom, right, top = (float(v) for v in re.search(rb"/MediaBox \[([^\]]+)\]", data).group(1).split())
    assert (left, bottom) == (0.0, 0.0)
    assert right / _PT_PER_CM == pytest.approx(width_cm, abs=0.01)
    plot_w = width_cm - 1.2
    assert top / _PT_PER_CM == pytest.approx(plot_w * 0.42 + 1.1, rel=0.05)


def test_fonts_are_embedded_as_truetype_and_lines_are_vectors():
    data = paper_figure(".pdf", [("a", walk())], grid=hall())
    assert b"/FontFile2" in data
    assert b"/Type3" not in data
    streams = [zlib.decompress(part) for part in re.findall(rb"stream\r?\n(x.+?)\r?\nendstream", data, re.DOTALL)]
    assert any(re.search(rb"0 0\.447\d* 0\.698\d* RG", part) for part in streams)
    svg = paper_figure(".svg", [("a", walk())], grid=hall()).decode()
    assert svg.count("<image") == 1
    assert "<text" not in svg
    assert "#0072b2" in svg


def test_the_trajectory_lies_where_it_is_on_the_map():
    picture = np.asarray(
        Image.open(io.BytesIO(paper_figure(".png", [("a", walk())], grid=hall()))).convert("RGB")
    ).astype(int)
    assert picture.shape[1] == pytest.approx(8.8 / 2.54 * 300, abs=2)
    line = np.argwhere(np.abs(picture - (0, 114, 178)).max(axis=2) < 40)
    dark = np.argwhere(picture.max(axis=2) < 40)
    plot = dark[(dark[:, 1] > 130)]
    middle = (plot[:, 0].min() + np.percentile(plot[:, 0], 90)) / 2
    assert np.ptp(line[:, 0]) < 15
    assert abs(line[:, 0].mean() - middle) < 0.25 * np.ptp(plot[:, 0])
    assert (picture == (238, 240, 243)).all(axis=2).any()


def test_truth_is_green_and_dashed_and_a_legend_names_all():
    truth = ("ground truth", walk(0.2))
    svg = paper_figure(".svg", [("ours", walk())], truth=truth, options=PaperOptions(title="A hall")).decode()
    assert "#009e73" in svg
    assert "stroke-dasharray" in svg
    assert "<!-- ground truth -->" in svg
    assert "<!-- A hall -->" in svg


def test_a_tall_map_is_no_taller_than_a_page():
    cells = np.zeros((2000, 20), np.int8)
    data = paper_figure(".pdf", [], grid=OccupancyGrid(cells, 0.1))
    box = [float(v) for v in re.search(rb"/MediaBox \[([^\]]+)\]", data).group(1).split()]
    assert box[3] / _PT_PER_CM == pytest.approx(23.0, abs=0.1)
