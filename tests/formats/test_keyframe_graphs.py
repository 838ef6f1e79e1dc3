# SPDX-License-Identifier: MIT
"""Graphs of keyframes: checked when made, written as CSV and as g2o."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.formats.g2o import read_g2o, write_g2o
from slamcli.formats.keyframe_graphs import LINK_COLUMNS, g2o_of_keyframes, write_covisibility, write_links
from slamcli.geometry import se3
from slamcli.posegraph.keyframe_graph import KeyframeGraph


def graph(**changed):
    T = np.tile(np.eye(4), (4, 1, 1))
    T[:, 0, 3] = np.arange(4)
    T[3, :3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    given = {
        "stamps_ns": np.arange(4) * 500_000_000 + 1_700_000_000_000_000_000, "T_map_base": T,
        "pairs": np.array([[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]), "shared": np.array([90, 20, 40, 80, 70]),
        "kinds": np.array([1, 0, 2, 1, 1]),
    }  # fmt: skip
    return KeyframeGraph(**(given | changed))


def test_every_edge_has_a_line(tmp_path):
    write_covisibility(tmp_path / "c.csv", graph())
    lines = (tmp_path / "c.csv").read_text().splitlines()
    assert lines[0] == "keyframe_a,keyframe_b,stamp_a_s,stamp_b_s,shared_points,kind"
    assert lines[2] == "0,2,1700000000.000000000,1700000001.000000000,20,covisible"
    assert [line.split(",")[-1] for line in lines[1:]] == ["tree", "covisible", "loop", "tree", "tree"]


def test_tree_and_loops_are_a_g2o_graph_of_the_final_poses(tmp_path):
    write_g2o(tmp_path / "g.g2o", g2o_of_keyframes(graph()))
    back = read_g2o(tmp_path / "g.g2o")
    assert back.ids.tolist() == [0, 1, 2, 3]
    assert np.column_stack([back.first, back.second]).tolist() == [[0, 1], [0, 3], [1, 2], [2, 3]]
    assert back.fixed.tolist() == [0]
    np.testing.assert_allclose(back.measured[1], [3, 0, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)
    np.testing.assert_array_equal(back.information, np.tile(np.eye(6), (4, 1, 1)))
    assert "edge 1: loop" in back.comments


def test_measured_edges_go_before_the_poses():
    measured = np.tile(se3.from_rotation_translation(np.eye(3), np.array([0.5, 0, 0])), (5, 1, 1))
    found = g2o_of_keyframes(graph(T_first_second=measured, information=np.tile(2 * np.eye(6), (5, 1, 1))))
    np.testing.assert_allclose(found.measured[:, 0], 0.5)
    assert found.information[0, 3, 3] == 2.0


def test_measured_edges_are_links_with_the_numbers_of_the_database(tmp_path):
    measured = np.tile(se3.from_rotation_translation(np.eye(3), np.array([0.75, 0, 0])), (5, 1, 1))
    kinds = np.array([3, 4, 2, 3, 3])
    made = graph(T_first_second=measured, kinds=kinds, ids=np.array([11, 12, 15, 19]))
    write_links(tmp_path / "l.csv", made)
    lines = (tmp_path / "l.csv").read_text().splitlines()
    assert lines[0] == ",".join(LINK_COLUMNS)
    assert lines[1] == "11,12,1700000000.000000000,1700000000.500000000,odometry,0.75,0,0,0,0,0,1,0.25,0"
    assert [line.split(",")[4] for line in lines[1:]] == ["odometry", "proximity", "loop", "odometry", "odometry"]
    metres, radians = made.residuals()
    np.testing.assert_allclose(metres, [0.25, 1.25, 2.25, 0.25, 0.25])
    np.testing.assert_allclose(radians, [0, 0, np.pi / 2, 0, np.pi / 2], atol=1e-12)
    assert g2o_of_keyframes(made).comments[1:] == ("edge 1: proximity", "edge 2: loop")
    assert not np.any(graph().residuals())


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"shared": np.zeros(3, int)}, r"shared has shape \(3,\), not \(5,\)"),
        ({"ids": np.zeros(5, int)}, r"ids has shape \(5,\), not \(4,\)"),
        ({"pairs": np.full((5, 2), 4)}, "names a keyframe that is not there"),
    ],
)
def test_graphs_that_do_not_fit_are_refused(changed, said):
    with pytest.raises(DataError, match=said):
        graph(**changed)
