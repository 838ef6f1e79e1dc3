# SPDX-License-Identifier: MIT
"""The stream of messages: order, stamps, faults of clocks, and that a seed decides everything."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.simulation import Simulation, World, resolve_settings, shapes

ROOM = World("room", shapes.rectangle(np.array([0, 0, 8, 5.0])), start=(2, 2, 0))
START = 1_700_000_000 * 10**9


def simulate(duration=10.0, seed=1, **settings):
    return Simulation(
        ROOM, resolve_settings({k.replace("__", "."): v for k, v in settings.items()}), seed=seed, duration_s=duration
    )


def fingerprint(simulation):
    found = []
    for m in simulation.messages():
        x = m.measurement
        values = getattr(x, "ranges_m", None)
        values = getattr(x, "position_m", None) if values is None else values
        values = x.angular_rad_s if values is None else values
        found.append((m.log_time_ns, m.topic, x.stamp_ns, values.tobytes()))
    return found


def test_topics_counts_and_log_order():
    messages = list(simulate(imu__enabled=True).messages())
    counts = Counter(m.topic for m in messages)
    assert counts == {"/tf_static": 2, "/scan": 100, "/odom": 201, "/tf": 201, "/ground_truth": 501, "/imu": 1001}
    logs = [m.log_time_ns for m in messages]
    assert logs == sorted(logs)
    assert [m.topic for m in messages[:2]] == ["/tf_static"] * 2
    assert all(m.topic == m.measurement.topic for m in messages)
    assert logs[0] == START


def test_frames():
    by_topic = {m.topic: m.measurement for m in simulate().messages()}
    assert (by_topic["/odom"].frame_id, by_topic["/odom"].child_frame_id) == ("odom", "base_link")
    assert (by_topic["/tf"].parent_frame_id, by_topic["/tf"].child_frame_id) == ("odom", "base_link")
    assert (by_topic["/tf_static"].parent_frame_id, by_topic["/tf_static"].child_frame_id) == ("base_link", "laser")
    assert (by_topic["/ground_truth"].frame_id, by_topic["/ground_truth"].child_frame_id) == ("map", "base_link")
    assert by_topic["/scan"].frame_id == "laser"


def test_a_scan_is_logged_when_its_last_beam_is_in():
    scans = [m for m in simulate(laser__sweep=0.08).messages() if m.topic == "/scan"]
    assert {m.log_time_ns - m.measurement.stamp_ns for m in scans} == {80_000_000}


def test_clock_offsets_move_stamps_and_not_what_is_measured():
    plain, shifted = simulate(), simulate(clock__laser_offset=0.1, clock__odometry_offset=-0.02)
    for a, b in zip(plain.messages(), shifted.messages(), strict=True):
        assert a.log_time_ns == b.log_time_ns
        moved = {"/scan": 100_000_000, "/odom": -20_000_000, "/tf": -20_000_000}.get(a.topic, 0)
        assert b.measurement.stamp_ns - a.measurement.stamp_ns == moved
    np.testing.assert_array_equal(plain.truth().positions_m, shifted.truth().positions_m)
    np.testing.assert_array_equal(shifted.truth().stamps_ns - plain.truth().stamps_ns, 100_000_000)


def test_jitter_has_its_size_and_truth_carries_the_scans_stamps():
    simulation = simulate(60.0, clock__laser_jitter=0.02)
    stamps = np.array([m.measurement.stamp_ns for m in simulation.messages() if m.topic == "/scan"])
    np.testing.assert_array_equal(stamps, simulation.truth().stamps_ns)
    late = (stamps - START) / 1e9 - simulation.scan_times_s
    assert late.std() == pytest.approx(0.02, rel=0.1)


def test_truth_topic_and_truth_trajectory_agree():
    simulation = simulate()
    at = {m.measurement.stamp_ns: m.measurement.pose_se2 for m in simulation.messages() if m.topic == "/ground_truth"}
    truth = simulation.truth()
    for stamp, pose in zip(truth.stamps_ns.tolist(), truth.poses_se2, strict=True):
        np.testing.assert_allclose(at[stamp], pose, atol=1e-12)


def test_the_same_seed_gives_the_same_messages_and_another_seed_others():
    settings = {"people__count": 2, "imu__enabled": True, "slip__count": 1, "clock__laser_jitter": 0.01}
    first = simulate(8.0, seed=5, **settings)
    assert fingerprint(first) == fingerprint(first) == fingerprint(simulate(8.0, seed=5, **settings))
    assert fingerprint(first) != fingerprint(simulate(8.0, seed=6, **settings))


def test_nonsense_is_refused():
    for duration in (0.0, -1.0, float("nan"), float("inf"), 1e9):
        with pytest.raises(UsageError, match="duration"):
            simulate(duration)
    with pytest.raises(UsageError, match="range_min"):
        simulate(laser__range_min=5, laser__range_max=4)
    with pytest.raises(UsageError, match="no scan fits"):
        simulate(0.01, laser__sweep=0.1)
