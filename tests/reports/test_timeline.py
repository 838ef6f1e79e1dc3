# SPDX-License-Identifier: MIT
"""Topics over time: silence is white, the usual rate is blue."""

import numpy as np
import pytest

from slamcli.reports.figures import timeline


def row(counts):
    return timeline.Row(name="/t", counts=np.asarray(counts, dtype=np.int64), fact="f")


def band(counts):
    """The coloured columns of a single topic."""
    page = timeline.timeline_image([row(counts)], 10.0)
    line = page[timeline._SIZE + timeline._ROW // 2]
    right = 2 * timeline._SIZE + timeline.raster.text_width("f", timeline._SIZE)
    return line[page.shape[1] - right - timeline.BINS : page.shape[1] - right].astype(int)


def test_a_steady_topic_is_blue_all_over():
    assert (band(np.full(timeline.BINS, 5)) == (0, 114, 178)).all()


@pytest.mark.parametrize("counts", [5, 1])
def test_a_pause_is_white(counts):
    steady = np.full(timeline.BINS, counts)
    steady[300:400] = 0
    shown = band(steady)
    assert (shown[310:390] == 255).all()
    assert (shown[:290] == (0, 114, 178)).all()


def test_rounding_of_few_messages_per_column_does_not_flicker():
    counts = np.bincount((np.arange(600) * timeline.BINS / 600).astype(int), minlength=timeline.BINS)
    inner = band(counts)[50:-50]
    assert np.ptp(inner[:, 0]) < 12


def test_rare_messages_are_single_strokes_on_a_pale_band():
    counts = np.zeros(timeline.BINS, dtype=np.int64)
    counts[::10] = 1
    shown = band(counts)
    assert (shown[::10] == (0, 114, 178)).all()
    assert (shown[5] == (222, 232, 241)).all()


def test_silence():
    assert timeline.find_silence(np.zeros(timeline.BINS, dtype=np.int64)).all()
    counts = np.zeros(timeline.BINS, dtype=np.int64)
    counts[[3, 700]] = 1
    assert timeline.find_silence(counts).sum() == timeline.BINS - 2


@pytest.mark.parametrize("number", [0, 1, 100])
def test_any_number_of_topics(number):
    page = timeline.timeline_image([row(np.zeros(timeline.BINS))] * number, 0.0, "title")
    assert page.shape[0] < 1700
    stacked = timeline.stacked(page, np.zeros((10, 2000, 3), dtype=np.uint8))
    assert stacked.shape == (page.shape[0] + 10, 2000, 3)
    assert (stacked[0, page.shape[1] :] == 255).all()
