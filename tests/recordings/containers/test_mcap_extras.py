# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from slamcli.pipelines.conversion import Selection
from slamcli.pipelines.convert import convert
from slamcli.recordings.containers import open_raw
from slamcli.runtime import RunLog

BLOB = bytes(range(256)) * 40


def _write(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/a", "cdr", schema)
        writer.add_metadata("robot", {"name": "Shakey", "year": "1966"})
        for i in range(50):
            writer.add_message(channel, 10**18 + i, b"\0\1\0\0\2\0\0\0x\0", 10**18 + i)
        writer.add_attachment(8, 7, "calibration.yaml", "text/yaml", BLOB)
        writer.add_metadata("rosbag2", {"serialized_metadata": "old"})
        writer.finish()


def _extras(path: Path) -> tuple[list[tuple[object, ...]], list[tuple[str, dict[str, str]]]]:
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        attachments = [(a.log_time, a.create_time, a.name, a.media_type, a.data) for a in reader.iter_attachments()]
        metadata = [(m.name, m.metadata) for m in reader.iter_metadata()]
        assert summary.statistics.attachment_count == len(summary.attachment_indexes) == len(attachments)
        assert summary.statistics.metadata_count == len(summary.metadata_indexes) == len(metadata)
        assert summary.statistics.message_count == len(list(reader.iter_messages()))
        return attachments, metadata


@pytest.mark.parametrize("damaged", [False, True])
def test_attachments_and_metadata_are_carried_through(tmp_path: Path, damaged: bool) -> None:
    _write(tmp_path / "a.mcap")
    if damaged:  # no footer: the records are found in sequence
        (tmp_path / "a.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:-20])
    convert([tmp_path / "a.mcap"], tmp_path / "b.mcap", selection=Selection(duration_s=1.0))
    convert([tmp_path / "b.mcap"], tmp_path / "c", format="rosbag2-mcap", compression="lz4")
    for path in (tmp_path / "b.mcap", tmp_path / "c" / "c_0.mcap"):
        attachments, metadata = _extras(path)
        assert attachments == [(7, 8, "calibration.yaml", "text/yaml", BLOB)]
        assert metadata == [("robot", {"name": "Shakey", "year": "1966"})]
    with open_raw(tmp_path / "b.mcap") as reader:
        assert sum(1 for _ in reader.messages()) == 50


def test_formats_without_a_place_for_them(tmp_path: Path) -> None:
    _write(tmp_path / "a.mcap")
    log = RunLog()
    made = convert([tmp_path / "a.mcap"], tmp_path / "b.bag", log=log)
    assert made.num_messages == 50
    assert any("2 attachments and metadata records are left out (robot, calibration.yaml)" in w for w in log.warnings)
