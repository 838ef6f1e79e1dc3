# SPDX-License-Identifier: MIT
"""The ``slamcli`` command: finds commands without importing them, and turns errors into one line and an exit code."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

import click

from slamcli import __version__
from slamcli.cli import kernel_cache
from slamcli.errors import InputError, SlamcliError

WORDS = "slamcli.words"
"""Where the words of the command line after the command lie in a context's `meta`."""

# name -> (module under slamcli.cli, one line of help); a command is imported when it runs, or for its own --help.
COMMANDS: dict[str, tuple[str, str]] = {
    "info": ("info", "What a recording holds, and which SLAM systems can run on it."),
    "doctor": ("doctor", "What is wrong with a recording, and the option that mends it."),
    "convert": ("convert", "Convert recordings and classic logs between formats."),
    "map": ("map", "Build a map and a trajectory from a recording."),
    "sweep": ("sweep", "Try many values of native parameters on a recording, and rank them."),
    "evaluate": ("evaluate", "Score a trajectory or a map against ground truth."),
    "compare": ("compare", "Run several SLAM systems on one recording, side by side."),
    "localize": ("localize", "Localise a recording on a known map (AMCL)."),
    "plan": ("plan", "Plan paths on a saved map."),
    "navigate": ("navigate", "Drive a simulated robot to goals with the whole navigation stack."),
    "explore": ("explore", "Explore an unknown world with a simulated robot, and save the map."),
    "teleop": ("teleop", "Drive a simulated robot with the keyboard, and record it."),
    "generate": ("generate", "Make a synthetic recording with ground truth."),
    "view": ("view", "Draw a recording, a result or a map."),
    "map-tools": ("map_tools", "Inspect, convert, crop and compare saved maps."),
    "vocabulary": ("vocabulary", "Train and inspect vocabularies of visual words."),
    "config": ("config", "Show resolved parameters; check native configuration files."),
    "schema": ("schema", "The JSON Schemas of run.json and --json documents; checks a document."),
    "warmup": ("warmup", "Compile all kernels beforehand (for images and CI)."),
}


class LazyGroup(click.Group):
    """A group whose commands are imported on demand, so that ``--help`` stays fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return one command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"slamcli.cli.{COMMANDS[cmd_name][0]}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Name the nearest command where there is none of that name."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            import difflib

            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            ctx.fail(f"no command {args[0]!r}{hint}")
        ctx.meta[WORDS] = args[1:]
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands from the table, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="slamcli")
def cli() -> None:
    """From a robot's recording to a map, a trajectory, a score and a path, without ROS.

    \b
    slamcli convert intel.clf.gz intel.mcap
    slamcli map --algo gmapping intel.mcap -o intel
    slamcli evaluate intel/trajectory.tum intel.relations
    slamcli plan -1.5,2.0 3.0,2.0 --map intel/map.yaml

    Exit codes: 0 done, 1 failed or a threshold missed, 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    code = run(arguments)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # whoever read it has gone, or the terminal has: Python would end with 120 for it
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 done, 1 failed, 2 wrong usage or input."""
    kernel_cache.prepare()
    try:
        result: Any = cli.main(args=arguments, prog_name="slamcli", standalone_mode=False)
    except click.exceptions.Abort:
        return _fail("interrupted; no result was written", 130)
    except KeyboardInterrupt:
        return _fail("interrupted; no result was written", 130)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = f" (see {context.command_path} --help)" if context is not None else ""
        return _fail(error.format_message().rstrip(".") + hint, 2)
    except SlamcliError as error:
        return _fail(str(error), 2 if isinstance(error, InputError) else 1)
    except BrokenPipeError:
        # The reader of our output has gone (`slamcli info bag | head`): not an error. Python would complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        return _fail("out of memory", 1)
    return result if isinstance(result, int) else 0


def _fail(message: str, code: int) -> int:
    click.echo(f"slamcli: {' '.join(message.split())}", err=True)  # one line, whatever a parser or a file's name holds
    return code
