# SPDX-License-Identifier: MIT
"""Small recordings in every format, with several chunks."""

import random
from pathlib import Path

from mcap.writer import Writer

from slamcli.recordings.adapters import message_factory
from slamcli.recordings.containers import FORMATS, create_raw, mcap_writer, open_raw, rosbag1_writer
from slamcli.recordings.raw import RawMessage, Topic

SUFFIXES = {"rosbag1": ".bag", "mcap": ".mcap", "sqlite3": ".db3", "rosbag2-mcap": "", "rosbag2-sqlite3": ""}
WRITABLE = [(name, compression) for name, compressions in FORMATS.items() for compression in compressions]
START_NS = 1_600_000_000 * 10**9
STRING = "std_msgs/msg/String"


def encoding_of(format: str) -> str:
    return "ros1" if format == "rosbag1" else "cdr"


def string_message(text: str, encoding: str) -> bytes:
    factory = message_factory(encoding)
    return bytes(factory.serialise(factory.make(STRING, text), STRING))


def topics(encoding: str) -> list[Topic]:
    return [
        Topic(name="/a", msgtype=STRING, count=None, encoding=encoding),
        Topic(name="/b", msgtype="nav_msgs/msg/Odometry", count=None, encoding=encoding, latched=True),
    ]


def messages(encoding: str, number: int = 60) -> list[RawMessage]:
    """Messages in log order, some at the same time."""
    rng = random.Random(3)
    out = []
    for index in range(number):
        time = START_NS + (index // 2) * 50_000_000
        text = "".join(rng.choices("abcdefgh", k=rng.randrange(10, 400)))
        out.append(RawMessage("/a", time, string_message(text, encoding), 0, index))
    return out


def write_sample(
    path: Path, format: str, compression: str, chunk_bytes: int = 2000, encoding: str | None = None, number: int = 60
) -> list[RawMessage]:
    """Write `messages` and return them."""
    encoding = encoding or encoding_of(format)
    sizes = mcap_writer.CHUNK_BYTES, rosbag1_writer.CHUNK_BYTES
    mcap_writer.CHUNK_BYTES = rosbag1_writer.CHUNK_BYTES = chunk_bytes
    try:
        with create_raw(path, format=format, compression=compression) as writer:
            for topic in topics(encoding):
                writer.add_topic(topic)
            for message in messages(encoding, number):
                writer.write(message)
    finally:
        mcap_writer.CHUNK_BYTES, rosbag1_writer.CHUNK_BYTES = sizes
    return messages(encoding, number)


def write_plain_mcap(path: Path, *, summary: bool = True) -> list[RawMessage]:
    """Write an MCAP file without chunks, by the mcap library."""
    folder_sample = path.with_name("chunked.mcap")
    write_sample(folder_sample, "mcap", "none")
    options = {} if summary else {"use_statistics": False, "use_summary_offsets": False, "repeat_schemas": False}
    if not summary:
        options["repeat_channels"] = False
    with open_raw(folder_sample) as reader, path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False, **options)
        writer.start("ros2", "test")
        channels = {}
        for number, topic in enumerate(reader.contents.topics):
            schema = writer.register_schema(topic.msgtype, "ros2msg", topic.definition.encode())
            channels[number] = writer.register_channel(topic.name, "cdr", schema)
        for message in reader.messages():
            writer.add_message(
                channels[message.channel], message.log_time_ns, message.data, message.log_time_ns, message.sequence
            )
        writer.finish()
    return messages("cdr")


def core(stream: object) -> list[tuple[str, int, bytes]]:
    """Topic, time and bytes of messages."""
    return [(m.topic, m.log_time_ns, bytes(m.data)) for m in stream]  # type: ignore[attr-defined]
