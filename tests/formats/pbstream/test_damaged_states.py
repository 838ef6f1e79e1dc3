# SPDX-License-Identifier: MIT
from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_states import make_state

from slamcli.errors import FormatError
from slamcli.formats.pbstream import schema
from slamcli.formats.pbstream.container import MAGIC, write_message
from slamcli.formats.pbstream.reading import read_state
from slamcli.formats.pbstream.writing import write_state
from slamcli.runtime import RunLog


def file_of(path: Path, *messages: Any) -> Path:
    stream = io.BytesIO()
    stream.write(MAGIC)
    for message in messages:
        write_message(stream, message if isinstance(message, bytes) else message.SerializeToString())
    path.write_bytes(stream.getvalue())
    return path


def refuse(path: Path, match: str) -> None:
    with pytest.raises(FormatError, match=match) as caught:
        read_state(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_state(tmp_path: Path) -> None:
    path = tmp_path / "a.pbstream"
    refuse(path, "No such file")
    path.write_bytes(b"")
    refuse(path, "not a Cartographer state")
    path.write_text("1.0 2.0 3.0\n")
    refuse(path, "not a Cartographer state")
    refuse(file_of(path), "empty state")
    refuse(tmp_path, "directory")


def test_versions(tmp_path: Path) -> None:
    path = tmp_path / "a.pbstream"
    graph = schema.Data()
    graph.pose_graph.SetInParent()
    assert read_state(file_of(path, schema.Header(format_version=1), graph)).nodes == ()
    spatial = schema.Data()
    spatial.submap.submap_3d.local_pose.rotation.w = 1.0
    with_pose = schema.Data()
    with_pose.pose_graph.trajectory.add().submap.add().pose.rotation.w = 1.0
    log = RunLog()
    assert len(read_state(file_of(path, schema.Header(format_version=1), with_pose, spatial), log=log).submaps) == 1
    assert log.warnings == [
        f"{path}: of version 1, whose 3D submaps have no rotational histogram: no loop closures are found in them"
    ]
    refuse(file_of(path, schema.Header(format_version=3), graph), "format version 3; versions 1 and 2")
    legacy = schema.PoseGraph()
    legacy.trajectory.add(trajectory_id=0)
    refuse(file_of(path, legacy), "before 1.0, without a header")
    refuse(file_of(path, schema.Header(format_version=2)), "no pose graph")


def test_every_cut_is_refused(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.pbstream", tmp_path / "cut.pbstream"
    write_state(whole, make_state("probability", trajectories=(0,)))
    data = whole.read_bytes()
    ends, at = [8], 8
    while at < len(data):
        at += 8 + int.from_bytes(data[at : at + 8], "little")
        ends.append(at)
    for length in np.unique(np.linspace(0, len(data) - 1, 60).astype(int)).tolist():
        path.write_bytes(data[:length])
        if length in ends[2:]:
            read_state(path)  # between two messages nobody can tell
        else:
            refuse(path, "cut off|not a Cartographer state|empty state")


def test_flipped_bytes_never_end_in_a_traceback(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.pbstream", tmp_path / "bad.pbstream"
    sound, refused = [], 0
    for kind in ("probability", "tsdf", "3d"):
        write_state(whole, make_state(kind, trajectories=(0,)))
        sound.append(unpacked(whole))
    for seed in range(150):
        messages = sound[seed % 3]
        random = np.random.default_rng(seed)
        which = int(random.integers(len(messages)))
        message = bytearray(messages[which])
        for _ in range(3):
            message[int(random.integers(len(message)))] = int(random.integers(256))
        try:
            read_state(file_of(path, *messages[:which], bytes(message), *messages[which + 1 :]))
        except FormatError:
            refused += 1
    assert refused > 60


def unpacked(path: Path) -> list[bytes]:
    data, at, found = path.read_bytes(), 8, []
    while at < len(data):
        size = int.from_bytes(data[at : at + 8], "little")
        found.append(zlib.decompress(data[at + 8 : at + 8 + size], 31))
        at += 8 + size
    return found


def test_sizes_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "a.pbstream"
    file_of(path, schema.Header(format_version=2), bytes(257 << 20))
    assert path.stat().st_size < 2_000_000
    refuse(path, "unpacks to over 256 MiB")
    path.write_bytes(MAGIC + (2**63).to_bytes(8, "little") + b"x")
    refuse(path, "cut off")
    path.write_bytes(MAGIC + (3).to_bytes(8, "little") + b"xyz")
    refuse(path, "not gzip data")


def with_submap(path: Path, change: Any) -> Path:
    """A state of one submap of 2 x 2 cells, changed."""
    data, graph = schema.Data(), schema.Data()
    graph.pose_graph.trajectory.add(trajectory_id=0).submap.add().pose.rotation.w = 1.0
    submap = data.submap.submap_2d
    submap.local_pose.rotation.w = 1.0
    submap.grid.limits.resolution = 0.05
    submap.grid.limits.max.x = 1.0
    submap.grid.limits.cell_limits.num_x_cells = submap.grid.limits.cell_limits.num_y_cells = 2
    submap.grid.cells = bytes([0, 1, 2, 3])
    change(data.submap, graph.pose_graph)
    return file_of(path, schema.Header(format_version=2), graph, data)


def set_to(name: str, value: Any) -> Any:
    def change(submap: Any, graph: Any) -> None:
        *parents, last = name.split(".")
        at = submap
        for parent in parents:
            at = getattr(at, parent)
        setattr(at, last, value)

    return change


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (set_to("submap_2d.grid.cells", bytes([0, 1, 2])), "3 cells, not 2 x 2"),
        (set_to("submap_2d.grid.cells", bytes([0, 1, 0xFF, 0xFF, 0x03, 1])), "values from 0 to 65535"),
        (set_to("submap_2d.grid.cells", bytes([0, 1, 0xFF])), "cut off"),
        (set_to("submap_2d.grid.limits.resolution", 0.0), "cells of 0.0 m"),
        (set_to("submap_2d.grid.limits.max.x", float("nan")), "at .nan"),
        (set_to("submap_2d.grid.limits.cell_limits.num_x_cells", -2), "a grid of -2 x 2"),
        (set_to("submap_2d.grid.limits.cell_limits.num_x_cells", 2**31 - 1), "a grid of 2147483647 x 2"),
        (set_to("submap_2d.grid.max_correspondence_cost", 0.5), "correspondence costs from 0 to 0.5"),
        (set_to("submap_2d.grid.tsdf_2d.max_weight", 1.0), "0 cells, not 2 x 2"),
        (set_to("submap_2d.local_pose.rotation.w", 0.0), "not a unit quaternion"),
        (set_to("submap_2d.local_pose.translation.x", float("inf")), "position is not finite"),
        (set_to("submap_id.number", 7), "submap 7 of trajectory 0 has no pose"),
        (set_to("submap_id.trajectory", -1), "id 0 of trajectory -1"),
        (lambda submap, graph: submap.ClearField("submap_2d"), "neither 2D nor 3D"),
        (lambda submap, graph: graph.trajectory[0].submap.add().pose.rotation.CopyFrom(graph.trajectory[0].submap[0].pose.rotation), "in the pose graph twice"),
        (lambda submap, graph: graph.constraint.add(tag=9).relative_pose.rotation.CopyFrom(submap.submap_2d.local_pose.rotation), "kind 9"),
    ],
)  # fmt: skip
def test_what_a_submap_cannot_be(tmp_path: Path, change: Any, match: str) -> None:
    assert len(read_state(with_submap(tmp_path / "good.pbstream", lambda submap, graph: None)).submaps) == 1
    refuse(with_submap(tmp_path / "bad.pbstream", change), match)


@pytest.mark.parametrize(
    ("axes", "values", "match"),
    [
        ((b"\0\2", b"\0\2", b"\0"), b"\1\1", "2 voxels, but 2, 2, 1 indices"),
        ((b"\0\0", b"\0\0", b"\0\0"), b"\1\1", "in it twice"),
        ((b"\xfe\xff\xff\x7f", b"\0", b"\0"), b"\1", "a voxel at index"),
        ((b"\0", b"\0", b"\0"), b"\x80\x80\x02", "values from 32768"),
    ],
)
def test_what_a_hybrid_grid_cannot_be(
    tmp_path: Path, axes: tuple[bytes, bytes, bytes], values: bytes, match: str
) -> None:
    def change(submap: Any, graph: Any) -> None:
        submap.submap_3d.local_pose.rotation.w = 1.0
        grid = submap.submap_3d.high_resolution_hybrid_grid
        grid.resolution, grid.values = 0.1, values
        grid.x_indices, grid.y_indices, grid.z_indices = axes

    refuse(with_submap(tmp_path / "bad.pbstream", change), match)


def test_what_a_node_cannot_be(tmp_path: Path) -> None:
    data, graph = schema.Data(), schema.Data()
    graph.pose_graph.trajectory.add().node.add().pose.rotation.w = 1.0
    data.node.node_data.gravity_alignment.w = data.node.node_data.local_pose.rotation.w = 1.0
    data.node.node_data.timestamp = 621355968000000000
    path = tmp_path / "a.pbstream"
    head = schema.Header(format_version=2), graph
    assert read_state(file_of(path, *head, data)).nodes[0].stamp_ns == 0
    refuse(file_of(path, *head, data, data), "node 0 of trajectory 0: it is in the file twice")
    data.node.node_data.timestamp = -(2**63)
    refuse(file_of(path, *head, data), "not within 292 years of 1970")
