# SPDX-License-Identifier: MIT
"""The graph as markers: what rosbags reads back is what was drawn, in ROS 1 and ROS 2."""

from __future__ import annotations

import graph_states
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from slamcli.measurements import PointCloud
from slamcli.posegraph import MapState
from slamcli.reports.graph_arrays import graph_arrays
from slamcli.reports.mcap import write_result


@pytest.mark.parametrize("name", ["out.mcap", "out.bag"])
def test_other_tools_read_the_graph(tmp_path, name):
    state, _ = graph_states.state_and_searches()
    points = np.random.default_rng(0).uniform(0, 5, (20, 3)).astype(np.float32)
    cloud = PointCloud(stamp_ns=0, frame_id="", points_m=points)
    written = write_result(tmp_path / name, trajectory=graph_states.trajectory(), state=state, cloud=cloud)
    assert {"/submaps", "/nodes", "/constraints", "/cloud"} <= set(written)
    with AnyReader([tmp_path / name]) as reader:
        found = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
    graph = graph_arrays(state)
    (nodes,) = found["/nodes"].markers
    np.testing.assert_allclose([(p.x, p.y, p.z) for p in nodes.points], graph.positions_m)
    outlines, *names = found["/submaps"].markers
    assert [marker.text for marker in names] == list(graph.submap_names)
    starts = np.array([(p.x, p.y) for p in outlines.points])[::2].reshape(-1, 4, 2)
    np.testing.assert_allclose(starts, graph.outlines_m)
    loops = [marker for marker in found["/constraints"].markers if marker.ns != "sequence"]
    assert sum(len(marker.points) for marker in loops) == 2 * graph.inter.sum()
    assert len({marker.id for marker in loops}) == len(loops)
    assert {marker.header.frame_id for marker in (*loops, nodes)} == {"map"}
    assert found["/cloud"].width == 20


def test_an_empty_graph_has_no_markers(tmp_path):
    nothing = MapState(nodes=(), submaps=(), constraints=())
    written = write_result(tmp_path / "out.mcap", trajectory=graph_states.trajectory(), state=nothing)
    assert set(written) == {"/pose", "/tf", "/trajectory"}


def test_without_nodes_only_submaps_are_drawn(tmp_path):
    state, _ = graph_states.state_and_searches()
    alone = MapState(nodes=(), submaps=state.submaps, constraints=())
    written = write_result(tmp_path / "out.mcap", trajectory=graph_states.trajectory(), state=alone)
    assert "/submaps" in written
    assert "/nodes" not in written
