# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import CalibrationError, DataError
from slamcli.geometry import quaternion, se3
from slamcli.geometry.frame_tree import FrameTree, FrameTreeBuilder

S = 1_000_000_000
IDENTITY = (0.0, 0.0, 0.0, 1.0)


def _yaw(angle: float) -> tuple[float, float, float, float]:
    return tuple(quaternion.from_yaw(angle).tolist())  # type: ignore[return-value]


def _driving() -> FrameTreeBuilder:
    builder = FrameTreeBuilder()
    for i in range(11):
        builder.add("odom", "base_link", i * S, (float(i), 0.0, 0.0), _yaw(0.1 * i))
    builder.add_static("base_link", "laser", (0.2, 0.0, 0.3), _yaw(np.pi / 2))
    return builder


def test_lookup_interpolates_position_and_yaw() -> None:
    tree = _driving().build()
    T = tree.lookup("odom", "base_link", 2_500_000_000)
    np.testing.assert_allclose(se3.to_se2(T), [2.5, 0.0, 0.25], atol=1e-12)


def test_lookup_composes_both_ways() -> None:
    tree = _driving().build()
    T_odom_laser = tree.lookup("odom", "laser", 4 * S)
    expected = tree.lookup("odom", "base_link", 4 * S) @ tree.lookup("base_link", "laser")
    np.testing.assert_allclose(T_odom_laser, expected, atol=1e-12)
    np.testing.assert_allclose(tree.lookup("laser", "odom", 4 * S) @ T_odom_laser, np.eye(4), atol=1e-12)


def test_lookup_between_siblings() -> None:
    builder = _driving()
    builder.add_static("base_link", "camera", (0.0, 0.5, 0.0), IDENTITY)
    T = builder.build().lookup("camera", "laser")
    np.testing.assert_allclose(T[:3, 3], [0.2, -0.5, 0.3], atol=1e-12)


def test_lookup_of_a_frame_in_itself_is_identity_even_if_unknown() -> None:
    np.testing.assert_array_equal(FrameTree().lookup("base_link", "base_link"), np.eye(4))


def test_lookup_many_equals_lookup() -> None:
    tree = _driving().build()
    stamps = np.linspace(0, 10 * S, 37).astype(np.int64)
    many, valid = tree.lookup_many("odom", "laser", stamps)
    assert valid.all()
    for stamp, T in zip(stamps, many, strict=True):
        np.testing.assert_allclose(T, tree.lookup("odom", "laser", int(stamp)), atol=1e-12)


def test_no_time_means_the_last_known() -> None:
    np.testing.assert_allclose(_driving().build().lookup("odom", "base_link")[0, 3], 10.0)


def test_extrapolation_is_bounded_and_counted() -> None:
    tree = _driving().build(tolerance_s=0.1)
    held = tree.lookup("odom", "base_link", 10 * S + 90_000_000)
    np.testing.assert_allclose(held[0, 3], 10.0)
    assert tree.num_extrapolated == 1
    with pytest.raises(DataError, match=r"odom -> base_link at 10\.200 s: it is known from 0\.000 to 10\.000 s"):
        tree.lookup("odom", "laser", 10 * S + 200_000_000)
    _, valid = tree.lookup_many("odom", "laser", [-S, 0, S, 11 * S])
    assert valid.tolist() == [False, True, True, False]


def test_backward_stamps_are_sorted_for_lookup() -> None:
    builder = FrameTreeBuilder()
    for t in (0, 2, 1, 3):
        builder.add("odom", "base_link", t * S, (float(t), 0.0, 0.0), IDENTITY)
    assert builder.build().lookup("odom", "base_link", 1_500_000_000)[0, 3] == pytest.approx(1.5)


def test_of_equal_stamps_the_last_one_counts() -> None:
    builder = FrameTreeBuilder()
    for t, x in ((0, 0.0), (1, 1.0), (1, 5.0), (2, 5.0)):
        builder.add("odom", "base_link", t * S, (x, 0.0, 0.0), IDENTITY)
    tree = builder.build()
    assert tree.lookup("odom", "base_link", S)[0, 3] == pytest.approx(5.0)
    assert np.isfinite(tree.lookup("odom", "base_link", S + 1)).all()


