# SPDX-License-Identifier: MIT
"""A stand-in for ``slamcli map`` in a process of its own: results whose errors are known, in no time."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.pipelines.job_process import Job, JobOutcome

POSES = 40


def arc() -> np.ndarray:
    """Return the true positions (N, 2), metres."""
    turn = np.linspace(0.0, 4.0, POSES)
    return np.column_stack([5.0 * np.cos(turn), 5.0 * np.sin(turn)])


def write_tum(path: Path, positions: np.ndarray) -> None:
    lines = [f"{i * 0.1:.9f} {x:.12f} {y:.12f} 0 0 0 0 1" for i, (x, y) in enumerate(positions)]
    path.write_text("\n".join(lines) + "\n")


class FakeMapping:
    """Takes the place of `slamcli.pipelines.jobs.run_job`.

    `error_m` returns the error of a run from its ``--set`` values and its seed; a text stands for a failure with this message.
    """

    def __init__(self, error_m: Callable[[Mapping[str, str], int], float | str]) -> None:
        self.error_m = error_m
        self.share: Callable[[Mapping[str, str], int], float] = lambda *_: 1.0
        self.ran: list[str] = []
        self.stop_after: int | None = None
        self._lock = threading.Lock()

    def __call__(self, job: Job, **_: Any) -> JobOutcome:
        with self._lock:
            if self.stop_after is not None and len(self.ran) >= self.stop_after:
                raise KeyboardInterrupt
            self.ran.append(job.name)
        words = list(job.arguments)
        assert words[0] == "map"
        values = dict(words[i + 1].split("=", 1) for i, word in enumerate(words) if word == "--set")
        seed, folder = int(words[words.index("--seed") + 1]), Path(words[words.index("-o") + 1])
        error = self.error_m(values, seed)
        if isinstance(error, str):
            return self._outcome(job, 2 if error.startswith("usage") else 1, f"slamcli: {error}")
        folder.mkdir(parents=True, exist_ok=True)
        positions = arc() + error * np.where(np.arange(POSES) % 2, 1.0, -1.0)[:, None] / np.sqrt(2.0)
        write_tum(folder / "trajectory.tum", positions[: int(POSES * self.share(values, seed))])
        run = {
            "summary": {"poses": POSES, "nested": {"thing": 3}, "flag": True},
            "parameters": {"particles": 30}, "frames": {"base": "base_link"},
            "timing": {"total_s": 1.0 + error, "realtime_factor": 4.0}, "peak_memory_bytes": 1000,
        }  # fmt: skip
        (folder / "run.json").write_text(json.dumps(run))
        return self._outcome(job, 0, f"{folder}: done")

    def _outcome(self, job: Job, code: int, message: str) -> JobOutcome:
        return JobOutcome(
            name=job.name, exit_code=code, message=message, stdout="", wall_s=1.5, cpu_s=1.2, peak_memory_bytes=10**8
        )
