# SPDX-License-Identifier: MIT
"""Message definitions as the container holds them, to decoders."""

from __future__ import annotations

import dataclasses
import functools
import struct
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from slamcli.errors import RecordingError
from slamcli.recordings.extra_types import add_extra_types
from slamcli.recordings.raw import Topic

_IDL_SEPARATOR = "=" * 80 + "\nIDL: "
TYPE_ERRORS = (
    TypesysError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    AssertionError,
    SyntaxError,
    RecursionError,
    IndexError,
)
SERDE_ERRORS = (SerdeError, *TYPE_ERRORS, struct.error, UnicodeError, OverflowError, MemoryError)
MAX_DEFINITION_BYTES = 4 << 20


def definition_types(topic: Topic) -> dict[str, Any]:
    """Return rosbags' field definitions of a topic's type and all types in it, as its definition says.

    Raises
    ------
    RecordingError
        If the definition cannot be understood.
    """
    text = topic.definition
    if len(text) > MAX_DEFINITION_BYTES:
        raise RecordingError(f"topic {topic.name}: its message definition has {len(text)} characters")
    types: dict[str, Any] = {}
    try:
        if topic.definition_format != "idl":
            types.update(get_types_from_msg(text, topic.msgtype))
            return _completed(types, topic)
        for part in text.split(_IDL_SEPARATOR) if text.startswith(_IDL_SEPARATOR) else [text]:
            if part:
                body = part.split("\n", 1)[1] if text.startswith(_IDL_SEPARATOR) and "\n" in part else part
                types.update(get_types_from_idl(body.removesuffix("=" * 80 + "\n")))
    except TYPE_ERRORS as error:
        raise RecordingError(
            f"topic {topic.name}: the definition of {topic.msgtype} cannot be understood ({_line(error)})"
        ) from error
    return _completed(types, topic)


def _completed(types: dict[str, Any], topic: Topic) -> dict[str, Any]:
    """Add the types that a definition uses without holding them, as ROS ships them."""
    shipped = shipped_types(topic.encoding).fielddefs
    waiting = [topic.msgtype]
    seen: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name not in types:
            types[name] = shipped[name]
        waiting.extend(used for _, field in types[name][1] if (used := _used_type(field)))
    return types


def _used_type(field: Any) -> str:
    """Return the name of the message type in a field's description, empty for basic types."""
    kind, value = field
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        kind, value = value[0]
    return str(value) if kind == Nodetype.NAME else ""


@functools.cache
def shipped_types(encoding: str) -> Typestore:
    """Return the types that ROS ships and those of `slamcli.recordings.extra_types`, of ROS 1 for ``ros1``, of ROS 2 else."""
    return add_extra_types(get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.LATEST))


def completed_topic(topic: Topic) -> Topic:
    """Return the topic with its definition and digest filled in where they are missing and can be known."""
    if topic.encoding not in ("ros1", "cdr") or (topic.definition and topic.digest):
        return topic
    try:
        store = typestore_of(topic)
        if topic.encoding == "ros1":
            definition, digest = store.generate_msgdef(topic.msgtype, ros_version=1)
        else:
            definition, _ = store.generate_msgdef(topic.msgtype, ros_version=2)
            digest = store.hash_rihs01(topic.msgtype)
    except (RecordingError, *TYPE_ERRORS):
        # Copying needs no definition. "*" is ROS 1's word for any type.
        return dataclasses.replace(topic, digest=topic.digest or ("*" if topic.encoding == "ros1" else ""))
    if topic.definition:
        return dataclasses.replace(topic, digest=topic.digest or digest)
    return dataclasses.replace(topic, definition=definition, definition_format="msg", digest=topic.digest or digest)


def typestore_of(topic: Topic) -> Typestore:
    """Return a type store that knows the topic's type: from its definition, else as ROS ships it.

    Raises
    ------
    RecordingError
        If there is no definition and ROS ships no such type, or the definition cannot be understood.
    """
    if topic.definition and topic.definition_format in ("msg", "idl"):
        store = get_typestore(Stores.EMPTY)
        types = definition_types(topic)
        try:
            store.register(types)
        except TYPE_ERRORS as error:
            raise RecordingError(
                f"topic {topic.name}: the definition of {topic.msgtype} cannot be understood ({_line(error)})"
            ) from error
        if topic.msgtype in store.fielddefs:
            return store
    store = shipped_types(topic.encoding)
    if topic.msgtype not in store.fielddefs:
        raise RecordingError(
            f"topic {topic.name}: the recording holds no definition of {topic.msgtype}, and ROS ships none"
        )
    return store


class Decoder:
    """Decodes messages by the definitions that the recording holds."""

    def __init__(self) -> None:
        self._stores: dict[tuple[str, str, str], Typestore | str] = {}

    def store(self, topic: Topic) -> Typestore:
        """Return the type store of a topic, made once for each definition."""
        key = (topic.msgtype, topic.encoding, topic.definition)
        if key not in self._stores:
            try:
                self._stores[key] = typestore_of(topic)
            except RecordingError as error:
                self._stores[key] = str(error)  # not the error: its traceback would keep the message
        found = self._stores[key]
        if isinstance(found, str):
            raise RecordingError(found)
        return found

    def decode(self, topic: Topic, data: bytes | memoryview, log_time_ns: int) -> Any:
        """Return the decoded message.

        Raises
        ------
        RecordingError
            If the type is unknown, or the bytes are not such a message.
        """
        if topic.encoding not in ("ros1", "cdr"):
            raise RecordingError(
                f"topic {topic.name}: messages encoded as {topic.encoding!r}; slamcli reads ros1 and cdr"
            )
        store = self.store(topic)
        try:
            if topic.encoding == "ros1":
                return store.deserialize_ros1(data, topic.msgtype)
            return store.deserialize_cdr(data, topic.msgtype)
        except SERDE_ERRORS as error:
            raise RecordingError(
                f"topic {topic.name}: the message of {log_time_ns / 1e9:.6f} s is no {topic.msgtype} ({_line(error)})"
            ) from error


def _line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0][:200] if text else type(error).__name__
