# SPDX-License-Identifier: MIT
"""Attachments and metadata of MCAP files: records beside the messages, carried through conversions as they are."""

from __future__ import annotations

import struct
from typing import NamedTuple

from slamcli.recordings.containers import mcap_records as records
from slamcli.recordings.containers.mcap_records import Fields, RecordError

MAX_EXTRA_BYTES = 1 << 30
_ROSBAG2 = "rosbag2"


class Extra(NamedTuple):
    """One such record."""

    op: int
    """`mcap_records.ATTACHMENT` or `mcap_records.METADATA`."""
    body: bytes
    name: str


def read_extra(op: int, body: bytes) -> Extra | None:
    """Return an attachment or metadata record, None for what a bag's writer makes anew.

    Raises
    ------
    RecordError
        If it is damaged.
    """
    fields = Fields(body)
    if op == records.ATTACHMENT:
        fields.take(16)
        name = fields.text()
        fields.text()
        fields.take(fields.number(8) + 4)
        return Extra(op, body, name)
    name = fields.text()
    fields.texts()
    # ros2 bag repeats its metadata.yaml there, with the counts and names of the old file.
    return None if name == _ROSBAG2 else Extra(op, body, name)


def index_of(extra: Extra, position: int, length: int) -> tuple[int, bytes]:
    """Return type and body of the summary's index record for an extra at a position of the file."""
    name = extra.name.encode()
    text = struct.pack("<I", len(name)) + name
    place = struct.pack("<QQ", position, length)
    if extra.op == records.METADATA:
        return records.METADATA_INDEX, place + text
    fields = Fields(extra.body)
    times = fields.take(16)
    fields.text()
    media = fields.take(fields.number(4))
    size = struct.pack("<Q", fields.number(8))
    return records.ATTACHMENT_INDEX, place + times + size + text + struct.pack("<I", len(media)) + media


def place_of(body: bytes) -> tuple[int, int]:
    """Return position and length of the record that an index record names."""
    if len(body) < 16:
        raise RecordError("an index of attachments is cut off")
    position, length = struct.unpack_from("<QQ", body)
    return position, length
