# SPDX-License-Identifier: MIT
"""Paths near a node, and closures with their nearest nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from visual_worlds import CAMERA, T_BASE_CAMERA, motion, signature, world

from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.near_paths import near_paths, nearest_on_path
from slamcli.rtabmap.parameters import RgbdGroup
from slamcli.rtabmap.registration import refused
from slamcli.rtabmap.visual_proximity import visual_proximity, visual_proximity_in_time
from slamcli.rtabmap.visual_registration import register_visual
from slamcli.rtabmap.visual_settings import VisualSettings

RGBD = RgbdGroup()


def link(a, b, kind=LinkKind.NEIGHBOR):
    return Link(from_id=a, to_id=b, kind=kind, T_from_to=np.eye(4), information=np.eye(6))


def lawn(rows=3, length=10):
    """Poses on parallel lanes 0.5 m apart, each driven the same way, 1 m from node to node; node 1 begins the first lane."""
    poses = {}
    for row in range(rows):
        for k in range(length):
            poses[row * length + k + 1] = motion(float(k), 0.5 * row)
    return poses, [link(i, i + 1) for i in range(1, rows * length)]


def test_lanes_are_paths_newest_first():
    poses, links = lawn()
    # Seen from the middle of the last lane, 3 m around: lanes 1 and 2 each in one piece, and the own lane behind short-term memory.
    paths = near_paths(26, poses, links, replace(RGBD, local_radius=3.1), among=range(1, 22))
    assert paths == [[13, 14, 15, 16, 17, 18, 19], [4, 5, 6, 7, 8]]


def test_one_path_if_it_never_left_the_radius():
    poses, links = lawn()
    (path,) = near_paths(26, poses, links, replace(RGBD, local_radius=100.0), among=range(1, 22))
    assert path == list(range(1, 22))


def test_depth_counts_closures_and_begins_at_the_last_one():
    poses, links = lawn()
    settings = replace(RGBD, local_radius=3.1, proximity_max_graph_depth=6)
    assert near_paths(26, poses, links, settings, among=range(1, 20)) == []
    closed = [*links, link(26, 6, LinkKind.GLOBAL_CLOSURE)]
    assert near_paths(26, poses, closed, settings, among=range(1, 20)) == [[4, 5, 6, 7, 8]]
    assert near_paths(26, poses, links, settings, among=range(1, 20), last_closure=16) == [[13, 14, 15, 16, 17, 18, 19]]
    assert len(near_paths(26, poses, links, replace(settings, proximity_max_graph_depth=0), among=range(1, 20))) == 2


def test_landmarks_are_not_on_paths():
    poses, links = lawn(1)
    poses[-3] = motion(1.0)
    assert (
        near_paths(5, poses, [*links, link(5, -3, LinkKind.LANDMARK)], RGBD) == [[1, 2, 3, 4], [6, 7, 8, 9, 10]][::-1]
    )
    assert near_paths(5, {5: np.eye(4)}, [], RGBD) == []


def test_nearest_looks_the_same_way():
    poses = {1: motion(0.1, rotvec=(0, 0, 3.0)), 2: motion(0.4, rotvec=(0, 0, 0.3)), 3: motion(2.0), 9: motion()}
    assert nearest_on_path([1, 2, 3], 9, poses, RGBD) == 2
    assert nearest_on_path([1, 3], 9, poses, RGBD) is None
    assert nearest_on_path([1, 3], 9, poses, replace(RGBD, proximity_path_filtering_radius=0.0)) == 3
    assert nearest_on_path([1], 9, poses, replace(RGBD, proximity_path_filtering_radius=0.0)) is None
    assert nearest_on_path([1, 2, 3], 9, poses, replace(RGBD, proximity_angle=180.0)) == 1


def visual(a, b, guess):
    return register_visual(a, b, CAMERA, T_BASE_CAMERA, VisualSettings(), seed=0, guess=guess)


@pytest.fixture
def places():
    """Nodes on two lanes that see the same wall: the second passes the first after ten nodes elsewhere."""
    points, descriptors = world(4)
    rng = np.random.default_rng(0)
    T = {i: motion(0.2 * i) for i in range(1, 5)} | {20 + i: motion(0.2 * i, 0.1) for i in range(1, 5)}
    nodes = {i: signature(i, pose, points, descriptors, rng=rng, noise_px=0.3) for i, pose in T.items()}
    links = [link(i, i + 1) for i in range(1, 4)] + [link(20 + i, 21 + i) for i in range(1, 4)]
    links.append(link(24, 1, LinkKind.GLOBAL_CLOSURE))
    return nodes, T, links


@pytest.mark.parametrize("guess", [False, True])
def test_the_nearest_node_is_tied(places, guess):
    nodes, T, links = places
    settings = replace(RGBD, proximity_odom_guess=guess)
    (match,) = visual_proximity(nodes[24], T, links, nodes.get, visual, settings, among=[1, 2, 3, 4])
    assert match.near_id == 4
    assert match.kind == LinkKind.LOCAL_SPACE_CLOSURE
    assert np.allclose(match.registration.T_a_b, motion(0.0, 0.1), atol=0.01)


def test_what_is_tied_already_or_switched_off_is_not_compared(places):
    nodes, T, links = places
    among = [1, 2, 3, 4]
    tied = [*links, link(24, 4, LinkKind.GLOBAL_CLOSURE)]
    assert visual_proximity(nodes[24], T, tied, nodes.get, visual, RGBD, among=among) == []
    off = replace(RGBD, proximity_by_space=False)
    assert visual_proximity(nodes[24], T, links, nodes.get, visual, off, among=among) == []
    assert visual_proximity(nodes[24], T, links, lambda i: None, visual, RGBD, among=among) == []


def test_a_long_motion_is_refused(places):
    nodes, T, links = places
    poses = {**T, 4: motion(0.8)}

    def far(a, b, guess):
        return replace(refused(""), T_a_b=motion(5.0))

    (match,) = visual_proximity(nodes[24], poses, links, nodes.get, far, RGBD, among=[1, 2, 3, 4])
    assert match.registration.T_a_b is None
    assert "5.00 m long" in match.registration.reason


def test_paths_compared_are_counted(places):
    nodes, T, links = places
    apart = [one for one in links if one.from_id > 20]
    settings = replace(RGBD, proximity_max_graph_depth=0)
    for most, wanted in ((2, [4, 3]), (0, [4, 3, 2])):
        limited = replace(settings, proximity_max_paths=most)
        found = visual_proximity(nodes[24], T, apart, nodes.get, visual, limited, among=[1, 2, 3, 4])
        assert [match.near_id for match in found] == wanted


def test_proximity_in_time_compares_short_term_memory(places):
    nodes, _, links = places
    short = [nodes[i] for i in (21, 22, 23)]
    assert visual_proximity_in_time(nodes[24], links, short, visual, RGBD) == []
    found = visual_proximity_in_time(nodes[24], links, short, visual, replace(RGBD, proximity_by_time=True))
    assert [match.near_id for match in found] == [22, 21]
    assert np.allclose(found[0].registration.T_a_b, motion(0.4), atol=0.01)
