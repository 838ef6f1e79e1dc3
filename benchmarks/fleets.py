# SPDX-License-Identifier: MIT
"""How the throughput of fleets scales: eight small recordings with one worker, with two, and on a Dask cluster of two workers.

    python benchmarks/fleets.py [SECONDS]

Prints wall time, the processor time of the runs and what the fleet itself adds to it. On a machine that does other things as well only the
processor times tell.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BAGS = 8
SLAMCLI = [sys.executable, "-m", "slamcli"]


def main() -> None:
    seconds = sys.argv[1] if len(sys.argv) > 1 else "10"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bags").mkdir()
        for seed in range(BAGS):
            words = [
                "generate",
                "office",
                str(folder / "bags" / f"r{seed}.mcap"),
                "--duration",
                seconds,
                "--seed",
                str(seed),
                "-q",
            ]
            subprocess.run([*SLAMCLI, *words], check=True)
        print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        measure(folder, "one worker", "--workers", "1")
        measure(folder, "two workers", "--workers", "2")
        on_dask(folder)


def measure(folder: Path, title: str, *words: str) -> None:
    output = folder / title.replace(" ", "-")
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [*SLAMCLI, "map", str(folder / "bags"), "-o", str(output), "-q", *words], check=True, stdout=subprocess.DEVNULL
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    runs = [run["timing"] for run in json.loads((output / "summary.json").read_text())["runs"]]
    jobs = sum(run["cpu_s"] for run in runs)
    whole = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    own = whole - jobs if whole > jobs else whole  # on a cluster the runs are no children of the fleet
    longest = sum(run["wall_s"] for run in runs)
    print(
        f"{title}: {wall:.1f} s, {BAGS / wall * 60:.1f} runs a minute; runs {jobs:.1f} s of processor, fleet {own:.1f} s; at once {longest / wall:.2f}"
    )


def on_dask(folder: Path) -> None:
    file = folder / "scheduler.json"
    module = [sys.executable, "-m"]
    scheduler = [*module, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = [
        *module,
        "distributed.cli.dask_worker",
        "--nthreads",
        "1",
        "--no-dashboard",
        "--local-directory",
        str(folder),
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    running = [subprocess.Popen([*scheduler, "--scheduler-file", str(file)], **quiet)]
    try:
        while not file.exists():
            time.sleep(0.1)
        running += [subprocess.Popen([*worker, "--scheduler-file", str(file)], **quiet) for _ in range(2)]
        time.sleep(10)
        measure(folder, "Dask, two workers", "--scheduler", json.loads(file.read_text())["address"])
    finally:
        for process in running:
            process.terminate()
            process.wait()


if __name__ == "__main__":
    main()
