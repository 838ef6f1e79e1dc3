# SPDX-License-Identifier: MIT
"""Writes a bag of scans and images to a temporary folder, times opening and streaming it, and deletes it.

    python benchmarks/reading.py [--gigabytes 1] [--formats rosbag1 mcap rosbag2-sqlite3] [--compression none]

Prints one line per format: writing, opening (index or summary), streaming everything undecoded, streaming the scans
only, a part of ten seconds by seeking, streaming without an index, and the peak memory.
"""

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.recordings.adapters import message_factory
from slamcli.recordings.containers import create_raw, open_raw
from slamcli.recordings.raw import RawMessage, Topic
from slamcli.runtime import RunLog, peak_memory_bytes

SCAN, IMAGE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Image"
START_NS = 1_700_000_000 * 10**9


def write(path: Path, format: str, compression: str, size_bytes: int) -> tuple[int, int]:
    """Write scans (1081 beams, 40 Hz) and images (640 x 480 rgb8, 30 Hz) until `size_bytes` are reached."""
    encoding = "ros1" if format == "rosbag1" else "cdr"
    factory = message_factory(encoding)
    rng = np.random.default_rng(1)
    ranges = rng.uniform(0.5, 10, 1081).astype(np.float32)
    pixels = np.repeat(rng.integers(0, 255, 640 * 480 * 3 // 16, dtype=np.uint8), 16)
    empty = np.zeros(0, dtype=np.float32)
    header = factory.header(START_NS, "laser")
    values = (-2.35, 2.35, 0.00436, 0.0, 0.025, 0.1, 30.0)
    scan = bytes(factory.serialise(factory.make(SCAN, header, *values, ranges, empty), SCAN))
    image = bytes(factory.serialise(factory.make(IMAGE, header, 480, 640, "rgb8", 0, 1920, pixels), IMAGE))
    written = count = 0
    with create_raw(path, format=format, compression=compression) as writer:
        writer.add_topic(Topic(name="/scan", msgtype=SCAN, count=None, encoding=encoding))
        writer.add_topic(Topic(name="/image", msgtype=IMAGE, count=None, encoding=encoding))
        tick = 0
        while written < size_bytes:
            time_ns = START_NS + tick * 25_000_000
            writer.write(RawMessage("/scan", time_ns, scan))
            written, count = written + len(scan), count + 1
            if tick % 4:
                writer.write(RawMessage("/image", time_ns + 1_000_000, image))
                written, count = written + len(image), count + 1
            tick += 1
    return written, count


def timed(function: Callable[..., Any], *arguments: Any) -> tuple[float, Any]:
    begin = time.perf_counter()
    result = function(*arguments)
    return time.perf_counter() - begin, result


def read(path: Path, topics: list[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None) -> int:
    with open_raw(path, RunLog()) as reader:
        return sum(len(message.data) for message in reader.messages(topics, start_ns, stop_ns))


def open_only(path: Path) -> int:
    with open_raw(path, RunLog()) as reader:
        return reader.contents.num_messages or 0


def bench(folder: Path, format: str, compression: str, size_bytes: int) -> None:
    path = folder / f"bench{ {'rosbag1': '.bag', 'mcap': '.mcap'}.get(format, '') }"
    seconds, (size, count) = timed(write, path, format, compression, size_bytes)
    print(
        f"{format} ({compression}): {size / 1e6:.0f} MB, {count} messages, written at {size / 1e6 / seconds:.0f} MB/s"
    )
    seconds, _ = timed(open_only, path)
    print(f"  opened (topics, counts, times) in {seconds:.3f} s")
    part = (None, START_NS + 10 * 10**9, START_NS + 15 * 10**9)
    for name, arguments in (("everything", ()), ("scans only", (["/scan"],)), ("5 s by seeking", part)):
        seconds, size = timed(read, path, *arguments)
        print(f"  {name}: {size / 1e6:.0f} MB in {seconds:.2f} s, {size / 1e6 / seconds:.0f} MB/s undecoded")
    if path.is_file():
        with path.open("r+b") as stream:
            stream.truncate(path.stat().st_size - 20)
        seconds, size = timed(read, path)
        print(f"  without its index: scanned and streamed in {seconds:.2f} s, {size / 1e6 / seconds:.0f} MB/s")
    print(f"  peak memory {peak_memory_bytes() / 1e6:.0f} MB")
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument("--formats", nargs="+", default=["rosbag1", "mcap", "rosbag2-sqlite3"])
    parser.add_argument("--compression", default="none")
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="slamcli-reading-"))
    try:
        for name in arguments.formats:
            bench(folder, name, arguments.compression, int(arguments.gigabytes * 1e9))
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
