# SPDX-License-Identifier: MIT
"""Where the time of each tier goes: shares per stage, and the functions that take most.

    python benchmarks/profiles.py [RECORDING] [--algo A ...] [--top N] [-- OPTIONS OF slamcli map]

Without a recording each tier maps one of sample_data. Every run is a process of its own on one thread (`--jobs 1`); kernels are
to be compiled beforehand (`slamcli warmup`), or their compilation stands under "loading kernels". Times are CPU time under cProfile, which makes Python code slower and
leaves compiled kernels as they are; what NumPy, zlib and others do counts for the function of slamcli that called them.
"""

from __future__ import annotations

import argparse
import cProfile
import os
import pstats
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = {
    "gmapping": [str(ROOT / "sample_data" / "office.bag")],
    "cartographer": [str(ROOT / "sample_data" / "office.bag")],
    "rtabmap": [str(ROOT / "sample_data" / "desk_rgbd.mcap")],
    "orbslam3": [str(ROOT / "sample_data" / "desk_rgbd.mcap"), "--mode", "rgbd"],
}
STAGES = {
    "cli": "start-up", "recordings": "reading", "measurements": "reading", "pipelines": "reading and feeding", "formats": "writing", "reports": "writing",
    "outputs": "writing", "trajectory": "motion", "geometry": "motion", "registration": "matching", "grids": "grids",
    "posegraph": "pose graph", "vision": "vision", "gmapping": "tier", "cartographer": "tier", "rtabmap": "tier", "orbslam3": "tier",
}  # fmt: skip
PREPARING = {"importlib": "imports", "<module>": "imports", "numba": "loading kernels", "llvmlite": "loading kernels"}
Function = tuple[str, int, str]


def run(arguments: list[str], out: Path) -> None:
    """Run `slamcli` under the profiler in this process; `out` takes the figures."""
    from slamcli.cli.main import main

    sys.argv = ["slamcli", *arguments]
    profile = cProfile.Profile(time.thread_time)
    code: object = 0
    profile.enable()
    try:
        main()
    except SystemExit as end:
        code = end.code
    profile.disable()
    profile.dump_stats(out)
    if code:
        sys.exit(1)


def stage_of(function: Function) -> str | None:
    """Return the stage a function belongs to; None for what works for its callers."""
    path, _, name = function
    for mark, stage in PREPARING.items():
        if mark == name or f"/{mark}/" in path or mark in path.split(" ")[-1].split("."):
            return stage
    if "/slamcli/" in path:
        return STAGES.get(path.rpartition("/slamcli/")[2].split("/")[0].removesuffix(".py"), "others")
    return None


def own_times(stats: pstats.Stats) -> dict[Function, float]:
    """Return the CPU seconds of each function of slamcli (and of preparing), with those of what it called from elsewhere."""
    table = stats.stats  # type: ignore[attr-defined]
    waiting: dict[Function, float] = {f: entry[2] for f, entry in table.items() if stage_of(f) is None}
    times: dict[Function, float] = defaultdict(float)
    for function, entry in table.items():
        if function not in waiting:
            times[function] += entry[2]
    for _ in range(50):  # up the chains of callers; what is left then has none
        handed: dict[Function, float] = defaultdict(float)
        for function, seconds in waiting.items():
            callers = table[function][4]
            whole = sum(edge[3] for edge in callers.values())
            if whole <= 0.0:
                times[function] += seconds
                continue
            for caller, edge in callers.items():
                target = handed if stage_of(caller) is None else times
                target[caller] += seconds * edge[3] / whole
        waiting = {f: seconds for f, seconds in handed.items() if seconds > 1e-6}
        if not waiting:
            break
    for function, seconds in waiting.items():
        times[function] += seconds
    return times


def show(title: str, stats: pstats.Stats, process_s: float, top: int) -> None:
    """Print the shares of stages and the functions that take most, as Markdown."""
    times = own_times(stats)
    whole = sum(times.values())
    stages: dict[str, float] = defaultdict(float)
    for function, seconds in times.items():
        stages[stage_of(function) or "others"] += seconds
    print(f"\n### {title}\n\n{whole:.1f} s on the main thread, {process_s:.1f} s CPU of the whole process.\n")
    print("| stage | s | share |\n|---|---|---|")
    for stage, seconds in sorted(stages.items(), key=lambda one: -one[1]):
        if seconds >= 0.005 * whole:
            print(f"| {stage} | {seconds:.2f} | {100 * seconds / whole:.0f} % |")
    print("\n| function | calls | s | share |\n|---|---|---|---|")
    chosen = [f for f in times if stage_of(f) not in (*PREPARING.values(), None)]
    for function in sorted(chosen, key=lambda one: -times[one])[:top]:
        path, _, name = function
        calls, seconds = stats.stats[function][1], times[function]  # type: ignore[attr-defined]
        where = path.rpartition("/slamcli/")[2].removesuffix(".py")
        print(f"| `{where}` {name.strip('<>')} | {calls} | {seconds:.2f} | {100 * seconds / whole:.1f} % |", flush=True)


def profile_tier(algo: str, recording: list[str], folder: Path, top: int) -> None:
    """Map in a fresh process."""
    target = folder / f"{algo}.prof"
    command = [sys.executable, __file__, "--child", str(target), "map", "--algo", algo, *recording]
    command += ["--jobs", "1", "--quiet", "-o", str(folder / algo)]
    began = sum(os.times()[2:4])
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    process_s = sum(os.times()[2:4]) - began
    if done.returncode:
        print(f"\n### {algo}\n\n{done.stderr.strip()}", flush=True)
        return
    show(f"{algo}: {Path(recording[0]).name}", pstats.Stats(str(target)), process_s, top)


def main() -> None:
    """Profile the tiers that were asked for."""
    if sys.argv[1:2] == ["--child"]:
        run(sys.argv[3:], Path(sys.argv[2]))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", nargs="?")
    parser.add_argument("--algo", action="append", choices=list(SAMPLES))
    parser.add_argument("--top", type=int, default=12)
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    arguments = parser.parse_args(words[:end])
    with tempfile.TemporaryDirectory(prefix="slamcli-profiles-") as folder:
        for algo in arguments.algo or SAMPLES:
            given = [arguments.recording, *words[end + 1 :]] if arguments.recording else SAMPLES[algo]
            profile_tier(algo, given, Path(folder), arguments.top)


if __name__ == "__main__":
    main()
