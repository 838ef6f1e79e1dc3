# SPDX-License-Identifier: MIT
"""What is remembered of jobs, so that what is done is not done again: one small file per job."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from slamcli import __version__
from slamcli.errors import SlamcliError
from slamcli.outputs import atomic_file
from slamcli.pipelines.job_process import Job, JobOutcome
from slamcli.pipelines.remote_files import fingerprint, plain_url
from slamcli.pipelines.run_record import describe_inputs

Signature = list[list[Any]]
"""Path, size and time of change of every file: what need not be read again if it is the same."""


class JobRecords:
    """The records of one set of jobs: a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, job: Job) -> JobOutcome | None:
        """Return what became of a job when it ran before, None where it must run: it failed, or something has changed since."""
        document = self._read(job.name)
        if document is None or not job.output.exists():
            return None
        try:
            same = document["key"] == _key(job) and (
                document["signature"] == _signature(job) or document["contents"] == _contents(job)
            )
            outcome = JobOutcome(**{**document["outcome"], "reused": True})
        except (KeyError, TypeError):
            return None
        return outcome if same and (outcome.done or outcome.missed) else None

    def keep(self, job: Job, outcome: JobOutcome) -> None:
        """Write down what became of a job."""
        record = {
            "key": _key(job), "signature": _signature(job), "contents": _contents(job),
            "outcome": asdict(outcome),
        }  # fmt: skip
        with atomic_file(self._path(job.name)) as stream:
            json.dump(record, stream, indent=2)

    def _read(self, name: str) -> dict | None:
        try:
            document = json.loads(self._path(name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return document if isinstance(document, dict) else None

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.json"


def _key(job: Job) -> str:
    """Return what must be the same for a job to be the same, besides the content of its inputs."""
    addresses = (plain_url(url) for url, _ in job.remote)
    return hashlib.sha256("\0".join([__version__, *job.arguments, *addresses]).encode()).hexdigest()


def _signature(job: Job) -> Signature:
    return [*_stats(job.inputs), *([plain_url(url), _fingerprint(url)] for url, _ in job.remote)]


def _stats(inputs: Sequence[Path]) -> Signature:
    found: Signature = []
    for file in (file for path in inputs for file in _files(path)):
        with contextlib.suppress(OSError):  # it has just gone
            stat = file.stat()
            found.append([str(file), stat.st_size, stat.st_mtime_ns])
    return found


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(p for p in path.rglob("*") if p.is_file())
    else:
        yield path


def _contents(job: Job) -> list[str]:
    return [
        *(_content(path, json.dumps(_stats([path]))) for path in job.inputs),
        *(_fingerprint(url) for url, _ in job.remote),
    ]


def _fingerprint(url: str) -> str:
    try:
        return fingerprint(url)
    except SlamcliError as error:  # what is wrong is told when it is fetched
        return str(error)


@functools.lru_cache(maxsize=4096)
def _content(path: Path, signature: str) -> str:  # noqa: ARG001 - a file that many jobs read is read once, until it changes
    if not (path.is_file() or path.is_dir()):
        return f"{path} is no file"
    try:
        return hashlib.sha256(json.dumps(describe_inputs([path])).encode()).hexdigest()
    except OSError as error:
        return str(error)
