# SPDX-License-Identifier: MIT
"""Markers as landmarks of the graph."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamcli.geometry import se3
from slamcli.rtabmap.closing import Closing
from slamcli.rtabmap.graph import graph_settings, optimise_graph
from slamcli.rtabmap.landmarks import UNKNOWN_VARIANCE, MarkerFinder, prior_links
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.parameters import GtsamGroup, MarkerGroup, OptimizerGroup, RgbdGroup, RtabmapParameters
from slamcli.rtabmap.signature import NodeImages, Signature, no_features

sys.path.append(str(Path(__file__).parents[1] / "vision"))
from marker_scenes import CAMERA, facing, picture

T_BASE_CAMERA = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0.4], [0, 0, 0, 1]])
SEEN = facing(0.2, 0.1, 1.5, turn=0.4)


def images(T_camera_marker=None, *, depth=None, edge_m=0.2):
    colour = picture({4: SEEN} if T_camera_marker is None else T_camera_marker, 0, edge_m=edge_m)
    return NodeImages(colour=colour, camera=CAMERA, T_base_camera=T_BASE_CAMERA, depth=depth)


def test_a_marker_is_a_link_to_minus_its_number():
    (link,) = MarkerFinder(MarkerGroup(length=0.2)).links(9, images())
    assert (link.from_id, link.to_id, link.kind) == (9, -4, LinkKind.LANDMARK)
    assert np.abs(link.T_from_to[:3, 3] - (T_BASE_CAMERA @ SEEN)[:3, 3]).max() < 0.02
    assert np.allclose(1 / np.diag(link.information), [0.001] * 3 + [0.01] * 3)


def test_settings_of_single_markers_and_ranges():
    finder = MarkerFinder(MarkerGroup(length=0.2, lengths="4:0.4", variance_orientation_ignored=True))
    (link,) = finder.links(9, images())
    assert np.linalg.norm(link.T_from_to[:3, 3] - T_BASE_CAMERA[:3, 3]) == pytest.approx(
        2 * np.linalg.norm(SEEN[:3, 3]), rel=0.02
    )
    assert 1 / link.information[5, 5] == pytest.approx(UNKNOWN_VARIANCE)
    assert MarkerFinder(MarkerGroup(length=0.2, max_range=1.0)).links(9, images()) == []
    assert MarkerFinder(MarkerGroup(length=0.2, min_range=2.0)).links(9, images()) == []
    assert MarkerFinder(MarkerGroup(length=0.2, dictionary=20)).links(9, images()) == []
    assert MarkerFinder(MarkerGroup(length=0.2)).links(9, images({0: SEEN})) == []


def test_depth_tells_the_edge_once_seen_head_on():
    level = facing(0.0, 0.0, 1.2, turn=0.0)
    flat = images({4: level}, depth=np.full((480, 640), 1.2, np.float32))
    finder = MarkerFinder(MarkerGroup())
    assert finder.links(1, images()) == []  # no depth, no edge
    (first,) = finder.links(2, flat)
    assert first.T_from_to[0, 3] == pytest.approx(1.3, abs=0.02)
    (second,) = finder.links(3, images())
    assert np.abs(second.T_from_to[:3, 3] - (T_BASE_CAMERA @ SEEN)[:3, 3]).max() < 0.03
    slanted = np.tile(np.linspace(1.0, 1.4, 640, dtype=np.float32), (480, 1))
    assert MarkerFinder(MarkerGroup()).links(2, images({4: level}, depth=slanted)) == []
    each = MarkerFinder(MarkerGroup(length=-1.0))
    assert len(each.links(2, flat)) == 1
    assert each.links(3, images({5: SEEN})) == []


def test_priors_place_the_map():
    settings = MarkerGroup(priors="4 10 0 1 0 0 1.5")
    (prior,) = prior_links(settings)
    assert (prior.from_id, prior.to_id, prior.kind) == (-4, -4, LinkKind.POSE_PRIOR)
    seen = Link(
        from_id=1, to_id=-4, kind=LinkKind.LANDMARK, T_from_to=T_BASE_CAMERA @ SEEN, information=100 * np.eye(6)
    )
    held = MapGraph()
    held.add_node(GraphNode(id=1, map_id=0, stamp_ns=0, T_odom_base=np.eye(4)), np.eye(4))
    held.add_link(seen)
    poses = held.T_map_base
    assert np.allclose(poses[-4], seen.T_from_to)
    told = graph_settings(OptimizerGroup(), GtsamGroup(), planar=False)
    graph = optimise_graph([1, -4], np.array([poses[1], poses[-4]]), [seen, prior], told, root=1)
    assert np.allclose(graph.pose(-4), prior.T_from_to, atol=1e-3)
    assert np.allclose(graph.pose(1), prior.T_from_to @ se3.inverse(seen.T_from_to), atol=1e-3)


def test_a_marker_that_was_seen_before_is_a_closure():
    parameters = RtabmapParameters(
        rgbd=RgbdGroup(marker_detection=True), marker=MarkerGroup(length=0.2, priors="4 10 0 1 0 0 1.5")
    )
    closing, graph = Closing(parameters, None, CAMERA, T_BASE_CAMERA, 0), MapGraph()
    for number in (1, 2):
        graph.add_node(GraphNode(id=number, map_id=0, stamp_ns=number, T_odom_base=np.eye(4)), np.eye(4))
    node = Signature(
        id=1, map_id=0, stamp_ns=1, T_odom_base=np.eye(4), features=no_features(), points=np.zeros((0, 3)),
        word_ids=np.zeros(0, np.int64),
    )  # fmt: skip
    new, closures = closing.by_markers(node, images(), graph)
    assert [(link.from_id, link.to_id, link.kind) for link in new] == [
        (1, -4, LinkKind.LANDMARK), (-4, -4, LinkKind.POSE_PRIOR),
    ]  # fmt: skip
    assert closures == []
    for link in new:
        graph.add_link(link)
    new, closures = closing.by_markers(replace(node, id=2), images(), graph)
    assert new == []
    assert [(one.link.from_id, one.link.to_id) for one in closures] == [(2, -4)]
    assert closing.by_markers(node, None, graph) == ([], [])
    off = Closing(replace(parameters, rgbd=RgbdGroup()), None, CAMERA, T_BASE_CAMERA, 0)
    assert off.by_markers(node, images(), graph) == ([], [])
