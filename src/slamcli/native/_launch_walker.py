# SPDX-License-Identifier: MIT
"""Walks a launch file's elements in order, as roslaunch does, and collects nodes, parameters and remappings."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native._substitution import Scope, auto_type, substitute
from slamcli.native._xml_tree import Element, parse_xml
from slamcli.native.ros_yaml import parse_ros_yaml, parse_value
from slamcli.native.settings import Setting, read_text

_MAX_FILES = 200
_MAX_INCLUDE_DEPTH = 20
_IGNORED = {"machine", "env", "test"}
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
_TYPES: dict[str, Callable[[str], Any]] = {
    "auto": auto_type,
    "": auto_type,
    "str": str,
    "string": str,
    "int": int,
    "double": float,
    "bool": lambda text: _BOOLEANS[text.strip().lower()],
    "boolean": lambda text: _BOOLEANS[text.strip().lower()],
}


@dataclass(slots=True)
class FoundNode:
    """A node while it is being read."""

    package: str
    type: str
    name: str
    namespace: str
    args: str
    file: str
    line: int
    remaps: dict[str, str] = field(default_factory=dict)

    @property
    def full_name(self) -> str:
        """Its resolved name without the leading slash."""
        return join_names(self.namespace, self.name)


@dataclass(slots=True)
class _Place:
    """Where the walk is: the file with its arguments, the namespace, the remappings in force."""

    file: Path
    arguments: dict[str, str]
    passed: dict[str, str]
    """Arguments that the includer (or caller) gave."""
    namespace: str
    remaps: dict[str, str]
    depth: int = 0
    node: FoundNode | None = None


def join_names(namespace: str, name: str) -> str:
    """Return a ROS name resolved in a namespace, without the leading slash."""
    if name.startswith("/"):
        return name.strip("/")
    return "/".join(part for part in (namespace.strip("/"), name.strip("/")) if part)


class Walker:
    """Collects what a launch file and the files it includes say."""

    def __init__(self, packages: Mapping[str, Path]) -> None:
        self.nodes: list[FoundNode] = []
        self.params: dict[str, Setting] = {}
        self.notes: list[str] = []
        self._packages = packages
        self._files = 0
        self._handlers: dict[str, Callable[[Element, _Place], None]] = {
            "arg": self._arg,
            "group": self._group,
            "include": self._include,
            "node": self._node,
            "param": self._param,
            "remap": self._remap,
            "rosparam": self._rosparam,
        }

    def read(self, path: Path, passed: dict[str, str]) -> dict[str, str]:
        """Read the outermost file and return its arguments with their values."""
        place = _Place(path, {}, passed, "", {})
        self._read(place)
        return place.arguments

    def private(self, node: FoundNode) -> dict[str, Setting]:
        """Return a node's own parameters, named as the node sees them (`~name`)."""
        prefix = node.full_name + "/"
        return {
            name[len(prefix) :]: dataclasses.replace(setting, name=name[len(prefix) :])
            for name, setting in self.params.items()
            if name.startswith(prefix)
        }

    def _read(self, place: _Place) -> None:
        self._files += 1
        if self._files > _MAX_FILES or place.depth > _MAX_INCLUDE_DEPTH:
            raise ConfigError(f"{place.file}: includes do not end (a file that includes itself?)")
        root = parse_xml(place.file)
        if root.tag != "launch":
            raise ConfigError(f"{place.file}:{root.line}: expected <launch>, found <{root.tag}>")
        self._children(root, place)

    def _children(self, element: Element, place: _Place) -> None:
        for child in element.children:
            if child.tag in _IGNORED or not self._condition(child, place):
                continue
            if child.tag not in self._handlers:
                known = ", ".join(sorted(self._handlers))
                raise _error(place, child, f"<{child.tag}> is not a launch element (known: {known})")
            self._handlers[child.tag](child, place)

    def _condition(self, element: Element, place: _Place) -> bool:
        for attribute, wanted in (("if", True), ("unless", False)):
            if attribute not in element.attributes:
                continue
            text = self._get(element, attribute, place).strip().lower()
            if text not in _BOOLEANS:
                raise _error(place, element, f"{attribute}={text!r} is neither true nor false")
            if _BOOLEANS[text] is not wanted:
                return False
        return True

    def _get(self, element: Element, attribute: str, place: _Place, default: str | None = None) -> str:
        """Return an attribute with its substitutions made."""
        text = element.attributes.get(attribute, default)
        if text is None:
            raise _error(place, element, f"<{element.tag}> has no {attribute}")
        try:
            return substitute(text, Scope(place.file, place.arguments, self._packages))
        except ConfigError as error:
            raise _error(place, element, str(error)) from error

    def _arg(self, element: Element, place: _Place) -> None:
        name = self._get(element, "name", place)
        if "value" in element.attributes:
            place.arguments[name] = self._get(element, "value", place)
        elif name in place.passed:
            place.arguments[name] = place.passed[name]
        elif "default" in element.attributes:
            place.arguments[name] = self._get(element, "default", place)
        else:
            raise _error(place, element, f"argument {name!r} needs a value: it has no default")

    def _group(self, element: Element, place: _Place) -> None:
        namespace = join_names(place.namespace, self._get(element, "ns", place, ""))
        self._children(element, dataclasses.replace(place, namespace=namespace, remaps=dict(place.remaps)))

    def _include(self, element: Element, place: _Place) -> None:
        path = self._find_file(self._get(element, "file", place), place)
        if path is None:
            self.notes.append(f"{_where(place, element)}: {element.attributes['file']} is not here: include skipped")
            return
        passed = dict(place.arguments) if _BOOLEANS.get(element.attributes.get("pass_all_args", "")) else {}
        for child in element.children:
            if child.tag == "arg" and self._condition(child, place):
                value = "value" if "value" in child.attributes else "default"
                passed[self._get(child, "name", place)] = self._get(child, value, place)
        namespace = join_names(place.namespace, self._get(element, "ns", place, ""))
        self._read(_Place(path, {}, passed, namespace, dict(place.remaps), place.depth + 1))

    def _find_file(self, name: str, place: _Place) -> Path | None:
        path = Path(name)
        candidates = [path] if path.is_absolute() else [place.file.parent / path]
        for candidate in [*candidates, place.file.parent / path.name]:
            try:
                if candidate.is_file():
                    return candidate
            except (OSError, ValueError):
                continue
        return None

    def _node(self, element: Element, place: _Place) -> None:
        node = FoundNode(
            package=self._get(element, "pkg", place),
            type=self._get(element, "type", place),
            name=self._get(element, "name", place),
            namespace=join_names(place.namespace, self._get(element, "ns", place, "")),
            args=" ".join(self._get(element, "args", place, "").split()),
            file=str(place.file),
            line=element.line,
        )
        inner = dataclasses.replace(place, node=node, namespace=node.full_name, remaps=dict(place.remaps))
        self._children(element, inner)
        node.remaps = inner.remaps
        self.nodes.append(node)

    def _remap(self, element: Element, place: _Place) -> None:
        place.remaps[self._get(element, "from", place)] = self._get(element, "to", place)

    def _param(self, element: Element, place: _Place) -> None:
        name = self._get(element, "name", place)
        if "value" in element.attributes:
            text = self._get(element, "value", place)
        elif "textfile" in element.attributes:
            path = self._find_file(self._get(element, "textfile", place), place)
            if path is None:
                self.notes.append(
                    f"{_where(place, element)}: {element.attributes['textfile']} is not here: {name} not set"
                )
                return
            text = read_text(path)
        else:
            self.notes.append(f"{_where(place, element)}: {name} comes from a command or binary file: not set")
            return
        value = self._typed(text, element, place)
        self._set(Setting(self._resolve(name, place), value, str(place.file), element.line))

    def _typed(self, text: str, element: Element, place: _Place) -> Any:
        kind = self._get(element, "type", place, "auto").strip().lower()
        if kind == "yaml":
            return parse_value(text, str(place.file), first_line=element.line)
        if kind not in _TYPES:
            raise _error(place, element, f"type {kind!r}: str, int, double, bool and yaml are known")
        try:
            return _TYPES[kind](text)
        except (ValueError, KeyError) as error:
            raise _error(place, element, f"value {text!r} is not of type {kind}") from error

    def _rosparam(self, element: Element, place: _Place) -> None:
        command = self._get(element, "command", place, "load")
        if command != "load":
            self.notes.append(f"{_where(place, element)}: rosparam {command} skipped")
            return
        space = self._resolve(self._get(element, "ns", place, ""), place)
        file, first_line, text = str(place.file), element.text_line, element.text
        if "file" in element.attributes:
            path = self._find_file(self._get(element, "file", place), place)
            if path is None:
                self.notes.append(f"{_where(place, element)}: {element.attributes['file']} is not here: not loaded")
                return
            file, first_line, text = str(path), 1, read_text(path)
        if _BOOLEANS.get(self._get(element, "subst_value", place, "false")):
            text = self._get(dataclasses.replace(element, attributes={"text": text}), "text", place)
        if "param" in element.attributes:
            name = join_names(space, self._get(element, "param", place))
            self._set(Setting(name, parse_value(text, file, first_line=first_line), file, first_line))
            return
        for setting in parse_ros_yaml(text, file, first_line=first_line, namespace=space):
            self._set(setting)

    def _resolve(self, name: str, place: _Place) -> str:
        if name.startswith("~"):
            name = name[1:]
        return join_names(place.namespace, name)

    def _set(self, setting: Setting) -> None:
        self.params.pop(setting.name, None)
        self.params[setting.name] = setting


def _where(place: _Place, element: Element) -> str:
    return f"{place.file}:{element.line}"


def _error(place: _Place, element: Element, message: str) -> ConfigError:
    return ConfigError(f"{_where(place, element)}: {message}")
