# SPDX-License-Identifier: MIT
"""One command over many inputs: each a run of its own, on this machine or a cluster, and a summary over all."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.outputs import atomic_file, check_directory, check_file
from slamcli.pipelines.fleet_summary import junit_of, summarise, write_summary
from slamcli.pipelines.job_process import size_text
from slamcli.pipelines.jobs import Job, JobOutcome, run_jobs
from slamcli.pipelines.process_tree import can_be_measured, physical_memory_bytes
from slamcli.pipelines.remote_files import Remote, local_name
from slamcli.pipelines.sources import FILE_SCHEME, Source, is_url, path_of_url
from slamcli.pipelines.trajectories import parse_source
from slamcli.runtime import RunLog

_LEAST_MEMORY_BYTES = 100_000_000
"""Less than any run needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetRequest:
    """A command, and what it is to be run on."""

    command: str
    sources: Sequence[Source]
    words: Sequence[str]
    """Options of the command line, in which ``{name}`` and ``{dir}`` stand for each input's."""
    after: Sequence[str] = ()
    """Arguments that follow the input; the same holds for them."""
    output: Path
    workers: int = 0
    """Jobs at once; 0: one per core, or as many as the cluster takes."""
    scheduler: str | None = None
    memory_limit_bytes: int | None = None
    """Of one job; None: its share of this machine's memory."""
    fresh: bool = False
    keep_inputs: bool = False
    """Whether what was fetched stays in the cache."""
    junit: Path | None = None
    """Where the summary goes as JUnit XML, besides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOutcome:
    """What came of it."""

    output: Path
    document: dict[str, Any]
    """The ``summary.json`` document."""

    @property
    def failed(self) -> int:
        """How many inputs failed or missed a threshold."""
        return int(self.document["counts"]["failed"] + self.document["counts"]["missed"])


def run_fleet(request: FleetRequest, log: RunLog, told: Callable[[JobOutcome], None] = lambda _: None) -> FleetOutcome:
    """Run the command on every input, and write results, records, summary and report into one folder.

    Parameters
    ----------
    told
        Is called with each outcome as it comes.

    Raises
    ------
    UsageError
        If the output cannot be written, or the cluster is not to be had.
    KeyboardInterrupt
        If it was interrupted: what was done stays, and the same request goes on from there.
    """
    began = time.perf_counter()
    check_directory(request.output)
    if request.junit is not None:
        check_file(request.junit)
    limit = request.memory_limit_bytes
    if limit is not None and limit < _LEAST_MEMORY_BYTES:
        raise UsageError(
            f"--max-memory {size_text(limit)}: no run gets by with less than {size_text(_LEAST_MEMORY_BYTES)}"
        )
    if request.scheduler is None:
        if not can_be_measured():
            log.warn(
                "memory is not watched: this system tells of other processes only through psutil, which is missing"
            )
        limit = limit or physical_memory_bytes() // (request.workers or os.cpu_count() or 1)
    jobs = [job_of(source, request) for source in request.sources]
    try:
        outcomes = run_jobs(
            jobs, workers=request.workers, records=request.output / "jobs", told=told, memory_limit_bytes=limit,
            scheduler=request.scheduler, fresh=request.fresh, keep_stdout=False,
        )  # fmt: skip
    finally:
        with contextlib.suppress(OSError):  # something was kept, or nothing was fetched
            _cache(request.output).rmdir()
    document = summarise(request.command, request.words, request.sources, outcomes, request.output, log)
    total_s = time.perf_counter() - began
    document["timing"] = {"total_s": round(total_s, 3), "workers": request.workers or None}
    write_summary(request.output, document, log, total_s)
    if request.junit is not None:
        with atomic_file(request.junit) as stream:
            stream.write(junit_of(document))
    return FleetOutcome(output=request.output, document=document)


def job_of(source: Source, request: FleetRequest) -> Job:
    """Return the run of one input: what a person would type for it. Addresses become the places that they are fetched to."""
    output = request.output / source.name
    cache = _cache(request.output) / source.name
    remote: list[Remote] = []

    def placed(word: str) -> str:
        flag, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        if not is_url(value):
            return word
        if value.lower().startswith(FILE_SCHEME):
            return f"{flag}{equals}{path_of_url(value)}"
        place = cache / str(len(remote)) / local_name(value)
        remote.append((value, place))
        return f"{flag}{equals}{place}"

    text = placed(source.text)
    words = [placed(filled(word, source)) for word in request.words]
    after = [placed(filled(word, source)) for word in request.after]
    arguments = (request.command, *words, "--output", str(output), "--", text, *after)
    values = (word.partition("=")[2] if word.startswith("--") else word for word in (*words, *after))
    read = [parse_source(text).path] * (not source.is_remote) + [
        path for value in values if (path := Path(value or "-")).exists()
    ]
    return Job(
        name=source.name, arguments=arguments, output=output, inputs=tuple(read), remote=tuple(remote),
        keeps_remote=request.keep_inputs,
    )  # fmt: skip


def _cache(output: Path) -> Path:
    """Return where fetched files lie: in the output, or in a folder of this output's own under $SLAMCLI_CACHE."""
    root = os.environ.get("SLAMCLI_CACHE")
    return Path(root) / sha256(os.fsencode(output.resolve())).hexdigest()[:12] if root else output / "cache"


def filled(word: str, source: Source) -> str:
    """Return a word with ``{name}`` and ``{dir}`` replaced."""
    return word.replace("{name}", source.stem).replace("{dir}", source.folder)
