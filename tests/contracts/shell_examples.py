# SPDX-License-Identifier: MIT
"""The slamcli commands that stand in pages, workflows and scripts, and whether they exist with the options they are given."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator

from slamcli.cli.main import COMMANDS

_ENDS = re.compile(r"\s(?:\||\|\||&&|;|>|2>|<)\s?|[;)`]\s*$|\s#.*|\)\"|`")


def commands_in(script: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the command and the words after it of each `slamcli` in a shell script; lines may go on after a backslash."""
    for line in script.replace("\\\n", " ").splitlines():
        for found in re.finditer(r"(?:^|[\s(\"'])slamcli ([a-z][a-z-]*)(.*)", line):
            rest = re.split(r"(?:^|[\s(\"'])slamcli ", found[2])[0]
            yield found[1], _ENDS.split(f"{rest} ", maxsplit=1)[0].replace("; ", " ; ").split(" ; ")[0].split()
            if (more := found[2][len(rest) :]).strip():
                yield from commands_in(more)


def wrong_in(script: str) -> list[str]:
    """Return the commands and options of a script that there are not."""
    wrong = []
    for name, words in commands_in(script):
        if name not in COMMANDS:
            wrong.append(f"slamcli {name}")
            continue
        command = importlib.import_module(f"slamcli.cli.{COMMANDS[name][0]}").command
        if hasattr(command, "commands"):
            command = command.commands.get(words[0] if words else "", command)
        known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        known |= {"--help", "-h"}
        wrong += [
            f"slamcli {name} {word}"
            for word in words
            if re.match(r"--?[a-z]", word) and word.partition("=")[0] not in known
        ]
    return wrong
