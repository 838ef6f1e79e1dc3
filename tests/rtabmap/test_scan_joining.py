# SPDX-License-Identifier: MIT
"""Sessions of planar scans that begin somewhere in an older map, or in another building."""

from __future__ import annotations

import numpy as np
import pytest
from session_worlds import FIRST_NS, opened, parameters
from visual_worlds import motion

from slamcli.errors import EstimationError
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.joined_maps import chosen_component
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.signature import NodeScan, no_features

BEAMS = np.linspace(-np.pi, np.pi, 240, endpoint=False)


class BlindFront:
    """A robot without cameras."""

    camera = None
    T_base_camera = np.eye(4)


def building(seed):
    """Walls as segments (N, 4): a hall of 14 x 9 m with pillars and boxes somewhere."""
    rng = np.random.default_rng(seed)
    corners = [(0.0, 0.0, 14.0, 9.0)]
    for _ in range(7):
        x, y = rng.uniform(1.0, 13.0), rng.choice([rng.uniform(0.3, 2.2), rng.uniform(6.5, 8.2)])
        corners.append((x, y, x + rng.uniform(0.3, 1.2), y + rng.uniform(0.3, 0.7)))
    return np.array(
        [side for a, b, c, d in corners for side in ((a, b, c, b), (c, b, c, d), (c, d, a, d), (a, d, a, b))]
    )


def scan(walls, x, y, yaw, rng):
    """What a planar laser sees: the nearest wall along each beam, with 1 cm of noise."""
    d = np.stack([np.cos(BEAMS + yaw), np.sin(BEAMS + yaw)], axis=1)
    a, e = walls[:, :2] - (x, y), walls[:, 2:] - walls[:, :2]
    cross = d[:, None, 0] * e[None, :, 1] - d[:, None, 1] * e[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[None, :, 0] * e[None, :, 1] - a[None, :, 1] * e[None, :, 0]) / cross
        u = (a[None, :, 0] * d[:, None, 1] - a[None, :, 1] * d[:, None, 0]) / cross
    ranges = np.where((t > 0.0) & (u >= 0.0) & (u <= 1.0), t, np.inf).min(axis=1)
    ranges = ranges + 0.01 * rng.normal(size=len(ranges))
    ends = np.stack([ranges * np.cos(BEAMS), ranges * np.sin(BEAMS), np.zeros_like(ranges)], axis=1)
    return NodeScan(points=ends.astype(np.float32), planar=True, T_base_sensor=np.eye(4), range_max_m=30.0)


def way(begin, count):
    """Poses (x, y, yaw) along the hall and back, half a metre apart."""
    steps = np.arange(begin, begin + count) * 0.5
    there = steps % 18.0
    x = np.where(there < 9.0, 2.0 + there, 20.0 - there)
    return [(float(px), 4.5 if s < 9.0 else 4.9, 0.0 if s < 9.0 else np.pi) for px, s in zip(x, there, strict=True)]


def inputs(walls, poses, *, T_odom_map, first_ns, seed=0):
    rng = np.random.default_rng(seed)
    for k, (x, y, yaw) in enumerate(poses):
        yield NodeInput(
            stamp_ns=first_ns + k * 10**9, T_odom_base=T_odom_map @ motion(x=x, y=y, rotvec=(0.0, 0.0, yaw)),
            covariance=np.diag([1e-4, 1e-4, 1e-8, 1e-8, 1e-8, 1e-5]), began_anew=k == 0, features=no_features(), points=np.zeros((0, 3)),
            scan=scan(walls, x, y, yaw, rng),
        )  # fmt: skip


def settings(**groups):
    groups = {"reg": {"strategy": 1, "force_3dof": True}, "rgbd": {"proximity_path_max_neighbors": 10}, **groups}
    return parameters(**groups, kp={"max_features": -1}, slamcli={"odometry": "recording"})


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A database with a map of the building, in whose frame the first pose is the origin."""
    path = tmp_path_factory.mktemp("scans") / "home.db"
    poses = way(0, 30)
    session = opened(path, settings(), front=BlindFront())
    start = np.linalg.inv(motion(x=poses[0][0], y=poses[0][1], rotvec=(0.0, 0.0, poses[0][2])))
    for node in inputs(building(1), poses, T_odom_map=start, first_ns=FIRST_NS):
        session.update(node)
    session.finish(FrameTrack())
    session.close(chosen_component(session.graph, session.own_nodes), None)
    return path


def continued(home, tmp_path, walls, **groups):
    """A second session on a copy of the database, from the middle of the hall on."""
    path = tmp_path / "second.db"
    path.write_bytes(home.read_bytes())
    session = opened(path, settings(**groups), append=True, front=BlindFront())
    poses = way(8, 24)
    ids = [
        session.update(node)
        for node in inputs(
            walls, poses, T_odom_map=motion(x=3.0, rotvec=(0.0, 0.0, 1.0)), first_ns=2 * FIRST_NS, seed=5
        )
    ]
    session.finish(FrameTrack())
    session.keeping.database.close()
    return session, ids, poses


def largest_error(session, ids, poses):
    """Of nodes of the second session in the frame of the first, metres."""
    origin = way(0, 1)[0]
    truth = [(x - origin[0], y - origin[1]) for x, y, _ in poses]
    return max(float(np.hypot(*(session.graph.T_map_base[i][:2, 3] - t))) for i, t in zip(ids, truth, strict=True))


def test_a_session_that_begins_elsewhere_is_found_in_the_older_map(home, tmp_path):
    session, ids, poses = continued(home, tmp_path, building(1))
    assert chosen_component(session.graph, session.own_nodes) == sorted(session.graph.nodes)
    assert largest_error(session, ids, poses) < 0.05
    reasons = [record.reason for record in session.closing.records]
    assert "found in the older map: waits for a second search that agrees" in reasons


def test_another_building_is_not_taken_for_it(home, tmp_path):
    session, ids, _ = continued(home, tmp_path, building(2))
    assert chosen_component(session.graph, session.own_nodes) == ids
    assert any(
        "the scan fits nowhere" in record.reason or "beams" in record.reason for record in session.closing.records
    )


def test_scans_are_localised_in_a_map_that_stays(home, tmp_path):
    session, ids, poses = continued(home, tmp_path, building(1), mem={"incremental_memory": False})
    assert largest_error(session, ids, poses) < 0.05
    lost, made, _ = continued(home, tmp_path, building(2), mem={"incremental_memory": False})
    assert len(made) == 24
    with pytest.raises(EstimationError, match="not localised: none of the 24 places"):
        chosen_component(lost.graph, lost.own_nodes, localising=True)
