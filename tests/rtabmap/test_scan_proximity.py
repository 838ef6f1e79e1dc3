# SPDX-License-Identifier: MIT
"""Closures by scans: a loop with drift is closed, places that look alike are not, and what parameters change."""

from __future__ import annotations

import numpy as np
import pytest
from scan_worlds import Walls, box, corridor, driven, furnished_room, seen

from slamcli.geometry import se2, se3
from slamcli.parameters import as_dict, resolve
from slamcli.rtabmap.graph_uncertainty import LinkVariances, WaysFromNode
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_proximity import ScanProximity, ScanProximityMatch
from slamcli.rtabmap.signature import NodeScan

RECENT = 10


def proximity(**native: object) -> ScanProximity:
    chosen = {
        "Reg/Strategy": 1, "Reg/Force3DoF": True, "RGBD/ProximityPathMaxNeighbors": 10, "RGBD/ProximityMaxGraphDepth": 0
    } | {"RGBD/" + name: value for name, value in native.items()}  # fmt: skip
    return ScanProximity(resolve(RtabmapParameters, as_dict(RtabmapParameters()), chosen))


def circle(count: int = 31) -> np.ndarray:
    """Poses around the middle of the room, a quarter of a turn more than once around."""
    angle = np.linspace(0.0, 2.5 * np.pi, count)
    return np.column_stack([3.8 + 1.3 * np.cos(angle), 3.0 + 1.0 * np.sin(angle), angle + np.pi / 2])


def drifted(poses: np.ndarray, turn: float, stretch: float = 1.0) -> np.ndarray:
    """Odometry that turns too far by `turn` radians a node, and measures ways `stretch` times too long."""
    motions = se2.between(poses[:-1], poses[1:]) * [stretch, stretch, 1.0] + [0.0, 0.0, turn]
    return se2.integrate(poses[0], motions)


def compared(
    walls: Walls, poses: np.ndarray, odometry: np.ndarray, which: ScanProximity, sigma_rad: float = 0.01
) -> tuple[list[ScanProximityMatch], MapGraph, dict[int, NodeScan]]:
    """What comes of comparing the last node."""
    rng = np.random.default_rng(3)
    graph = driven(odometry, odometry, sigma_rad=sigma_rad)
    scans = {row + 1: seen(walls, pose, rng) for row, pose in enumerate(poses)}
    among = range(1, len(poses) - RECENT + 1)
    return which.links(len(poses), graph, scans.get, among=among), graph, scans


def test_a_loop_with_drift_is_closed() -> None:
    poses = circle()
    odometry = drifted(poses, 0.004, 1.01)
    matches, graph, _ = compared(furnished_room(), poses, odometry, proximity())
    assert len(matches) == 1
    match = matches[0]
    assert match.registration.T_a_b is not None, match.registration.reason
    true = se2.between(poses[match.near_id - 1], poses[-1])
    error = se2.between(true, se3.to_se2(match.registration.T_a_b))
    before = se2.between(odometry[match.near_id - 1], odometry[-1])
    assert np.hypot(*(before - true)[:2]) > 0.08
    assert np.hypot(error[0], error[1]) < 0.03
    assert match.near_id in match.merged_ids
    assert len(match.merged_ids) > 1
    assert match.sigma_m > 0.05
    assert not graph.are_linked(match.near_id, len(poses))


def test_nothing_is_compared_without_need() -> None:
    poses = circle()
    odometry = drifted(poses, 0.004, 1.01)
    for off in ({"ProximityBySpace": False}, {"ProximityPathMaxNeighbors": 0}, {"LocalRadius": 0.01}):
        assert compared(furnished_room(), poses, odometry, proximity(**off))[0] == []
    # A place that the graph knows already.
    rng = np.random.default_rng(3)
    graph = driven(odometry, odometry, sigma_m=0.001, sigma_rad=0.0005)
    scans = {row + 1: seen(furnished_room(), pose, rng) for row, pose in enumerate(poses)}
    assert proximity().links(len(poses), graph, scans.get, among=range(1, len(poses) - RECENT + 1)) == []


