# SPDX-License-Identifier: MIT
import sqlite3
from pathlib import Path

import pytest
import yaml
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags import rosbag2
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore
from sample_bags import (
    START_NS,
    STRING,
    SUFFIXES,
    WRITABLE,
    core,
    encoding_of,
    string_message,
    write_plain_mcap,
    write_sample,
)

from slamcli.errors import RecordingError, UsageError
from slamcli.recordings.containers import create_raw, mcap_writer, open_raw, rosbag1_writer
from slamcli.recordings.raw import RawMessage, Topic


@pytest.mark.parametrize(("format", "compression"), WRITABLE)
def test_what_is_written_is_read(tmp_path: Path, format: str, compression: str) -> None:
    path = tmp_path / f"bag{SUFFIXES[format]}"
    written = write_sample(path, format, compression)
    with open_raw(path) as reader:
        contents = reader.contents
        assert core(reader.messages()) == core(written)
        assert reader.contents.damage == ()
        assert reader.decode(next(iter(reader.messages()))).data.isalpha()
    assert [(t.name, t.msgtype, t.count, t.latched) for t in contents.topics] == [
        ("/a", STRING, 60, False),
        ("/b", "nav_msgs/msg/Odometry", 0, True),
    ]
    assert contents.topics[0].definition.strip().startswith("string data")
    assert (contents.start_ns, contents.end_ns, contents.num_messages) == (START_NS, START_NS + 29 * 50_000_000, 60)
    if format != "rosbag2-sqlite3":
        assert contents.compression == compression


@pytest.mark.parametrize(("format", "compression"), WRITABLE)
def test_other_readers_open_it(tmp_path: Path, format: str, compression: str) -> None:
    path = tmp_path / f"bag{SUFFIXES[format]}"
    written = write_sample(path, format, compression)
    with AnyReader([path]) as reader:
        read = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
    assert read == core(written)
    if path.suffix == ".mcap":
        with path.open("rb") as stream:
            mcap = make_reader(stream, validate_crcs=True)
            assert [message.sequence for _, _, message in mcap.iter_messages()] == list(range(60))
            assert mcap.get_header().profile == "ros2"


@pytest.mark.parametrize(("format", "compression"), WRITABLE)
def test_same_messages_same_bytes(tmp_path: Path, format: str, compression: str) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_sample(tmp_path / name / f"bag{SUFFIXES[format]}", format, compression)
    one = sorted(p for p in (tmp_path / "one").rglob("*") if p.is_file())
    two = sorted(p for p in (tmp_path / "two").rglob("*") if p.is_file())
    assert [p.read_bytes() for p in one] == [p.read_bytes() for p in two]


_MESSAGES = st.lists(
    st.tuples(st.sampled_from(["/a", "/b", "/c"]), st.integers(0, 50), st.binary(min_size=0, max_size=200)), max_size=60
)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(drawn=_MESSAGES, start=st.integers(-1, 51), length=st.integers(0, 60))
@pytest.mark.parametrize("format", ["rosbag1", "mcap", "sqlite3"])
def test_any_order_comes_back_in_log_order_and_seeking_equals_filtering(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    format: str,
    drawn: list[tuple[str, int, bytes]],
    start: int,
    length: int,
) -> None:
    monkeypatch.setattr(mcap_writer, "CHUNK_BYTES", 300)
    monkeypatch.setattr(rosbag1_writer, "CHUNK_BYTES", 300)
    path = tmp_path / f"bag{SUFFIXES[format]}"
    with create_raw(path, format=format) as writer:
        for name in ("/a", "/b", "/c"):
            writer.add_topic(Topic(name=name, msgtype=STRING, count=None, encoding=encoding_of(format)))
        for name, time, data in drawn:
            writer.write(RawMessage(name, START_NS + time, data))
    expected = sorted(((name, START_NS + time, data) for name, time, data in drawn), key=lambda item: item[1])
    begin, end = START_NS + start, START_NS + start + length
    with open_raw(path) as reader:
        assert core(reader.messages()) == expected
        part = [item for item in expected if begin <= item[1] < end and item[0] in ("/a", "/c")]
        assert core(reader.messages(["/c", "/a"], begin, end)) == part
        assert reader.contents.damage == ()


def test_long_overlapping_chunks_are_read_with_bounded_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Every chunk holds a message of the recording's start, so that all of them are open at once.
    monkeypatch.setattr(rosbag1_writer, "CHUNK_BYTES", 4000)
    monkeypatch.setattr("slamcli.recordings.containers.runs.BUDGET_BYTES", 10_000)
    monkeypatch.setattr("slamcli.recordings.containers.runs.Budget.__init__.__defaults__", (10_000,))
    times = [t for k in range(40) for t in (k, 1000 + k, 2000 + k, 3000 + k)]
    data = [string_message(f"{i:04d}" * 250, "ros1") for i in range(len(times))]
    with create_raw(tmp_path / "x.bag", compression="lz4") as writer:
        writer.add_topic(Topic(name="/a", msgtype=STRING, count=None, encoding="ros1"))
        for time, payload in zip(times, data, strict=True):
            writer.write(RawMessage("/a", START_NS + time, payload))
    with open_raw(tmp_path / "x.bag") as reader:
        read = core(reader.messages())
        assert reader._budget._total <= 10_000
    assert read == sorted((("/a", START_NS + t, d) for t, d in zip(times, data, strict=True)), key=lambda item: item[1])


