# SPDX-License-Identifier: MIT
"""ROS parameter YAML: nested maps, ``deg()``/``rad()`` and ``!degrees``, every value with its line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from slamcli.errors import ConfigError
from slamcli.native.expressions import evaluate
from slamcli.native.settings import Setting, read_text

_MAX_DEPTH = 50
_MAX_VALUES = 100_000
_ANGLE = re.compile(r"^(deg|rad)\((.*)\)$")
_ANGLE_TAGS = {"!degrees": "deg", "!radians": "rad"}
_STANDARD = "tag:yaml.org,2002:"


def read_ros_yaml(path: Path, namespace: str = "") -> tuple[Setting, ...]:
    """Return the parameters of a YAML file in the order of the file, flat, named below `namespace`.

    Raises
    ------
    ConfigError
        If the file cannot be read or is not a map of parameters; the message has file and line.
    """
    return parse_ros_yaml(read_text(Path(path)), str(path), namespace=namespace)


def parse_ros_yaml(text: str, file: str, *, first_line: int = 1, namespace: str = "") -> tuple[Setting, ...]:
    """Return the parameters in `text`; `first_line` is the line of `file` on which it begins."""
    root = _compose(text, file, first_line)
    if root is None:
        return ()
    if not isinstance(root, yaml.MappingNode):
        raise ConfigError(
            f"{file}:{_line(root, first_line)}: expected `name: value` pairs, found {type(root).__name__.removesuffix('Node').lower()}"
        )
    return tuple(_Reader(file, first_line).flatten(root, namespace.strip("/")))


def parse_value(text: str, file: str, *, first_line: int = 1) -> Any:
    """Return the one value (of any shape) that `text` holds; None if it holds none."""
    root = _compose(text, file, first_line)
    return None if root is None else _Reader(file, first_line).value(root, 0)


def _compose(text: str, file: str, first_line: int) -> yaml.Node | None:
    try:
        # Only the node tree is built here: no tag can construct anything.
        return yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = (mark.line if mark else 0) + first_line
        raise ConfigError(f"{file}:{line}: not YAML: {error.problem or error.context}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{file}: not YAML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise ConfigError(f"{file}: nested too deeply for a parameter file") from error


def _line(node: yaml.Node, first_line: int) -> int:
    return int(node.start_mark.line) + first_line


class _Reader:
    """Turns a node tree into settings; aliases cannot grow it beyond the limits."""

    def __init__(self, file: str, first_line: int) -> None:
        self._file = file
        self._first_line = first_line
        self._values = 0

    def flatten(self, node: yaml.MappingNode, prefix: str, depth: int = 0) -> Iterator[Setting]:
        for key, child in self._pairs(node, depth):
            name = f"{prefix}/{key.strip('/')}" if prefix else key.strip("/")
            if isinstance(child, yaml.MappingNode) and child.value:
                yield from self.flatten(child, name, depth + 1)
            else:
                yield Setting(name, self.value(child, depth + 1), self._file, _line(child, self._first_line))

    def value(self, node: yaml.Node, depth: int) -> Any:
        self._count(node, depth)
        if isinstance(node, yaml.SequenceNode):
            return [self.value(child, depth + 1) for child in node.value]
        if isinstance(node, yaml.MappingNode):
            return {key: self.value(child, depth + 1) for key, child in self._pairs(node, depth)}
        return self._scalar(node)

    def _pairs(self, node: yaml.MappingNode, depth: int) -> Iterator[tuple[str, yaml.Node]]:
        self._count(node, depth)
        for key, child in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigError(f"{self._where(key)}: a parameter's name must be plain text")
            if key.tag == f"{_STANDARD}merge":
                for merged in child.value if isinstance(child, yaml.SequenceNode) else [child]:
                    if not isinstance(merged, yaml.MappingNode):
                        raise ConfigError(f"{self._where(key)}: << needs a map")
                    yield from self._pairs(merged, depth + 1)
                continue
            yield str(key.value), child

    def _scalar(self, node: yaml.Node) -> Any:
        text = str(node.value)
        if node.tag in _ANGLE_TAGS:
            return self._angle(_ANGLE_TAGS[node.tag], text, node)
        angle = _ANGLE.match(text.strip())
        if angle and node.tag == f"{_STANDARD}str":
            return self._angle(angle.group(1), angle.group(2), node)
        convert = _SCALARS.get(node.tag)
        if convert is None:
            raise ConfigError(f"{self._where(node)}: tag {node.tag!r} is not allowed in a parameter file")
        try:
            return convert(node)
        except (ValueError, OverflowError) as error:
            raise ConfigError(f"{self._where(node)}: {text!r}: {error}") from error

    def _angle(self, unit: str, inner: str, node: yaml.Node) -> float:
        try:
            number = float(evaluate(inner))
        except (ConfigError, ValueError, TypeError, OverflowError) as error:
            raise ConfigError(f"{self._where(node)}: {node.value!r} is not an angle") from error
        return math.radians(number) if unit == "deg" else number

    def _count(self, node: yaml.Node, depth: int) -> None:
        self._values += 1
        if depth > _MAX_DEPTH or self._values > _MAX_VALUES:
            raise ConfigError(f"{self._where(node)}: nested too deeply or too large for a parameter file")

    def _where(self, node: yaml.Node) -> str:
        return f"{self._file}:{_line(node, self._first_line)}"


_CONSTRUCTOR = yaml.constructor.SafeConstructor()
_SCALARS: dict[str, Callable[[Any], Any]] = {
    f"{_STANDARD}null": lambda _: None,
    f"{_STANDARD}bool": _CONSTRUCTOR.construct_yaml_bool,
    f"{_STANDARD}int": _CONSTRUCTOR.construct_yaml_int,
    f"{_STANDARD}float": _CONSTRUCTOR.construct_yaml_float,
    f"{_STANDARD}str": lambda node: str(node.value),
    f"{_STANDARD}timestamp": lambda node: str(node.value),
    f"{_STANDARD}value": lambda node: str(node.value),
}
