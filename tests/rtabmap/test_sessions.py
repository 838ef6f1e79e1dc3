# SPDX-License-Identifier: MIT
"""Sessions: updates one after the other, maps that join or do not, localisation, long-term memory."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from session_worlds import FIRST_NS, STEPS, Hall, errors, node_inputs, on_circle, opened, parameters
from visual_worlds import motion

from slamcli.errors import EstimationError
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.joined_maps import chosen_component, what_joined
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.node_input import OdometryStep

ELSEWHERE = motion(x=30.0, y=-4.0, rotvec=(0.0, 0.0, 2.0))


def run(session, inputs):
    """Feed nodes; return their ids."""
    return [session.update(node) for node in inputs]


def first_session(path, settings, rounds=1.25, **how):
    """A finished session of a bit more than one round; its database is closed."""
    session = opened(path, settings)
    steps = list(range(int(rounds * STEPS)))
    ids = run(session, node_inputs(Hall(), steps, **how))
    session.finish(FrameTrack())
    session.close(chosen_component(session.graph, session.own_nodes), None)
    return session, dict(zip(ids, steps, strict=True))


def test_a_robot_that_has_not_moved_makes_no_node(tmp_path):
    session = opened(tmp_path / "a.db", parameters())
    nodes = list(node_inputs(Hall(), [0, 0, 1]))
    assert run(session, nodes) == [1, None, 2]
    assert [link.kind for link in session.graph.links] == [LinkKind.NEIGHBOR]
    session.keeping.database.close()


def test_a_round_is_closed_and_drift_is_taken_out(tmp_path):
    session, steps_of = first_session(tmp_path / "a.db", parameters(), drift_rad=0.01)
    tied = [(k.from_id, k.to_id) for k in session.graph.links if k.kind == LinkKind.LOCAL_SPACE_CLOSURE]
    assert [pair for pair in tied if pair[1] - pair[0] == STEPS] == [(k, k + STEPS) for k in range(1, 5)]
    assert errors(session, steps_of) < 0.05
    with Database.read(tmp_path / "a.db") as database:
        assert len(database.nodes()) == len(steps_of)
        optimised = database.optimised()
        assert optimised is not None
        assert np.allclose(optimised.T_map_base[-1], session.graph.T_map_base[len(steps_of)], atol=1e-5)


def test_closures_that_strain_the_graph_are_refused(tmp_path):
    settings = parameters(rgbd={"optimize_max_error": 1e-3})
    session, _ = first_session(tmp_path / "a.db", settings, drift_rad=0.01)
    assert sum(record.refused for record in session.records) > 0
    assert {link.kind for link in session.graph.links} == {LinkKind.NEIGHBOR}
    refusals = [record.reason for record in session.closing.records if not record.accepted]
    assert any("RGBD/OptimizeMaxError" in reason for reason in refusals)


def test_a_second_session_that_begins_elsewhere_joins(tmp_path):
    settings, path = parameters(), tmp_path / "a.db"
    first, steps_of = first_session(path, settings)
    session = opened(path, settings, append=True)
    steps = list(range(4, 4 + STEPS // 2))
    ids = run(session, node_inputs(Hall(), steps, T_odom_map=ELSEWHERE, first_ns=2 * FIRST_NS))
    session.finish(FrameTrack())
    assert ids[0] == len(first.graph.nodes) + 1
    shown = chosen_component(session.graph, session.own_nodes)
    assert shown == sorted(session.graph.nodes)
    assert errors(session, steps_of | dict(zip(ids, steps, strict=True))) < 0.05
    assert np.array_equal(
        session.graph.T_map_base[1], first.graph.T_map_base[1].astype(np.float32).astype(np.float64)
    ) or (np.abs(session.graph.T_map_base[1] - first.graph.T_map_base[1]).max() < 1e-6)
    words = what_joined(session.graph, shown, session.own_nodes)
    assert words == f"joined the database's map: {len(ids)} new nodes and {len(steps_of)} earlier ones"
    session.close(shown, None)


def test_a_session_that_never_joins_stays_by_itself(tmp_path):
    settings, path = parameters(), tmp_path / "a.db"
    first, steps_of = first_session(path, settings)
    session = opened(path, settings, append=True)
    ids = run(session, node_inputs(Hall(seed=7), list(range(6)), first_ns=2 * FIRST_NS))
    session.finish(FrameTrack())
    shown = chosen_component(session.graph, session.own_nodes)
    assert shown == ids
    assert what_joined(session.graph, shown, session.own_nodes).startswith(
        f"nothing tied this run to the database's {len(steps_of)} earlier nodes: the result shows its own 6 nodes alone"
    )
    session.close(shown, None)
    third = opened(path, settings, append=True)  # the poses of the map that was no result are optimised anew
    for node_id, pose in first.graph.T_map_base.items():
        assert np.abs(third.graph.T_map_base[node_id] - pose).max() < 1e-3
    third.keeping.database.close()


def test_start_new_map_on_loop_closure_keeps_nothing_before(tmp_path):
    path = tmp_path / "a.db"
    _, steps_of = first_session(path, parameters())
    settings = parameters(rtabmap={"start_new_map_on_loop_closure": True})
    session = opened(path, settings, append=True)
    elsewhere = list(node_inputs(Hall(seed=7), list(range(3)), first_ns=2 * FIRST_NS))
    known = [replace(node, began_anew=False) for node in node_inputs(Hall(), list(range(5, 10)), first_ns=3 * FIRST_NS)]
    ids = run(session, [*elsewhere, *known])
    assert ids[:3] == [None] * 3
    made = [node_id for node_id in ids if node_id is not None]
    assert made == list(range(len(steps_of) + 1, len(steps_of) + 1 + len(made)))
    assert len(made) >= 3
    assert chosen_component(session.graph, session.own_nodes) == sorted(session.graph.nodes)
    session.close(made, None)
    with Database.read(path) as database:
        assert database.nodes().ids.tolist() == sorted(session.graph.nodes)


def test_a_session_that_waits_for_a_closure_in_vain_says_so(tmp_path):
    path = tmp_path / "a.db"
    first_session(path, parameters())
    session = opened(path, parameters(rtabmap={"start_new_map_on_loop_closure": True}), append=True)
    assert run(session, node_inputs(Hall(seed=7), list(range(4)), first_ns=2 * FIRST_NS)) == [None] * 4
    with pytest.raises(EstimationError, match="StartNewMapOnLoopClosure"):
        chosen_component(session.graph, session.own_nodes)
    session.keeping.database.close()


def test_localisation_leaves_the_map_to_the_last_bit(tmp_path):
    path = tmp_path / "a.db"
    first_session(path, parameters())
    settings = parameters(mem={"incremental_memory": False})
    session = opened(path, settings, append=True)
    before = {node_id: pose.copy() for node_id, pose in session.graph.T_map_base.items()}
    steps = list(range(2, 2 + STEPS))
    ids = run(session, node_inputs(Hall(), steps, T_odom_map=ELSEWHERE, drift_rad=0.01, first_ns=2 * FIRST_NS))
    session.finish(FrameTrack())
    assert session.localising
    assert all(np.array_equal(session.graph.T_map_base[node_id], pose) for node_id, pose in before.items())
    assert chosen_component(session.graph, session.own_nodes, localising=True) == sorted(session.graph.nodes)
    placed = [session.graph.T_map_base[node_id] for node_id in ids]
    off = [float(np.linalg.norm(T[:3, 3] - on_circle(step)[:3, 3])) for T, step in zip(placed, steps, strict=True)]
    assert max(off) < 0.05  # the first ones too, which were placed backwards
    assert session.memory.working == sorted(before)
    session.keeping.database.close()


def test_what_is_not_localised_is_an_error(tmp_path):
    path = tmp_path / "a.db"
    first_session(path, parameters())
    session = opened(path, parameters(mem={"incremental_memory": False}), append=True)
    run(session, node_inputs(Hall(seed=7), list(range(4)), first_ns=2 * FIRST_NS))
    session.finish(FrameTrack())
    with pytest.raises(EstimationError, match="not localised: none of the 4 places"):
        chosen_component(session.graph, session.own_nodes, localising=True)
    session.keeping.database.close()


def test_bounded_memory_transfers_and_closes_loops_with_what_comes_back(tmp_path):
    settings = parameters(
        rtabmap={"memory_thr": 8, "loop_thr": 0.04}, rgbd={"local_radius": 1.0, "proximity_by_space": False},
        slamcli={"final_searches": 0}, bayes={"prediction_lc": "0.1 0.36 0.30"},
    )  # fmt: skip
    session = opened(tmp_path / "a.db", settings)
    run(session, node_inputs(Hall(), list(range(3 * STEPS))))
    sizes = [record.working for record in session.records]
    assert max(sizes) <= 8 + 1 + settings.rtabmap.max_retrieved + settings.rgbd.max_local_retrieved
    transferred = sum(record.transferred for record in session.records)
    retrieved = sum(record.retrieved for record in session.records)
    assert transferred > STEPS
    assert retrieved > 0
    assert session.records[-1].long_term == transferred - retrieved
    late = [record for record in session.records[2 * STEPS :] if record.loop_closure]
    assert len(late) >= STEPS // 2
    session.keeping.database.close()


def test_the_same_sessions_write_the_same_file(tmp_path):
    for name in ("a", "b"):
        path, hall = tmp_path / f"{name}.db", Hall()
        for k, steps in enumerate((list(range(STEPS + 2)), list(range(3, 9)))):
            session = opened(path, parameters(), append=k > 0)
            run(session, node_inputs(hall, steps, first_ns=(1 + k) * FIRST_NS))
            session.finish(FrameTrack())
            session.close(chosen_component(session.graph, session.own_nodes), None)
    assert (tmp_path / "a.db").read_bytes() == (tmp_path / "b.db").read_bytes()


def test_odometry_as_it_is_known_in_the_end_is_kept(tmp_path):
    session, track, steps = opened(tmp_path / "a.db", parameters()), FrameTrack(), list(range(4))
    for node in node_inputs(Hall(), steps, drift_rad=0.02):
        step = OdometryStep(stamp_ns=node.stamp_ns, T_odom_base=node.T_odom_base, covariance=node.covariance)
        track.add(step, begins=node.began_anew)
        track.mark_node(session.update(node))
    better = np.array([on_circle(step) for step in steps])
    track.refine(np.array(track.stamps_ns), better)
    session.finish(track)
    session.close([1, 2, 3, 4], None)
    with Database.read(tmp_path / "a.db") as database:
        links = [link for link in database.links() if link.kind == LinkKind.NEIGHBOR]
    assert [(link.from_id, link.to_id) for link in links] == [(1, 2), (2, 3), (3, 4)]
    motions = [np.linalg.inv(a) @ b for a, b in pairwise(better)]
    assert np.allclose([link.T_from_to for link in links], motions, atol=1e-5)
