# SPDX-License-Identifier: MIT
"""CPU time of every kernel on a real call of it (pytest-benchmark).

    python benchmarks/kernel_calls.py                                   once: takes the calls from runs of slamcli
    pytest benchmarks/bench_kernels.py -p no:xdist                      all kernels
    pytest benchmarks/bench_kernels.py -k registration --benchmark-compare

Each round gets fresh copies of the arguments, which kernels may write to. Time is that of the process, so that other work on the
machine disturbs little; compare runs of one machine only.
"""

from __future__ import annotations

import importlib
import time

import pytest
from kernel_calls import CALLS, load_calls

_ROUNDS_S = 0.2
"""How long each kernel is measured for, seconds."""


@pytest.mark.parametrize("call", load_calls(), ids=lambda call: call.key)
@pytest.mark.benchmark(timer=time.process_time)
def test_kernel(benchmark, call):
    kernel = getattr(importlib.import_module(call.module), call.name)
    kernel(*call.arguments())  # compiled, or loaded from the cache
    arguments = call.arguments()
    start = time.process_time()
    kernel(*arguments)
    seconds = time.process_time() - start
    benchmark.group = call.module.removeprefix("slamcli.").partition(".")[0]
    benchmark.extra_info.update(scenario=call.scenario, input=call.input_size(), recorded_s=call.seconds)
    rounds = int(min(max(_ROUNDS_S / max(seconds, 1e-6), 5), 1000))
    benchmark.pedantic(kernel, setup=lambda: (call.arguments(), {}), rounds=rounds)


def test_there_are_calls():
    if not CALLS.exists():
        pytest.fail(f"no {CALLS.name}: run python benchmarks/kernel_calls.py first")
