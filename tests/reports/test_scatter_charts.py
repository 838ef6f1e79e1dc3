# SPDX-License-Identifier: MIT
"""Scatter charts and histograms: every value is drawn once, where the axes say."""

from __future__ import annotations

import re
from xml.etree.ElementTree import XML

import numpy as np
import pytest

from slamcli.reports.scatter import Points, histogram, scatter_chart


def scatter(y, lowest=1e-4):
    y = np.asarray(y, dtype=float)
    return scatter_chart(
        "a <b>", "t", "m", [Points(label="x & y", x=np.arange(len(y), dtype=float), y=y)], lowest=lowest
    )


@pytest.mark.parametrize("y", [[], [1.0], [np.nan], [0.0, 1.0], [5, 5], [1e-9, 1e9]])
def test_any_points_give_well_formed_svg(y):
    markup = scatter(y)
    XML(markup)
    assert "nan" not in markup
    assert "a &lt;b&gt;" in markup


def test_decades_lie_equally_far_apart():
    heights = [float(y) for y in re.findall(r"M[\d.]+ ([\d.]+)h0", scatter([0.01, 0.1, 1.0, 0.0], lowest=1e-3))]
    np.testing.assert_allclose(np.diff(sorted(heights)), np.diff(sorted(heights))[0], atol=0.6)
    assert len(heights) == 4
    assert [label for label in ("0.001", "0.01", "0.1", "1") if f">{label}</text>" not in scatter([0.001, 1.0])] == []


def test_narrow_ranges_have_ticks_between_decades():
    assert {"0.2", "0.5"} <= set(re.findall(r">([\d.]+)</text>", scatter([0.11, 0.9])))


def test_bars_are_as_high_as_there_are_values():
    a, b = np.array([0.2, 0.2, 0.2, 0.8]), np.array([0.2, np.nan])
    markup = histogram("h", "score", [("a", a), ("b", b)], limit=("least", 0.5), bins=10)
    XML(markup)
    bars = [tuple(map(float, m)) for m in re.findall(r"M[\d.]+ ([\d.]+)V([\d.]+)H", markup)]
    heights = sorted(foot - head for foot, head in bars)
    np.testing.assert_allclose(np.array(heights) / heights[0], [1.0, 1.0, 3.0], atol=0.02)
    assert ">least</text>" in markup
    assert "0.5</text>" in markup
    assert re.search(r">1\.5</text>", markup) is None  # counts are whole


@pytest.mark.parametrize("values", [[], [np.nan], [0.5]])
def test_few_values_are_enough(values):
    markup = histogram("h", "score", [("a", np.asarray(values, dtype=float))])
    XML(markup)
    assert len(re.findall(r"M[\d.]+ [\d.]+V[\d.]+H", markup)) == np.isfinite(values).sum()