def test_split_files_are_one_recording(tmp_path: Path) -> None:
    whole = write_sample(tmp_path / "whole.bag", "rosbag1", "none")
    parts = []
    for index, part in enumerate((whole[:20], whole[20:45], whole[45:])):
        parts.append(tmp_path / f"part_{index}.bag")
        with create_raw(parts[-1]) as writer:
            writer.add_topic(Topic(name="/a", msgtype=STRING, count=None, encoding="ros1"))
            for message in part:
                writer.write(message)
    with open_raw([parts[2], parts[0], parts[1], parts[0]]) as reader:
        assert core(reader.messages()) == core(whole)
        assert [(t.name, t.count) for t in reader.contents.topics] == [("/a", 60)]


@pytest.mark.parametrize("summary", [True, False])
def test_mcap_without_chunks(tmp_path: Path, summary: bool) -> None:
    written = write_plain_mcap(tmp_path / "plain.mcap", summary=summary)
    with open_raw(tmp_path / "plain.mcap") as reader:
        assert reader.contents.num_messages == 60
        assert core(reader.messages()) == core(written)
        assert core(reader.messages(None, START_NS + 10**9)) == [m for m in core(written) if m[1] >= START_NS + 10**9]
        assert reader.contents.damage == ()


@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("summary", [True, False])
def test_mcap_as_the_mcap_library_writes_it(
    tmp_path: Path, index: IndexType, compression: CompressionType, summary: bool
) -> None:
    options = dict.fromkeys(("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets"), summary)
    with (tmp_path / "x.mcap").open("wb") as stream:
        writer = Writer(
            stream, chunk_size=500, compression=compression, index_types=index, enable_crcs=summary, **options
        )
        writer.start("ros2", "test")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        channels = {name: writer.register_channel(name, "cdr", schema) for name in ("/a", "/b")}
        expected = []
        for number in range(50):
            item = ("/a" if number % 3 else "/b", START_NS + (number * 7) % 50, string_message(f"{number}", "cdr"))
            writer.add_message(channels[item[0]], item[1], item[2], item[1] + 3, number)
            expected.append(item)
        writer.add_attachment(START_NS, START_NS, "note.txt", "text/plain", b"words")
        writer.add_metadata("about", {"robot": "x"})
        writer.finish()
    expected.sort(key=lambda item: item[1])
    with open_raw(tmp_path / "x.mcap") as reader:
        assert core(reader.messages()) == expected
        assert reader.contents.num_messages == 50
        assert reader.contents.damage == ()
        assert core(reader.messages(["/b"], START_NS + 10, START_NS + 30)) == [
            item for item in expected if item[0] == "/b" and START_NS + 10 <= item[1] < START_NS + 30
        ]
        assert {m.publish_time_ns - m.log_time_ns for m in reader.messages()} == {3}


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_ros2_bags_as_rosbags_writes_them(tmp_path: Path, storage: StoragePlugin, mode: CompressionMode) -> None:
    writer = rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/a", STRING, typestore=get_typestore(Stores.ROS2_HUMBLE))
        for number in range(30):
            writer.write(connection, START_NS + number, string_message(f"{number}", "cdr"))
    with open_raw(tmp_path / "bag") as reader:
        assert [reader.decode(m).data for m in reader.messages()] == [str(number) for number in range(30)]
        assert reader.contents.damage == ()
        assert reader.contents.format == f"rosbag2-{storage.name.lower()}"
        assert reader.contents.compression == ("none" if mode is CompressionMode.NONE else "zstd")


def test_ros1_messages_in_mcap(tmp_path: Path) -> None:
    written = write_sample(tmp_path / "x.mcap", "mcap", "zstd", encoding="ros1")
    with open_raw(tmp_path / "x.mcap") as reader:
        assert core(reader.messages()) == core(written)
        assert {t.encoding for t in reader.contents.topics} == {"ros1"}
        assert reader.contents.topics[1].digest == "cd5e73d190d741a2f92e81eda573aca7"  # nav_msgs/Odometry
        assert reader.decode(next(iter(reader.messages()))).data.isalpha()
    with (tmp_path / "x.mcap").open("rb") as stream:
        mcap = make_reader(stream)
        assert mcap.get_header().profile == "ros1"
        assert {s.name: s.encoding for s in mcap.get_summary().schemas.values()}["std_msgs/String"] == "ros1msg"


