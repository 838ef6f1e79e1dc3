# SPDX-License-Identifier: MIT
"""Markers rendered into pictures are found where they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from marker_scenes import CAMERA, facing, picture

from slamcli.errors import ConfigError
from slamcli.vision.markers import FAMILIES, find_markers, marker_pose


@pytest.mark.parametrize("family", [0, 3, 8, 17, 20])
def test_markers_of_each_family_are_found_where_they_are(family):
    T = {3: facing(0.3, 0.1, 1.5, turn=0.4), 7: facing(-0.4, -0.2, 2.0, turn=-0.5)}
    image = picture(T, family, edge_m=0.2)
    found = find_markers(image, family)
    assert [marker.number for marker in found] == [3, 7]
    for marker in found:
        pose = marker_pose(marker.corners, 0.2, CAMERA)
        assert np.abs(pose.T_camera_marker[:3, 3] - T[marker.number][:3, 3]).max() < 0.02
        cosine = (np.trace(pose.T_camera_marker[:3, :3].T @ T[marker.number][:3, :3]) - 1) / 2
        assert np.degrees(np.arccos(min(cosine, 1.0))) < 3.0
        assert pose.rms_px < 0.5


def test_colour_pictures_are_taken_and_others_have_none():
    image = picture({5: facing(0.0, 0.0, 1.0, turn=0.3)}, 0, edge_m=0.2)
    assert [m.number for m in find_markers(np.repeat(image[:, :, None], 3, axis=2), 0)] == [5]
    assert find_markers(np.full((480, 640), 128, np.uint8), 0) == []
    assert find_markers(image, 20) == []


def test_a_number_seen_twice_is_nobody():
    image = picture({5: facing(-0.3, 0.0, 1.2, turn=0.2)}, 0, edge_m=0.2)
    twice = np.minimum(image, image[:, ::1])
    twice[:, 320:] = np.minimum(twice[:, 320:], image[:, :320])
    assert find_markers(twice, 0) == []


def test_a_far_marker_seen_head_on_is_ambiguous():
    far = marker_pose(CAMERA.project(square(facing(0.0, 0.0, 6.0, turn=0.05))).round(0), 0.1, CAMERA)
    near = marker_pose(CAMERA.project(square(facing(0.0, 0.0, 0.6, turn=0.6))), 0.1, CAMERA)
    assert far.ambiguous
    assert not near.ambiguous


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_turns_by_quarters_are_found_exactly(quarter, turn):
    T = facing(0.0, 0.0, 0.6, turn=turn)
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
    T[:3, :3] = T[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    pose = marker_pose(CAMERA.project(square(T)), 0.1, CAMERA)
    assert np.allclose(pose.T_camera_marker, T, atol=1e-3)


def square(T):
    corners = 0.05 * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    return corners @ T[:3, :3].T + T[:3, 3]


def test_families_are_opencvs():
    assert [getattr(cv2.aruco, f"DICT_{name}") for name in FAMILIES] == list(range(21))
    with pytest.raises(ConfigError, match="there are 0 to 20"):
        find_markers(np.zeros((10, 10), np.uint8), 21)
