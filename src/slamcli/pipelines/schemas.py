# SPDX-License-Identifier: MIT
"""The schemas of the JSON that slamcli writes: which there are, the stamp that a document bears, and whether a document keeps to it."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.native.settings import shipped_folders

_STAMP = re.compile(r"slamcli\.([a-z][a-z-]*)\.([1-9][0-9]*)")
_LONGEST = 300
"""Characters of a message: jsonschema repeats the value that is wrong."""
_FILE = re.compile(r"([a-z][a-z-]*)-([1-9][0-9]*)")


@dataclass(frozen=True, slots=True, order=True)
class SchemaName:
    """What a document is, as its first key says: ``slamcli.<name>.<version>``."""

    name: str
    version: int

    @property
    def stamp(self) -> str:
        """The value of the key ``schema``."""
        return f"slamcli.{self.name}.{self.version}"

    @property
    def file(self) -> str:
        """The schema's file in ``configs/schemas``."""
        return f"{self.name}-{self.version}.json"


def stamped(name: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document with ``"schema": "slamcli.<name>.<newest version>"`` as its first key.

    Raises
    ------
    LookupError
        If there is no schema of this name: add ``configs/schemas/<name>-1.json``.
    """
    rest = {key: value for key, value in document.items() if key != "schema"}
    return {"schema": newest(name).stamp, **rest}


@cache
def schema_names() -> tuple[SchemaName, ...]:
    """Return all schemas, by name and version."""
    found = (_FILE.fullmatch(file.stem) for folder in _folders() for file in folder.glob("*.json"))
    return tuple(sorted({SchemaName(match[1], int(match[2])) for match in found if match}))


def newest(name: str) -> SchemaName:
    """Return the newest version of a schema.

    Raises
    ------
    LookupError
        If there is none of this name.
    """
    versions = [known for known in schema_names() if known.name == name]
    if not versions:
        raise LookupError(f"no schema {name!r}: configs/schemas has no {name}-1.json")
    return versions[-1]


def find_schema(text: str) -> SchemaName:
    """Return the schema that a person means by ``map``, ``map.1``, ``map-1`` or ``slamcli.map.1``; without a version the newest.

    Raises
    ------
    UsageError
        If there is none; the message names the nearest.
    """
    bare = text.removeprefix("slamcli.")
    for known in reversed(schema_names()):
        if bare in (known.name, f"{known.name}.{known.version}", f"{known.name}-{known.version}"):
            return known
    near = difflib.get_close_matches(bare, [known.name for known in schema_names()], n=1)
    hint = f"did you mean {near[0]!r}?" if near else "`slamcli schema` lists them"
    raise UsageError(f"no schema {text!r}: {hint}")


def schema_text(schema: SchemaName) -> str:
    """Return the schema's file."""
    return next(path for folder in _folders() if (path := folder / schema.file).is_file()).read_text(encoding="utf-8")


def load_schema(schema: SchemaName) -> dict[str, Any]:
    """Return the schema as a document."""
    document: dict[str, Any] = json.loads(schema_text(schema))
    return document


def schema_of(document: object) -> SchemaName:
    """Return which schema a document names.

    Raises
    ------
    UsageError
        If it names none, or one that is not known.
    """
    stamp = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(stamp, str):
        raise UsageError('the document names no schema: its key "schema" should say slamcli.<name>.<version>')
    match = _STAMP.fullmatch(stamp)
    schema = SchemaName(match[1], int(match[2])) if match else None
    if schema is None or schema not in schema_names():
        raise UsageError(f"schema {stamp!r} is not one that this slamcli knows: `slamcli schema` lists them")
    return schema


def first_deviation(document: object, schema: SchemaName) -> str | None:
    """Return where and how a document leaves its schema; None where it does not."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    error = best_match(Draft202012Validator(load_schema(schema)).iter_errors(document))
    if error is None:
        return None
    text = " ".join(error.message.split())
    return f"{error.json_path}: {text if len(text) <= _LONGEST else text[: _LONGEST - 1] + '…'}"


def _folders() -> tuple[Path, ...]:
    return tuple(folder / "schemas" for folder in shipped_folders())
