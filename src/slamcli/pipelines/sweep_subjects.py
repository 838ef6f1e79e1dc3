# SPDX-License-Identifier: MIT
"""The recordings of a sweep, and what is true of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slamcli.errors import FormatError, UsageError
from slamcli.pipelines.sources import RECORDINGS, find_sources, is_url, stem_of
from slamcli.pipelines.sweep_request import Subject
from slamcli.pipelines.trajectories import is_recording, parse_source

TRUTH = "truth"
_BESIDE = ("{name}.truth.tum", "{name}.relations", "{name}.groundtruth.tum", "{name}.gt.tum")
"""Files that hold what is true of a recording, where they lie beside it."""
_INSIDE = ("groundtruth.tum", "groundtruth.txt")
"""The same in a data set's folder."""


def find_subjects(inputs: Sequence[Path], reference: str | None, *, together: bool) -> tuple[Subject, ...]:
    """Return the recordings: one that may be split over several files, or `together` each by itself.

    Parameters
    ----------
    inputs
        Files, folders, and with `together` what else `slamcli.pipelines.sources.find_sources` takes.
    reference
        What results are scored against: a file, ``{name}`` and ``{dir}`` in it the recording's own, or ``truth`` for what lies
        beside the recording.
    together
        Whether each input is a recording of its own.

    Raises
    ------
    InputError
        If a reference is not there, or recordings are called the same.
    """
    if not together:
        return (Subject(name="", inputs=tuple(inputs), reference=_reference(inputs[0], reference)),)
    sources = find_sources([str(path) for path in inputs], RECORDINGS)
    if len(sources) < 2:
        raise UsageError("--together: name several recordings")
    if any(is_url(source.text) for source in sources):
        raise UsageError("--together: recordings must lie on this machine; --each fetches them one by one")
    if reference is not None and reference != TRUTH and "{" not in reference:
        raise UsageError(
            f"--together: --ref {reference} is one for all: write {{name}} and {{dir}} for each recording's own"
        )
    return tuple(
        Subject(name=source.name, inputs=(Path(source.text),), reference=_reference(Path(source.text), reference))
        for source in sources
    )


def _reference(path: Path, given: str | None) -> str | None:
    if given is None:
        return None
    folder, name = str(path.parent), stem_of(path.resolve().name)
    if given == TRUTH and not Path(given).exists():
        return _found_truth(path, folder, name)
    text = given.replace("{name}", name).replace("{dir}", folder)
    source = parse_source(text)
    if not Path(source.path).exists():
        hint = "; `--ref truth` finds what lies beside the recording" if given != TRUTH else ""
        raise FormatError(f"--ref {text}: no such file{hint}")
    return text


def _found_truth(path: Path, folder: str, name: str) -> str:
    places = [Path(folder) / pattern.format(name=name) for pattern in _BESIDE]
    if path.is_dir():
        places += [path / file for file in _INSIDE]
    for place in places:
        if place.is_file():
            return str(place)
    if path.is_dir() and is_recording(path):
        return str(path)
    looked = ", ".join(place.name for place in places)
    raise FormatError(f"--ref truth: nothing that is true of {path} lies beside it (looked for {looked})")
