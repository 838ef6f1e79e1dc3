# SPDX-License-Identifier: MIT
"""Statistics per frame: columns, the share of time without poses, and what is said of gaps."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.orbslam3.statistics import step_columns, tell_gaps, untracked_share
from slamcli.runtime import RunLog

STAMPS = [10_000_000_000 + 100_000_000 * i for i in range(10)]


def columns(tracked):
    return step_columns(STAMPS, tracked, {i: (50 + i, 1 + i // 4, 200) for i in tracked})


def test_columns_have_a_row_for_every_frame():
    steps = columns([0, 1, 2, 5, 9])
    assert steps["tracked"].tolist() == [1, 1, 1, 0, 0, 1, 0, 0, 0, 1]
    assert steps["points_held"].tolist() == [50, 51, 52, 0, 0, 55, 0, 0, 0, 59]
    assert steps["keyframes"][9] == 3
    assert {len(values) for values in steps.values()} == {10}


def test_gaps_are_told_once_with_the_first_and_the_longest():
    log = RunLog()
    steps = columns([0, 1, 2, 5, 9])
    tell_gaps(steps, 2, log)
    assert log.warnings == [
        (
            "5 of 10 frames (50 %) have no pose: the first 0.30 s after the recording's first frame, the longest gap 0.30 s from 0.60 s on; "
            "2 of them were tracked in other maps, which show no place of this one (see atlas.npz)"
        )
    ]
    assert untracked_share(steps) == pytest.approx(0.5)


def test_nothing_is_said_of_a_whole_track():
    log = RunLog()
    steps = columns(list(range(10)))
    tell_gaps(steps, 0, log)
    assert log.warnings == []
    assert untracked_share(steps) == 0.0


def test_the_share_counts_time_and_not_frames():
    steps = step_columns([0, 100, 200, 1000, 1100], [0, 1, 3, 4], {})
    assert untracked_share(steps) == pytest.approx(800 / 1200)
    assert untracked_share(step_columns([5], [], {})) == 1.0
    assert untracked_share(step_columns([5, 5], [0], {})) == 0.5
    assert np.all(step_columns([5], [], {})["keyframes"] == 0)