@pytest.mark.parametrize("format", ["mcap", "sqlite3"])
def test_files_compressed_as_a_whole(tmp_path: Path, format: str) -> None:
    path = tmp_path / f"bag{SUFFIXES[format]}"
    written = write_sample(path, format, "none")
    packed = path.with_name(path.name + ".zstd")
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    with open_raw(packed) as reader:
        assert core(reader.messages()) == core(written)
        assert reader.contents.compression == "zstd"


def test_folder_without_metadata_and_with_missing_file(tmp_path: Path) -> None:
    written = write_sample(tmp_path / "bag", "rosbag2-sqlite3", "none")
    with open_raw(tmp_path / "bag" / "metadata.yaml") as reader:
        assert reader.contents.format == "rosbag2-sqlite3"
    document = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert document["message_count"] == 60
    assert document["relative_file_paths"] == ["bag_0.db3"]
    document["relative_file_paths"].append("bag_1.db3")
    (tmp_path / "bag" / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": document}))
    with open_raw(tmp_path / "bag") as reader:
        assert "bag_1.db3" in reader.contents.damage[0]
    (tmp_path / "bag" / "metadata.yaml").write_text("a: [")
    with open_raw(tmp_path / "bag") as reader:
        assert "cannot be understood" in reader.contents.damage[0]
        assert core(reader.messages()) == core(written)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    with open_raw(tmp_path / "bag") as reader:
        assert core(reader.messages()) == core(written)
        assert reader.contents.damage == ()


def test_a_folder_is_replaced_whole_and_foreign_files_are_not_touched(tmp_path: Path) -> None:
    write_sample(tmp_path / "bag", "rosbag2-sqlite3", "none")
    write_sample(tmp_path / "bag", "rosbag2-mcap", "none")
    assert sorted(p.name for p in (tmp_path / "bag").iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    (tmp_path / "bag" / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"notes\.txt"):
        write_sample(tmp_path / "bag", "rosbag2-mcap", "none")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    write_sample(path, "mcap", "none")
    before = path.read_bytes()
    with pytest.raises(RecordingError), create_raw(path) as writer:
        writer.write(RawMessage("/a", 0, b""))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["x.mcap"]


def test_writer_says_what_does_not_fit(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no format 'ros3'"):
        create_raw(tmp_path / "x.bag", format="ros3")
    with pytest.raises(UsageError, match="one of none, bz2, lz4"):
        create_raw(tmp_path / "x.bag", compression="zstd")
    with pytest.raises(UsageError, match="cannot tell the format"):
        create_raw(tmp_path / "x.txt")
    with create_raw(tmp_path / "x.bag") as writer:
        with pytest.raises(RecordingError, match="rosbag1 holds ros1 messages"):
            writer.add_topic(Topic(name="/a", msgtype=STRING, count=None))
        with pytest.raises(RecordingError, match="was not added"):
            writer.write(RawMessage("/a", 0, b""))


def test_unknown_types_are_copied_and_read_by_their_definition(tmp_path: Path) -> None:
    definition = "uint8 level\nInner inner\n" + "=" * 80 + "\nMSG: my_msgs/Inner\nfloat32[2] values\n"
    topic = Topic(name="/x", msgtype="my_msgs/msg/Outer", count=None, definition=definition, encoding="ros1")
    nameless = Topic(name="/y", msgtype="other_msgs/msg/Unknown", count=None, encoding="ros1")
    with create_raw(tmp_path / "x.bag") as writer:
        writer.add_topic(topic)
        writer.add_topic(nameless)
        writer.write(RawMessage("/x", START_NS, bytes([7, 0, 0, 128, 63, 0, 0, 0, 64])))
        writer.write(RawMessage("/y", START_NS, b"abc"))
    with open_raw(tmp_path / "x.bag") as reader:
        first, second = reader.messages()
        assert reader.decode(first).level == 7
        assert reader.decode(first).inner.values.tolist() == [1.0, 2.0]
        assert bytes(second.data) == b"abc"
        with pytest.raises(RecordingError, match="no definition of other_msgs/msg/Unknown"):
            reader.decode(second)


def test_two_types_under_one_name_keep_apart(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with create_raw(path) as writer:
        writer.add_topic(Topic(name="/a", msgtype=STRING, count=None))
        writer.add_topic(Topic(name="/a", msgtype="std_msgs/msg/Int8", count=None))
        writer.write(RawMessage("/a", START_NS, string_message("x", "cdr"), 0))
        writer.write(RawMessage("/a", START_NS + 1, b"\0\1\0\0\5", 1))
    with open_raw(path) as reader:
        assert [reader.decode(m).data for m in reader.messages(["/a"])] == ["x", 5]
        assert [t.count for t in reader.contents.topics] == [1, 1]


def test_write_ahead_log_of_a_recording_that_was_not_closed(tmp_path: Path) -> None:
    path = tmp_path / "x.db3"
    write_sample(path, "sqlite3", "none")
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (START_NS + 10**12, b"\0\1\0\0")
    )
    connection.commit()
    with open_raw(path) as reader:
        assert reader.contents.num_messages == 61
    connection.close()
