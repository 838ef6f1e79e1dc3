# SPDX-License-Identifier: MIT
"""Real calls of every kernel, taken from runs of slamcli: what bench_kernels.py measures.

    python benchmarks/kernel_calls.py                       runs the scenarios and writes .benchmarks/kernel_calls.pickle
    python benchmarks/kernel_calls.py --only orbslam3       those with this in their names; what else was taken stays
    python benchmarks/kernel_calls.py --table RUN.json      the slowest kernels of a run of bench_kernels.py, as Markdown

Whatever Python calls a kernel for is looked at on its way: of each kernel the slowest of the calls number 1, 2, 4, 8, ... of each
scenario is kept with copies of its arguments. A kernel that no scenario reaches keeps the call that its room's `warm()` makes, on tiny input. Kernels
that only other kernels call are measured within those. Exit code 1: a scenario failed.
"""

from __future__ import annotations

import argparse
import copy
import importlib
import json
import pickle
import pkgutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from kernel_scenarios import scenarios
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

import slamcli
from slamcli.cli.main import run
from slamcli.cli.warmup import ROOMS

ROOT = Path(__file__).resolve().parent.parent
CALLS = ROOT / ".benchmarks" / "kernel_calls.pickle"
WARM = "warm"
"""Stands for a scenario: the call that a room's `warm()` makes."""
_LARGE = 16 * 2**20
"""Bytes above which empty blocks of an array are left out."""
_BLOCK = 2**16
"""Elements of a block."""


class Packed:
    """A large array that is zero for the most part (a store with room to grow), without its empty blocks."""

    def __init__(self, array: NDArray[Any]) -> None:
        self._shape, self._dtype = array.shape, array.dtype
        flat = array.reshape(-1)
        starts = range(0, flat.size, _BLOCK)
        self._blocks = {
            start: flat[start : start + _BLOCK].copy() for start in starts if flat[start : start + _BLOCK].any()
        }

    def __deepcopy__(self, memo: dict[int, Any]) -> Packed:  # nobody writes to it
        return self

    def array(self) -> NDArray[Any]:
        """Return a new array with the same content; as in the store, empty blocks take no memory before they are written to."""
        flat = np.zeros(int(np.prod(self._shape)), self._dtype)
        for start, block in self._blocks.items():
            flat[start : start + len(block)] = block
        return flat.reshape(self._shape)


def packed(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a copy of a kernel's arguments to keep."""
    large = [isinstance(a, np.ndarray) and a.nbytes > _LARGE and a.flags.c_contiguous for a in arguments]
    return copy.deepcopy(tuple(Packed(a) if big else a for a, big in zip(arguments, large, strict=True)))


@dataclass
class Call:
    """One call of a kernel."""

    module: str
    name: str
    packed: tuple[Any, ...]
    seconds: float
    scenario: str

    @property
    def key(self) -> str:
        """The room, file and name of the kernel."""
        return f"{self.module.removeprefix('slamcli.')}.{self.name}"

    def arguments(self) -> tuple[Any, ...]:
        """Return new copies of the arguments, which the kernel may write to."""
        return tuple(a.array() if isinstance(a, Packed) else a for a in copy.deepcopy(self.packed))

    def input_size(self) -> str:
        """Tell the shapes of the three largest arrays among the arguments."""
        arrays = sorted(_arrays(self.arguments()), key=lambda a: -a.nbytes)[:3]
        return ", ".join(f"{' × '.join(map(str, a.shape))} {a.dtype}" for a in arrays) or "numbers"


def _arrays(value: Any) -> list[NDArray[Any]]:
    if isinstance(value, np.ndarray):
        return [value]
    return [a for part in value for a in _arrays(part)] if isinstance(value, tuple | list) else []


class Recorder:
    """Stands for one kernel: passes calls on, and keeps one of them."""

    def __init__(self, module: str, name: str, kernel: Dispatcher, book: Book) -> None:
        self._module, self._name, self._kernel, self._book = module, name, kernel, book
        self._count, self._scenario = 0, book.scenario

    def __call__(self, *arguments: Any) -> Any:
        if self._scenario != self._book.scenario:
            self._count, self._scenario = 0, self._book.scenario
        self._count += 1
        if self._count & (self._count - 1):
            return self._kernel(*arguments)
        kept, compiled = packed(arguments), len(self._kernel.signatures)
        start = time.thread_time()  # not disturbed by other work
        result = self._kernel(*arguments)
        seconds = time.thread_time() - start
        if len(self._kernel.signatures) > compiled:  # the time is the compiler's
            seconds = 0.0
        self._book.offer(Call(self._module, self._name, kept, seconds, self._book.scenario))
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kernel, name)


class Book:
    """The calls that were kept."""

    def __init__(self) -> None:
        self.calls: dict[str, Call] = {}
        self.scenario = WARM
        self._recorders: dict[int, Recorder] = {}

    def offer(self, call: Call) -> None:
        """Keep the call if it is from a real run and slower than the one there is."""
        known = self.calls.get(call.key)
        if known is None or known.scenario == WARM or (call.scenario != WARM and call.seconds > known.seconds):
            self.calls[call.key] = call

    def recorder(self, module: str, name: str, kernel: Dispatcher) -> Recorder:
        """Return the one recorder of a kernel, wherever it is imported."""
        if id(kernel) not in self._recorders:
            self._recorders[id(kernel)] = Recorder(module, name, kernel, self)
        return self._recorders[id(kernel)]


