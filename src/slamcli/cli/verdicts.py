# SPDX-License-Identifier: MIT
"""What ``--max``, ``--min`` and ``--junit`` do, for every command that has them: the verdicts, the exit code, the file for CI."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import click

from slamcli.cli.console import Console

if TYPE_CHECKING:
    from slamcli.evaluation.thresholds import Threshold, Verdict
    from slamcli.reports.junit import JunitCase


class Verdicts:
    """Judges a command's figures; a context manager around its work that writes the JUnit file whatever comes of it.

    ::

        with Verdicts("evaluate", subject="EST against REF", upper=upper, lower=lower, junit=junit) as verdicts:
            ...
            verdicts.judge(score.figures())
            document["thresholds"] = verdicts.as_dicts()
            verdicts.tell(console)
        return verdicts.exit_code

    An error inside the block goes on its way; in the file it is a ``failure`` where the work itself failed (`ProcessError`), an
    ``error`` where it could not be done.

    Raises
    ------
    UsageError
        On entering: if a threshold is not KEY=VALUE, or the JUnit file cannot be written.
    """

    def __init__(
        self, command: str, *, subject: str, upper: Sequence[str], lower: Sequence[str], junit: Path | None
    ) -> None:
        self._command, self._subject, self._junit = command, subject, junit
        self._texts = (upper, lower)
        self._began = time.perf_counter()
        self._thresholds: list[Threshold] = []
        self._figures: Mapping[str, float] = {}
        self._verdicts: tuple[Verdict, ...] = ()

    @property
    def exit_code(self) -> int:
        """1 if a threshold was missed, else 0."""
        return 0 if all(verdict.passed for verdict in self._verdicts) else 1

    @property
    def keys(self) -> tuple[str, ...]:
        """The figures that thresholds are on."""
        return tuple(threshold.key for threshold in self._thresholds)

    def judge(self, figures: Mapping[str, float]) -> None:
        """Hold the figures against the thresholds.

        Raises
        ------
        UsageError
            If a threshold is on a figure that there is not; the message names those there are.
        """
        from slamcli.evaluation.thresholds import judge

        self._figures = figures
        self._verdicts = judge(figures, self._thresholds)

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the verdicts for a JSON document, in the order of the options: --max first."""
        return [_as_dict(verdict) for verdict in self._verdicts]

    def added_to(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return a run's document with the verdicts, where there are any."""
        return {**document, "thresholds": self.as_dicts()} if self._verdicts else dict(document)

    def tell(self, console: Console) -> None:
        """Say what was missed; what was kept only with --verbose."""
        for verdict in self._verdicts:
            (console.detail if verdict.passed else console.warn)(verdict.message)

    def __enter__(self) -> Self:
        from slamcli.evaluation.thresholds import parse_threshold
        from slamcli.outputs import check_file

        if self._junit is not None:
            check_file(self._junit)
        try:
            upper, lower = self._texts
            self._thresholds = [parse_threshold(text, upper=True) for text in upper]
            self._thresholds += [parse_threshold(text, upper=False) for text in lower]
        except Exception as error:
            self._write(self._cases(error))
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, BrokenPipeError):  # the reader of stdout has gone: no error (cli.main)
            self._write(self._cases())
        elif isinstance(error, Exception):
            self._write(self._cases(error))

    def _cases(self, error: Exception | None = None) -> list[JunitCase]:
        """Return a case for the command where it failed or nothing was asked of it, and one for each threshold."""
        from slamcli.errors import DependencyError, ProcessError
        from slamcli.reports.junit import JunitCase

        classname = f"slamcli.{self._command}"
        said = None if error is None else _message(error)
        failed = isinstance(error, ProcessError) and not isinstance(error, DependencyError)
        cases = [
            JunitCase(
                name=f"{self._subject}: {verdict.threshold.key} {'<=' if verdict.threshold.upper else '>='} {verdict.threshold.value:g}",
                classname=classname, failure=None if verdict.passed else verdict.message, output=verdict.message,
            )
            for verdict in self._verdicts
        ]  # fmt: skip
        if said is not None or not cases:
            failure, trouble = (said, None) if failed else (None, said)
            cases.insert(0, JunitCase(name=self._subject, classname=classname, failure=failure, error=trouble))
        # The work was done once for all of them: its time and its figures stand at the first.
        figures = "\n".join(f"{name} = {value:.9g}" for name, value in self._figures.items())
        output = "\n\n".join(text for text in (cases[0].output, figures) if text)
        return [replace(cases[0], seconds=time.perf_counter() - self._began, output=output), *cases[1:]]

    def _write(self, cases: Sequence[JunitCase]) -> None:
        if self._junit is None:
            return
        from slamcli import __version__
        from slamcli.outputs import atomic_file
        from slamcli.reports.junit import junit_xml

        text = junit_xml(f"slamcli {self._command}", cases, {"slamcli": __version__})
        with atomic_file(self._junit) as stream:
            stream.write(text)


def _as_dict(verdict: Verdict) -> dict[str, Any]:
    bar = verdict.threshold
    return {
        "key": bar.key,
        "max" if bar.upper else "min": bar.value,
        "value": verdict.figure,
        "passed": verdict.passed,
        "message": verdict.message,
    }


def _message(error: Exception) -> str:
    from slamcli.errors import SlamcliError

    if isinstance(error, click.ClickException):
        return error.format_message()
    return str(error) if isinstance(error, SlamcliError) else f"{type(error).__name__}: {error}"
