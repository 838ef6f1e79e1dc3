# SPDX-License-Identifier: MIT
"""Odometry through a world whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from odometry_world import CAMERA, STEP_NS, T_BASE_CAMERA, World, circle, nothing, pose

from slamcli.geometry import se3
from slamcli.rtabmap.feature_settings import Detector, FeatureSettings
from slamcli.rtabmap.odometry_settings import Filtering, OdometrySettings, odometry_settings
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.visual_odometry import VisualOdometry

WORLD = World()
SETTINGS = OdometrySettings(scales=(1.0,))


def travel(poses, settings=SETTINGS, *, guesses=None, blind=()):
    odometry = VisualOdometry(settings, CAMERA, T_BASE_CAMERA)
    steps = []
    for number, T in enumerate(poses):
        features = nothing() if number in blind else WORLD.features(T, seed=number)
        guess = None if guesses is None else guesses[number]
        steps.append(odometry.step(number * STEP_NS, features, guess))
    return odometry, steps


def errors(T_true, T_found):
    return np.linalg.norm((np.linalg.inv(T_true) @ T_found)[:, :3, 3], axis=1)


def test_a_circle_is_followed() -> None:
    poses = circle(60)
    odometry, steps = travel(poses)
    stamps, track = odometry.track()
    np.testing.assert_array_equal(stamps, np.arange(60) * STEP_NS)
    assert errors(np.array(poses), track).max() < 0.02
    assert errors(np.array(poses), np.array([step.T_odom_base for step in steps])).max() < 0.02
    assert steps[0].keyframe
    np.testing.assert_allclose(steps[0].T_odom_base, np.eye(4), atol=1e-12)
    assert not steps[0].covariance.any()
    assert 5 < odometry.counts["keyframes"] < 50


def test_the_same_input_gives_the_same_bytes() -> None:
    one, two = (travel(circle(20))[0].track()[1] for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_covariances_are_about_as_large_as_the_errors() -> None:
    poses = np.array(circle(60))
    _, steps = travel(poses)
    found = np.array([step.T_odom_base for step in steps])
    true_motion, motion = (np.linalg.inv(T[:-1]) @ T[1:] for T in (poses, found))
    wrong = (np.linalg.inv(true_motion) @ motion)[:, :3, 3]
    deviations = np.array([np.sqrt(np.diag(step.covariance)[:3]) for step in steps[1:]])
    assert 0.1 < np.median(np.abs(wrong) / deviations) < 1.5
    assert all(np.linalg.eigvalsh(step.covariance).min() > 0 for step in steps[1:])


def test_repeated_images_do_not_move() -> None:
    poses = [*circle(10), circle(10)[-1]]
    odometry = VisualOdometry(SETTINGS, CAMERA, T_BASE_CAMERA)
    for number, T in enumerate(poses):
        step = odometry.step(number * STEP_NS, WORLD.features(T, seed=min(number, 9)))
    assert odometry.counts["frames that repeat the one before"] == 1
    _, track = odometry.track()
    np.testing.assert_array_equal(track[-1], track[-2])
    assert step.num_inliers == step.num_features


def test_a_dark_spell_is_lost_and_found_again() -> None:
    poses = circle(30)
    odometry, steps = travel(poses, blind=range(15, 20))
    assert [step.T_odom_base is None for step in steps] == [15 <= number < 20 for number in range(30)]
    assert odometry.counts["frames lost"] == 5
    assert odometry.counts["resets"] == 0
    stamps, track = odometry.track()
    assert len(stamps) == 25
    assert errors(np.array([T for n, T in enumerate(poses) if not 15 <= n < 20]), track).max() < 0.02


def test_after_the_countdown_odometry_begins_anew_where_it_was() -> None:
    here, elsewhere = [pose(0.0, 0.0, 0.0)] * 5, [pose(0.0, 0.0, np.pi)] * 5
    odometry, steps = travel([*here, *elsewhere], replace(SETTINGS, reset_countdown=3))
    assert [step.began_anew for step in steps] == [False] * 7 + [True] + [False] * 2
    assert odometry.counts["resets"] == 1
    assert odometry.counts["frames lost"] == 3
    np.testing.assert_allclose(steps[7].T_odom_base, steps[4].T_odom_base, atol=1e-9)


def test_what_was_seen_before_odometry_began_anew_stays_where_it_was() -> None:
    poses = [*circle(12), *circle(12)[::-1]]
    behind = [T @ pose(0.0, 0.0, np.pi) for T in poses[12:]]
    odometry, _ = travel([*poses[:12], *behind], replace(SETTINGS, reset_countdown=3))
    assert odometry.counts["resets"] == 1
    _, track = odometry.track()
    assert errors(np.array(poses[:12]), track[:12]).max() < 0.02


def test_without_a_countdown_it_stays_lost() -> None:
    _, steps = travel([pose(0.0, 0.0, 0.0)] * 3 + [pose(0.0, 0.0, np.pi)] * 8)
    assert all(step.T_odom_base is None for step in steps[3:])


def test_a_guess_leads_over_a_jump() -> None:
    poses = [pose(0.0, 0.0, 0.0), pose(0.0, 0.0, 0.05), pose(0.3, 0.0, 0.5)]
    guesses = [None, None, np.linalg.inv(poses[1]) @ poses[2]]
    _, steps = travel(poses, guesses=guesses)
    assert errors(np.array(poses), np.array([step.T_odom_base for step in steps])).max() < 0.05


def test_too_few_points_begin_no_map() -> None:
    odometry = VisualOdometry(SETTINGS, CAMERA, T_BASE_CAMERA)
    assert odometry.step(0, WORLD.features(np.eye(4), most=10)).T_odom_base is None
    assert odometry.step(1, WORLD.features(np.eye(4))).T_odom_base is not None


def test_frame_to_frame_drifts_more_than_frame_to_map() -> None:
    poses = np.array(circle(60))
    to_map, _ = travel(poses)
    to_frame, _ = travel(poses, replace(SETTINGS, frame_to_map=False))
    own = [np.sqrt((errors(poses, odometry.track()[1]) ** 2).mean()) for odometry in (to_map, to_frame)]
    assert own[0] < own[1] < 0.1


def test_a_small_map_is_kept_small() -> None:
    settings = replace(SETTINGS, map_size=300, bundle_frames=2)
    odometry, _ = travel(circle(60), settings)
    assert errors(np.array(circle(60)), odometry.track()[1]).max() < 0.05
    assert len(odometry._map) < 1500
    assert len(odometry._map.keyframes) < odometry.counts["keyframes"]


def test_keyframes_can_need_motion_in_the_image() -> None:
    odometry, _ = travel(circle(60), replace(SETTINGS, least_motion_px=100.0))
    assert odometry.counts["keyframes"] < travel(circle(60))[0].counts["keyframes"]
    assert errors(np.array(circle(60)), odometry.track()[1]).max() < 0.06


def test_views_of_a_point_that_count_can_be_limited() -> None:
    odometry, _ = travel(circle(60), replace(SETTINGS, most_views=3))
    assert errors(np.array(circle(60)), odometry.track()[1]).max() < 0.03


def test_filters_smooth_what_is_given_out() -> None:
    poses = np.array([pose(0.03 * number, 0.0, 0.0) for number in range(30)])

    def roughness(settings):
        track = travel(poses, settings)[0].track()[1]
        return float(np.diff(track[10:, :3, 3], n=2, axis=0).std())

    raw = roughness(SETTINGS)
    assert roughness(replace(SETTINGS, filtering=Filtering.KALMAN)) < 0.7 * raw
    assert roughness(replace(SETTINGS, filtering=Filtering.PARTICLE)) < 1.5 * raw


def test_a_robot_that_cannot_strafe_moves_along_arcs() -> None:
    poses = np.array(circle(20))
    track = travel(poses, replace(SETTINGS, holonomic=False))[0].track()[1]
    motions = se3.inverse(track[:-1]) @ track[1:]
    yaws = np.arctan2(motions[:, 1, 0], motions[:, 0, 0])
    np.testing.assert_allclose(motions[:, 1, 3], motions[:, 0, 3] * np.tan(yaws / 2), atol=1e-9)
    assert errors(poses, track).max() < 0.02


def test_settings_come_from_rtabmaps_parameters() -> None:
    settings = odometry_settings(RtabmapParameters(), FeatureSettings(detector=Detector.GFTT_ORB).scales, 7)
    assert settings == OdometrySettings(scales=(1.0,), seed=7)


@pytest.mark.parametrize(
    ("detector", "levels"), [(Detector.ORB_OCTREE, 8), (Detector.ORB, 3), (Detector.GFTT_BRIEF, 1)]
)
def test_each_detector_has_its_pyramid(detector: Detector, levels: int) -> None:
    scales = FeatureSettings(detector=detector).scales
    assert len(scales) == levels
    assert scales[0] == 1.0