def test_covariances_grow_by_their_factor() -> None:
    poses = circle()
    odometry = drifted(poses, 0.004)
    sizes = []
    for factor in (100.0, 400.0):
        found = compared(furnished_room(), poses, odometry, proximity(ProximityMergedScanCovFactor=factor))[0]
        sizes.append(found[0].registration.covariance[0, 0] - 0.005**2)
    assert sizes[1] == pytest.approx(4.0 * sizes[0], rel=0.05)


def test_the_two_halves_of_a_symmetric_hall_are_not_taken_for_each_other() -> None:
    """A hall that looks the same after half a turn: at its far end nothing may be closed with the near one."""
    hall = np.array([*box(0, 0, 24, 6), *box(3, 2, 4, 4), *box(20, 2, 21, 4)])
    x = np.linspace(2.0, 22.0, 41)
    poses = np.column_stack([x, np.full(41, 1.0), np.zeros(41)])
    matches, _, _ = compared(hall, poses, drifted(poses, 0.001, 1.02), proximity(), sigma_rad=0.02)
    for match in matches:
        if match.registration.T_a_b is not None:
            error = se2.between(se2.between(poses[match.near_id - 1], poses[-1]), se3.to_se2(match.registration.T_a_b))
            assert np.hypot(error[0], error[1]) < 0.3


def test_along_a_corridor_a_closure_tells_nothing_of_the_way() -> None:
    out = np.column_stack([np.linspace(0.0, 12.0, 25), np.zeros(25), np.zeros(25)])
    back = np.column_stack([np.linspace(12.0, 4.0, 17), np.full(17, 0.2), np.full(17, np.pi)])
    poses = np.vstack([out, back])
    odometry = drifted(poses, 0.0, 1.03)
    matches, _, _ = compared(corridor(), poses, odometry, proximity())
    for match in matches:
        found = match.registration
        if found.T_a_b is not None:
            error = se2.between(se2.between(poses[match.near_id - 1], poses[-1]), se3.to_se2(found.T_a_b))
            assert abs(error[1]) < 0.05
            assert np.sqrt(found.covariance[0, 0]) > 0.3 * abs(error[0])


def test_a_far_move_waits_for_a_second_closure_that_agrees() -> None:
    poses = circle(33)
    odometry = drifted(poses, 0.02, 1.15)
    which = proximity(ProximityPathFilteringRadius=0.2)
    rng = np.random.default_rng(3)
    scans = {row + 1: seen(furnished_room(), pose, rng) for row, pose in enumerate(poses)}
    reasons, found = [], []
    for count in range(28, 34):
        graph = driven(odometry[:count], odometry[:count], sigma_m=0.05, sigma_rad=0.05)
        for match in which.links(count, graph, scans.get, among=range(1, count - RECENT + 1)):
            reasons.append(match.registration.reason)
            if match.registration.T_a_b is not None:
                found.append((count, match))
    assert "waits for a second closure" in reasons[0], reasons
    assert found
    for count, match in found:
        true = se2.between(poses[match.near_id - 1], poses[count - 1])
        assert match.registration.T_a_b is not None
        error = se2.between(true, se3.to_se2(match.registration.T_a_b))
        assert np.hypot(error[0], error[1]) < 0.15  # the merged scans are as warped as this odometry


def test_uncertainty_adds_up_along_the_way() -> None:
    poses = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    graph = driven(poses, poses, sigma_m=0.1, sigma_rad=0.02)
    ways = WaysFromNode(11, graph.T_map_base, graph.links, LinkVariances())
    moved, turned = ways.variances(1)
    assert turned == pytest.approx(10 * 0.02**2, rel=1e-6)
    # The error of heading at each link moves node 1 by its distance from where the link was measured.
    arms = np.arange(1.0, 11.0) ** 2
    assert moved == pytest.approx(10 * 0.1**2 + 0.02**2 * float(arms.sum()), rel=0.25)
    assert ways.variances(11) == (0.0, 0.0)
    alone = driven(poses[:2], poses[:2])
    alone.remove_links(list(alone.links))
    assert WaysFromNode(2, alone.T_map_base, alone.links, LinkVariances()).variances(1) == (np.inf, np.inf)
