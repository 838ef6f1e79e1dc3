# SPDX-License-Identifier: MIT
"""The modelled time of an update."""

from __future__ import annotations

import pytest
from memory_worlds import World, parameters

from slamcli.rtabmap.update_cost import UpdateWork, modelled_ms, update_work


def test_every_part_takes_time():
    base = modelled_ms(UpdateWork())
    typical = {
        "key_points": 500,
        "words": 200_000,
        "working": 1000,
        "retrieved": 2,
        "registrations": 1,
        "optimised": 1000,
    }
    assert modelled_ms(UpdateWork(**typical)) == pytest.approx(base + 2.5 + 20.0 + 5.0 + 10.0 + 20.0 + 40.0)
    for name in ("key_points", "working", "retrieved", "registrations", "optimised"):
        assert modelled_ms(UpdateWork(**{name: 100})) > base


def test_long_updates_transfer():
    """Without a bound on nodes, two go as soon as an update takes longer than it may."""
    for limit_ms, gone in ((1.0, [1, 2]), (1000.0, [])):
        world = World(parameters(rtabmap={"time_thr": limit_ms}, rgbd={"local_immunization_ratio": 0.0}))
        for place in range(6):
            signature, _ = world.see(place)
        work = update_work(signature, world.memory.sizes(), retrieved=0, registrations=0, optimised=0)
        assert (work.key_points, work.words, work.working) == (20, 120, 3)
        assert world.memory.transfer(world.graph, work=work) == gone
