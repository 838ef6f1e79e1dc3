# SPDX-License-Identifier: MIT
"""The long-term memory of tiers that keep one on disk: where it lies while a map is made, and where it ends."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from slamcli.errors import FormatError, UsageError
from slamcli.mapper import DatabaseChoice, MappingResult, Tier
from slamcli.outputs import check_file
from slamcli.parameters import as_dict, resolve
from slamcli.pipelines.config import NativeConfig
from slamcli.rtabmap.database import Database, count_committed_nodes, is_in_use
from slamcli.runtime import RunLog

FILE = "rtabmap.db"
"""Its name in the folder of a result."""
_INCREMENTAL = "Mem/IncrementalMemory"
_BESIDE = ("-journal", "-wal", "-shm")


@dataclass(frozen=True, slots=True, kw_only=True)
class DatabaseRequest:
    """What the user says of the database."""

    file: Path | None = None
    """None: it is written beside the result, and ends in its folder."""
    anew: bool = False
    """Whether a map in the file is not gone on from, but replaced."""

    def check(self, tier: Tier, inputs: Sequence[Path], output: Path, *, localise_only: bool) -> None:
        """Raise before long work what would fail after it.

        Raises
        ------
        UsageError
            If the tier keeps no database, options contradict each other, or the file cannot be used.
        """
        named = [option for option, value in (("--database", self.file), ("--delete-db-on-start", self.anew)) if value]
        if not tier.remembers:
            if named:
                raise UsageError(f"{named[0]}: {tier.name} keeps no database; --algo rtabmap does")
            return
        if self.file is None:
            if self.anew:
                raise UsageError("--delete-db-on-start: name the database with --database")
            if localise_only:
                raise UsageError(
                    "--localise-only (Mem/IncrementalMemory false): name the database to localise in with --database"
                )
            return
        self._check_file(inputs, output, localise_only=localise_only)

    def _check_file(self, inputs: Sequence[Path], output: Path, *, localise_only: bool) -> None:
        path = Path(self.file or "")
        if path.is_dir():
            raise UsageError(f"--database {path}: a folder; name a file (RTAB-Map's end in .db)")
        if any(path.resolve() == other.resolve() for other in inputs):
            raise UsageError(f"--database {path}: it is the recording as well; name another file")
        if path.resolve().is_relative_to(output.resolve()):
            raise UsageError(f"--database {path}: lies in the folder of the result, {output}; name another with -o")
        if localise_only:
            if self.anew:
                raise UsageError("--localise-only and --delete-db-on-start: there would be no map to localise in")
            if not path.is_file():
                raise UsageError(f"--localise-only: there is no database {path}")
            return
        check_file(path)
        if path.is_file() and not os.access(path, os.W_OK):
            raise UsageError(f"--database {path}: is read-only (--localise-only uses its map without changing it)")

    @property
    def appends(self) -> bool:
        """Whether the file is there, and is gone on from."""
        return self.file is not None and self.file.is_file() and not self.anew

    def begin(self, output: Path, log: RunLog, *, localise_only: bool = False) -> DatabaseChoice:
        """Make way for the database, and return where it lies; one that must not change is copied there.

        What a run that was killed left beside the result is moved aside, never removed, unless there is no node in it.

        Raises
        ------
        UsageError
            If another process uses the file.
        """
        if self.file is not None and not localise_only:
            choice = DatabaseChoice(path=self.file, append=self.appends, keep=True)
            if self.anew and self.file.is_file():
                _check_free(self.file)
                _remove(self.file)
                log.note(f"{self.file}: begun anew (--delete-db-on-start)")
            self.file.resolve().parent.mkdir(parents=True, exist_ok=True)
            return choice
        path = running_file(output)
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            _check_free(path)
            if _is_empty(path):
                _remove(path)
        if path.exists():
            aside = _free_name(path)
            for ending in ("", *_BESIDE):
                left = path.with_name(path.name + ending)
                if left.exists():
                    left.rename(aside.with_name(aside.name + ending))
            log.note(
                f"an earlier run that did not end left its database: it lies in {aside} now (--database goes on in it)"
            )
        if self.file is not None:
            _check_free(self.file)
            shutil.copyfile(self.file, path)
        return DatabaseChoice(path=path, append=self.file is not None)


def localising(tier: Tier, config: NativeConfig, asked: bool) -> tuple[NativeConfig, bool]:
    """Return the configuration and whether the map stays as it is: by ``--localise-only``, or by the tier's own parameter."""
    if not tier.remembers:
        return config, asked
    values = as_dict(config.parameters)
    localise_only = asked or values.get(_INCREMENTAL) is False
    if localise_only and _INCREMENTAL in values:
        parameters = resolve(type(config.parameters), values, {_INCREMENTAL: False})
        config = replace(config, parameters=parameters)
    return config, localise_only


def running_file(output: Path) -> Path:
    """Return where the database lies while a result is made: beside its folder."""
    whole = output.resolve()
    return whole.with_name(f"{whole.name}.running.db")


def put_into(folder: Path, result: MappingResult, choice: DatabaseChoice | None) -> tuple[str, ...]:
    """Put the database into the folder of the result, unless it stays where it is; return the names that are new there.

    The file beside the folder is there still, so that nothing is lost if the folder is not finished; `remove_running`
    removes it.
    """
    if choice is None or choice.keep or is_scratch(choice) or result.database is None:
        return ()
    try:
        os.link(result.database, folder / FILE)
    except OSError:
        shutil.copyfile(result.database, folder / FILE)
    return (FILE,)


def remove_running(choice: DatabaseChoice | None) -> None:
    """Remove the database beside the result, once it lies in its folder."""
    if choice is not None and (is_scratch(choice) or not choice.append):
        _remove(choice.path)


def leave_behind(choice: DatabaseChoice | None, log: RunLog) -> None:
    """Clear up after a run that failed: what it began and has nodes stays, and it is said where; everything else is removed."""
    if choice is None or not choice.path.exists():
        return
    if is_scratch(choice):
        _remove(choice.path)
    elif not choice.append:
        num_nodes = count_committed_nodes(choice.path)
        if num_nodes:
            log.warn(f"{choice.path} holds the {num_nodes} nodes made so far (--database goes on in it)")
        else:
            _remove(choice.path)


def is_scratch(choice: DatabaseChoice | None) -> bool:
    """Return whether it is a copy of a database that must not change: worth nothing once the run is over."""
    return choice is not None and choice.append and not choice.keep


def _remove(path: Path) -> None:
    for ending in ("", *_BESIDE):
        path.with_name(path.name + ending).unlink(missing_ok=True)


def _check_free(path: Path) -> None:
    if is_in_use(path):
        raise UsageError(
            f"{path}: another process uses this database; wait until it has ended, or give another file or -o"
        )


def _is_empty(path: Path) -> bool:
    """Return whether a database has no nodes."""
    try:
        with Database.read(path) as database:
            return len(database.nodes()) == 0
    except FormatError:
        return False


def _free_name(path: Path) -> Path:
    stem = path.name.removesuffix(".running.db")
    number = 1
    while (aside := path.with_name(f"{stem}.interrupted-{number}.db")).exists():
        number += 1
    return aside
