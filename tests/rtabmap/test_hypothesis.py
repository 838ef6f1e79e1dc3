# SPDX-License-Identifier: MIT
"""Which hypotheses are verified."""

from __future__ import annotations

import numpy as np
import pytest
from memory_worlds import World, parameters

from slamcli.rtabmap.hypothesis import Hypothesis, LoopDetector
from slamcli.rtabmap.links import LinkKind

pytestmark = pytest.mark.kernels


def turned(degrees: float) -> np.ndarray:
    """Pixels of 40 points at different depths, seen from a place to the side."""
    rng = np.random.default_rng(3)
    points = rng.uniform([-2, -1.5, 3], [2, 1.5, 8], (40, 3))
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    seen = points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T - [0.3 * bool(degrees), 0, 0]
    return 500 * seen[:, :2] / seen[:, 2:] + [320, 240]


def loop(settings, *, first: int = 12, again: int = 3) -> tuple[World, list[Hypothesis]]:
    """A robot that sees 12 places, then those from the fourth on again."""
    world = World(settings)
    detector = LoopDetector(settings, world.memory, seed=0)
    found = []
    for number in range(first + again):
        place, view = (number, 0) if number < first else (number - first + 3, 1)
        signature, _ = world.see(place, view=view, clutter=5)
        found.append(detector.hypothesis(signature, world.graph))
    return world, found


def test_loops_are_accepted_and_new_places_are_not():
    _, found = loop(parameters())
    assert found[0] == Hypothesis(reason="no places in working memory")
    assert found[3].reason == "the only place in working memory"
    assert [one.reason[:12] for one in found[6:12]] == ["posterior 0."] * 6
    assert [(one.node, one.accepted) for one in found[12:]] == [(4, True), (5, True), (6, True)]
    assert [one.posterior > 0.11 for one in found[12:]] == [True] * 3


def test_the_only_place_is_not_enough():
    world, found = loop(parameters(), first=3, again=0)
    signature, _ = world.see(0, view=1)
    found = LoopDetector(parameters(rtabmap={"loop_thr": 0.01}), world.memory, seed=0).hypothesis(
        signature, world.graph
    )
    assert (found.node, found.accepted, found.reason) == (1, False, "the only place in working memory")


def test_a_session_that_is_not_tied_is_eager():
    settings = parameters(rtabmap={"loop_thr": 1.0}, rgbd={"aggressive_loop_thr": 0.05})
    world, found = loop(settings)
    assert not any(one.accepted for one in found)
    detector = LoopDetector(settings, world.memory, seed=0)
    world.memory.begin_session()
    world.previous = None
    signature, _ = world.see(8, view=2, clutter=5)
    hypothesis = detector.hypothesis(signature, world.graph)
    assert (hypothesis.node, hypothesis.accepted) == (9, True)
    world.tie(9, signature.id, LinkKind.GLOBAL_CLOSURE)
    signature, _ = world.see(9, view=2, clutter=5)
    assert detector.hypothesis(signature, world.graph).reason.endswith("below 1")


def test_a_hypothesis_must_grow_where_asked():
    settings = parameters(rtabmap={"loop_ratio": 5.0})
    _, found = loop(settings)
    assert "of the one before" in found[13].reason
    assert not found[13].accepted


def test_epipolar_geometry():
    """The same place with its points where another view has them, and with points that moved about."""
    settings = parameters(vhep={"enabled": True, "match_count_min": 30}, kp={"max_features": 40})
    for pixels, accepted in ((turned(10), True), (np.random.default_rng(0).uniform(0, 600, (40, 2)), False)):
        world = World(settings)
        detector = LoopDetector(settings, world.memory, seed=0)
        for place in range(8):
            world.see(place, number=40, pixels=turned(0), clutter=5)
        signature, _ = world.see(2, number=40, pixels=pixels, clutter=5)
        for _ in range(2):
            found = detector.hypothesis(signature, world.graph)
        assert found.node == 3
        assert found.accepted == accepted
        assert found.reason == ("" if accepted else "epipolar geometry")


def test_images_without_words_say_nothing():
    world, _ = loop(parameters())
    detector = LoopDetector(parameters(), world.memory, seed=0)
    signature, _ = world.see(3, number=4)
    assert detector.hypothesis(signature, world.graph) == Hypothesis(reason="no words")
