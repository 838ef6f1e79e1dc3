# SPDX-License-Identifier: MIT
"""Fuzz every reader through the command line: mutated recordings, logs, maps, trajectories, relations, configurations.

    python benchmarks/fuzz.py --cases 10000 --seed 1

A case passes if the command ends within the time limit with exit code 0, 1 or 2, prints one line that begins with
``slamcli:`` where it is not 0, leaves no output behind where it is 2 and no temporary file ever, and grows by less than
1 GB. Everything else (an exception, a Python warning, a hang, a crash of the interpreter) is a failure: the mutated
input is kept under --keep with the traceback beside it, and the exit code is 1.

Cases are numbered and depend on the seed and their number only: ``--first 4711 --cases 1`` runs one again.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import queue
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from fuzz_corpus import COMMANDS, make_corpus
from fuzz_mutations import mutate

TIME_LIMIT_S = 20
GROWTH_LIMIT_BYTES = 1_000_000_000
ADDRESS_SPACE_BYTES = 8_000_000_000
RESTART = 9  # how a worker ends that has grown: peak memory never falls again


class HangError(BaseException):
    """The time limit of a case is over; not an Exception, so that nothing swallows it."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Fuzz slamcli through its command line.")
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="kinds of input, separated by commas")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for failing cases")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        return work(options, *map(int, options.worker.split(":")))
    results: Counter[str] = Counter()
    start = time.monotonic()
    lines: queue.Queue[dict[str, Any]] = queue.Queue()
    threads = [threading.Thread(target=supervise, args=(options, job, lines)) for job in range(options.jobs)]
    for thread in threads:
        thread.start()
    failures = []
    done = 0
    while done < options.cases:
        record = lines.get()
        if "stop" in record:
            sys.exit(record["stop"])
        done += 1
        results[f"{record['kind']}: {record['result']}"] += 1
        if record["result"] == "failure":
            failures.append(record)
            print(f"case {record['case']}: {record['kind']}: {record['command']}: {record['why']}", flush=True)
        if done % 500 == 0:
            print(f"{done} cases, {len(failures)} failures, {time.monotonic() - start:.0f} s", flush=True)
    for thread in threads:
        thread.join()
    for name, count in sorted(results.items()):
        print(f"{name}: {count}")
    print(f"{done} cases, {len(failures)} failures, {time.monotonic() - start:.0f} s, seed {options.seed}")
    return 1 if failures else 0


def supervise(options: argparse.Namespace, job: int, lines: queue.Queue[dict[str, Any]]) -> None:
    """Run this job's share of the cases in worker processes; a worker that dies or hangs costs one case."""
    last = options.first + options.cases
    case = options.first + job
    while case < last:
        command = [sys.executable, __file__, *sys.argv[1:], "--worker", f"{case}:{last}:{options.jobs}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as worker:
            watchdog = threading.Timer(0, lambda: None)
            ready = False
            assert worker.stdout is not None
            for line in worker.stdout:
                watchdog.cancel()
                record = json.loads(line)
                ready = True
                if "ready" not in record:
                    lines.put(record)
                    case = record["case"] + options.jobs
                watchdog = threading.Timer(2 * TIME_LIMIT_S, worker.kill)
                watchdog.start()
            watchdog.cancel()
        if not ready:
            lines.put({"stop": "a worker did not start: run this script with --worker 0:1:1 to see why"})
            return
        if case < last and worker.returncode not in (0, RESTART):
            why = f"the process ended with {worker.returncode} (killed after {2 * TIME_LIMIT_S} s, or crashed)"
            lines.put({"case": case, "kind": "?", "command": "?", "result": "failure", "why": why})
            case += options.jobs


def work(options: argparse.Namespace, case: int, last: int, step: int) -> int:
    """Run cases in this process; one JSON line each on stdout."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE_BYTES, ADDRESS_SPACE_BYTES))
    out = os.fdopen(os.dup(1), "w")
    kinds = [kind for kind in options.only.split(",") if kind]
    with tempfile.TemporaryDirectory(prefix="slamcli-fuzz-") as folder:
        corpus = make_corpus(Path(folder) / "corpus", kinds)
        compile_kernels()
        for warm in corpus:  # imports, too, before memory and time are watched
            run_command(COMMANDS[warm.kind][0], warm.path, Path(folder) / "warm")
        print(json.dumps({"ready": len(corpus)}), file=out, flush=True)
        while case < last:
            record = run_case(case, options, corpus, Path(folder) / "case")
            print(json.dumps(record), file=out, flush=True)
            case += step
            if record.get("grown"):
                return RESTART
    return 0


def compile_kernels() -> None:
    from slamcli.cli.main import run

    with contextlib.redirect_stderr(io.StringIO()):
        run(["warmup"])


def run_case(case: int, options: argparse.Namespace, corpus: list[Any], folder: Path) -> dict[str, Any]:
    rng = random.Random(f"{options.seed}:{case}")
    seed = corpus[case % len(corpus)]
    command = rng.choice(COMMANDS[seed.kind])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    path = mutate(seed, folder, rng, corpus)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    problem, code = "", None
    try:
        code, problem = run_command(command, path, folder / "out")
    except HangError:
        problem = f"hangs for more than {TIME_LIMIT_S} s\n{traceback.format_exc()}"
    except BaseException as error:  # noqa: BLE001 - whatever comes out is the finding
        problem = f"{type(error).__name__}: {error}\n{traceback.format_exc()}"
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    if not problem and grown > GROWTH_LIMIT_BYTES:
        problem = f"grew by {grown / 1e9:.1f} GB"
    record = {"case": case, "kind": seed.kind, "command": " ".join(command), "result": f"exit {code}"}
    if problem:
        record |= {"result": "failure", "why": problem.splitlines()[0][:300], "grown": grown > GROWTH_LIMIT_BYTES}
        kept = options.keep / f"{options.seed}-{case}"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(folder, kept)
        (kept / "problem.txt").write_text(f"{record['command']}\n{path.name}\n\n{problem}\n")
    return record


def run_command(command: tuple[str, ...], path: Path, out: Path) -> tuple[int, str]:
    """Run one command in this process; return its exit code and what is wrong with it, if anything."""
    from slamcli.cli.main import run

    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    arguments = [word.format(input=path, out=out, dir=path.parent) for word in command]
    stdout, stderr = io.StringIO(), io.StringIO()
    with alarm(TIME_LIMIT_S), warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = run(arguments)
    last = stderr.getvalue().strip().splitlines()[-1:]
    if code not in (0, 1, 2):
        return code, f"exit code {code}"
    if code == 2 and not (last and last[0].startswith("slamcli: ")):
        return code, f"exit code 2 and no message: {last}"
    if "Traceback" in stderr.getvalue():
        return code, "prints a traceback"
    left = sorted(str(p.relative_to(out)) for p in out.rglob("*"))
    if any(name.rpartition("/")[2].startswith(".slamcli-") for name in left):
        return code, f"leaves temporary files: {left[:5]}"
    if code == 2 and left:
        return code, f"exit code 2 and output left: {left[:5]}"
    return code, ""


@contextlib.contextmanager
def alarm(seconds: int) -> Iterator[None]:
    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise HangError

    signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)


if __name__ == "__main__":
    sys.exit(main())
