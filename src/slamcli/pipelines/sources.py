# SPDX-License-Identifier: MIT
"""Many inputs from few words: a folder, a pattern, a list in a file, addresses of a store."""

from __future__ import annotations

import glob
import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from urllib.request import url2pathname

from slamcli.errors import FormatError, UsageError
from slamcli.formats.trajectories import find_format
from slamcli.pipelines.trajectories import is_recording
from slamcli.recordings.containers.folder import STORAGE_SUFFIXES
from slamcli.recordings.folders import find_layout

_WILD = re.compile(r"[*?\[]")
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
_SUFFIXES = (
    ".zst",
    ".zstd",
    ".gz",
    ".lz4",
    ".bz2",
    ".bag",
    ".mcap",
    ".db3",
    ".clf",
    ".log",
    ".dat",
    ".tum",
    ".txt",
    ".csv",
    ".yaml",
    ".db",
)
FILE_SCHEME = "file://"
_OF_RESULT = "trajectory.tum"
_RESULTS = ("trajectory", "keyframes", "aligned", "map")
"""Names that every result has alike: its folder tells it from others."""
_RESERVED = ("jobs", "cache", "summary.json", "summary.csv", "summary.md", "report.html", "run.json")
"""Names in the folder of a fleet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One of many inputs."""

    text: str
    """Path or address, for the command line of its own run."""
    stem: str
    """Its name without suffixes: what ``{name}`` stands for."""
    folder: str
    """Where it lies: what ``{dir}`` stands for."""
    name: str
    """Among its fellows: of its folder in the output."""

    @property
    def is_remote(self) -> bool:
        """Whether it must be fetched."""
        return is_url(self.text)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What is looked for in folders."""

    noun: str
    find: Callable[[Path], Path | None]
    """Return what a file or folder is as one of them: itself, or the file in it that counts; None for anything else."""


def is_url(text: str) -> bool:
    """Return whether a word is an address: ``s3://bucket/run.mcap``."""
    return _URL.match(text) is not None


def path_of_url(url: str) -> str:
    """Return the path that a ``file://`` address names; the host in it does not matter."""
    rest = url[len(FILE_SCHEME) :]
    return url2pathname(rest if rest.startswith("/") else rest[rest.find("/") :])


def is_many(text: str, kind: Kind) -> bool:
    """Return whether a word stands for inputs of their own: a list, a pattern, an address, or a folder that holds some."""
    path = Path(text)
    if path.exists():
        return path.is_dir() and kind.find(path) is None and any(_in_folder(path, kind))
    return text.startswith("@") or is_url(text) or _WILD.search(text) is not None


def find_sources(texts: Sequence[str], kind: Kind) -> list[Source]:
    """Return the inputs that words stand for, in the order of the words and by name within each, none twice.

    Parameters
    ----------
    texts
        Paths, patterns (``runs/*.mcap``, ``**`` for any depth), lists (``@list.txt``: one word per line, relative to the list's
        folder, ``#`` begins a remark) and addresses (see `slamcli.pipelines.remote_files`). A path that is there is what it is,
        even if it looks like a pattern. A folder stands for what lies directly in it.
    kind
        What is looked for.

    Raises
    ------
    UsageError
        If a word stands for nothing, or a list cannot be read.
    """
    found: dict[str, Source] = {}
    for text in texts:
        for source in _expand(text, kind):
            found.setdefault(str(source.text), source)
    return _named(list(found.values()))


def _expand(text: str, kind: Kind) -> Iterator[Source]:
    path = Path(text)
    if path.exists() or not (text.startswith("@") or is_url(text) or _WILD.search(text)):
        if path.is_dir() and kind.find(path) is None:
            inside = list(_in_folder(path, kind))
            if not inside:
                raise UsageError(f"{text}: no {kind.noun} lies in this folder")
            yield from map(_source, map(str, inside))
        else:
            yield _source(str(kind.find(path) or text))
    elif text.startswith("@"):
        yield from _of_list(Path(text[1:]), kind)
    elif text.lower().startswith(FILE_SCHEME):
        yield from _expand(path_of_url(text), kind)
    elif is_url(text):
        yield from _of_url(text)
    else:
        yield from _of_pattern(text, kind)


def _of_list(path: Path, kind: Kind) -> Iterator[Source]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        raise UsageError(f"@{path}: the list cannot be read: {reason}") from error
    words = [word for line in lines if (word := line.strip()) and not word.startswith("#")]
    if not words:
        raise UsageError(f"@{path}: the list is empty: write one {kind.noun} per line")
    for word in words:
        if word.startswith("@"):
            raise UsageError(f"@{path}: {word}: a list in a list")
        yield from _expand(word if is_url(word) else str(path.parent / Path(word).expanduser()), kind)


