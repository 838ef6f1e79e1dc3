# SPDX-License-Identifier: MIT
"""The offset of an IMU's clock: found within its deviation, not made up where turning is steady."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_worlds import NOISE, camera_ride

from slamcli.posegraph.imu_clock import clock_offset


@pytest.mark.parametrize("ahead_ms", [-41, -12, 0, 7, 33])
def test_offsets_are_found(ahead_ms):
    poses, samples, _, _ = camera_ride(8.0, 3)
    shifted = replace(samples, stamps_ns=samples.stamps_ns + ahead_ms * 1_000_000)
    found = clock_offset(poses, shifted, NOISE)
    assert found.sigma_s < 2e-3
    assert abs(found.seconds - ahead_ms * 1e-3) < max(4 * found.sigma_s, 1e-3)
    assert (found.gain > 0.3) == (abs(ahead_ms) > 10)


def test_none_is_surely_found_at_rest():
    poses, samples, _, _ = camera_ride(8.0, 3, still=True)
    found = clock_offset(poses, samples, NOISE)
    assert not abs(found.seconds) > 5 * found.sigma_s


def test_offsets_beyond_reach_are_unknown():
    poses, samples, _, _ = camera_ride(8.0, 3)
    found = clock_offset(poses, replace(samples, stamps_ns=samples.stamps_ns + 150_000_000), NOISE)
    assert np.isinf(found.sigma_s)
