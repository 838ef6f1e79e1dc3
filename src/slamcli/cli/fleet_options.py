# SPDX-License-Identifier: MIT
"""Options of commands that take many inputs: each becomes a run of its own (see ``docs/fleets.md``)."""

from __future__ import annotations

import functools
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from slamcli.cli.console import Console, print_json
from slamcli.cli.main import WORDS
from slamcli.cli.options import Decorator
from slamcli.cli.quantities import parse_size
from slamcli.errors import UsageError

_INTERRUPTED = 130
_NAME = "{name}"

_OPTIONS = (
    click.option(
        "--each", is_flag=True,
        help="Every input is a recording of its own; a folder of them, a pattern in quotes, @LIST.txt and URLs say so by themselves.",
    ),
    click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Runs at once.  [default: all cores]"),
    click.option("--scheduler", metavar="tcp://HOST:PORT", help="Run them on this Dask cluster."),
    click.option(
        "--max-memory", metavar="SIZE",
        help="End a run that needs more memory (2GB).  [default: each worker's share of the machine's]",
    ),
    click.option("--fresh", is_flag=True, help="Run all again, also what an earlier call has done."),
    click.option("--keep-inputs", is_flag=True, help="Keep fetched files in OUT/cache."),
)  # fmt: skip
_OURS = ("each", "workers", "scheduler", "max_memory", "fresh", "keep_inputs")
_NOT_PASSED_ON = (*_OURS, "output", "as_json", "verbosity")
_OWN_FILES = ("save_state", "plot", "database")
"""Options that name a file which a run writes: one per run, so `{name}` must stand in it."""


def fleet_options(argument: str = "bag", *, result: str, own_jobs: bool = False) -> Decorator:
    """Let a command take many inputs; stands directly below ``@click.command()``.

    The command itself is called only for one input, and gets none of the options.

    Parameters
    ----------
    argument
        Name of the argument that holds the inputs; ``estimate`` are trajectories, all others recordings.
    result
        Ending of the folder's name where none is given (``maps``).
    own_jobs
        Whether the command has jobs of its own: it gets `workers` (None: not given), `scheduler` and `memory_limit_bytes`.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def one_or_many(**arguments: Any) -> Any:
            ours = {name: arguments.pop(name) for name in _OURS}
            ours["max_memory"] = None if ours["max_memory"] is None else parse_size(ours["max_memory"], "--max-memory")
            words = _inputs(click.get_current_context(), argument)
            if arguments.get("together") and ours["each"]:
                raise UsageError("--together ranks over all recordings, --each does every one by itself: choose one")
            if not arguments.get("together") and _are_many(words, argument, each=ours["each"]):
                return _run(argument, result, own_jobs, words, arguments, ours)
            if own_jobs:
                _refuse_alone({name: ours[name] for name in ("fresh", "keep_inputs")})
                names = {"workers": "workers", "scheduler": "scheduler", "max_memory": "memory_limit_bytes"}
                return function(**arguments, **{names[name]: ours[name] for name in names})
            _refuse_alone(ours)
            return function(**arguments)

        for option in _OPTIONS:
            one_or_many = option(one_or_many)
        added = one_or_many.__click_params__[-len(_OPTIONS) :]  # type: ignore[attr-defined]
        del one_or_many.__click_params__[-len(_OPTIONS) :]  # type: ignore[attr-defined]
        one_or_many.__click_params__[:0] = added[::-1]  # type: ignore[attr-defined]  # click turns the order: they are the last of --help
        return one_or_many

    return decorate


def _are_many(words: Sequence[str], argument: str, *, each: bool) -> bool:
    if each and not words:
        raise UsageError("--each: name the inputs")
    if each or not words:
        return each
    if all(_is_plain_file(word) for word in words):  # most calls: nothing else is imported
        return False
    from slamcli.pipelines.sources import is_many

    return any(is_many(word, _kind(argument)) for word in words)


def _inputs(context: click.Context, argument: str) -> list[str]:
    """Return the inputs as they were given: a `Path` takes a slash out of ``s3://``."""
    values, _, _ = context.command.make_parser(context).parse_args(list(context.meta[WORDS]))
    return _as_words(values.get(argument))


def _is_plain_file(word: str) -> bool:
    return Path(word).is_file()


def _kind(argument: str) -> Any:
    from slamcli.pipelines.sources import RECORDINGS, TRAJECTORIES

    return TRAJECTORIES if argument == "estimate" else RECORDINGS


def _refuse_alone(ours: dict[str, Any]) -> None:
    given = next((name for name in ours if ours[name]), None)
    if given is not None:
        raise UsageError(f"--{given.replace('_', '-')} is for many inputs: say --each if every input is one of its own")


