# SPDX-License-Identifier: MIT
"""What is wrong with an IMU is said, and what can be used of it is."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.cartographer.attitude import Attitude, attitude_of
from slamcli.mapper import Setup
from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog

START, HZ, G = 1_700_000_000_000_000_000, 100, 9.80665
NUM = 10 * HZ
QUERY = np.array([START, START + 9_000_000_000], dtype=np.int64)
TURN = np.outer(np.full(NUM, 0.3), [0.0, 0.0, 1.0])
FORCE = np.outer(np.full(NUM, G), [0.0, 0.0, 1.0])


def attitude(rates: np.ndarray, forces: np.ndarray, mount: np.ndarray | None = None) -> tuple[Attitude | None, RunLog]:
    log = RunLog()
    setup = Setup(T_base_laser={}, T_base_sensor={} if mount is None else {"/imu": mount}, log=log)
    samples = [
        ImuSample(stamp_ns=START + k * 10**9 // HZ, frame_id="imu", angular_rad_s=w, acceleration_m_s2=f, topic="/imu")
        for k, (w, f) in enumerate(zip(rates, forces, strict=True))
    ]
    return attitude_of(samples, setup, 10.0), log


def turned(found: Attitude | None) -> float:
    assert found is not None
    first, last = found.yaws(QUERY)
    return float(last - first)


def test_a_sound_imu_on_its_side():
    # The IMU's y axis points up.
    mount = np.eye(4)
    mount[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    found, log = attitude(TURN @ mount[:3, :3], FORCE @ mount[:3, :3], mount)
    assert turned(found) == pytest.approx(2.7, abs=1e-6)
    assert not log.warnings


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 0.6, 0.8)])
def test_a_wrong_mount_turns_about_gravity_even_so(up: tuple[float, float, float]):
    found, log = attitude(np.outer(np.full(NUM, 0.3), up), np.outer(np.full(NUM, G), up))
    assert turned(found) == pytest.approx(2.7, abs=1e-6)
    assert found is not None
    np.testing.assert_allclose(found.tilt(int(QUERY[1])), [0, 0, 0, 1], atol=1e-6)
    angle = round(np.degrees(np.arccos(up[2])))
    assert f"gravity is {angle}° from the vertical" in log.warnings[0]


@pytest.mark.parametrize(
    ("scale", "has_gravity", "warning"),
    [(1.0 / G, True, "multiples of gravity"), (0.0, False, "not gravity"), (5.0, False, "not gravity")],
)
def test_forces_in_other_units_or_without_gravity(scale: float, has_gravity: bool, warning: str):
    found, log = attitude(TURN, FORCE * scale)
    assert turned(found) == pytest.approx(2.7, abs=1e-6)
    assert found is not None
    assert found.has_gravity == has_gravity
    assert [warning in told for told in log.warnings] == [True]


def test_samples_that_cannot_be_used():
    rates = TURN.copy()
    rates[5] = np.nan
    found, log = attitude(rates, FORCE)
    assert turned(found) == pytest.approx(2.7, abs=1e-6)
    assert log.warnings == ["1 of 1000 IMU samples are not finite: they are left out"]
    found, log = attitude(TURN * 200, FORCE)
    assert found is None
    assert "degrees per second" in log.warnings[0]
    assert attitude(TURN[:1], FORCE[:1])[0] is None
