# SPDX-License-Identifier: MIT
"""Kill commands at random moments (kill -9) and check what is left: the old output, or the new one, or none.

    python benchmarks/kill.py --moments 20 --seed 1

Every command runs once to its end (the new output) and once with other options (the old output). It is then started again
and again over the old output or over none, and killed after a random share of the time that it needs. Afterwards everything that
is visible must be byte for byte the old or the new output (run.json and report.html, which hold times, must be whole
files), the next run must succeed and leave no temporary file. Exits with 1 if anything else is found.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> int:
    parser = argparse.ArgumentParser(description="Kill slamcli at random moments.")
    parser.add_argument("--moments", type=int, default=20, help="kills per command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="commands, separated by commas")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    problems = 0
    with tempfile.TemporaryDirectory(prefix="slamcli-kill-") as name:
        folder = Path(name)
        source = folder / "source.mcap"
        slamcli("generate", "office", str(source), "--duration", "30").wait()
        recording = str(source)
        # target, command, and what makes an old output that differs
        commands = {
            "generate": ("out.bag", ["generate", "office", "{out}", "--duration", "30"], ["--seed", "2"]),
            "convert": ("out.bag", ["convert", recording, "{out}", "--compression", "bz2"], ["--duration", "5"]),
            "convert folder": (
                "out",
                ["convert", recording, "{out}", "--format", "rosbag2-sqlite3"],
                ["--duration", "5"],
            ),
            "map": ("out", ["map", recording, "-o", "{out}", "--set", "particles=5"], ["--duration", "9"]),
            "map cartographer": (
                "out",
                ["map", recording, "--algo", "cartographer", "-o", "{out}"],
                ["--duration", "9"],
            ),
        }
        for label, (target, arguments, variation) in commands.items():
            if not options.only or label.split()[0] in options.only.split(","):
                problems += check_command(label, folder / label, target, (arguments, variation), options.moments, rng)
    return 1 if problems else 0


def slamcli(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "slamcli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def check_command(
    label: str, folder: Path, target: str, command: tuple[list[str], list[str]], moments: int, rng: random.Random
) -> int:
    arguments, variation = command
    seconds = 0.0
    for name, words in (("old", arguments + variation), ("new", arguments)):
        (folder / name).mkdir(parents=True)
        begin = time.monotonic()
        run_to_end(folder / name / target, words)
        seconds = time.monotonic() - begin
    if label.startswith("map"):
        (folder / "old" / target / "mine.txt").write_text("of the user")
    new = contents(folder / "new" / target)
    problems, states = 0, dict.fromkeys(("old", "new", "none", "with temporary files"), 0)
    for moment in range(moments):
        place = folder / "place"
        shutil.rmtree(place, ignore_errors=True)
        if moment % 2:
            shutil.copytree(folder / "old", place)
        else:
            place.mkdir()
        before = contents(place / target)
        process = slamcli(*(word.format(out=place / target) for word in arguments))
        time.sleep(rng.uniform(0.2, 1.0) * seconds)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        found = contents(place / target)
        states["with temporary files"] += any(path.name.startswith(".slamcli-") for path in place.iterdir())
        kept = {name: hashed for name, hashed in before.items() if name == "mine.txt"}
        if found == before:
            states["old" if before else "none"] += 1
        elif found == new | kept:
            states["new"] += 1
        else:
            problems += 1
            print(f"{label}: kill {moment} left {sorted(found)}; expected {sorted(new | kept)} or {sorted(before)}")
        run_to_end(place / target, arguments)
        if left := [path.name for path in place.iterdir() if path.name.startswith(".slamcli-")]:
            problems += 1
            print(f"{label}: the run after kill {moment} left {left}")
    told = ", ".join(f"{count} {state}" for state, count in states.items())
    print(f"{label}: {moments} kills within {seconds:.1f} s: {told}; {problems} problems", flush=True)
    return problems


def run_to_end(target: Path, arguments: list[str]) -> None:
    process = slamcli(*(word.format(out=target) for word in arguments))
    _, talk = process.communicate()
    if process.returncode != 0:
        sys.exit(f"slamcli {' '.join(arguments)}: exit code {process.returncode}: {talk.decode()}")


def contents(target: Path) -> dict[str, str]:
    """Return what lies there: a hash per file, and for files that hold times whether they are whole."""
    files = (
        [target] if target.is_file() else sorted(p for p in target.rglob("*") if p.is_file()) if target.is_dir() else []
    )
    return {os.path.relpath(path, target): fingerprint(path) for path in files}


def fingerprint(path: Path) -> str:
    data = path.read_bytes()
    if path.name == "run.json":
        return f"outputs {sorted(json.loads(data)['outputs'])}"
    if path.name == "report.html":
        return "whole" if data.rstrip().endswith(b"</html>") else "cut"
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
