# SPDX-License-Identifier: MIT
"""Pose errors, pairs, segments and projection on small exact worlds."""

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.evaluation import (
    AlignMode,
    DeltaUnit,
    PoseRelation,
    absolute_errors,
    align,
    project,
    relative_errors,
    transformed,
)
from slamcli.evaluation.pairs import find_pairs
from slamcli.evaluation.segments import kitti_errors, subtrajectory_errors, subtrajectory_lengths
from slamcli.geometry import quaternion
from slamcli.geometry.alignment import Similarity
from slamcli.trajectory import Trajectory, associate

S = 10**9
ANGLES = (PoseRelation.ANGLE_DEG, PoseRelation.ANGLE_RAD, PoseRelation.ROT_PART)


def walk(n=120, seed=0):
    """A random walk in space."""
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(size=(n, 3)) * 0.2, axis=0)
    quats = [np.array([0, 0, 0, 1.0])]
    for _ in range(n - 1):
        quats.append(quaternion.multiply(quats[-1], quaternion.normalise(np.append(rng.normal(size=3) * 0.05, 1))))
    return Trajectory(np.arange(n) * S // 10, positions, np.array(quats))


def drive(n=2000, step=0.5):
    """Straight along x."""
    return Trajectory.from_se2(np.arange(n) * S // 10, np.column_stack([np.arange(n) * step, np.zeros(n), np.zeros(n)]))


@pytest.mark.parametrize("relation", [r for r in PoseRelation if r is not PoseRelation.POINT_DISTANCE_ERROR_RATIO])
def test_no_error_against_itself(relation):
    assert absolute_errors(walk(), walk(), relation).statistics.max < 1e-7
    assert relative_errors(walk(), walk(), relation, delta=3).statistics.max < 1e-7


@pytest.mark.parametrize("relation", list(PoseRelation))
def test_relative_errors_do_not_see_where_the_map_lies(relation):
    estimate = walk(seed=0)
    noisy = Trajectory(estimate.stamps_ns, estimate.positions_m * 1.1, estimate.quats_xyzw)
    T = Similarity(quaternion.to_matrix(quaternion.normalise(np.array([1.0, 2, 3, 4]))), np.array([5.0, 6, 7]))
    a = relative_errors(estimate, noisy, relation, delta=5)
    b = relative_errors(estimate, transformed(noisy, T), relation, delta=5)
    np.testing.assert_allclose(a.errors, b.errors, atol=1e-6 if relation in ANGLES else 1e-9)


def test_exact_values():
    truth, estimate = drive(5, 1.0), drive(5, 1.1)
    assert absolute_errors(truth, estimate).errors.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert relative_errors(truth, estimate, delta=2).errors.tolist() == pytest.approx([0.2, 0.2])
    ratio = relative_errors(truth, estimate, PoseRelation.POINT_DISTANCE_ERROR_RATIO, delta=2, all_pairs=True)
    assert ratio.errors.tolist() == pytest.approx([10, 10, 10])
    turned = Trajectory(truth.stamps_ns, truth.positions_m, np.tile(quaternion.from_yaw(np.pi / 2), (5, 1)))
    assert absolute_errors(truth, turned, PoseRelation.ANGLE_DEG).errors.tolist() == pytest.approx([90] * 5)
    assert absolute_errors(truth, turned, PoseRelation.ROT_PART).errors[0] == pytest.approx(2)


def naive_all_pairs(along, delta, tolerance):
    found = []
    for i in range(len(along) - 1):
        off = [abs(along[j] - along[i] - delta) for j in range(i + 1, len(along))]
        j = int(np.argmin(off))
        if off[j] <= tolerance:
            found.append([i, i + 1 + j])
    return found


@pytest.mark.parametrize("seed", range(4))
def test_all_pairs_by_path_and_angle_equal_their_naive_twins(seed):
    from scipy.spatial.transform import Rotation

    t = walk(80, seed)
    still = t.select(np.sort(np.concatenate([np.arange(80), [5, 5, 40, 79]])))
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(still.positions_m, axis=0), axis=1))])
    pairs = find_pairs(still, 2.0, DeltaUnit.METRES, all_pairs=True, rel_tol=0.05)
    assert pairs.tolist() == naive_all_pairs(along, 2.0, 0.1)
    turns = Rotation.from_quat(t.quats_xyzw)
    expected = [
        [i, j]
        for i in range(80)
        for j in range(i + 1, 80)
        if 9 <= np.degrees((turns[i].inv() * turns[j]).magnitude()) <= 11
    ]
    assert find_pairs(t, 10, DeltaUnit.DEGREES, all_pairs=True).tolist() == expected
    np.testing.assert_array_equal(
        find_pairs(t, np.radians(10), DeltaUnit.RADIANS, all_pairs=True),
        find_pairs(t, 10, DeltaUnit.DEGREES, all_pairs=True),
    )


