# SPDX-License-Identifier: MIT
"""Inline SVG charts: well-formed, thinned without losing spikes, drawn where the axes say."""

import re
from xml.etree.ElementTree import XML, tostring

import numpy as np
import pytest

from slamcli.reports import scales, svg


def chart(y, x=None, **more):
    y = np.asarray(y, dtype=float)
    x = np.arange(len(y), dtype=float) if x is None else np.asarray(x, dtype=float)
    return svg.line_chart(
        svg.Chart(title="a <b>", x_label="time in s", y_label="m", series=[svg.Series(label="y & z", x=x, y=y)], **more)
    )


@pytest.mark.parametrize(
    "y",
    [
        [],
        [1.0],
        [np.nan],
        [1, np.nan, 2],
        [5, 5, 5],
        [0, 0],
        [1e300, -1e300],
        [1e-12, 2e-12],
        [np.inf, 1.0, -np.inf],
        range(5000),
    ],
)
def test_any_series_gives_well_formed_svg(y):
    root = XML(chart(y))
    assert root.tag == "svg"
    assert "nan" not in tostring(root, encoding="unicode")
    assert "inf" not in tostring(root, encoding="unicode")


def test_text_is_escaped():
    assert "a &lt;b&gt;" in chart([1, 2])


def test_thinning_keeps_spikes_and_order():
    y = np.zeros(100_000)
    y[70_001], y[123] = 9.0, -4.0
    x, kept = svg.thin(np.arange(100_000.0), y)
    assert len(kept) <= 1200
    assert kept.max() == 9.0
    assert kept.min() == -4.0
    assert (np.diff(x) >= 0).all()


def test_thinning_leaves_short_series_and_gaps_alone():
    y = np.full(5000, np.nan)
    assert np.isnan(svg.thin(np.arange(5000.0), y)[1]).all()
    assert len(svg.thin(np.arange(7.0), np.arange(7.0))[0]) == 7


def test_a_line_lies_where_the_axes_say():
    root = XML(chart([0.0, 10.0], from_zero=True))
    ticks = {
        t.text: float(t.get("x"))
        for t in root.iter("text")
        if t.get("text-anchor") == "middle" and t.get("class") == "tick"
    }
    d = next(p.get("d") for p in root.iter("path") if p.get("class") == "line c0")
    (x0, y0), (x1, y1) = re.findall(r"([\d.]+) ([\d.]+)", d)
    assert float(x0) == pytest.approx(ticks["0"], abs=0.1)
    assert float(x1) == pytest.approx(ticks["1"], abs=0.1)
    assert float(y1) < float(y0)


def test_gaps_begin_a_new_line():
    root = XML(chart([1, 2, np.nan, 3, 4]))
    assert next(p.get("d") for p in root.iter("path") if p.get("class") == "line c0").count("M") == 2


def test_events_are_marked():
    markup = chart([1, 2, 3, 4], marks_x=np.array([1.0, 2.0]), marks_label="resampled")
    assert "resampled" in markup
    assert (
        next(
            p.get("d") for p in XML(markup).iter("path") if p.get("class") == "line mark" and "v7" in p.get("d")
        ).count("v7")
        == 2
    )


def test_plane_has_equal_scales():
    square = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], dtype=float)
    root = XML(svg.plane_chart("square", [("a", square), ("b", square + 1)]))
    d = next(p.get("d") for p in root.iter("path") if p.get("class") == "line c2" and p.get("d").count("L") == 3)
    at = np.array(re.findall(r"([\d.]+) ([\d.]+)", d), dtype=float)
    assert np.ptp(at[:, 0]) == pytest.approx(np.ptp(at[:, 1]), rel=0.01)


@pytest.mark.parametrize(
    "points", [np.zeros((0, 2)), np.zeros((1, 2)), np.array([(0.0, 0.0), (50.0, 0.0)]), np.full((3, 2), np.nan)]
)
def test_degenerate_planes(points):
    assert XML(svg.plane_chart("p", [("a", points)])).tag == "svg"


@pytest.mark.parametrize(("low", "high", "count"), [(0, 1, 5), (-3.7, 12.2, 8), (1e6, 1e6 + 1, 5), (0, 1e-9, 4)])
def test_ticks_are_round_and_inside(low, high, count):
    found = scales.ticks(low, high, count)
    assert 2 <= len(found) <= count + 1
    assert low - 1e-9 * (high - low) <= found[0]
    assert found[-1] <= high + 1e-9 * max(1.0, abs(high))
    step = scales.tick_step(high - low, count)
    assert f"{step:e}"[0] in "125"


@pytest.mark.parametrize(
    ("seconds", "told"), [(0.5, "0.5 s"), (75.04, "75 s"), (2691.2, "44 min 51 s"), (90000, "25 h 0 min")]
)
def test_durations(seconds, told):
    assert scales.duration(seconds) == told


def test_a_legend_of_several_rows_leaves_the_chart_its_size():
    series = [
        svg.Series(label=f"a label of some length {i}", x=np.arange(3.0), y=np.arange(3.0), colour=i) for i in range(4)
    ]
    drawn = [
        XML(svg.line_chart(svg.Chart(title="t", x_label="x", y_label="y", series=series[:count]))) for count in (2, 4)
    ]
    heights = [int(root.get("viewBox").split()[-1]) for root in drawn]
    assert heights == [220, 236]
    for root, height in zip(drawn, heights, strict=True):
        tops = [float(text.get("y")) for text in root.iter() if text.get("class") == "tick"]
        labels = [
            float(text.get("y")) for text in root.iter() if text.get("class") == "label" and "length" in text.text
        ]
        assert max(labels) < min(tops)
        assert max(tops) == height - 24