def _of_pattern(text: str, kind: Kind) -> Iterator[Source]:
    pattern, part = text, ""
    paths = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207 - a pattern may begin anywhere
    if not paths and kind is TRAJECTORIES and ":" in text:  # a topic in each of many recordings
        pattern, colon, rest = text.partition(":")
        part = colon + rest
        paths = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207
    elif "." not in Path(text).name.removeprefix("."):  # `runs/*` takes what fits, `runs/*.mcap` what it says
        paths = [str(found) for path in paths if (found := kind.find(Path(path))) is not None]
    if not paths:
        raise UsageError(f"{text}: no {kind.noun} matches this pattern")
    for path in paths:
        yield replace(_source(path, _distinct_part(pattern, path)), text=path + part)


def _distinct_part(pattern: str, path: str) -> str:
    """Return the part of a path that the last wild part of a pattern stands for: `results/*/trajectory.tum` tells by folders."""
    parts = Path(pattern).parts
    back = next(i for i, part in enumerate(reversed(parts), start=1) if _WILD.search(part))
    return Path(path).parts[-back]


def _of_url(text: str) -> Iterator[Source]:
    from slamcli.pipelines.remote_files import list_remote

    yield from (_source(url) for url in list_remote(text))


def _source(text: str, part: str = "") -> Source:
    """Return one input; its name is that of its last part, or of the part that tells it from others."""
    folder, _, last = text.rstrip("/").rpartition("/")
    stem = stem_of(part or (last.partition("?")[0] if is_url(text) else last))
    if stem in _RESULTS and not part:
        stem = PurePosixPath(folder).name or stem
    return Source(text=text, stem=stem, folder=folder or ("/" if text.startswith("/") else "."), name=stem)


def stem_of(name: str) -> str:
    """Return a name without the suffixes of recordings, trajectories and packed files; other dots stay."""
    while (suffix := Path(name).suffix) and suffix.lower() in _SUFFIXES:
        name = name[: -len(suffix)]
    return name


def _named(sources: Sequence[Source]) -> list[Source]:
    """Return the inputs with names that differ, even where capitals do not count, and that no order of them changes.

    Equal names get the folder's in front, and where that does not help either, a digest of the whole path behind.
    """
    named = [replace(source, name=_safe(source.stem)) for source in sources]
    for longer in (_with_folder, _with_digest):
        counts = Counter(source.name.casefold() for source in named)
        named = [
            replace(source, name=longer(source)) if counts[source.name.casefold()] > 1 else source for source in named
        ]
    return named


def _with_folder(source: Source) -> str:
    return _safe(f"{PurePosixPath(source.folder).name}-{source.stem}")


def _with_digest(source: Source) -> str:
    return f"{_safe(source.stem)}-{hashlib.sha256(source.text.encode()).hexdigest()[:8]}"


def _safe(name: str) -> str:
    """Return a name that can be a folder's beside those that a fleet makes itself."""
    name = re.sub(r"[^\w.+=,@ -]", "-", name).strip(" .") or "input"
    return f"{name}-input" if name.casefold() in _RESERVED else name


def _in_folder(folder: Path, kind: Kind) -> Iterator[Path]:
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        raise UsageError(f"{folder}: the folder cannot be read: {error.strerror}") from error
    yield from (found for p in inside if not p.name.startswith(".") and (found := kind.find(p)) is not None)


def _as_recording(path: Path) -> Path | None:
    """Return a path that is one recording; several bags in a folder are, if metadata.yaml or their numbers say that they were split."""
    if not path.is_dir():
        return path if is_recording(path) else None
    if (path / "metadata.yaml").exists() or find_layout(path) is not None:
        return path
    bags = [p.name for p in path.iterdir() if p.name.endswith(STORAGE_SUFFIXES) and p.is_file()]
    return path if len(bags) == 1 or _are_splits([stem_of(name) for name in bags]) else None


def _are_splits(stems: Sequence[str]) -> bool:
    """Return whether names are those of one bag's parts as rosbag2 writes them: ``run_0``, ``run_1`` and so on."""
    parts = [stem.rpartition("_") for stem in stems]
    numbers = sorted(part[2] for part in parts)
    return bool(stems) and len({part[0] for part in parts}) == 1 and numbers == sorted(map(str, range(len(stems))))


def _as_trajectory(path: Path) -> Path | None:
    if path.is_dir():
        if (path / _OF_RESULT).is_file():
            return path / _OF_RESULT
        return path if is_recording(path) else None  # its own true trajectory
    if not path.name.lower().endswith((".tum", ".txt")):  # a table may be anything; a pattern takes those of poses too
        return None
    try:
        find_format(path)
    except (FormatError, OSError):
        return None
    return path


RECORDINGS = Kind(noun="recording", find=_as_recording)
TRAJECTORIES = Kind(noun="trajectory", find=_as_trajectory)
