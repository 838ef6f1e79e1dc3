# SPDX-License-Identifier: MIT
"""CPU time of every kernel on a real call of it (pytest-benchmark).

    python benchmarks/kernel_calls.py                                   once: takes the calls from runs of slamcli
    pytest benchmarks/bench_kernels.py -p no:xdist                      all kernels
    pytest benchmarks/bench_kernels.py -k registration --benchmark-compare

Each round gets fresh copies of the arguments, which kernels may write to. Time is that of the process, so that other work on the
machine disturbs little; compare runs of one machine only.
"""

from __future__ import annotations

import copy
import importlib
import pickle
import time
from typing import TYPE_CHECKING

import pytest
from kernel_calls import CALLS

if TYPE_CHECKING:
    from kernel_calls import Call

_ROUNDS_S = 0.2
"""How long each kernel is measured for, seconds."""


def _calls() -> list[Call]:
    if not CALLS.exists():
        return []
    with CALLS.open("rb") as stream:
        return pickle.load(stream)


@pytest.mark.parametrize("call", _calls(), ids=lambda call: call.key)
@pytest.mark.benchmark(timer=time.process_time)
def test_kernel(benchmark, call):
    kernel = getattr(importlib.import_module(call.module), call.name)
    kernel(*copy.deepcopy(call.arguments))  # compiled, or loaded from the cache
    benchmark.group = call.module.removeprefix("slamcli.").partition(".")[0]
    benchmark.extra_info.update(
        scenario=call.scenario, shapes=[str(getattr(a, "shape", a))[:60] for a in call.arguments]
    )
    rounds = int(min(max(_ROUNDS_S / max(call.seconds, 1e-6), 5), 1000))
    benchmark.pedantic(kernel, setup=lambda: (copy.deepcopy(call.arguments), {}), rounds=rounds)


def test_there_are_calls():
    if not CALLS.exists():
        pytest.fail(f"no {CALLS.name}: run python benchmarks/kernel_calls.py first")
