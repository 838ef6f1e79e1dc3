# SPDX-License-Identifier: MIT
"""Trajectories of different frames laid over each other."""

import numpy as np
import pytest

from slamcli.geometry import se2
from slamcli.pipelines.view_alignment import laid_over
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

POSES = np.column_stack([np.linspace(0, 5, 50), np.sin(np.linspace(0, 6, 50)), np.linspace(0, 1, 50)])
STAMPS = np.arange(50, dtype=np.int64) * 100_000_000
BASE = Trajectory.from_se2(STAMPS, POSES, "map")
MOVED = Trajectory.from_se2(STAMPS, se2.compose([3.0, -2.0, 0.7], POSES), "world")


@pytest.mark.parametrize(
    ("how", "told"), [("fit", "t, fitted"), ("auto", "t, fitted"), ("start", "t, from the same start")]
)
def test_a_rigid_motion_is_undone(how, told):
    name, found = laid_over(BASE, "t", MOVED, how, RunLog())
    assert name == told
    np.testing.assert_allclose(found.poses_se2, POSES, atol=1e-9)
    assert found.frame_id == "map"


def test_none_leaves_it():
    assert laid_over(BASE, "t", MOVED, "none", RunLog()) == ("t", MOVED)


def test_start_begins_at_the_first_common_time():
    later = Trajectory.from_se2(STAMPS[20:], se2.compose([3.0, -2.0, 0.7], POSES[20:]))
    np.testing.assert_allclose(laid_over(BASE, "t", later, "start", RunLog())[1].poses_se2, POSES[20:], atol=1e-9)


def test_what_has_no_common_time_stays_with_a_note():
    log = RunLog()
    other = Trajectory.from_se2(STAMPS + 10**15, POSES)
    assert laid_over(BASE, "t", other, "fit", log) == ("t", other)
    assert log.notes[0].startswith("t is drawn as it is")
