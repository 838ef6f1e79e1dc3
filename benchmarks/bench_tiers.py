# SPDX-License-Identifier: MIT
"""Time of each system on the samples, whole command from start to files (pytest-benchmark).

    pytest benchmarks/bench_tiers.py -p no:xdist [--benchmark-autosave] [--benchmark-compare]

Wall time of a process of its own with warm kernels, as a user waits for it; keep the machine idle, or look at the CPU time of each run,
which `extra_info` has beside the multiple of real time and the peak memory that run.json tells.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLES = Path(__file__).resolve().parent.parent / "sample_data"
RUNS = {
    "gmapping laser": ["--algo", "gmapping", str(SAMPLES / "office.bag")],
    "cartographer laser": ["--algo", "cartographer", str(SAMPLES / "office.bag")],
    "cartographer loop": ["--algo", "cartographer", str(SAMPLES / "loop_corridor.mcap")],
    "rtabmap laser": ["--algo", "rtabmap", str(SAMPLES / "office.bag")],
    "rtabmap rgbd": ["--algo", "rtabmap", str(SAMPLES / "desk_rgbd.mcap")],
    "orbslam3 rgbd": ["--algo", "orbslam3", str(SAMPLES / "desk_rgbd.mcap"), "--mode", "rgbd"],
    "orbslam3 mono": ["--algo", "orbslam3", str(SAMPLES / "desk_rgbd.mcap"), "--mode", "mono"],
}


def slamcli(benchmark, *arguments: str) -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "slamcli", *arguments], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    benchmark.extra_info.setdefault("cpu_s", []).append(round(used, 3))  # that of the warm-up round first


@pytest.mark.parametrize("name", RUNS)
def test_map(benchmark, tmp_path, name):
    arguments = ["map", *RUNS[name], "-o", str(tmp_path / "map"), "-q"]
    benchmark.group = "map"
    benchmark.pedantic(slamcli, args=[benchmark, *arguments], rounds=3, warmup_rounds=1)
    run = json.loads((tmp_path / "map" / "run.json").read_text())
    benchmark.extra_info.update(
        realtime_factor=run["timing"]["realtime_factor"], peak_memory_bytes=run["peak_memory_bytes"]
    )


@pytest.mark.parametrize("planner", ["dwa", "teb"])
def test_navigate(benchmark, tmp_path, planner):
    arguments = [
        "navigate", "24,8", "--map", str(SAMPLES / "office.map.yaml"), "--start", "2,8.75,0", "--people", "3", "--lean",
        "--local-planner", planner, "-o", str(tmp_path / "drive"), "-q",
    ]  # fmt: skip
    benchmark.group = "navigate"
    benchmark.pedantic(slamcli, args=[benchmark, *arguments], rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("command", ["info", "doctor"])
def test_reading(benchmark, command):
    benchmark.group = "read"
    benchmark.pedantic(slamcli, args=[benchmark, command, str(SAMPLES / "office.bag")], rounds=5, warmup_rounds=1)


def test_help(benchmark):
    benchmark.group = "start"
    benchmark.pedantic(slamcli, args=[benchmark, "--help"], rounds=10, warmup_rounds=1)