def _run(
    argument: str, result: str, own_jobs: bool, words: Sequence[str], arguments: dict[str, Any], ours: dict[str, Any]
) -> int:
    from slamcli.pipelines.fleet import FleetRequest, run_fleet
    from slamcli.pipelines.sources import find_sources
    from slamcli.reports.fleet_report import fleet_text
    from slamcli.runtime import RunLog

    context = click.get_current_context()
    with Console(arguments.get("verbosity", 0)) as console:
        log = RunLog(console)
        sources = find_sources(words, _kind(argument))
        options, others = given_words(context, argument)
        for name in ("jobs", "workers") if own_jobs else ("jobs",):
            if not _is_given(context, name):
                options += [f"--{name}", "1"]
        junit: Path | None = arguments.get("junit")
        request = FleetRequest(
            command=context.info_name or "", sources=sources, words=options, after=others,
            output=Path(arguments.get("output") or _default_output(words[0], result)), workers=ours["workers"] or 0,
            scheduler=ours["scheduler"], memory_limit_bytes=ours["max_memory"], fresh=ours["fresh"],
            keep_inputs=ours["keep_inputs"], junit=junit if junit is not None and _NAME not in str(junit) else None,
        )  # fmt: skip
        from slamcli.cli.fleet_progress import FleetProgress

        progress = FleetProgress(console, len(sources))
        try:
            outcome = run_fleet(request, log, progress.told)
        except KeyboardInterrupt:
            progress.interrupted()
            return _INTERRUPTED
        progress.clear()
        console.tell(log)
        if arguments.get("as_json"):
            print_json(outcome.document)
        else:
            width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
            click.echo(fleet_text(outcome.document, width))
        progress.ended(outcome.output)
    codes = {row["exit_code"] for row in outcome.document["runs"]}
    return 2 if codes == {2} else int(outcome.failed > 0)


def _is_given(context: click.Context, name: str) -> bool:
    """Return whether an option was given, True where the command has none of that name."""
    return name not in context.params or context.get_parameter_source(name) is ParameterSource.COMMANDLINE


def given_words(context: click.Context, argument: str) -> tuple[list[str], list[str]]:
    """Return the options of a command line as they were given, and the arguments besides `argument`.

    Options of fleets, the output folder and those about what is printed are left out.

    Raises
    ------
    UsageError
        If an option names a file that every run would write.
    """
    given = list(context.meta[WORDS])
    values, _, order = context.command.make_parser(context).parse_args(given)
    taken: dict[str, int] = {}
    options: list[str] = []
    for parameter in order:
        name = parameter.name or ""
        if not isinstance(parameter, click.Option) or name in _NOT_PASSED_ON:
            continue
        raw = values[name]
        if name == "junit" and _NAME not in str(raw):
            continue  # one file for all of them: a case per input
        if parameter.multiple:
            raw = raw[taken.setdefault(name, 0)]
            taken[name] += 1
        if name in _OWN_FILES and _NAME not in str(raw):
            raise UsageError(f"{parameter.opts[-1]} {raw}: every run would write this file: put {{name}} into its name")
        options += _words_of(parameter, raw)
    others = [
        word
        for parameter in context.command.params
        if isinstance(parameter, click.Argument) and parameter.name != argument
        for word in _as_words(values.get(parameter.name or ""))
    ]
    return options, others


def _words_of(option: click.Option, raw: Any) -> Iterator[str]:
    """Yield one option as words of a command line."""
    flag = max(option.opts, key=len)
    if option.is_flag or option.count:
        yield max(option.secondary_opts, key=len) if option.secondary_opts and raw is False else flag
    elif isinstance(raw, tuple):
        yield flag
        yield from map(str, raw)
    else:
        yield f"{flag}={raw}" if flag.startswith("--") else f"{flag}{raw}"


def _as_words(value: Any) -> list[str]:
    return [str(one) for one in (value if isinstance(value, (tuple, list)) else (value,)) if isinstance(one, str)]


def _default_output(word: str, result: str) -> Path:
    """Return the folder beside the inputs that bears their name: of the folder, of the list, or of what a pattern begins with."""
    from slamcli.pipelines.sources import is_url, stem_of

    if is_url(word):
        fixed = [part for part in word.split("/")[2:] if part and not set(part) & set("*?[")]
        return Path(f"{stem_of(fixed[-1]) if fixed else 'fleet'}-{result}")
    if word.startswith("@"):
        path = Path(word[1:])
        return path.parent / f"{path.stem}-{result}"
    path = Path(word)
    while set(path.name) & set("*?[") and not path.exists():
        path = path.parent
    name = stem_of(path.resolve().name) or "fleet"
    return path.parent / f"{name}-{result}" if path.name else Path(f"{name}-{result}")
