# SPDX-License-Identifier: MIT
"""Closures kept for pictures: bounded, spread over the run, only where something was seen; read back as pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from database_worlds import signature, written

from slamcli.rtabmap.closure_check import closure_record
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.node_pictures import node_views, place_views
from slamcli.rtabmap.registration import refused
from slamcli.rtabmap.run_figures import place_closures
from slamcli.rtabmap.sights import Sights
from slamcli.rtabmap.signature import no_features

MATCHES = np.column_stack([np.arange(15), np.arange(15)[::-1]])
FOUND = replace(refused("none"), matches=MATCHES)


def test_kinds_and_pixels_of_the_matches():
    sights = Sights()
    old, new = signature(1), signature(2)
    sights.offer(old, new, LinkKind.GLOBAL_CLOSURE, FOUND, "")
    sights.offer(old, new, LinkKind.LOCAL_SPACE_CLOSURE, FOUND, "")
    sights.offer(old, new, LinkKind.GLOBAL_CLOSURE, refused("too few"), "too few")
    assert [len(sights.of(kind)) for kind in ("loop", "near", "refused")] == [1, 1, 1]
    loop = sights.of("loop")[0]
    np.testing.assert_allclose(loop.pixels_older, old.features.pixels[:15], rtol=1e-6)
    np.testing.assert_allclose(loop.pixels_newer, new.features.pixels[14::-1], rtol=1e-6)
    assert sights.of("refused")[0].reason == "too few"
    assert len(sights.of("refused")[0].pixels_older) == 0


def test_nodes_that_are_gone_or_see_nothing_are_left_out():
    sights = Sights()
    blind = replace(signature(3), features=no_features(), points=np.zeros((0, 3)), word_ids=np.zeros(0, np.int64))
    for older, newer in ((None, signature(2)), (signature(1), None), (signature(1), blind)):
        sights.offer(older, newer, LinkKind.GLOBAL_CLOSURE, FOUND, "")
    assert sights.of("loop") == []


def test_of_many_some_are_kept_from_first_to_last():
    sights, node = Sights(), signature(1)
    for number in range(2, 1002):
        sights.offer(node, replace(node, id=number), LinkKind.GLOBAL_CLOSURE, FOUND, "")
    kept = [sight.newer for sight in sights.of("loop")]
    assert 16 <= len(kept) <= 32
    assert kept[0] == 2
    assert kept[-1] > 900
    assert len(set(np.diff(kept))) == 1


def test_pictures_are_read_from_the_database(tmp_path):
    path = written(tmp_path / "a.db", 4)
    sights = Sights()
    with Database.read(path) as database:
        nodes = database.nodes()
        stamp_of = dict(zip(nodes.ids.tolist(), nodes.stamps_ns.tolist(), strict=True))
        pictured = [node_id for node_id in stamp_of if database.read_images(node_id) is not None]
        assert len(pictured) >= 2
        views = node_views(database, pictured, np.array([stamp_of[node_id] for node_id in pictured]))
        assert [view.name for view in views] == [f"node {node_id}" for node_id in pictured]
        assert all(len(view.places) <= view.num_features for view in views)
        ends = [database.read_signature(node_id) for node_id in pictured[:2]]
        for kind in (LinkKind.GLOBAL_CLOSURE, LinkKind.LOCAL_SPACE_CLOSURE):
            for _ in range(9):
                sights.offer(*ends, kind, FOUND, "")
        for number in range(9):
            sights.offer(*ends, LinkKind.GLOBAL_CLOSURE, FOUND, f"reason {number}")
        places = place_views(database, sights, stamp_of, 2)
        gone = place_views(database, sights, {}, 1)
    assert [place.kind for place in places] == ["loop"] * 4 + ["near"] * 2 + ["refused"] * 4
    assert places[0].older.places.shape == places[0].newer.places.shape == (15, 2)
    assert places[-1].reason == "reason 8"
    assert [places[0].older.of_this_run, places[0].newer.of_this_run] == [node_id >= 2 for node_id in pictured[:2]]
    assert gone == ()


def test_records_are_told_with_the_stamps_of_both_nodes(tmp_path):
    path = written(tmp_path / "a.db", 3)
    records = [
        closure_record((1, 3, LinkKind.GLOBAL_CLOSURE), 77, refused("too few", num_matches=4), posterior=0.5),
        closure_record((3, -9, LinkKind.LANDMARK), 77, replace(FOUND, T_a_b=np.eye(4), reason=""), ratio=1.5),
    ]
    with Database.read(path) as database:
        first, second = place_closures(records, database)
        assert first.older_stamp_ns == database.nodes().stamps_ns[0]
    assert (first.node, first.older_node, first.kind, first.accepted, first.reason) == (3, 1, "loop", False, "too few")
    assert (second.node, second.older_node, second.older_stamp_ns, second.accepted) == (3, -9, None, True)
    assert second.strain == pytest.approx(1.5)
