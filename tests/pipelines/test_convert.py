# SPDX-License-Identifier: MIT
import json
import os
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from slamcli.errors import RecordingError, UsageError
from slamcli.pipelines.conversion import Selection
from slamcli.pipelines.convert import convert
from slamcli.recordings.adapters import message_factory
from slamcli.recordings.carmen import CarmenOptions
from slamcli.recordings.containers import create_raw, open_raw
from slamcli.recordings.raw import RawMessage, Topic
from slamcli.runtime import RunLog

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
START_NS = 1_600_000_000 * 10**9
SCAN, INFO, MARKER, TF = (
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/CameraInfo",
    "visualization_msgs/msg/Marker",
    "tf2_msgs/msg/TFMessage",
)


def write_bag(path: Path, encoding: str = "ros1", **options: str) -> None:
    """Scans with sequence numbers, a latched transform, a camera's calibration."""
    factory = message_factory(encoding)
    with create_raw(path, **options) as writer:
        writer.add_topic(Topic(name="/scan", msgtype=SCAN, count=None, encoding=encoding, publisher="/driver"))
        writer.add_topic(Topic(name="/tf_static", msgtype=TF, count=None, encoding=encoding, latched=True))
        writer.add_topic(Topic(name="/info", msgtype=INFO, count=None, encoding=encoding))
        transform = factory.make(
            "geometry_msgs/msg/TransformStamped",
            factory.header(START_NS, "base_link"),
            "laser",
            factory.transform(np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 0.0, 1.0])),
        )
        tf = factory.serialise(factory.make(TF, [transform]), TF)
        writer.write(RawMessage("/tf_static", START_NS, tf))
        for index in range(50):
            stamp = START_NS + index * 100_000_000
            header = factory.header(stamp, "laser")
            if encoding == "ros1":
                header.seq = 1000 + index
            ranges = np.linspace(1, 2, 31 + index % 3, dtype=np.float32)
            values = (-1.0, 1.0, 0.1, 0.0, 0.1, 0.0, 10.0)
            scan = factory.make(SCAN, header, *values, ranges, np.zeros(0, np.float32))
            writer.write(RawMessage("/scan", stamp + 5, factory.serialise(scan, SCAN)))
        roi = factory.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        numbers = (np.arange(5.0), np.arange(9.0), np.eye(3).ravel(), np.arange(12.0))
        info = factory.make(INFO, factory.header(START_NS, "camera"), 48, 64, "plumb_bob", *numbers, 0, 0, roi)
        writer.write(RawMessage("/info", START_NS + 10**9, factory.serialise(info, INFO)))


def raw(path: Path) -> list[tuple[str, int, bytes]]:
    with open_raw(path) as reader:
        return [(m.topic, m.log_time_ns, bytes(m.data)) for m in reader.messages()]


