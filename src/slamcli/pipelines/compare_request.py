# SPDX-License-Identifier: MIT
"""What ``slamcli compare`` is asked for: systems, variants of them and finished results, each with what is its own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.mapper import find_tier
from slamcli.parameters import declarations
from slamcli.recordings import Mends
from slamcli.recordings.camera_topics import CameraNames

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")
_RESERVED = frozenset({"jobs"})
_COMMA = re.compile(r",(?=[^,=]+=)")
"""A comma before a further KEY=VALUE, not one within a value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entrant:
    """One thing to compare: a run of a system, or a result that is there already."""

    name: str
    """Names its folder, its figures and its place in the report."""
    algo: str = ""
    """The system; empty for a finished result."""
    sets: tuple[str, ...] = ()
    config_files: tuple[Path, ...] = ()
    mode: str | None = None
    result: Path | None = None
    """Folder of a finished result."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What the user named, as texts of the command line; see :func:`entrants_of`."""

    algos: Sequence[str] = ()
    variants: Sequence[str] = ()
    results: Sequence[str] = ()
    configs: Sequence[str] = ()
    sets: Sequence[str] = ()
    modes: Sequence[str] = ()

    @property
    def runs(self) -> bool:
        """Whether anything is to be run: systems are named, or nothing is and all are meant."""
        return bool(self.algos or self.variants) or not self.results


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareRequest:
    """What to compare, and how."""

    inputs: Sequence[Path] = ()
    wanted: Wanted = field(default_factory=Wanted)
    references: Sequence[str] = ()
    """Ground truth: a trajectory, a relations file and a map, at most one of each."""
    output: Path | None = None
    scan_topics: Sequence[str] = ()
    points_topics: Sequence[str] = ()
    odom_topic: str | None = None
    imu_topic: str | None = None
    cameras: CameraNames = field(default_factory=CameraNames)
    camera_files: Sequence[Path] = ()
    base_frame: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
    seed: int = 0
    jobs: int = 1
    workers: int = 1
    """Runs at once; more than one disturb each other's times."""
    scheduler: str | None = None
    """A Dask cluster to run them on."""
    memory_limit_bytes: int | None = None
    """A run that needs more is ended."""
    mends: Mends = field(default_factory=Mends)
    given_mends: Mapping[str, object] = field(default_factory=dict)
    """The mends as the user gave them, by option."""
    judged: Sequence[str] = ()
    """Figures that thresholds are on, ``<name>.<figure>``: told before anything runs if their name is none."""
    command: str = ""

    @property
    def mend_words(self) -> list[str]:
        """The mends as words of a command line."""
        words: list[str] = []
        for flag, value in self.given_mends.items():
            for item in value if isinstance(value, tuple) else (value,):
                words += [flag] if item is True else [flag, str(item)]
        return words


def entrants_of(wanted: Wanted, default: Sequence[str]) -> tuple[Entrant, ...]:
    """Return the entrants that options name.

    Parameters
    ----------
    wanted
        Systems (``ALGO``), variants (``NAME=ALGO`` or ``NAME=ALGO:KEY=VALUE,...``) and results (``NAME=DIR``); and what is one
        entrant's own: configs (``WHICH=FILE``), modes (``WHICH=MODE``) and sets (``WHICH:KEY=VALUE``, or ``KEY=VALUE`` where one
        system alone has the key). WHICH is an entrant's name, or a system's for all entrants of it.
    default
        Systems where none is named.

    Raises
    ------
    UsageError
        If one is not of its form, names nothing, or two entrants have one name.
    """
    found = [Entrant(name=algo, algo=algo) for algo in wanted.algos]
    found += [_variant(text) for text in wanted.variants]
    found += [_result(text) for text in wanted.results]
    found = found or [Entrant(name=algo, algo=algo) for algo in default]
    names = [entrant.name for entrant in found]
    for entrant in found:
        _check_name(entrant.name, names)
        if entrant.algo:
            find_tier(entrant.algo)
    for option, texts in (("--config", wanted.configs), ("--mode", wanted.modes)):
        for text in texts:
            which, equals, value = text.partition("=")
            if not (which and equals and value):
                raise UsageError(f"{option} {text!r}: write it as ALGO={'FILE' if option == '--config' else 'MODE'}")
            _check_which(which, found, option, text)
            for i, entrant in enumerate(found):
                if which in (entrant.name, entrant.algo):
                    found[i] = (
                        replace(entrant, config_files=(*entrant.config_files, Path(value)))
                        if option == "--config" else replace(entrant, mode=value)
                    )  # fmt: skip
    for text in wanted.sets:
        which, setting = _which_set(text, found)
        for i, entrant in enumerate(found):
            if which in (entrant.name, entrant.algo):
                found[i] = replace(entrant, sets=(*entrant.sets, setting))
    return tuple(found)


def _variant(text: str) -> Entrant:
    name, equals, rest = text.partition("=")
    algo, _, settings = rest.partition(":")
    if not (name and equals and algo) or ":" in name:
        raise UsageError(f"--variant {text!r}: write it as NAME=ALGO or NAME=ALGO:KEY=VALUE,KEY=VALUE")
    sets = tuple(part.strip() for part in _COMMA.split(settings)) if settings else ()
    for part in sets:
        if "=" not in part:
            raise UsageError(f"--variant {text!r}: {part!r} is not KEY=VALUE")
    return Entrant(name=name, algo=algo, sets=sets)


def _result(text: str) -> Entrant:
    name, equals, folder = text.partition("=")
    if not (name and equals and folder):
        raise UsageError(f"--result {text!r}: write it as NAME=DIR, a folder that `slamcli map` wrote")
    path = Path(folder)
    for part in ("run.json", "trajectory.tum"):
        if not (path / part).is_file():
            raise UsageError(f"--result {text}: no {part} in {path}: name a folder that `slamcli map` wrote")
    return Entrant(name=name, result=path)


def _check_name(name: str, names: Sequence[str]) -> None:
    if not _NAME.fullmatch(name) or name in _RESERVED:
        raise UsageError(f"{name!r} cannot be the name of a folder here: letters, digits, . _ + and - (and not 'jobs')")
    if names.count(name) > 1:
        raise UsageError(f"two of what is to be compared are called {name!r}: name them with --variant NAME=ALGO")


def _check_which(which: str, found: Sequence[Entrant], option: str, text: str) -> None:
    known = sorted({name for e in found if e.algo for name in (e.name, e.algo)})
    if which not in known:
        raise UsageError(f"{option} {text}: {which!r} is not compared here; it could be {', '.join(known) or 'none'}")


def _which_set(text: str, found: Sequence[Entrant]) -> tuple[str, str]:
    """Return which entrants a ``--set`` is for, and its KEY=VALUE."""
    key, equals, _ = text.partition("=")
    if not (key and equals):
        raise UsageError(f"--set {text!r}: write it as ALGO:KEY=VALUE, or KEY=VALUE")
    which, colon, rest = text.partition(":")
    names = {name for e in found if e.algo for name in (e.name, e.algo)}
    if colon and len(which) < len(key) and which in names:
        return which, rest
    if colon and len(which) < len(key):
        _check_which(which, found, "--set", text)
    algos = sorted({e.algo for e in found if e.algo})
    having = [a for a in algos if any(d.name == key for d in declarations(find_tier(a).parameters))]
    if len(having) != 1:
        told = f"{' and '.join(having)} have it" if having else f"none of {', '.join(algos)} has it"
        example = having[0] if having else next(iter(algos), "gmapping")
        raise UsageError(f"--set {text}: {told}; say which is meant: --set {example}:{text}")
    return having[0], text