def find_kernels() -> dict[str, dict[str, Dispatcher]]:
    """Return every kernel by module and name."""
    for found in pkgutil.walk_packages(slamcli.__path__, "slamcli."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
    kernels: dict[str, dict[str, Dispatcher]] = {}
    for name in sorted(sys.modules):
        if name.startswith("slamcli.") and name.endswith("_kernels"):
            own = vars(sys.modules[name])
            kernels[name] = {k: v for k, v in own.items() if isinstance(v, Dispatcher) and v.py_func.__module__ == name}
    return kernels


@contextmanager
def listening(book: Book) -> Iterator[list[tuple[ModuleType, str, Any]]]:
    """Put recorders where Python code refers to kernels, for a while; kernels go on calling each other directly.

    Gives what was replaced: module, attribute, and the kernel or module of kernels that stood there.
    """
    kernels = find_kernels()
    by_identity = {id(k): (module, name, k) for module, own in kernels.items() for name, k in own.items()}
    proxies: dict[str, ModuleType] = {}
    for module, own in kernels.items():
        proxies[module] = ModuleType(module)
        vars(proxies[module]).update(vars(sys.modules[module]))
        vars(proxies[module]).update({name: book.recorder(module, name, kernel) for name, kernel in own.items()})
    replaced: list[tuple[ModuleType, str, Any]] = []
    for holder in [m for n, m in sys.modules.items() if n.startswith("slamcli") and n not in kernels]:
        for attribute, value in list(vars(holder).items()):
            if isinstance(value, ModuleType) and value.__name__ in proxies:
                replaced.append((holder, attribute, value))
                setattr(holder, attribute, proxies[value.__name__])
            elif id(value) in by_identity:
                replaced.append((holder, attribute, value))
                setattr(holder, attribute, book.recorder(*by_identity[id(value)]))
    try:
        yield replaced
    finally:
        for holder, attribute, value in replaced:
            setattr(holder, attribute, value)


def load_calls(source: Path = CALLS) -> list[Call]:
    """Return the calls that were kept, by the names of their kernels; none where there is no file."""
    if not source.exists():
        return []
    return [Call(**fields) for fields in pickle.loads(source.read_bytes())]


def save_calls(calls: dict[str, Call], target: Path = CALLS) -> None:
    """Write the calls that were kept."""
    target.parent.mkdir(exist_ok=True)
    target.write_bytes(pickle.dumps([vars(calls[key]) for key in sorted(calls)]))


def run_scenarios(book: Book, only: str) -> list[str]:
    """Run the scenarios with `only` in their names, and return those that failed."""
    failed = []
    with tempfile.TemporaryDirectory() as temporary:
        for name, arguments in scenarios(Path(temporary)):
            if only not in name:
                continue
            book.scenario = name
            start = time.process_time()
            code = run(arguments if arguments[0] == "evaluate" else [*arguments, "-q"])
            seconds = time.process_time() - start
            print(f"{name}: exit code {code}, {seconds:.1f} s, {len(book.calls)} kernels so far", file=sys.stderr)
            if code:
                failed.append(name)
    return failed


def record(only: str) -> int:
    """Run everything, write the calls that were kept, and tell what was not reached; return the exit code."""
    book = Book()
    with listening(book):
        for room in ROOMS:
            importlib.import_module(f"slamcli.{room}").warm()
        for call in load_calls() if only else []:
            book.offer(call)
        failed = run_scenarios(book, only)
    save_calls(book.calls)
    known = {f"{m.removeprefix('slamcli.')}.{n}" for m, own in find_kernels().items() for n in own}
    tiny = sorted(key for key, call in book.calls.items() if call.scenario == WARM)
    print(f"{len(book.calls)} kernels that Python calls, of {len(known)}")
    print(f"called by other kernels only: {', '.join(sorted(known - set(book.calls)))}")
    print(f"reached by no scenario, so on the tiny input of warm(): {', '.join(tiny) or 'none'}")
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


def table(source: Path, rows: int = 40) -> str:
    """Return the slowest kernels of a run of bench_kernels.py (pytest-benchmark's JSON) as a Markdown table."""
    runs = json.loads(source.read_text())["benchmarks"]
    runs.sort(key=lambda run: (-run["stats"]["median"], run["name"]))
    lines = ["| kernel | median CPU time | largest arrays | taken from |", "|---|---|---|---|"]
    for found in runs[:rows]:
        kernel = found["name"].partition("[")[2].rstrip("]")
        about = found["extra_info"]
        seconds = f"{found['stats']['median'] * 1e3:.3g} ms"
        lines.append(f"| `{kernel}` | {seconds} | {about['input']} | {about['scenario']} |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--table", type=Path, metavar="RUN.json")
    options = parser.parse_args()
    if options.table is None:
        return record(options.only)
    print(table(options.table))
    return 0


if __name__ == "__main__":
    import kernel_calls  # under its name, by which what it keeps is found again

    sys.exit(kernel_calls.main())
