# SPDX-License-Identifier: MIT
"""g2o files: round trips, GTSAM as a second reader, damage, and the graph of a mapping run."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import FormatError
from slamcli.formats.g2o import G2oGraph, graph_of_state, read_g2o, write_g2o
from slamcli.geometry import quaternion, se3
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges, optimise_planar
from slamcli.runtime import RunLog

PLANAR = """\
# made by hand
VERTEX_SE2 0 0 0 0
VERTEX_SE2 7 1.5 -0.25 0.1
VERTEX_SE2 3 2 0 3.141592653589793
FIX 0
EDGE_SE2 0 7 1 0 0.1 500 1 2 400 3 900
EDGE_SE2 7 3 1 0 0.1 500 0 0 500 0 900
"""


def random_graph(dimension, seed=0):
    rng = np.random.default_rng(seed)
    freedom = {2: 3, 3: 6}[dimension]
    if dimension == 2:
        poses, measured = rng.normal(size=(5, 3)), rng.normal(size=(6, 3))
    else:
        poses, measured = (
            np.concatenate([rng.normal(size=(n, 3)), Rotation.random(n, rng).as_quat()], axis=1) for n in (5, 6)
        )
    root = rng.normal(size=(6, freedom, freedom))
    information = root @ root.transpose(0, 2, 1)
    information = (information + information.transpose(0, 2, 1)) / 2
    return G2oGraph(
        dimension=dimension, ids=np.array([4, 1, 0, 99, 2]), poses=poses, first=np.array([4, 1, 0, 99, 2, 4]),
        second=np.array([1, 0, 99, 2, 4, 0]), measured=measured, information=information, fixed=np.array([1, 4]),
        comments=("seeded", "one, two"),
    )  # fmt: skip


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_written_is_read_again_exactly(tmp_path, dimension):
    graph = random_graph(dimension)
    write_g2o(tmp_path / "a.g2o", graph)
    read = read_g2o(tmp_path / "a.g2o")
    for name in ("ids", "poses", "first", "second", "measured", "information", "fixed"):
        np.testing.assert_array_equal(getattr(read, name), getattr(graph, name), err_msg=name)
    assert read.comments == graph.comments
    write_g2o(tmp_path / "b.g2o", read)
    assert (tmp_path / "a.g2o").read_bytes() == (tmp_path / "b.g2o").read_bytes()


@pytest.mark.parametrize("dimension", [2, 3])
def test_gtsam_reads_the_same(tmp_path, dimension):
    graph = random_graph(dimension)
    write_g2o(tmp_path / "a.g2o", graph)
    factors, values = gtsam.readG2o(str(tmp_path / "a.g2o"), dimension == 3)
    assert factors.size() == 6
    for number, pose in zip(graph.ids.tolist(), graph.poses, strict=True):
        if dimension == 2:
            found = values.atPose2(number)
            np.testing.assert_allclose([found.x(), found.y()], pose[:2], atol=1e-12)
            assert np.cos(found.theta() - pose[2]) == pytest.approx(1, abs=1e-12)
        else:
            expected = se3.from_position_quaternion(pose[:3], pose[3:])
            np.testing.assert_allclose(values.atPose3(number).matrix(), expected, atol=1e-12)
    noise = factors.at(2).noiseModel().information()
    order = [0, 1, 2] if dimension == 2 else [3, 4, 5, 0, 1, 2]  # GTSAM has rotations first
    np.testing.assert_allclose(noise, graph.information[2][np.ix_(order, order)], rtol=1e-9)


def test_a_file_by_hand_is_understood(tmp_path):
    path = tmp_path / "hand.g2o"
    path.write_text(PLANAR)
    graph = read_g2o(path)
    assert graph.dimension == 2
    assert graph.ids.tolist() == [0, 7, 3]
    assert graph.fixed.tolist() == [0]
    np.testing.assert_array_equal(graph.information[0], [[500, 1, 2], [1, 400, 3], [2, 3, 900]])
    assert (graph.first[1], graph.second[1]) == (7, 3)


def test_unknown_tags_are_noted(tmp_path):
    path, log = tmp_path / "more.g2o", RunLog()
    path.write_text(PLANAR + "VERTEX_XY 9 1 2\nEDGE_SE2_XY 0 9 1 2 1 0 1\nVERTEX_XY 10 1 2\n")
    assert len(read_g2o(path, log=log).ids) == 3
    assert log.notes == [f"{path}: 3 lines with other tags are left out: 1 x 'EDGE_SE2_XY', 2 x 'VERTEX_XY'"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no VERTEX_SE2"),
        ("hello world\n", "no VERTEX_SE2"),
        ("\0\1\2", "not text"),
        ("VERTEX_SE2 0 1 2\n", "line 1: VERTEX_SE2 with 3 numbers, not 4"),
        ("VERTEX_SE2 0 1 2 x\n", "line 1: 'x' is not a number"),
        ("VERTEX_SE2 0 1 2 nan\n", "is not a finite number"),
        ("VERTEX_SE2 -1 1 2 3\n", "line 1: '-1' is not the number of a vertex"),
        ("VERTEX_SE2 99999999999999999999999 1 2 3\n", "is not the number of a vertex"),
        ("VERTEX_SE2 0 1 2 3\nVERTEX_SE2 0 1 2 3\n", "line 2: vertex 0 comes twice, first in line 1"),
        ("VERTEX_SE2 0 1 2 3\nEDGE_SE2 0 1 0 0 0 1 0 0 1 0 1\n", "line 2: an edge names vertex 1"),
        ("VERTEX_SE2 0 1 2 3\nEDGE_SE2 0 0 0 0 0 1 0 0 1 0\n", "line 2: EDGE_SE2 with 10 numbers, not 11"),
        ("VERTEX_SE2 0 1 2 3\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n", "line 2: VERTEX_SE3:QUAT in a graph of 2D poses"),
        ("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0\n", "line 1: a quaternion of zeros"),
        ("VERTEX_SE2 0 1 2 3\nFIX a\n", "line 2: 'a' is not the number of a vertex"),
    ],
)
def test_damage_is_named(tmp_path, text, message):
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as raised:
        read_g2o(path)
    assert "\n" not in str(raised.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FormatError, match="cannot be read as a g2o pose graph"):
        read_g2o(tmp_path / "none.g2o")


def state(tilt=0.0, frozen=()):
    def at(x, y, yaw):
        return se3.from_position_quaternion([x, y, 0.0], quaternion.from_roll_pitch_yaw(tilt, 0.0, yaw))

    def submap(trajectory, number, x):
        pose = at(x, 0, 0.5)
        return Submap(
            id=Id(trajectory, number), T_local_submap=pose, T_map_submap=pose, num_range_data=1, finished=True
        )

    def node(trajectory, number, x):
        return Node(
            id=Id(trajectory, number), stamp_ns=number, T_local_node=at(x, 1, 0), T_map_node=at(x, 1, 0),
            gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]), points_m=np.zeros((0, 3), np.float32),
        )  # fmt: skip

    def constraint(submap, node, x):
        return Constraint(
            submap=Id(*submap), node=Id(*node), T_submap_node=at(x, 0, 0.25), translation_weight=5.0, rotation_weight=7.0,
            kind="intra",
        )  # fmt: skip

    return MapState(
        nodes=(node(1, 0, 9.0), node(0, 2, 2.0), node(0, 0, 1.0)), submaps=(submap(1, 0, 8.0), submap(0, 0, 0.0)),
        constraints=(constraint((0, 0), (0, 0), 1.0), constraint((0, 0), (1, 0), 2.0), constraint((0, 5), (0, 0), 3.0)),
        frozen=frozenset(frozen),
    )  # fmt: skip


def test_the_graph_of_a_run_numbers_submaps_before_nodes(tmp_path):
    graph = graph_of_state(state())
    assert graph.dimension == 2
    np.testing.assert_allclose(graph.poses[:, 0], [0, 8, 1, 2, 9])
    assert list(zip(graph.first.tolist(), graph.second.tolist(), strict=True)) == [(0, 2), (0, 4)]
    np.testing.assert_array_equal(graph.information[0], np.diag([25.0, 25, 49]))
    np.testing.assert_allclose(graph.measured, [[1, 0, 0.25], [2, 0, 0.25]], atol=1e-12)
    assert graph.fixed.tolist() == [0]
    assert graph.comments == (
        "vertices 0 to 0: submaps 0 to 0 of trajectory 0",
        "vertices 1 to 1: submaps 0 to 0 of trajectory 1",
        "vertices 2 to 2: nodes 0 to 0 of trajectory 0",
        "vertices 3 to 3: nodes 2 to 2 of trajectory 0",
        "vertices 4 to 4: nodes 0 to 0 of trajectory 1",
    )
    write_g2o(tmp_path / "run.g2o", graph)
    np.testing.assert_array_equal(read_g2o(tmp_path / "run.g2o").poses, graph.poses)


def test_a_run_that_leaves_the_plane_is_a_graph_in_space():
    graph = graph_of_state(state(tilt=0.1))
    assert graph.dimension == 3
    assert graph.poses.shape == (5, 7)
    np.testing.assert_array_equal(graph.information[0], np.diag([25.0, 25, 25, 49, 49, 49]))


def test_frozen_trajectories_are_fixed():
    assert graph_of_state(state(frozen={1})).fixed.tolist() == [0, 1, 4]


def test_an_empty_run_is_an_empty_graph():
    graph = graph_of_state(MapState(nodes=(), submaps=(), constraints=()))
    assert len(graph.ids) == len(graph.first) == len(graph.fixed) == 0


def test_a_graph_from_a_file_can_be_adjusted(tmp_path):
    path = tmp_path / "hand.g2o"
    path.write_text(PLANAR)
    graph = read_g2o(path)
    place = {number: i for i, number in enumerate(graph.ids.tolist())}
    first, second = (np.array([place[n] for n in ends.tolist()]) for ends in (graph.first, graph.second))
    one = np.ones(2)
    edges = PlanarEdges(
        first=first, second=second, measured=graph.measured, translation_weight=one, rotation_weight=one,
        information=graph.information, robust=np.zeros(2, bool),
    )  # fmt: skip
    fixed = np.isin(graph.ids, graph.fixed)
    solution = optimise_planar(graph.poses, fixed, edges, loss=Loss(), max_iterations=30, tolerance=1e-12)
    np.testing.assert_allclose(solution.poses[1], [1, 0, 0.1], atol=1e-8)
    np.testing.assert_allclose(solution.poses[2], [1 + np.cos(0.1), np.sin(0.1), 0.2], atol=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_mutated_files_are_read_or_refused_in_one_line(tmp_path, dimension):
    rng = np.random.default_rng(dimension)
    path = tmp_path / "a.g2o"
    write_g2o(path, random_graph(dimension))
    whole = path.read_bytes()
    refused, read = [], []
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(len(data)))
            match int(rng.integers(3)):
                case 0:
                    data[at] = int(rng.integers(256))
                case 1:
                    del data[at : at + int(rng.integers(1, 60))]
                case _:
                    data[at:at] = data[at // 2 : at // 2 + 40]
        path.write_bytes(data)
        try:
            read.append(read_g2o(path, log=RunLog()))
        except FormatError as error:
            refused.append(str(error))
    assert not any("\n" in message for message in refused)
    assert all(np.isfinite(graph.measured).all() for graph in read)
    assert min(len(read), len(refused)) > 10