def test_pairs_by_frames_seconds_and_consecutive_path():
    t = drive(11, 0.5)
    assert find_pairs(t, 4, DeltaUnit.FRAMES).tolist() == [[0, 4], [4, 8]]
    assert len(find_pairs(t, 4, DeltaUnit.FRAMES, all_pairs=True)) == 7
    assert find_pairs(t, 0.4, DeltaUnit.SECONDS).tolist() == [[0, 4], [4, 8]]
    assert find_pairs(t, 0.4, DeltaUnit.SECONDS, all_pairs=True).tolist() == [[i, i + 4] for i in range(7)]
    assert find_pairs(t, 2, DeltaUnit.METRES).tolist() == [[0, 4], [4, 8]]
    backwards = t.select([0, 1, 2, 1, 4, 5, 6, 7, 8])
    assert find_pairs(backwards, 0.4, DeltaUnit.SECONDS).tolist() == [[0, 4], [4, 8]]


def test_pairs_that_cannot_be():
    for delta, unit, message in [
        (0, DeltaUnit.FRAMES, "positive"),
        (float("nan"), DeltaUnit.METRES, "positive"),
        (1.5, DeltaUnit.FRAMES, "whole number"),
        (181, DeltaUnit.DEGREES, "largest angle"),
    ]:
        with pytest.raises(UsageError, match=message):
            find_pairs(drive(5), delta, unit)
    with pytest.raises(EstimationError, match="no two of 5 matched poses"):
        find_pairs(drive(5), 100, DeltaUnit.METRES)
    with pytest.raises(UsageError, match="relative"):
        absolute_errors(drive(5), drive(5), PoseRelation.POINT_DISTANCE_ERROR_RATIO)
    with pytest.raises(DataError, match="no pairs"):
        absolute_errors(drive(5), drive(6))
    still = drive(5, 0.0)
    with pytest.raises(EstimationError, match="does not move"):
        relative_errors(still, still, PoseRelation.POINT_DISTANCE_ERROR_RATIO)


def test_alignment_modes_undo_what_was_done():
    truth = walk()
    T = Similarity(quaternion.to_matrix(quaternion.from_yaw(1.0)), np.array([5.0, 6, 7]))
    for mode, moved in [
        (AlignMode.SE3, transformed(truth, T)),
        (AlignMode.POSYAW, transformed(truth, T)),
        (AlignMode.ORIGIN, transformed(truth, T)),
        (AlignMode.SIM3, transformed(truth, Similarity(T.rotation, T.translation_m, 3.0))),
        (AlignMode.SCALE, transformed(truth, Similarity(np.eye(3), np.zeros(3), 3.0))),
        (AlignMode.NONE, truth),
    ]:
        aligned, found = align(associate(truth, moved), mode)
        assert absolute_errors(truth, aligned, PoseRelation.FULL).statistics.max < 1e-9, mode
        assert found.scale == pytest.approx(1 / 3 if "sim3" in mode or "scale" in mode else 1)
    for mode in (AlignMode.SE3, AlignMode.POSYAW):
        aligned, _ = align(associate(truth, transformed(truth, T)), mode, num_poses=1)
        assert absolute_errors(truth, aligned).statistics.max < 1e-9


