# SPDX-License-Identifier: MIT
"""Cartographer's ``.pbstream``: the whole state of a mapping run, read and written without loss.

A file is eight bytes of magic, then messages: the compressed size (8 bytes, little-endian) and a gzip'd protobuf. The
first message is a header with the format's version, the second the pose graph, the third the options of each
trajectory; submaps, nodes and sensor data follow.

References
----------
Cartographer, ``io/proto_stream``, ``io/internal/mapping_state_serialization`` and ``mapping/proto``.
"""

from slamcli.formats.pbstream.container import is_pbstream
from slamcli.formats.pbstream.reading import StateFile, read_state, read_state_file
from slamcli.formats.pbstream.writing import write_state

__all__ = ["StateFile", "is_pbstream", "read_state", "read_state_file", "write_state"]
