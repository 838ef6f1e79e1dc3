# SPDX-License-Identifier: MIT
"""The record of a command whose output is a file and no folder: ``OUTPUT.run.json`` beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli.outputs import atomic_file
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.runtime import RunLog


def write_output_record(
    outputs: Sequence[Path],
    *,
    command: str,
    inputs: Sequence[Path],
    parameters: Mapping[str, Any],
    changed: Mapping[str, Any],
    summary: Mapping[str, Any],
    topics: Mapping[str, Any] | None = None,
    duration_s: float = 0.0,
    log: RunLog,
) -> Path:
    """Write what was run on what and what came of it, and return where: the first output's whole name and ``.run.json``.

    The suffix stays in the name, because a recording or map converted in its folder has its own record there already.

    Raises
    ------
    UsageError
        If it cannot be written.
    """
    target = outputs[0].with_name(f"{outputs[0].name}.run.json")
    document = run_document(
        command=command,
        algo="",
        parameters=parameters,
        changed=changed,
        seed=0,
        jobs=1,
        inputs=describe_inputs(inputs),
        topics=topics or {},
        frames={},
        log=log,
        total_s=sum(log.seconds.values()),
        duration_s=duration_s,
        summary=summary,
        outputs=[*(path.name for path in outputs), target.name],
    )
    with atomic_file(target) as stream:
        stream.write(to_json(document))
    return target