def test_a_repeated_constant_transform_is_static() -> None:
    builder = FrameTreeBuilder()
    for t in range(5):
        builder.add("base_link", "laser", t * S, (0.1, 0.0, 0.0), IDENTITY)
    tree = builder.build()
    assert tree.is_static("base_link", "laser")
    np.testing.assert_allclose(tree.lookup("base_link", "laser", 500 * S)[0, 3], 0.1)
    assert tree.edge("laser").num_samples == 5  # type: ignore[union-attr]


def test_two_parents_are_reported_and_the_busier_one_wins() -> None:
    builder = _driving()
    builder.add("elsewhere", "base_link", 0, (9.0, 9.0, 0.0), IDENTITY)
    tree = builder.build()
    assert tree.parent("base_link") == "odom"
    assert len(tree.problems) == 1
    assert "'base_link' has two parents: odom (11 x), elsewhere (1 x); odom is used" in tree.problems[0]


def test_an_override_wins() -> None:
    builder = _driving()
    builder.override("base_link", "laser", (1.0, 0.0, 0.0), IDENTITY)
    builder.override("robot", "base_link", (0.0, 0.0, 2.0), IDENTITY)
    tree = builder.build()
    assert tree.parent("base_link") == "robot"
    np.testing.assert_allclose(tree.lookup("robot", "laser")[:3, 3], [1.0, 0.0, 2.0])


def test_a_robot_model_only_fills_gaps() -> None:
    builder = _driving()
    builder.fall_back("base_link", "laser", (7.0, 0.0, 0.0), IDENTITY)
    builder.fall_back("base_link", "imu", (0.0, 7.0, 0.0), IDENTITY)
    tree = builder.build()
    np.testing.assert_allclose(tree.lookup("base_link", "laser")[0, 3], 0.2)
    np.testing.assert_allclose(tree.lookup("base_link", "imu")[1, 3], 7.0)


def test_cycles_are_cut_and_reported() -> None:
    builder = FrameTreeBuilder()
    for t in range(3):
        builder.add("a", "b", t, (1.0, 0.0, 0.0), IDENTITY)
        builder.add("b", "c", t, (1.0, 0.0, 0.0), IDENTITY)
    builder.add("c", "a", 0, (1.0, 0.0, 0.0), IDENTITY)
    builder.add("a", "a", 0, (1.0, 0.0, 0.0), IDENTITY)
    tree = builder.build()
    np.testing.assert_allclose(tree.lookup("a", "c")[0, 3], 2.0)
    assert any("cycle" in problem and "c -> a is ignored" in problem for problem in tree.problems)
    assert any("own parent" in problem for problem in tree.problems)


def test_unknown_and_unconnected_frames_name_what_is_known() -> None:
    builder = _driving()
    builder.add_static("world", "camera", (0.0, 0.0, 0.0), IDENTITY)
    tree = builder.build()
    assert tree.roots == ("odom", "world")
    assert not tree.connected("odom", "camera")
    with pytest.raises(CalibrationError, match=r"no frame 'lidar' .*known: base_link, camera, laser, odom, world"):
        tree.lookup("base_link", "lidar")
    with pytest.raises(CalibrationError, match=r"'laser' and 'camera' are not connected \(laser is connected to base"):
        tree.lookup("laser", "camera")


def test_unnormalised_and_unset_rotations() -> None:
    builder = FrameTreeBuilder()
    builder.add_static("a", "b", (0.0, 0.0, 0.0), (0.0, 0.0, 2.0, 2.0))
    builder.add_static("a", "c", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    tree = builder.build()
    np.testing.assert_allclose(se3.to_se2(tree.lookup("a", "b"))[2], np.pi / 2)
    np.testing.assert_allclose(tree.lookup("a", "c"), np.eye(4))
