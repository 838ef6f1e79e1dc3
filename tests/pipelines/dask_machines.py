# SPDX-License-Identifier: MIT
"""A Dask cluster for tests: a scheduler and workers as processes of this machine, ended whatever happens."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Machines:
    """A scheduler at `address`, and its workers by name."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self._environment = {**os.environ, **environment}
        self.workers: dict[str, subprocess.Popen[bytes]] = {}
        self._file = folder / "scheduler.json"
        self._scheduler = self._start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.address = json.loads(self._wait_for_file())["address"]

    def add(self, name: str) -> None:
        words = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--name", name, "--death-timeout", "60"]
        self.workers[name] = self._start("dask_worker", *words, "--local-directory", str(self.folder / name))

    def kill(self, name: str) -> None:
        process = self.workers.pop(name)
        process.send_signal(signal.SIGKILL)
        process.wait()

    def end(self) -> None:
        for process in [*self.workers.values(), self._scheduler]:
            process.kill()
            process.wait()

    def _start(self, module: str, *words: str) -> subprocess.Popen[bytes]:
        log = (self.folder / f"{module}.log").open("ab")
        with log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", "--scheduler-file", str(self._file), *words],
                stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=self._environment, cwd=self.folder,
            )  # fmt: skip

    def _wait_for_file(self) -> str:
        end = time.monotonic() + 60
        while not self._file.exists():
            if time.monotonic() > end or self._scheduler.poll() is not None:
                raise RuntimeError((self.folder / "dask_scheduler.log").read_text())
            time.sleep(0.05)
        return self._file.read_text()


@contextmanager
def machines(folder: Path, *names: str, **environment: str) -> Iterator[Machines]:
    cluster = Machines(folder, environment)
    try:
        for name in names:
            cluster.add(name)
        yield cluster
    finally:
        cluster.end()
