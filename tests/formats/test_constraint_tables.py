# SPDX-License-Identifier: MIT
"""Constraints and loop searches as CSV: exact stamps, empty cells for what is not known."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from slamcli.formats.constraint_tables import write_constraints, write_loop_searches
from slamcli.geometry import se3
from slamcli.posegraph import Constraint, Id, LoopSearch, MapState, Node, Submap

NODE = Node(
    id=Id(1, 4),
    stamp_ns=1_600_000_000_000_000_007,
    T_local_node=np.eye(4),
    T_map_node=se3.from_se2([1.5, -2.0, 0.0]),
    gravity_alignment_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    points_m=np.zeros((0, 3), dtype=np.float32),
)
SUBMAP = Submap(id=Id(0, 2), T_local_submap=np.eye(4), T_map_submap=np.eye(4), num_range_data=3, finished=True)


def constraint(node, kind):
    return Constraint(
        submap=SUBMAP.id,
        node=node,
        T_submap_node=se3.from_se2([1.5, -2.3, 0.01]),
        translation_weight=500.0,
        rotation_weight=1600.0,
        kind=kind,
    )


STATE = MapState(
    nodes=(NODE,), submaps=(SUBMAP,), constraints=(constraint(NODE.id, "inter"), constraint(Id(1, 5), "intra"))
)


def rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_line_for_every_constraint(tmp_path):
    write_constraints(tmp_path / "c.csv", STATE)
    first, second = rows(tmp_path / "c.csv")
    assert (first["kind"], first["submap_trajectory"], first["submap"], first["node_trajectory"], first["node"]) == (
        "inter",
        "0",
        "2",
        "1",
        "4",
    )
    assert first["node_stamp_s"] == "1600000000.000000007"
    assert float(first["translation_weight"]) == 500.0
    assert float(first["translation_residual_m"]) == pytest.approx(0.3)
    assert float(first["rotation_residual_rad"]) == pytest.approx(0.01)
    assert (second["kind"], second["node_stamp_s"], second["translation_residual_m"]) == ("intra", "", "")


def test_a_line_for_every_search(tmp_path):
    searches = (
        LoopSearch(
            submap=Id(0, 2),
            node=NODE.id,
            score=0.75,
            accepted=True,
            reason="",
            translation_residual_m=0.02,
            rotation_residual_rad=0.001,
            round=1,
        ),
        LoopSearch(submap=Id(0, 2), node=Id(9, 9), score=0.4, accepted=False, reason='score "0.4", low'),
    )
    write_loop_searches(tmp_path / "l.csv", searches, STATE)
    first, second = rows(tmp_path / "l.csv")
    assert (first["round"], first["accepted"], first["score"], first["x_m"], first["y_m"]) == (
        "1",
        "1",
        "0.75",
        "1.500000",
        "-2.000000",
    )
    assert (second["accepted"], second["reason"], second["x_m"], second["translation_residual_m"]) == (
        "0",
        'score "0.4", low',
        "",
        "",
    )
    write_loop_searches(tmp_path / "n.csv", searches, None)
    assert rows(tmp_path / "n.csv")[0]["x_m"] == ""


def test_nothing_is_a_line_of_names(tmp_path):
    write_constraints(tmp_path / "c.csv", MapState(nodes=(), submaps=(), constraints=()))
    assert (tmp_path / "c.csv").read_text().count("\n") == 1
