# SPDX-License-Identifier: MIT
"""Schemas say everything, and a released version does not change under its readers.

A change that a version may take (docs/json.md), and a new version: python tests/contracts/test_schemas.py
"""

from __future__ import annotations

import copy
import importlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from jsonschema import Draft202012Validator

from slamcli.cli.main import COMMANDS
from slamcli.pipelines.schemas import SchemaName, load_schema, schema_names, stamped

ROOT = Path(__file__).resolve().parents[2]
SHAPES = Path(__file__).with_name("schema_shapes.json")
BRANCHES = ("allOf", "anyOf", "oneOf")
# map, localize, navigate and explore print the document that they write as run.json.
SAME_AS_RUN = {"map", "localize", "navigate", "explore"}


def walk(schema: dict[str, Any], root: dict[str, Any], path: str = "$") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield all places of documents with what the schema says of them; a reference is followed."""
    if "$ref" in schema:
        schema = {**root["$defs"][schema["$ref"].rpartition("/")[2]], **schema}
    yield path, schema
    for name, inner in schema.get("properties", {}).items():
        yield from walk(inner, root, f"{path}.{name}")
    for key, suffix in (("items", "[]"), ("additionalProperties", ".*")):
        if isinstance(schema.get(key), dict) and schema[key]:
            yield from walk(schema[key], root, path + suffix)
    for key in BRANCHES:
        for number, inner in enumerate(schema.get(key, [])):
            yield from walk(inner.get("then", inner), root, f"{path}|{key}{number}")


def shape(root: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what readers depend on: for each place its types, the keys that are always there, the values allowed."""
    found = {}
    for path, schema in walk(root, root):
        kinds = schema.get("type", [])
        entry = {
            "types": sorted([kinds] if isinstance(kinds, str) else kinds),
            "required": sorted(schema.get("required", [])),
            "values": sorted(map(str, schema.get("enum", [schema["const"]] if "const" in schema else []))),
        }
        found[path] = {key: value for key, value in entry.items() if value}
    return found


def breaks(old: dict[str, dict[str, Any]], new: dict[str, dict[str, Any]]) -> list[str]:
    """Return what a reader of the old shape could stumble over in a document of the new one."""
    wrong = []
    for path, before in old.items():
        now = new.get(path)
        if now is None:
            wrong.append(f"{path} is gone")
            continue
        for key in ("types", "values"):
            more = set(now.get(key, [])) - set(before.get(key, []))
            if before.get(key) and (more or not now.get(key)):
                wrong.append(f"{path}: {key} {before[key]} became {now.get(key)}")
        if lost := set(before.get("required", [])) - set(now.get("required", [])):
            wrong.append(f"{path}: {sorted(lost)} may be absent")
    return wrong


def shapes() -> dict[str, dict[str, Any]]:
    return {schema.stamp: shape(load_schema(schema)) for schema in schema_names()}


@pytest.mark.parametrize("schema", schema_names(), ids=lambda s: s.stamp)
def test_a_schema_is_valid_and_explains_itself(schema: SchemaName):
    document = load_schema(schema)
    Draft202012Validator.check_schema(document)
    assert document["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert document["title"]
    assert document["description"]
    first, says = next(iter(document["properties"].items()))
    assert (first, says["const"]) == ("schema", schema.stamp)
    assert "schema" in document["required"]
    for path, place in walk(document, document):
        if re.search(r"\.[^.*\]]+$", path) and "|" not in path:
            assert place.get("description"), path
        if "properties" in place and "|" not in path:
            assert "additionalProperties" in place, f"{path}: decide whether other keys may be there"
            assert set(place.get("required", [])) <= set(place["properties"]), path


def test_a_released_version_keeps_its_promises():
    frozen, now = json.loads(SHAPES.read_text()), shapes()
    assert sorted(set(frozen) - set(now)) == [], "the file of a released schema stays"
    assert {stamp: found for stamp, old in frozen.items() if (found := breaks(old, now[stamp]))} == {}, (
        "readers would stumble: make a new version (docs/json.md)"
    )
    assert now == frozen, "run: python tests/contracts/test_schemas.py"


@pytest.mark.parametrize(
    ("path", "change"),
    [
        ("a key goes", lambda s: s["properties"].pop("findings")),
        ("a type changes", lambda s: s["properties"]["errors"].update(type="string")),
        ("a value may be null", lambda s: s["properties"]["errors"].update(type=["integer", "null"])),
        ("a type is no longer said", lambda s: s["properties"]["errors"].pop("type")),
        ("a key may be absent", lambda s: s["required"].remove("findings")),
        ("an inner key may be absent", lambda s: s["properties"]["findings"]["items"]["required"].remove("check")),
        (
            "a value is added",
            lambda s: s["properties"]["findings"]["items"]["properties"]["severity"]["enum"].append("fatal"),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_breaks_readers_is_found(path, change):
    before = load_schema(SchemaName("doctor", 1))
    after = copy.deepcopy(before)
    change(after)
    assert breaks(shape(before), shape(before)) == []
    assert len(breaks(shape(before), shape(after))) >= 1, path


def test_a_new_key_breaks_no_reader():
    before = load_schema(SchemaName("doctor", 1))
    after = copy.deepcopy(before)
    after["properties"]["more"] = {"type": "string"}
    after["required"].append("more")
    assert breaks(shape(before), shape(after)) == []


def commands_with_json() -> Iterator[str]:
    for name, (module, _) in COMMANDS.items():
        command = importlib.import_module(f"slamcli.cli.{module}").command
        inner = command.commands.items() if isinstance(command, click.Group) else [("", command)]
        for child, one in inner:
            if any("--json" in parameter.opts for parameter in one.params):
                yield f"{name} {child}".strip()


@pytest.mark.parametrize("command", list(commands_with_json()))
def test_every_command_with_json_has_a_schema_and_stands_in_the_docs(command):
    known = {schema.name for schema in schema_names()}
    assert command in SAME_AS_RUN or command.replace(" ", "-") in known, "add configs/schemas/NAME-1.json"
    assert f"`{command} --json`" in (ROOT / "docs" / "json.md").read_text(), "add a row to docs/json.md"


def test_every_schema_stands_in_the_docs():
    page = (ROOT / "docs" / "json.md").read_text()
    assert [schema.name for schema in schema_names() if f"| `{schema.name}` |" not in page] == []


def test_the_stamp_is_the_first_key_and_a_name_without_schema_is_refused():
    assert next(iter(stamped("doctor", {"errors": 0, "schema": "old"}).items())) == ("schema", "slamcli.doctor.1")
    with pytest.raises(LookupError, match=r"configs/schemas has no nothing-1\.json"):
        stamped("nothing", {})


if __name__ == "__main__":
    released = json.loads(SHAPES.read_text()) if SHAPES.exists() else {}
    current = shapes()
    stumbling = [f"{stamp}: {line}" for stamp, old in released.items() for line in breaks(old, current.get(stamp, {}))]
    if stumbling:
        sys.exit("readers would stumble: make a new version (docs/json.md)\n" + "\n".join(stumbling))
    SHAPES.write_text(json.dumps(current, indent=1, sort_keys=True) + "\n")