def test_projection_keeps_the_angle_about_the_normal():
    flat = Trajectory.from_se2(np.arange(4) * S, [[1, 2, 0.1], [2, 3, 3.0], [3, 4, -3.0], [4, 5, -0.2]])
    np.testing.assert_allclose(project(flat, "xy").poses_se2, flat.poses_se2, atol=1e-12)
    side = project(flat, "xz")
    assert side.positions_m[:, 1].tolist() == [0, 0, 0, 0]
    np.testing.assert_allclose(np.abs(side.quats_xyzw), [[0, 0, 0, 1]] * 4, atol=1e-12)
    with pytest.raises(UsageError, match="no plane 'xw'"):
        project(flat, "xw")


def naive_kitti(truth, estimate, lengths):
    """The development kit's loop, in its words."""
    along = [0.0]
    for a, b in zip(truth.positions_m[:-1], truth.positions_m[1:], strict=True):
        along.append(along[-1] + float(np.linalg.norm(b - a)))
    errors = []
    for length in lengths:
        for first in range(0, len(truth), 10):
            last = next((i for i in range(first, len(along)) if along[i] > along[first] + length), None)
            if last is None:
                continue
            moved = np.linalg.inv(truth.transforms[first]) @ truth.transforms[last]
            found = np.linalg.inv(estimate.transforms[first]) @ estimate.transforms[last]
            error = np.linalg.inv(found) @ moved
            angle = np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1))
            errors.append([np.linalg.norm(error[:3, 3]) / length * 100, np.degrees(angle) / length])
    return np.array(errors)


def test_kitti_segments_equal_the_naive_loop():
    truth, estimate = walk(400, 1), walk(400, 2)
    lengths = (5.0, 10.0, 40.0, 1000.0)
    found = kitti_errors(truth, estimate, lengths_m=lengths)
    expected = naive_kitti(truth, estimate, lengths)
    np.testing.assert_allclose(np.column_stack([found.trans_percent, found.rot_deg_per_m]), expected, rtol=1e-6)


def test_a_scale_error_of_one_percent_is_one_percent_drift():
    truth, estimate = drive(), drive(step=0.505)
    assert kitti_errors(truth, estimate).trans_percent == pytest.approx(1.0, rel=0.01)
    lengths = subtrajectory_lengths(truth)
    assert lengths == pytest.approx((99.95, 199.9, 299.85, 399.8, 499.75), abs=0.011)
    for record in subtrajectory_errors(truth, estimate, lengths):
        assert record.statistics()["rel_trans_perc"].mean == pytest.approx(1.0, rel=0.02)
        assert record.rel_rot.max() == 0
    for record in subtrajectory_errors(truth, estimate, lengths, scale=0.5 / 0.505):
        assert record.rel_trans.max() < 1e-9


def test_tilt_and_yaw_of_subtrajectories_are_told_apart():
    truth = drive(100)
    yaw_drift = np.column_stack([truth.poses_se2[:, :2], np.linspace(0, 0.2, 100)])
    record = subtrajectory_errors(truth, Trajectory.from_se2(truth.stamps_ns, yaw_drift), [10.0])[0]
    assert record.rel_yaw == pytest.approx(record.rel_rot, rel=1e-6)
    assert record.rel_gravity.max() < 1e-9
    roll = quaternion.from_roll_pitch_yaw(np.linspace(0, 0.2, 100), 0.0, 0.0)
    record = subtrajectory_errors(truth, Trajectory(truth.stamps_ns, truth.positions_m, roll), [10.0])[0]
    assert record.rel_gravity == pytest.approx(record.rel_rot, rel=1e-6)
    assert record.rel_yaw.max() < 1e-9


def test_segments_that_are_none():
    assert subtrajectory_errors(drive(5), drive(5), [100.0]) == ()
    assert len(kitti_errors(drive(5), drive(5)).first) == 0
    with pytest.raises(UsageError, match="must be a positive number"):
        kitti_errors(drive(5), drive(5), lengths_m=[0.0])
