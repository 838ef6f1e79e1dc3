# SPDX-License-Identifier: MIT
"""Pictures of clouds: coloured by height, the nearest point on top, far strays left out."""

from __future__ import annotations

import graph_states
import numpy as np
import pytest
from test_html_report import parse

from slamcli.measurements import PointCloud
from slamcli.reports import scales
from slamcli.reports.figures.cloud import cloud_view, height_range
from slamcli.reports.html import report


@pytest.fixture(scope="module")
def box():
    """A floor at 0 m with a table at 1 m in the middle, 4 x 2 m."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(0, 4, 0.01), np.arange(0, 2, 0.01)))
    table = (np.abs(x - 2) < 0.5) & (np.abs(y - 1) < 0.5)
    floor = np.column_stack([x, y, np.zeros(len(x))])
    return np.concatenate([floor, np.column_stack([x[table], y[table], np.ones(table.sum())])]).astype(np.float32)


def test_heights_are_colours_and_the_higher_covers_the_lower(box):
    picture = cloud_view(box, (0, 1))
    colours, counts = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    found = {tuple(c): n for c, n in zip(colours.tolist(), counts.tolist(), strict=True)}
    low, high = (tuple(np.round(c).astype(int).tolist()) for c in scales.time_colours([0.0, 1.0]))
    assert found[low] / found[high] == pytest.approx(7.0, rel=0.1)  # 8 m2 of floor less 1 m2 of table
    assert height_range(box) == (0.0, 1.0)


def test_a_far_stray_does_not_shrink_the_picture(box):
    stray = np.concatenate([box, np.array([[5000.0, 0, 0]], dtype=np.float32)])
    np.testing.assert_array_equal(cloud_view(stray, (0, 1)), cloud_view(box, (0, 1)))


def test_the_page_shows_both_views_and_the_height(box):
    cloud = PointCloud(stamp_ns=0, frame_id="map", points_m=box)
    trajectory = graph_states.trajectory()
    markup = report({}, cloud=cloud, trajectory=trajectory)
    assert f"{len(box):,} points;" in markup
    told = parse(markup).text
    assert {"From above", "From the side", "Height of the robot"} <= set(told)
    assert markup == report({}, cloud=cloud, trajectory=trajectory)
    nothing = PointCloud(stamp_ns=0, frame_id="map", points_m=np.zeros((0, 3), dtype=np.float32))
    assert "From above" not in report({}, cloud=nothing)
