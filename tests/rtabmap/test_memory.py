# SPDX-License-Identifier: MIT
"""Short-term, working and long-term memory: rehearsal, weights, transfer and retrieval."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory_worlds import FEATURES, World, parameters, place_features

from slamcli.errors import DataError
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.memory_records import MemorySizes
from slamcli.rtabmap.signature import is_bad

pytestmark = pytest.mark.kernels


def test_nodes_age_from_short_term_into_working_memory():
    world = World(parameters())
    for place in range(5):
        world.see(place)
    memory = world.memory
    assert memory.short_term == [3, 4, 5]
    assert memory.working == [1, 2]
    assert memory.sizes() == MemorySizes(short_term=3, working=2, long_term=0, words=5 * FEATURES)
    memory.begin_session()
    assert memory.short_term == []
    assert memory.working == [1, 2, 3, 4, 5]
    with pytest.raises(DataError, match="node 5 is there already"):
        memory.add(memory.recall(5), world.graph)


def test_only_the_strongest_key_points_become_words():
    world = World(parameters())
    signature, _ = world.see(1, number=FEATURES + 5)
    assert (signature.word_ids[:FEATURES] > 0).all()
    assert (signature.word_ids[FEATURES:] == 0).all()
    bounded = World(parameters(kp={"max_features": 0}))
    assert (bounded.see(1, number=50)[0].word_ids > 0).all()
    nothing = World(parameters(kp={"max_features": -1}))
    assert not nothing.see(1)[0].word_ids.any()


def test_bad_images_have_no_words():
    """Less than half of 20, or of the mean of those in memory."""
    world = World(parameters())
    assert is_bad(world.see(1, number=9)[0])
    signature, _ = world.see(2, number=10)
    assert not is_bad(signature)
    unbounded = World(parameters(kp={"max_features": 0}))
    unbounded.see(1, number=40)
    assert is_bad(unbounded.see(2, number=19)[0])
    assert unbounded.see(3, number=20)[0].word_ids.all()


# --- rehearsal -----------------------------------------------------------------------------------------------------


def test_rehearsal_while_moving_moves_the_weight_only():
    world = World(parameters())
    world.see(1)
    _, added = world.see(1, view=1)
    assert added.similarity > 0.6
    assert added.merged_id is None
    assert [world.memory.weight(node) for node in (1, 2)] == [1, 0]
    world.see(1, view=2)  # compared with the last: 0 + 0 + 1
    assert [world.memory.weight(node) for node in (1, 2, 3)] == [1, 1, 0]
    assert world.memory.take_changed_weights() == [(1, 1), (2, 1)]
    assert world.memory.take_changed_weights() == []


def test_rehearsal_while_standing_merges_into_the_older():
    world = World(parameters())
    world.see(1)
    for view, weight in ((1, 1), (2, 2)):
        _, added = world.see(1, view=view, moved=False)
        assert (added.kept_id, added.merged_id) == (1, view + 1)
        assert world.memory.weight(1) == weight
    assert world.memory.short_term == [1]
    assert list(world.graph.nodes) == [1]
    world.memory.dictionary.drop_unused()
    assert len(world.memory.dictionary) == FEATURES


def test_rehearsal_may_keep_the_newer():
    world = World(parameters(mem={"rehearsal_id_updated_to_new_one": True}))
    first, _ = world.see(1)
    _, added = world.see(1, view=1, moved=False)
    assert (added.kept_id, added.merged_id) == (2, 1)
    kept = world.memory.recall(2)
    assert kept.features is first.features  # what the first saw, under the new number
    assert kept.id == 2
    assert world.memory.weight(2) == 1
    moving = World(parameters(mem={"rehearsal_id_updated_to_new_one": True}))
    moving.see(1)
    moving.see(1, view=1)
    assert [moving.memory.weight(node) for node in (1, 2)] == [0, 1]


@pytest.mark.parametrize(
    "mem",
    [{"rehearsal_similarity": 1.0}, {"rehearsal_weight_ignored_while_moving": True}, {"incremental_memory": False}],
)
def test_no_rehearsal(mem: dict):
    world = World(parameters(mem=mem))
    world.see(1)
    world.see(1)
    assert [world.memory.weight(node) for node in (1, 2)] == [0, 0]


def test_without_a_link_a_node_becomes_intermediate():
    world = World(parameters())
    world.see(1)
    world.previous = None
    world.see(1, view=1, moved=False)
    assert [world.memory.weight(node) for node in (1, 2)] == [1, -1]
    world.see(2)
    world.see(3)
    assert world.memory.short_term == [1, 2, 3, 4]  # intermediate nodes do not count
    world.see(4)
    assert world.memory.short_term == [2, 3, 4, 5]


def test_seeing_the_same_while_standing():
    world = World(parameters())
    world.see(1)
    signature, _ = world.see(2)
    assert world.memory.rehearse(signature)
    assert world.memory.weight(2) == 1
    other = place_features(7)
    unlike = type(signature)(
        id=9, map_id=0, stamp_ns=9, T_odom_base=np.eye(4), features=other, points=np.zeros((FEATURES, 3)),
        word_ids=world.memory.words_of(other),
    )  # fmt: skip
    assert not world.memory.rehearse(unlike)
    world.see(3)  # words that no node shows are gone
    assert len(world.memory.dictionary) == 3 * FEATURES


# --- loops ---------------------------------------------------------------------------------------------------------


def test_a_place_seen_again_is_the_best_hypothesis():
    world = World(parameters())
    for place in range(12):
        world.see(place, clutter=5)
    for round_ in range(3):
        signature, _ = world.see(4 + round_, view=5, clutter=5)
        likelihood = world.memory.likelihood(signature)
        assert likelihood.ids.tolist() == world.memory.working
        assert int(likelihood.ids[np.argmax(likelihood.scores)]) == 5 + round_
        posterior = world.memory.posterior(likelihood, world.graph)
        assert posterior.best[0] == 5 + round_
    assert posterior.best[1] > 0.7


def test_a_new_place_is_the_virtual_one():
    world = World(parameters())
    for place in range(12):
        signature, _ = world.see(place)
        likelihood = world.memory.likelihood(signature)
        if likelihood is not None:
            posterior = world.memory.posterior(likelihood, world.graph)
    assert posterior.virtual > 0.9
    assert likelihood.values.tolist() == [2.0] + [1.0] * 9
    assert world.memory.likelihood(world.see(3, number=5)[0]) is None


def test_closures_move_weights():
    world = World(parameters())
    for place in range(5):
        world.see(place)
    memory = world.memory
    memory._held.weights[1], memory._held.weights[5] = 3, 1
    memory.closed(1, 5, by_scans=True)
    assert memory.last_closure == 0
    memory.closed(5, 1)
    assert (memory.weight(1), memory.weight(5), memory.last_closure) == (0, 4, 5)
    memory.closed(1, 99)
    assert memory.last_closure == 5


def test_a_reduced_graph_keeps_the_older():
    world = World(parameters(mem={"reduce_graph": True}))
    for place in (0, 1, 2, 3, 4, 0):
        world.see(place)
    world.memory._held.weights[6] = 2
    world.tie(1, 6, LinkKind.GLOBAL_CLOSURE)
    world.memory.closed(1, 6)
    assert world.memory.weight(1) == 2
    world.see(5)
    world.see(6)
    _, added = world.see(7)
    assert added.reduced == ((6, 1),)
    assert world.memory.last_closure == 1
    assert world.memory.short_term == [7, 8, 9]
    assert 6 not in world.graph.nodes
    assert world.graph.are_linked(1, 7)


# --- long-term memory ----------------------------------------------------------------------------------------------


def bounded(nodes: int = 6, **mem) -> World:
    """A world whose working memory has room for so many, nothing is near, and neighbours are two links away at most."""
    return World(
        parameters(
            rtabmap={"memory_thr": nodes},
            mem=mem,
            rgbd={"local_radius": 0.5, "local_immunization_ratio": 0.0},
            bayes={"prediction_lc": "0.1 0.5 0.3 0.1"},
        )
    )


def test_the_oldest_of_the_least_weight_goes():
    world = bounded(5)
    gone = []
    for place in range(10):
        world.see(place)
        world.memory._held.weights[2] = 1
        gone.append(world.memory.transfer(world.graph))
    # The sixth node of working memory comes with node 9. Two go, one more than came; 2 stays for its weight.
    assert gone == [[]] * 8 + [[1, 3], []]
    assert world.memory.working == [2, 4, 5, 6, 7]
    assert world.memory.sizes().long_term == 2
    assert world.memory.signature(1) is None
    assert world.memory.recall(1).id == 1
    world.memory.dictionary.drop_unused()
    assert len(world.memory.dictionary) == 8 * FEATURES


def test_words_come_back_with_their_node():
    world = bounded(5)
    for place in range(10):
        world.see(place)
        world.memory.transfer(world.graph)
    world.see(10)
    assert world.memory.retrieve(3, world.graph) == [2, 1]
    assert world.memory.working[:2] == [1, 2]
    for node in (1, 2):
        assert world.memory.recall(node).word_ids.tolist() == world.store.nodes[node].word_ids.tolist()
    assert sorted(world.memory._immune)[:3] == [1, 2, 3]
    assert world.memory.working == [1, 2, 3, 4, 5, 6, 7, 8]
    assert world.memory.transfer(world.graph) == [6, 7]  # not what is around the hypothesis


def test_words_that_look_the_same_by_now_are_taken():
    """A place whose words were forgotten is seen anew; when its first node comes back, it has the new words."""
    world = bounded(4)
    for place in range(9):
        world.see(place)
        world.memory.transfer(world.graph)
    assert world.memory.signature(1) is None
    again, _ = world.see(0)
    assert (again.word_ids > world.store.nodes[1].word_ids.max()).all()
    world.memory._bring_back([1])
    assert world.memory.recall(1).word_ids.tolist() == again.word_ids.tolist()
    assert world.memory.likelihood(again).scores.argmax() == 0


def test_retrieval_is_by_time_first_then_by_space():
    world = bounded(3)
    for place in range(12):
        world.see(place)
        world.memory.transfer(world.graph)
    world.tie(6, 1, LinkKind.GLOBAL_CLOSURE)
    for node in (5, 6, 7, 1):
        if world.memory.signature(node) is not None:
            world.memory._release(node)
    world.memory._bring_back([6])
    assert world.memory.retrieve(6, world.graph) == [7, 5]
    world.memory._rtabmap = parameters(rtabmap={"max_retrieved": 9, "memory_thr": 3}).rtabmap
    found = world.memory.retrieve(6, world.graph)
    assert found == [4, 1, 2]  # two links along the odometry, then those that the closure leads to


def test_what_is_near_comes_back_and_stays():
    """The robot goes 20 m along a line and turns back: nodes beside those that are near are read."""
    settings = parameters(rtabmap={"memory_thr": 5}, rgbd={"local_radius": 2.5, "local_immunization_ratio": 0.5})
    world = World(settings)
    for place in range(12):
        world.see(place)
        world.memory.retrieve(0, world.graph, here=world.previous)
        world.memory.transfer(world.graph)
    assert 9 in world.memory.working  # near ones stay
    outside = [node for node in range(1, 10) if world.memory.signature(node) is None]
    border = max(outside)
    world.see(20, x=float(border) + 1.0)
    world.tie(border + 1, 13, LinkKind.LOCAL_SPACE_CLOSURE)
    assert border in world.memory.retrieve(0, world.graph, here=13)


def test_no_long_term_memory_without_a_store():
    world = World(parameters(rtabmap={"memory_thr": 1}), with_store=False)
    for place in range(6):
        world.see(place)
        assert world.memory.transfer(world.graph) == []
    assert not world.memory.bounded
    with pytest.raises(DataError, match="no database"):
        world.memory.recall(99)


def test_memory_begins_where_the_last_session_ended():
    world = bounded(5)
    for place in range(10):
        world.see(place)
        world.memory.transfer(world.graph)
    working = [*world.memory.working, *world.memory.short_term]
    again = World(parameters())
    again.store, again.graph = world.store, world.graph
    again.memory._store = world.store
    again.memory.restore(dict.fromkeys(world.graph.nodes, 2), working, last_word=max(world.store.words))
    assert again.memory.working == sorted(working)
    assert again.memory.sizes().long_term == 10 - len(working)
    assert again.memory.weight(4) == 2
    again.next_id = 11
    signature, _ = again.see(5, view=1)
    likelihood = again.memory.likelihood(signature)
    assert int(likelihood.ids[np.argmax(likelihood.scores)]) == 6
    everything = World(parameters(mem={"init_wm_with_all_nodes": True}))
    everything.memory._store = world.store
    everything.memory.restore(dict.fromkeys(range(1, 11), 0), working)
    assert everything.memory.working == list(range(1, 11))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), room=st.integers(2, 8))
def test_memory_is_always_in_step(seed: int, room: int):
    """Whatever happens, each node is in one memory, words are those of the nodes at hand, and working memory keeps its bound."""
    rng = np.random.default_rng(seed)
    world = World(
        parameters(
            rtabmap={"memory_thr": room}, rgbd={"local_radius": 3.0}, mem={"reduce_graph": bool(rng.integers(2))}
        )
    )
    memory = world.memory
    for _ in range(25):
        _, added = world.see(int(rng.integers(8)), view=int(rng.integers(3)), moved=bool(rng.random() < 0.8))
        kept = memory.recall(added.kept_id)
        likelihood = memory.likelihood(kept)
        best = 0
        if likelihood is not None:
            posterior = memory.posterior(likelihood, world.graph)
            assert posterior.virtual + posterior.values.sum() == pytest.approx(1.0)
            best = posterior.best[0]
        retrieved = memory.retrieve(best, world.graph, here=added.kept_id)
        if best and rng.random() < 0.3 and not world.graph.are_linked(best, kept.id):
            world.tie(best, kept.id, LinkKind.GLOBAL_CLOSURE)
            memory.closed(best, kept.id)
        gone = memory.transfer(world.graph)
        assert not set(gone) & set(retrieved)
        held = {*memory.short_term, *memory.working}
        assert len(held) == len(memory.short_term) + len(memory.working)
        assert held == set(memory._held.signatures) == set(memory._held.bags)
        assert len(held) == len(memory._held.file)
        assert memory.sizes().long_term == len(set(world.graph.nodes) - held)
        memory.dictionary.drop_unused()
        shown = {int(word) for node in held for word in memory.recall(node).word_ids if word > 0}
        assert set(memory.dictionary._rows) == shown
        assert min((memory.weight(node) for node in held), default=0) >= -1
