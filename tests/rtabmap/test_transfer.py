# SPDX-License-Identifier: MIT
"""Which nodes go to long-term memory, by hand."""

from __future__ import annotations

from slamcli.rtabmap.transfer import nodes_to_transfer


def test_weight_then_use_then_number():
    working = {1: 5, 2: 4, 3: 9, 4: 9}
    assert nodes_to_transfer(working, {1: 1, 2: 0, 3: 0, 4: 0}, 3) == [2, 3, 4]
    assert nodes_to_transfer(working, dict.fromkeys(working, 0), 4) == [2, 1, 3, 4]
    assert nodes_to_transfer(working, dict.fromkeys(working, 0), 2, by_number=True) == [1, 2]
    assert nodes_to_transfer(working, {1: 0, 2: -1, 3: 0, 4: 0}, 1) == [2]
    assert nodes_to_transfer(working, dict.fromkeys(working, 0), 9, kept=[2, 3]) == [1, 4]
    assert nodes_to_transfer({}, {}, 2) == []


def test_what_is_recent_stays():
    """After the last loop closure, 6 of 10 nodes, 4 at least (0.4 of 10) stay; the closure's node itself always."""
    working, weights = {node: node for node in range(1, 11)}, dict.fromkeys(range(1, 11), 1)
    weights.update({8: 0, 9: 0, 10: 0})
    assert nodes_to_transfer(working, weights, 5, last_closure=5, recent_ratio=0.4) == [8, 9, 10, 1, 2]
    # 6 are recent (5 to 10); the third that goes leaves 3, less than 4: from then on only older ones.
    assert nodes_to_transfer(working, weights, 9, last_closure=5, recent_ratio=0.4) == [8, 9, 10, 1, 2, 3, 4]
    # 3 are recent (8 to 10), fewer than 4: all of them stay.
    assert nodes_to_transfer(working, weights, 9, last_closure=8, recent_ratio=0.4) == [1, 2, 3, 4, 5, 6, 7]
    # The closure is not in working memory: nothing is recent.
    assert nodes_to_transfer(working, weights, 3, last_closure=0) == [8, 9, 10]
