# SPDX-License-Identifier: MIT
"""Cartographer's ``.pbstream``: the whole state of a mapping run, read and written without loss.

A file is eight bytes of magic, then messages: the compressed size (8 bytes, little-endian) and a gzip'd protobuf. The
first message is a header with the format's version, the second the pose graph, the third the options of each
trajectory; submaps, nodes and sensor data follow.

`container.is_pbstream` tells a state by its first bytes, `reading.read_state` and `writing.write_state` are the pair, and
`node_poses.read_node_poses` gives the trajectories.

References
----------
Cartographer, ``io/proto_stream``, ``io/internal/mapping_state_serialization`` and ``mapping/proto``.
"""
