# SPDX-License-Identifier: MIT
"""Steps of odometry that no robot makes."""

from __future__ import annotations

import numpy as np

from slamcli.runtime import RunLog
from slamcli.trajectory.odometry_jumps import without_jumps

STAMPS = np.arange(6) * 100_000_000


def test_a_reset_is_taken_out() -> None:
    poses = np.column_stack([np.arange(6) * 0.1, np.zeros(6), np.zeros(6)])
    jumped = poses.copy()
    jumped[3:, 0] += 40.0
    log = RunLog()
    mended = without_jumps(STAMPS, jumped, log)
    expected = poses.copy()
    expected[3:, 0] -= 0.1  # what it moved during the reset is not known
    np.testing.assert_allclose(mended, expected, atol=1e-12)
    assert log.counts["jumps of the odometry"] == 1
    assert "first by 40.1 m at 0.300 s" in log.warnings[0]


def test_odometry_without_jumps_comes_back_as_it_is() -> None:
    poses = np.column_stack([np.arange(6) * 0.1, np.zeros(6), np.linspace(0.0, 1.0, 6)])
    log = RunLog()
    assert without_jumps(STAMPS, poses, log) is poses
    assert not log.warnings
