# SPDX-License-Identifier: MIT
"""Real calls of every kernel, taken from runs of slamcli: what bench_kernels.py measures.

usage: kernel_calls.py [FILE]      runs the scenarios (some minutes) and writes the calls (default: .benchmarks/kernel_calls.pickle)

Whatever Python calls a kernel for is looked at on its way: of each kernel the slowest of its calls number 2, 4, 8, 16, ... is kept
with copies of its arguments. A kernel that no scenario reaches keeps the call that its room's `warm()` makes (marked `tiny`). Kernels
that only other kernels call are measured within those.
"""

from __future__ import annotations

import copy
import importlib
import pickle
import pkgutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher

import slamcli
from slamcli.cli.main import run
from slamcli.cli.warmup import ROOMS

ROOT = Path(__file__).resolve().parent.parent
CALLS = ROOT / ".benchmarks" / "kernel_calls.pickle"
SAMPLES = ROOT / "sample_data"


@dataclass
class Call:
    """One call of a kernel."""

    module: str
    name: str
    arguments: tuple[Any, ...]
    seconds: float
    scenario: str

    @property
    def key(self) -> str:
        """The room, file and name of the kernel."""
        return f"{self.module.removeprefix('slamcli.')}.{self.name}"


class Recorder:
    """Stands for one kernel: passes calls on, and keeps one of them."""

    def __init__(self, module: str, name: str, kernel: Dispatcher, book: Book) -> None:
        self._module, self._name, self._kernel, self._book = module, name, kernel, book
        self._count = 0

    def __call__(self, *arguments: Any) -> Any:
        self._count += 1
        if self._count == 1 or self._count & (self._count - 1):
            return self._kernel(*arguments)
        kept = copy.deepcopy(arguments)
        start = time.perf_counter()
        result = self._kernel(*arguments)
        self._book.offer(Call(self._module, self._name, kept, time.perf_counter() - start, self._book.scenario))
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kernel, name)


class Book:
    """The calls that were kept."""

    def __init__(self) -> None:
        self.calls: dict[str, Call] = {}
        self.scenario = "warm"
        self._recorders: dict[int, Recorder] = {}

    def offer(self, call: Call) -> None:
        """Keep the call if it is from a real run and slower than the one there is."""
        known = self.calls.get(call.key)
        if known is None or known.scenario == "warm" or (call.scenario != "warm" and call.seconds > known.seconds):
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


def listen(book: Book) -> None:
    """Put recorders where Python code refers to kernels; kernels among themselves go on calling each other directly."""
    kernels = find_kernels()
    by_identity = {id(k): (module, name, k) for module, own in kernels.items() for name, k in own.items()}
    proxies: dict[str, ModuleType] = {}
    for module, own in kernels.items():
        proxy = ModuleType(module)
        vars(proxy).update(vars(sys.modules[module]))
        vars(proxy).update({name: book.recorder(module, name, kernel) for name, kernel in own.items()})
        proxies[module] = proxy
    for holder in [m for n, m in sys.modules.items() if n.startswith("slamcli") and n not in kernels]:
        for attribute, value in list(vars(holder).items()):
            if (isinstance(value, ModuleType) and value.__name__ in proxies and not attribute.endswith("_kernels")) or (
                isinstance(value, ModuleType)
                and value.__name__ in proxies
                and holder.__name__ != value.__name__.rpartition(".")[0]
            ):
                setattr(holder, attribute, proxies[value.__name__])
            elif id(value) in by_identity:
                setattr(holder, attribute, book.recorder(*by_identity[id(value)]))


