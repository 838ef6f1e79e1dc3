# SPDX-License-Identifier: MIT
"""Stamps of scans and odometry: good clocks are believed, clocks that run backwards give way to the recorded order."""

from __future__ import annotations

import numpy as np

from slamcli.trajectory.clocks import align_clocks

EPOCH = 1_700_000_000_000_000_000
MS = 1_000_000


def test_good_clocks_are_believed():
    scans, wheels = EPOCH + np.arange(5) * 100 * MS, EPOCH + np.arange(20) * 25 * MS + 7
    poses = np.random.default_rng(0).normal(size=(20, 3))
    stamps, odometry, by_order = align_clocks(scans, wheels, np.zeros(20, np.int64), poses)
    assert not by_order
    np.testing.assert_array_equal(stamps, scans)
    np.testing.assert_array_equal(odometry.stamps_ns, wheels)
    assert odometry.poses is poses


def test_one_step_back_in_two_hundred_is_jitter():
    scans = EPOCH + np.arange(300) * 100 * MS
    scans[150] -= 130 * MS
    wheels = EPOCH + np.arange(10) * MS
    stamps, _, by_order = align_clocks(scans, wheels, np.zeros(10, np.int64), np.zeros((10, 3)))
    assert not by_order
    assert (np.diff(stamps) > 0).all()
    assert np.flatnonzero(stamps != scans).tolist() == [149, 150]


def test_bad_clocks_give_way_to_the_recorded_order():
    """Two messages of odometry were recorded before each scan, whatever their stamps say."""
    rng = np.random.default_rng(1)
    places = np.repeat(np.arange(30), 2)
    scans = EPOCH + np.arange(30) * 100 * MS + rng.integers(-90, 90, 30) * MS
    wheels = EPOCH + np.arange(60) * 50 * MS + rng.integers(-90, 90, 60) * MS + 10**12  # and a clock of its own
    poses = rng.normal(size=(60, 3))
    stamps, odometry, by_order = align_clocks(scans, wheels, places, poses)
    assert by_order
    assert odometry.poses is poses
    for k in range(30):
        before = odometry.stamps_ns[2 * k : 2 * k + 2]
        assert (before < stamps[k]).all()
        assert k == 0 or (before > stamps[k - 1]).all()


def test_a_single_scan():
    stamps, odometry, by_order = align_clocks(
        np.array([EPOCH]), np.array([EPOCH - 5, EPOCH + 5]), np.array([0, 1]), np.zeros((2, 3))
    )
    assert not by_order
    assert stamps.tolist() == [EPOCH]
    assert odometry.stamps_ns.tolist() == [EPOCH - 5, EPOCH + 5]
