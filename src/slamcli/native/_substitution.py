# SPDX-License-Identifier: MIT
"""Substitution arguments of ROS launch files: ``$(arg x)``, ``$(find pkg)``, ``$(env V)``, ``$(eval ..)``."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native.expressions import evaluate

_ARGUMENT = re.compile(r"\$\(([^()]*(?:\([^()]*\)[^()]*)*)\)")
_MAX_TEXT = 100_000


@dataclass(frozen=True, slots=True)
class Scope:
    """What may be named at one place of a launch file."""

    file: Path
    arguments: Mapping[str, str]
    packages: Mapping[str, Path]
    """Folders of ROS packages that the caller knows."""


def substitute(text: str, scope: Scope) -> str:
    """Return `text` with its substitution arguments replaced.

    Raises
    ------
    ConfigError
        If an argument is not set, or a substitution is not known. The message has no place: the caller adds it.
    """
    if "$(" not in text:
        return text
    result = _ARGUMENT.sub(lambda match: _replace(match.group(1).strip(), scope), text)
    if len(result) > _MAX_TEXT:
        raise ConfigError(f"substitution makes {len(result)} characters")
    return result


def _replace(command: str, scope: Scope) -> str:
    verb, _, rest = command.partition(" ")
    rest = rest.strip()
    match verb:
        case "arg":
            return _argument(rest, scope)
        case "find":
            return str(find_package(rest, scope))
        case "env":
            if rest not in os.environ:
                raise ConfigError(f"$(env {rest}): the environment has no {rest}")
            return os.environ[rest]
        case "optenv":
            name, _, default = rest.partition(" ")
            return os.environ.get(name, default.strip())
        case "dirname":
            return str(scope.file.parent)
        case "anon":
            return rest
        case "eval":
            value = evaluate(
                rest, _typed(scope.arguments), {"arg": lambda name: _typed({name: _argument(name, scope)})[name]}
            )
            return str(value).lower() if isinstance(value, bool) else str(value)
    raise ConfigError(f"$({command}): unknown substitution; arg, find, env, optenv, dirname, anon and eval are known")


def _argument(name: str, scope: Scope) -> str:
    if name not in scope.arguments:
        known = ", ".join(sorted(scope.arguments)) or "none"
        raise ConfigError(
            f"$(arg {name}): no such argument here (known: {known}); give it as {name}:=VALUE or a default"
        )
    return scope.arguments[name]


def _typed(arguments: Mapping[str, str]) -> dict[str, object]:
    """Arguments as roslaunch types them within eval: numbers and booleans where the text is one."""
    return {name: auto_type(value) for name, value in arguments.items()}


def auto_type(text: str) -> object:
    """Return text as roslaunch types a parameter without a type: int, float, bool, else text."""
    try:
        return float(text) if "." in text else int(text)
    except ValueError:
        pass
    lowered = text.strip().lower()
    return lowered == "true" if lowered in ("true", "false") else text


def find_package(name: str, scope: Scope) -> Path:
    """Return the folder of a ROS package: a known one, else a folder above the file that is it, else a bare name.

    Without ROS a package often cannot be found. The name stands for it then, so that a value which merely passes
    through (an rviz file, a vocabulary) does no harm; reading such a file is what fails or is skipped.
    """
    if name in scope.packages:
        return scope.packages[name]
    for folder in scope.file.resolve().parents:
        if folder.name == name and folder.parent != folder:
            return folder
        manifest = folder / "package.xml"
        if manifest.is_file() and f"<name>{name}</name>" in manifest.read_text(encoding="utf-8", errors="replace"):
            return folder
    return Path(name)
