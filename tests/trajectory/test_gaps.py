# SPDX-License-Identifier: MIT
"""What is said of frames without a pose."""

from __future__ import annotations

import numpy as np

from slamcli.trajectory.gaps import gap_sentence

STAMPS = 5_000_000_000 + 100_000_000 * np.arange(10)


def test_how_many_the_first_and_the_longest():
    has_pose = np.array([1, 1, 0, 1, 1, 0, 0, 0, 1, 1], dtype=bool)
    assert gap_sentence(STAMPS, has_pose, "scan") == (
        "4 of 10 scans (40 %) have no pose: the first 0.20 s after the recording's first scan, the longest gap 0.30 s from 0.50 s on"
    )


def test_nothing_of_a_whole_track_and_the_end_counts():
    assert gap_sentence(STAMPS, np.ones(10, bool)) == ""
    assert gap_sentence(STAMPS[:1], np.zeros(1, bool)).startswith("1 of 1 frames (1e+02 %)")
    assert "the longest gap 0.20 s from 0.70 s on" in gap_sentence(STAMPS, np.arange(10) < 7)
