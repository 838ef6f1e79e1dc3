# SPDX-License-Identifier: MIT
"""The filter over places by hand and against a naive twin."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import DataError
from slamcli.rtabmap.bayes_filter import BayesFilter, Posterior
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.place_links import LinkTable, PlaceLinks

pytestmark = pytest.mark.kernels

DEFAULT = (0.1, 0.36, 0.30, 0.16, 0.062, 0.0151, 0.00255, 0.000324, 2.5e-05, 1.3e-06, 4.8e-08, 1.2e-09, 1.9e-11, 2.2e-13,
           1.7e-15, 8.5e-18, 2.9e-20, 6.9e-23)  # fmt: skip


def link(a: int, b: int, kind: LinkKind = LinkKind.NEIGHBOR) -> Link:
    return Link(from_id=a, to_id=b, kind=kind, T_from_to=np.eye(4), information=np.eye(6))


def linked(ids: list[int], links: list[Link], intermediate: frozenset[int] = frozenset()) -> PlaceLinks:
    return LinkTable().among(
        ids, lambda place: [x for x in links if place in (x.from_id, x.to_id)], intermediate=intermediate
    )


def naive_levels(start: int, ids: list[int], links: list[Link], deepest: int, intermediate: frozenset[int]):
    """How far places are, by relaxing all links until nothing changes."""
    level = {start: 0}
    for _ in range(2 * len(ids) + 2):
        for x in links:
            for a, b in ((x.from_id, x.to_id), (x.to_id, x.from_id)):
                if a in level and a in ids and b in ids and x.kind != LinkKind.LOCAL_SPACE_CLOSURE:
                    step = 1 if x.kind in (0, 6) and a not in intermediate else 0
                    level[b] = min(level.get(b, 99), level[a] + step)
    return {place: depth for place, depth in level.items() if depth <= deepest and place in ids}


def naive_predict(posterior, states, ids, links, prediction, virtual_prior, intermediate):
    """As RTAB-Map fills and normalises the columns of its matrix."""
    size = len(states) + 1
    matrix = np.zeros((size, size))
    total, least = sum(prediction), min(prediction)
    if size == 1:
        matrix[0, 0] = 1.0
    elif virtual_prior > 0:
        matrix[:, 0] = (1 - virtual_prior) / (size - 1)
        matrix[0, 0] = virtual_prior
    else:
        matrix[:, 0] = 1 / size
    for s, state in enumerate(states, 1):
        column = matrix[:, s]
        for place, depth in naive_levels(state, ids, links, len(prediction) - 2, intermediate).items():
            if place in states:
                column[1 + states.index(place)] = prediction[depth + 1]
        added = column.sum()
        if added < total - prediction[0]:
            column[s] += total - prediction[0] - added
        if total < 1:
            column[1:][column[1:] == 0] = (1 - total) / (size - 1)
        added = column.sum()
        if abs(added - (1 - prediction[0])) > 1e-4 and added > 0:
            column *= (1 - prediction[0]) / added
            column[column < least] = 0.0
        column[0] = prediction[0]
    return matrix @ posterior


def test_a_chain_by_hand():
    """Three places in a row; the robot was at the middle one for sure, then sees nothing special."""
    links = linked([1, 2, 3], [link(1, 2), link(2, 3)])
    filter_ = BayesFilter((0.1, 0.5, 0.4), 0.9)
    ids = np.array([1, 2, 3])
    filter_.update(ids, np.array([0.0, 0.0, 1.0, 0.0]), links)
    # 0.5 + 2 * 0.4 = 1.3 is scaled to 0.9.
    assert filter_.predict(ids, links) == pytest.approx([0.1, 0.36 / 1.3, 0.45 / 1.3, 0.36 / 1.3])
    posterior = filter_.update(ids, np.array([1.0, 1.0, 1.0, 2.0]), links)
    weights = np.array([0.1, 0.36 / 1.3, 0.45 / 1.3, 2 * 0.36 / 1.3])
    assert [posterior.virtual, *posterior.values] == pytest.approx(weights / weights.sum())
    assert posterior.best == (3, pytest.approx(1 - 0.1 / weights.sum()))


def test_an_end_of_the_chain_keeps_what_is_missing():
    """One neighbour only: 0.5 + 0.4 = 0.9 is as it should be; without any, all stays: 0.9."""
    filter_ = BayesFilter((0.1, 0.5, 0.4), 0.9)
    ids = np.array([1, 2])
    links = linked([1, 2], [link(1, 2)])
    filter_.update(ids, np.array([0.0, 1.0, 0.0]), links)
    assert filter_.predict(ids, links) == pytest.approx([0.1, 0.5, 0.4])
    assert filter_.predict(np.array([1]), linked([1], [])) == pytest.approx([0.1, 0.9])


def test_places_tied_by_a_closure_are_one():
    links = [link(1, 2), link(2, 3), link(3, 4), link(4, 1, LinkKind.GLOBAL_CLOSURE)]
    table = linked([1, 2, 3, 4], links)
    filter_ = BayesFilter((0.1, 0.4, 0.3), 0.9)
    ids = np.array([1, 2, 3, 4])
    filter_.update(ids, np.array([0.0, 1.0, 0.0, 0.0, 0.0]), table)
    # 1 and 4 are level 0; 2 and 3 level 1: 0.4 + 0.4 + 0.3 + 0.3 = 1.4 scaled to 0.9.
    assert filter_.predict(ids, table) == pytest.approx([0.1, 0.36 / 1.4, 0.27 / 1.4, 0.27 / 1.4, 0.36 / 1.4])
    near = linked([1, 2, 3, 4], [*links[:3], link(4, 1, LinkKind.LOCAL_SPACE_CLOSURE)])
    assert len(near.others) == 6  # not by proximity


def test_intermediate_nodes_take_no_step():
    """1 - 2 - 3 with 2 intermediate: 3 is one step from 1."""
    links = [link(1, 2), link(2, 3)]
    table = linked([1, 2, 3], links, frozenset({2}))
    filter_ = BayesFilter((0.1, 0.5, 0.4), 0.9)
    filter_.update(np.array([1, 3]), np.array([0.0, 1.0, 0.0]), table)
    assert filter_.predict(np.array([1, 3]), table) == pytest.approx([0.1, 0.5, 0.4])


def test_new_places_spread_and_places_that_come_begin_with_nothing():
    filter_ = BayesFilter((0.1, 0.9), 0.8)
    nothing = linked([1, 2], [])
    filter_.update(np.array([1, 2]), np.array([1.0, 0.0, 0.0]), nothing)
    assert filter_.predict(np.array([1, 2]), nothing) == pytest.approx([0.8, 0.1, 0.1])
    filter_.update(np.array([1]), np.array([0.0, 1.0]), linked([1], []))
    assert filter_.predict(np.array([1, 2]), nothing) == pytest.approx([0.1, 0.9, 0.0])
    filter_.reset()
    # All alike: the virtual place, 1 and 2 with weight 1 each.
    assert filter_.predict(np.array([1, 2]), nothing) == pytest.approx([1.0, 1.0, 1.0])


def test_no_places():
    posterior = BayesFilter(DEFAULT, 0.9).update(np.zeros(0, np.int64), np.array([2.0]), linked([], []))
    assert posterior.virtual == 1.0
    assert posterior.best == (0, 0.0)


def test_of_equal_places_the_newest_is_best():
    posterior = Posterior(np.array([1, 5, 9]), np.array([0.3, 0.3, 0.1]), 0.3)
    assert posterior.best == (5, pytest.approx(0.7))


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    size=st.integers(1, 12),
    prediction=st.sampled_from(
        [DEFAULT, (0.1, 0.4, 0.3, 0.1), (0.2, 0.3), (0.1, 0.36, 0.3), (0.0, 0.0, 0.5), (0.1, 0.9)]
    ),
    virtual=st.sampled_from([0.9, 0.5, 0.0, 1.0]),
)
def test_prediction_is_the_naive_one(seed: int, size: int, prediction: tuple[float, ...], virtual: float):
    rng = np.random.default_rng(seed)
    ids = sorted(rng.permutation(30)[:size].tolist())
    kinds = [LinkKind.NEIGHBOR, LinkKind.GLOBAL_CLOSURE, LinkKind.LOCAL_SPACE_CLOSURE, LinkKind.NEIGHBOR_MERGED]
    links = [link(a, b) for a, b in itertools.pairwise(ids) if rng.random() < 0.9]
    links += [link(int(a), int(b), kinds[rng.integers(4)]) for a, b in rng.choice(ids, (4, 2))]
    closed = {end for x in links if x.kind == LinkKind.GLOBAL_CLOSURE for end in (x.from_id, x.to_id)}
    intermediate = frozenset(i for i in ids if rng.random() < 0.1 and i not in closed)
    states = [i for i in ids if i not in intermediate and rng.random() < 0.8]
    filter_ = BayesFilter(prediction, virtual)
    seen = rng.random(len(states) + 1)
    table = linked(ids, links, intermediate)
    first = filter_.update(np.array(states, np.int64), seen, table)
    last = np.array([first.virtual, *first.values])
    assert last.sum() == pytest.approx(1.0)
    expected = naive_predict(last, states, ids, links, prediction, virtual, intermediate)
    assert filter_.predict(np.array(states, np.int64), table) == pytest.approx(expected, abs=1e-12)


def test_wrong_settings():
    for prediction in ((0.1,), (0.1, 1.2), (0.1, -0.1)):
        with pytest.raises(DataError, match="probabilities"):
            BayesFilter(prediction, 0.9)
    with pytest.raises(DataError, match="no probability"):
        BayesFilter(DEFAULT, 1.5)
    with pytest.raises(DataError, match="2 likelihoods for 2 places"):
        BayesFilter(DEFAULT, 0.9).update(np.array([1, 2]), np.ones(2), linked([1, 2], []))