def scenarios(folder: Path) -> list[tuple[str, list[str]]]:
    """Return command lines that reach the kernels between them."""
    office, desk = str(SAMPLES / "office.bag"), str(SAMPLES / "desk_rgbd.mcap")
    plan = ["plan", "2,8.75", "24,8", "--map", str(SAMPLES / "office.map.yaml"), "--robot-radius", "0.2"]
    drive = ["navigate", "24,8", "--map", str(SAMPLES / "office.map.yaml"), "--start", "2,8.75,0", "--lean"]
    out = lambda name: ["-o", str(folder / name)]  # noqa: E731
    return [
        ("gmapping", ["map", "--algo", "gmapping", office, "--jobs", "1", *out("gmapping")]),
        ("cartographer", ["map", "--algo", "cartographer", office, "--jobs", "1", *out("cartographer")]),
        ("rtabmap laser", ["map", "--algo", "rtabmap", office, "--jobs", "1", *out("rtabmap-laser")]),
        ("rtabmap", ["map", "--algo", "rtabmap", desk, "--octomap", "--jobs", "1", *out("rtabmap")]),
        ("orbslam3 rgbd", ["map", "--algo", "orbslam3", desk, "--mode", "rgbd", "--dense", "mesh", "--jobs", "1", *out("rgbd")]),
        ("orbslam3 mono", ["map", "--algo", "orbslam3", desk, "--mode", "mono", "--jobs", "1", *out("mono")]),
        ("generate stereo", ["generate", "visual_room", str(folder / "stereo.mcap"), "--camera", "stereo", "--imu", "--duration", "8"]),
        ("orbslam3 stereo-inertial", ["map", "--algo", "orbslam3", str(folder / "stereo.mcap"), "--mode", "stereo-inertial", "--jobs", "1", *out("stereo")]),
        ("rtabmap stereo", ["map", "--algo", "rtabmap", str(folder / "stereo.mcap"), "--mode", "stereo", "--jobs", "1", *out("rtabmap-stereo")]),
        ("generate 3d", ["generate", "office", str(folder / "lidar.mcap"), "--lidar3d", "--imu", "--duration", "20"]),
        ("cartographer 3d", ["map", "--algo", "cartographer", str(folder / "lidar.mcap"), "--mode", "3d", "--jobs", "1", *out("carto3d")]),
        ("localize", ["localize", office, "--map", str(SAMPLES / "office.map.yaml"), "--global", *out("localize")]),
        ("navfn", [*plan, "--planner", "navfn", *out("navfn")]),
        ("astar", [*plan, "--planner", "astar", *out("astar")]),
        ("dijkstra", [*plan, "--planner", "dijkstra", *out("dijkstra")]),
        ("dwa", [*drive, "--people", "3", *out("dwa")]),
        ("teb", [*drive, "--people", "3", "--local-planner", "teb", *out("teb")]),
        ("theta", [*drive, "--global-planner", "theta_star", "--local-planner", "pursuit", *out("theta")]),
        ("global planner", [*drive, "--global-planner", "global_planner", *out("global")]),
        ("car", [*drive, "--set", "robot.drive=car", "--global-planner", "hybrid_astar", "--local-planner", "teb", *out("car")]),
        ("explore", ["explore", "simple_rooms", "--slam", "cartographer", "--lean", "--timeout", "120", *out("explore")]),
        ("evaluate", ["evaluate", str(folder / "gmapping" / "map.yaml"), str(SAMPLES / "office.map.yaml")]),
    ]  # fmt: skip


def record(target: Path = CALLS) -> dict[str, Call]:
    """Run everything and write the calls that were kept."""
    book = Book()
    listen(book)
    for room in ROOMS:
        module = importlib.import_module(f"slamcli.{room}")
        for _ in range(2):  # the first call of each kernel is not looked at: it compiles
            module.warm()
    with tempfile.TemporaryDirectory() as temporary:
        for name, arguments in scenarios(Path(temporary)):
            book.scenario = name
            start = time.process_time()
            code = run([*arguments, *([] if arguments[0] == "evaluate" else ["-q"])])
            print(
                f"{name}: exit code {code}, {time.process_time() - start:.1f} s, {len(book.calls)} kernels so far",
                file=sys.stderr,
            )
    target.parent.mkdir(exist_ok=True)
    with target.open("wb") as stream:
        pickle.dump([book.calls[key] for key in sorted(book.calls)], stream)
    return book.calls


if __name__ == "__main__":
    sys.modules["kernel_calls"] = sys.modules["__main__"]
    Call.__module__ = "kernel_calls"
    calls = record(Path(sys.argv[1]) if len(sys.argv) > 1 else CALLS)
    entries = {
        f"{m.removeprefix('slamcli.')}.{n}" for m, own in find_kernels().items() for n in own if not n.startswith("_")
    }
    print(f"{len(calls)} kernels, {sum(c.scenario == 'warm' for c in calls.values())} of them on tiny input; never called from Python: "
          f"{', '.join(sorted(entries - set(calls)))}")  # fmt: skip
