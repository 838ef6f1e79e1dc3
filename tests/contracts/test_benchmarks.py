# SPDX-License-Identifier: MIT
"""The benchmarks reach every kernel and every tier; they are run by hand (docs/performance.md)."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "slamcli"
KERNEL_MODULES = {
    ".".join(("slamcli", *path.relative_to(SOURCE).with_suffix("").parts)) for path in SOURCE.rglob("*_kernels.py")
}


@pytest.fixture
def kernel_calls(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import kernel_calls

    yield kernel_calls
    del sys.modules["kernel_calls"], sys.modules["kernel_scenarios"]


def test_every_module_of_kernels_is_found(kernel_calls):
    found = kernel_calls.find_kernels()
    assert set(found) == KERNEL_MODULES
    assert [module for module, kernels in found.items() if not kernels] == []


def test_recorders_stand_before_every_module_of_kernels_and_go_again(kernel_calls):
    book = kernel_calls.Book()
    with kernel_calls.listening(book) as replaced:
        standing = [(holder, attribute, getattr(holder, attribute)) for holder, attribute, _ in replaced]
        assert all(isinstance(now, ModuleType | kernel_calls.Recorder) for *_, now in standing)
    reached = {
        was.__name__ if isinstance(was, ModuleType) else was.py_func.__module__
        for holder, _, was in replaced
        if not (isinstance(was, ModuleType) and was.__name__.rpartition(".")[0] == holder.__name__)  # a package's own
    }
    assert KERNEL_MODULES - reached == set()
    assert all(getattr(holder, attribute) is was for holder, attribute, was in replaced)


def test_what_is_kept_is_the_slowest_call_with_its_arguments_as_they_were(kernel_calls):
    book = kernel_calls.Book()
    book.scenario = "one"

    def kernel(values, store):
        values += 1.0
        return len(store)

    kernel.signatures = [()]

    recorder = kernel_calls.Recorder("slamcli.room._some_kernels", "kernel", kernel, book)
    store = np.zeros((40, 2**20), np.uint8)
    store[3, 5] = 7
    for call in range(5):
        assert recorder(np.full(3, float(call)), store) == 40
    (call,) = book.calls.values()
    values, again = call.arguments()
    assert call.key == "room._some_kernels.kernel"
    assert values.tolist() in ([0.0] * 3, [1.0] * 3, [3.0] * 3)  # calls number 1, 2 and 4
    assert np.array_equal(again, store)
    assert call.input_size() == "40 × 1048576 uint8, 3 float64"
    values[:] = 9.0
    assert call.arguments()[0][0] != 9.0


def test_calls_on_tiny_input_give_way_to_real_ones(kernel_calls, tmp_path):
    book = kernel_calls.Book()
    for scenario, seconds in (("warm", 5.0), ("drive", 1.0), ("warm", 9.0), ("map", 2.0), ("plan", 1.5)):
        book.offer(kernel_calls.Call("slamcli.room._some_kernels", "kernel", (1,), seconds, scenario))
    kernel_calls.save_calls(book.calls, tmp_path / "folder" / "calls.pickle")
    (call,) = kernel_calls.load_calls(tmp_path / "folder" / "calls.pickle")
    assert (call.scenario, call.seconds, call.arguments()) == ("map", 2.0, (1,))
    assert kernel_calls.load_calls(tmp_path / "none.pickle") == []


def test_scenarios_have_names_of_their_own(kernel_calls, tmp_path):
    names = [name for name, _ in kernel_calls.scenarios(tmp_path)]
    assert len(set(names)) == len(names) > 0


def test_every_tier_is_timed(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import bench_tiers

    timed = {arguments[arguments.index("--algo") + 1] for arguments in bench_tiers.RUNS.values()}
    del sys.modules["bench_tiers"]
    assert timed == {point.name for point in entry_points(group="slamcli.mappers")}
    assert all(Path(arguments[2]).exists() for arguments in bench_tiers.RUNS.values())