def test_ros1_to_mcap_and_back_gives_the_same_messages(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    conversion = convert([tmp_path / "a.bag"], tmp_path / "b.mcap")
    assert (conversion.num_messages, conversion.num_lost, conversion.damage) == (52, 0, ())
    convert([tmp_path / "b.mcap"], tmp_path / "c.bag", compression="lz4")
    before = raw(tmp_path / "a.bag")
    after = raw(tmp_path / "c.bag")
    assert after == before  # sequence numbers of headers travel in MCAP's own
    with open_raw(tmp_path / "a.bag") as a, open_raw(tmp_path / "c.bag") as c:
        for old, new in zip(a.contents.topics, c.contents.topics, strict=True):
            assert (old.name, old.msgtype, old.digest, old.latched, old.count) == (
                *(new.name, new.msgtype, new.digest, new.latched, new.count),
            )


def test_ros2_messages_are_what_ros2_knows(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    convert([tmp_path / "a.bag"], tmp_path / "b", format="rosbag2-sqlite3")
    with AnyReader([tmp_path / "b"]) as reader:
        messages = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
        durability = {c.topic: [q.durability.name for q in c.ext.offered_qos_profiles] for c in reader.connections}
    assert messages["/info"].k.tolist() == list(np.arange(9.0))
    assert messages["/scan"].header.stamp.sec == 1_600_000_004
    assert not hasattr(messages["/scan"].header, "seq")
    assert messages["/tf_static"].transforms[0].transform.translation.y == 0.2
    assert durability == {"/scan": [], "/info": [], "/tf_static": ["TRANSIENT_LOCAL"]}


def test_all_formats_in_a_circle(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.mcap", "cdr")
    before = raw(tmp_path / "a.mcap")
    chain = ["b", "c.db3", "d.bag", "e.mcap", "f"]
    source = tmp_path / "a.mcap"
    for name in chain:
        convert([source], tmp_path / name, format="rosbag2-sqlite3" if name == "f" else None)
        source = tmp_path / name
    assert raw(source) == before


def test_plain_mcap_keeps_ros1_messages_on_request(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    convert([tmp_path / "a.bag"], tmp_path / "b.mcap", encoding="ros1")
    assert raw(tmp_path / "b.mcap") == raw(tmp_path / "a.bag")
    with open_raw(tmp_path / "b.mcap") as reader:
        assert [t.publisher for t in reader.contents.topics] == ["/driver", "", ""]
    with pytest.raises(UsageError, match="for plain MCAP"):
        convert([tmp_path / "a.bag"], tmp_path / "c.bag", encoding="cdr")


def test_types_that_differ_are_migrated_and_told(tmp_path: Path) -> None:
    factory = message_factory("ros1")
    fields = factory._store.fielddefs[MARKER][1]
    header = factory.header(START_NS, "map")
    pose = factory.pose(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    color = factory.make("std_msgs/msg/ColorRGBA", 1.0, 0.5, 0.25, 1.0)
    values = {
        "header": header,
        "ns": "n",
        "id": 4,
        "type": 1,
        "action": 0,
        "pose": pose,
        "text": "t",
        "scale": factory.vector(np.ones(3)),
        "color": color,
        "points": [],
        "colors": [],
        "lifetime": factory.make("builtin_interfaces/msg/Duration", 1, 2),
        "frame_locked": True,
        "mesh_resource": "",
        "mesh_use_embedded_materials": False,
    }
    data = factory.serialise(factory.make(MARKER, *(values[name] for name, _ in fields)), MARKER)
    with create_raw(tmp_path / "a.bag") as writer:
        writer.add_topic(Topic(name="/m", msgtype=MARKER, count=None, encoding="ros1"))
        writer.write(RawMessage("/m", START_NS, data))
    log = RunLog()
    convert([tmp_path / "a.bag"], tmp_path / "b.mcap", log=log)
    assert "differs between ROS 1 and ROS 2" in log.warnings[0]
    with open_raw(tmp_path / "b.mcap") as reader:
        marker = reader.decode(next(iter(reader.messages())))
    assert (marker.ns, marker.id, marker.text, marker.pose.position.z, marker.frame_locked) == ("n", 4, "t", 3.0, True)


def test_old_tf_becomes_tf2(tmp_path: Path) -> None:
    factory = message_factory("ros1")
    data = factory.serialise(factory.make(TF, []), TF)
    definition = "geometry_msgs/TransformStamped[] transforms\n"
    old = Topic(name="/tf", msgtype="tf/msg/tfMessage", count=None, definition=definition, encoding="ros1")
    with create_raw(tmp_path / "a.bag") as writer:
        writer.add_topic(old)
        writer.write(RawMessage("/tf", START_NS, data))
    conversion = convert([tmp_path / "a.bag"], tmp_path / "b.mcap")
    assert conversion.topics[0].msgtype == TF


def test_types_that_ros2_does_not_ship_keep_their_definition(tmp_path: Path) -> None:
    definition = (
        "Header header\ntime when\nInner[] inner\n" + "=" * 80 + "\nMSG: my_msgs/Inner\nfloat64 value\nstring name\n"
    )
    topic = Topic(name="/x", msgtype="my_msgs/msg/Outer", count=None, definition=definition, encoding="ros1")
    body = (5).to_bytes(4, "little") + bytes(8) + (1).to_bytes(4, "little") + b"m"
    body += bytes([1, 0, 0, 0, 2, 0, 0, 0]) + (1).to_bytes(4, "little") + np.float64(1.5).tobytes() + b"\2\0\0\0ab"
    with create_raw(tmp_path / "a.bag") as writer:
        writer.add_topic(topic)
        writer.write(RawMessage("/x", START_NS, body))
    convert([tmp_path / "a.bag"], tmp_path / "b.mcap")
    with open_raw(tmp_path / "b.mcap") as reader:
        message = reader.decode(next(iter(reader.messages())))
        assert (message.header.frame_id, message.when.nanosec, message.inner[0].value) == ("m", 2, 1.5)
    convert([tmp_path / "b.mcap"], tmp_path / "c.bag")
    assert raw(tmp_path / "c.bag") == [("/x", START_NS, body)]


def test_part_and_topics(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    selection = Selection(start_s=1.0, duration_s=2.0, topics=("/scan", "/info"), exclude_topics=("/info",))
    conversion = convert([tmp_path / "a.bag"], tmp_path / "b.bag", selection=selection)
    assert [(t.name, t.count) for t in conversion.topics] == [("/scan", 20)]
    assert conversion.start_ns == START_NS + 10**9 + 5
    for bad, words in (
        (Selection(topics=("/scam",)), "no topic '/scam' in the recording; it has /scan"),
        (Selection(start_s=1e6), "lies outside"),
        (Selection(duration_s=0.0), "more than 0 s"),
        (Selection(exclude_topics=("/scan", "/info", "/tf_static")), "no topic is left"),
    ):
        with pytest.raises(UsageError, match=words):
            convert([tmp_path / "a.bag"], tmp_path / "c.bag", selection=bad)
    assert not (tmp_path / "c.bag").exists()


def test_source_and_target_must_differ(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    with pytest.raises(UsageError, match="are the same"):
        convert([tmp_path / "a.bag"], tmp_path / "." / "a.bag")
    convert([tmp_path / "a.bag"], tmp_path / "folder")
    with pytest.raises(UsageError, match="lies in the target"):
        convert([tmp_path / "folder" / "folder_0.mcap"], tmp_path / "folder")
    with pytest.raises(UsageError, match="lies in the source"):
        convert([tmp_path / "folder"], tmp_path / "folder" / "x.bag")


def test_damaged_input_is_converted_up_to_the_damage(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag")
    data = (tmp_path / "a.bag").read_bytes()
    (tmp_path / "a.bag").write_bytes(data[:12000])
    log = RunLog()
    conversion = convert([tmp_path / "a.bag"], tmp_path / "b.mcap", log=log)
    assert 10 < conversion.num_messages < 52
    assert conversion.damage
    assert log.warnings == list(conversion.damage)
    (tmp_path / "a.bag").write_bytes(data[:4200])
    with pytest.raises(RecordingError, match="no message of it can be read"):
        convert([tmp_path / "a.bag"], tmp_path / "c.mcap")
    assert not (tmp_path / "c.mcap").exists()


def test_messages_that_are_not_what_their_type_says_are_left_out(tmp_path: Path) -> None:
    with create_raw(tmp_path / "a.bag") as writer:
        writer.add_topic(Topic(name="/scan", msgtype=SCAN, count=None, encoding="ros1"))
        writer.write(RawMessage("/scan", START_NS, b"\xff" * 30))
    log = RunLog()
    conversion = convert([tmp_path / "a.bag"], tmp_path / "b.mcap", log=log)
    assert (conversion.num_messages, conversion.num_lost) == (0, 1)
    assert "/scan: 1 messages are not what their type says" in log.warnings[0]


def test_carmen_to_every_format(tmp_path: Path) -> None:
    line = "FLASER 3 1.0 2.0 81.83 0.1 0 0 0.1 0 0 {} h 0\n"
    (tmp_path / "a.clf").write_text("".join(line.format(s) for s in ("5.5", "5.1", "5.9")))
    for name in ("b.bag", "b.mcap", "b.db3", "b"):
        conversion = convert([tmp_path / "a.clf"], tmp_path / name)
        assert conversion.source_format == "carmen"
        assert {t.name: t.count for t in conversion.topics} == {"/tf_static": 1, "/odom": 3, "/tf": 3, "/scan": 3}
        with open_raw(tmp_path / name) as reader:
            stamps = [reader.decode(m).header.stamp for m in reader.messages(["/scan"])]
        assert [s.nanosec for s in stamps] == [500_000_000, 100_000_000, 900_000_000]
    selection = Selection(topics=("/scan",), start_s=0.1)
    assert convert([tmp_path / "a.clf"], tmp_path / "c.bag", selection=selection).num_messages == 1
    with pytest.raises(RecordingError, match="cannot be joined"):
        convert([tmp_path / "a.clf", tmp_path / "b.bag"], tmp_path / "d.bag")


def test_other_encodings_pass_between_mcap_files_only(tmp_path: Path) -> None:
    schema = bytes(range(256)).decode("latin-1")
    with create_raw(tmp_path / "a.mcap") as writer:
        for name, count in (("/log", 1), ("/empty", 0)):
            writer.add_topic(
                Topic(
                    name=name,
                    msgtype="foxglove.Log",
                    count=None,
                    encoding="protobuf",
                    definition=schema,
                    definition_format="protobuf",
                )
            )
            for _ in range(count):
                writer.write(RawMessage(name, START_NS, b"abc"))
    convert([tmp_path / "a.mcap"], tmp_path / "b.mcap")
    with open_raw(tmp_path / "b.mcap") as reader:
        topic = reader.contents.topics[0]
        assert (topic.msgtype, topic.encoding, topic.definition, topic.definition_format) == (
            *("foxglove.Log", "protobuf", schema, "protobuf"),
        )
    with pytest.raises(
        RecordingError, match="'protobuf' messages cannot become 'ros1' ones; leave it out with --exclude-topics /log"
    ):
        convert([tmp_path / "b.mcap"], tmp_path / "c.bag")
    log = RunLog()
    convert([tmp_path / "b.mcap"], tmp_path / "c.bag", selection=Selection(topics=("/empty",)), log=log)
    assert "it is empty and left out" in log.warnings[0]


@pytest.mark.real_data
@pytest.mark.skipif(not (DATA / "bags").is_dir(), reason=f"no recordings under {DATA}")
def test_real_bags_come_back_equal(tmp_path: Path) -> None:
    convert([DATA / "bags" / "trace0_sqlite3"], tmp_path / "a.bag", compression="lz4")
    convert([tmp_path / "a.bag"], tmp_path / "b.mcap")
    assert raw(tmp_path / "b.mcap") == raw(DATA / "bags" / "trace0_mcap")
    convert([DATA / "bags" / "ccny_laser_scan_matcher_demo.bag"], tmp_path / "c.bag")
    with AnyReader([tmp_path / "c.bag"]) as reader:
        assert reader.message_count == 360


def test_the_record_beside_the_target(tmp_path: Path) -> None:
    (tmp_path / "a.clf").write_text("FLASER 4 1 2 3 4 0 0 0 0 0 0 1000.5 host 0.5\n")
    (tmp_path / "a.run.json").write_text("another's")
    made = convert([tmp_path / "a.clf"], tmp_path / "a.mcap", carmen=CarmenOptions(max_range_m=3.5))
    assert made.record == tmp_path / "a.mcap.run.json"
    record = json.loads(made.record.read_text())
    assert (record["command"], record["topics"]["/scan"]) == ("convert", 1)
    assert record["inputs"][0]["name"] == "a.clf"
    assert record["changed"]["max_range_m"] == 3.5
    assert record["parameters"]["format"] == "mcap"
    assert record["outputs"] == ["a.mcap", "a.mcap.run.json"]
    assert (tmp_path / "a.run.json").read_text() == "another's"
