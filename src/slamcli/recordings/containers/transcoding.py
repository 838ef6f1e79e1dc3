# SPDX-License-Identifier: MIT
"""Messages from ROS 1's encoding to ROS 2's and back, without decoding them where the types agree."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Callable
from typing import Any

from rosbags.convert.converter import is_same_wireformat, migrate_bytes
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from slamcli.errors import RecordingError
from slamcli.recordings.containers.decoding import SERDE_ERRORS, TYPE_ERRORS, shipped_types, typestore_of
from slamcli.recordings.containers.qos import LATCHED_QOS
from slamcli.recordings.raw import RawMessage, Topic

_HEADER = "std_msgs/msg/Header"
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_LITTLE_ENDIAN = b"\x00\x01"


class TranscodingError(Exception):
    """A message is not what its type says."""


class Transcoder:
    """Changes the encoding of one topic's messages.

    Standard types become those that the other ROS ships, so that its tools know them; where the two differ, fields of the
    same name are kept (`migrates` is then set) and the others get their defaults. Types that the other ROS does not ship
    keep their definition. A header's sequence number, which ROS 2 has not, travels as the message's `sequence`.

    Raises
    ------
    RecordingError
        If the topic's type is unknown or cannot be expressed in the other encoding.
    """

    def __init__(self, topic: Topic, encoding: str) -> None:
        if {topic.encoding, encoding} != {"ros1", "cdr"}:
            raise RecordingError(f"topic {topic.name}: {topic.encoding!r} messages cannot become {encoding!r} ones")
        self._to_cdr = encoding == "cdr"
        self._source_type = topic.msgtype
        self._source = typestore_of(topic)
        self._target_type = _RENAMED.get(topic.msgtype, topic.msgtype)
        try:
            self._target = self._target_store(encoding)
            same = is_same_wireformat(self._source, self._target, self._source_type, self._target_type)
            definition, digest = self._target.generate_msgdef(self._target_type, ros_version=2 if self._to_cdr else 1)
            digest = self._target.hash_rihs01(self._target_type) if self._to_cdr else digest
        except TYPE_ERRORS as error:
            raise RecordingError(
                f"topic {topic.name}: {topic.msgtype} cannot be expressed for {encoding} ({error})"
            ) from error
        self.migrates = not same
        """Whether the two types differ in more than names."""
        fields = self._source.fielddefs[self._source_type][1]
        self._has_header = bool(fields) and fields[0][1][1] == _HEADER
        self._convert = self._converter()
        self.topic = dataclasses.replace(
            topic,
            msgtype=self._target_type,
            definition=definition,
            definition_format="msg",
            encoding=encoding,
            digest=digest,
            qos=topic.qos or (LATCHED_QOS if topic.latched and self._to_cdr else ""),
        )
        """The topic as it is in the other encoding."""

    def message(self, message: RawMessage) -> RawMessage:
        """Return the message in the other encoding.

        Raises
        ------
        TranscodingError
            If its bytes are not what its type says.
        """
        try:
            data = self._convert(message.data)
        except SERDE_ERRORS as error:
            raise TranscodingError(str(error)[:200]) from error
        sequence = message.sequence
        if self._has_header and self._to_cdr:
            sequence = int.from_bytes(message.data[:4], "little")
        elif self._has_header and sequence:
            data = struct.pack("<I", sequence) + data[4:]
        return message._replace(data=data, sequence=sequence)

    def _target_store(self, encoding: str) -> Typestore:
        shipped = shipped_types(encoding)
        if self._target_type in shipped.fielddefs:
            return shipped
        store = get_typestore(Stores.EMPTY)
        store.register({**self._source.fielddefs, _HEADER: shipped.fielddefs[_HEADER]})
        return store

    def _converter(self) -> Callable[[bytes | memoryview], bytes | memoryview]:
        source, target = self._source, self._target
        if self.migrates:
            cache: dict[str, object] = {}

            def migrate(data: bytes | memoryview) -> bytes | memoryview:
                return migrate_bytes(
                    source,
                    target,
                    self._source_type,
                    self._target_type,
                    cache,
                    data,
                    src_is2=not self._to_cdr,
                    dst_is2=self._to_cdr,
                )

            return migrate
        if self._to_cdr:
            return lambda data: target.ros1_to_cdr(data, self._target_type)

        def to_ros1(data: bytes | memoryview) -> bytes:
            if bytes(data[:2]) != _LITTLE_ENDIAN:
                decoded: Any = source.deserialize_cdr(data, self._source_type)
                data = source.serialize_cdr(decoded, self._source_type, little_endian=True)
            return bytes(source.cdr_to_ros1(data, self._source_type))

        return to_ros1
