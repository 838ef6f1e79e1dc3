# SPDX-License-Identifier: MIT
from __future__ import annotations

import importlib
import re
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from slamcli import __version__
from slamcli.cli import main as main_module
from slamcli.cli.main import COMMANDS, run
from slamcli.errors import ConfigError, PlanningError

ROOT = Path(__file__).resolve().parents[2]
FORBIDDEN = ("numba", "cv2", "gtsam", "open3d", "scipy")


def all_commands() -> list[tuple[str, click.Command]]:
    found = []
    for name, (module, _) in COMMANDS.items():
        command = importlib.import_module(f"slamcli.cli.{module}").command
        found.append((name, command))
        if isinstance(command, click.Group):
            found.extend((f"{name} {child}", inner) for child, inner in command.commands.items())
    return found


@pytest.mark.parametrize("arguments", [[], *([name] for name in COMMANDS)], ids=lambda a: a[0] if a else "slamcli")
def test_help_is_quick_and_imports_nothing_heavy(arguments):
    code = (
        "import sys; from slamcli.cli.main import run; code = run(sys.argv[1:]); "
        f"print('loaded', [n for n in {FORBIDDEN!r} if n in sys.modules]); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments, "--help"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "loaded []"


def test_help_answers_in_under_300_ms():
    times = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "slamcli", "--help"], capture_output=True, check=True)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.3


def test_every_command_and_every_option_has_help():
    for name, command in all_commands():
        assert command.help, name
        assert "\\b" not in command.help, f"{name}: click needs the backspace itself, not backslash and b"
        assert command.help.strip().splitlines()[0].endswith((".", ":")), name
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, f"{name} {parameter.opts}"


def test_help_fits_80_columns():
    for name, command in [("", main_module.cli), *all_commands()]:
        words = ["slamcli", *name.split()]
        context = click.Context(command, info_name=" ".join(words), terminal_width=80, max_content_width=80)
        text = command.get_help(context)
        assert [line for line in text.splitlines() if len(line) > 80] == [], name
        assert not re.search(r"^  .*\.\.\.$", text, re.MULTILINE), name  # the line of a subcommand that was cut off


def test_what_is_true_is_named_by_ref_and_by_truth_alike():
    names = {name: {opt for p in command.params for opt in p.opts} for name, command in all_commands()}
    for name in ("map", "sweep", "compare", "localize", "view"):
        assert {"--ref", "--truth"} <= names[name], name


def test_every_command_has_a_page_and_stands_in_the_readme():
    readme = (ROOT / "README.md").read_text()
    index = (ROOT / "docs" / "index.md").read_text()
    for name in COMMANDS:
        assert (ROOT / "docs" / f"{name}.md").is_file() or name == "config", name
        assert re.search(rf"\bslamcli {name}\b|`{name}`", readme), name
        assert name in index, name


def test_every_option_is_on_the_page_of_its_command():
    missing = []
    mends = (ROOT / "docs" / "recordings.md").read_text()
    for name, command in all_commands():
        first = name.split()[0]
        page = (ROOT / "docs" / ("configuration.md" if first == "config" else f"{first}.md")).read_text()
        page += mends if "recordings.md" in page else ""  # the options of all that read a recording stand there
        page += "--quiet --verbose --json"  # the same everywhere: the README says so
        options = [parameter.opts for parameter in command.params if isinstance(parameter, click.Option)]
        missing.extend(f"{name}: {opts[-1]}" for opts in options if not any(option in page for option in opts))
    assert missing == []


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.strip().endswith(__version__)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mpa"], "no command 'mpa'; did you mean 'map'?"),
        (["--wrong"], "No such option"),
        (["info", "--wrong", "x"], "No such option"),
        (["evaluate"], "Missing argument"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(capsys, arguments, message):
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.startswith("slamcli: ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (ConfigError("lstep: x"), 2, "slamcli: lstep: x\n"),
        (PlanningError("no path"), 1, "slamcli: no path\n"),
        (MemoryError(), 1, "slamcli: out of memory\n"),
        (KeyboardInterrupt(), 130, "slamcli: interrupted; no result was written\n"),
    ],
)
def test_errors_become_one_line_and_an_exit_code(capsys, monkeypatch, error, code, message):
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(main_module.cli, "main", fail)
    assert run([]) == code
    assert capsys.readouterr().err == message


def test_a_programming_error_keeps_its_traceback(monkeypatch):
    def fail(**_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(main_module.cli, "main", fail)
    with pytest.raises(ZeroDivisionError):
        run([])


def test_a_reader_that_goes_away_is_no_error():
    command = f"{sys.executable} -m slamcli config show --algo gmapping | head -n 1"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command}"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr == ""
