# SPDX-License-Identifier: MIT
"""ROS 1 bags: by their index where it is sound, else by reading their chunks in sequence."""

from __future__ import annotations

import contextlib
import dataclasses
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from slamcli.errors import RecordingError
from slamcli.recordings.containers import rosbag1_records as records
from slamcli.recordings.containers.compression import MAX_CHUNK_BYTES, DecompressionError, decompress
from slamcli.recordings.containers.damage import Damage, at_time
from slamcli.recordings.containers.rosbag1_records import RecordError
from slamcli.recordings.containers.runs import Budget, Buffer, Run, stream_entries
from slamcli.recordings.containers.source import Source
from slamcli.recordings.containers.topic_table import MAX_TOPICS, TopicTable
from slamcli.recordings.raw import RawMessage, Topic

_CHUNK_SIGNATURE = b"\x00\x00\x00compression="
_MAX_CANDIDATES = 10_000
_SIGNATURE_MARGIN = len(_CHUNK_SIGNATURE) + 12


@dataclass(slots=True)
class _Chunk:
    position: int
    start_ns: int
    end_ns: int
    counts: dict[int, int] = field(default_factory=dict)


class Rosbag1Volume:
    """One ``.bag`` file.

    Raises
    ------
    RecordingError
        If it is no bag of format 2.0, or encrypted.
    """

    format = "rosbag1"

    def __init__(self, source: Source, table: TopicTable, damage: Damage, budget: Budget) -> None:
        self._source = source
        self._table = table
        self._damage = damage
        self._budget = budget
        self._chunks: list[_Chunk] = []
        self._connections: dict[int, Topic] = {}
        self._channels: dict[int, int] = {}
        self._compressions: Counter[str] = Counter()
        try:
            self._read_index(self._read_bag_header())
        except RecordError as reason:
            self._chunks, self._connections = [], {}
            self._scan(str(reason))
        self._register()

    @property
    def compression(self) -> str:
        """Name of the chunks' compression."""
        if not self._compressions and self._chunks:
            with contextlib.suppress(RecordError):
                self._chunk_header(self._chunks[0].position)
        return next(iter(self._compressions), "none")

    @property
    def start_ns(self) -> int | None:
        """Log time of the first message."""
        return min((chunk.start_ns for chunk in self._chunks if chunk.counts), default=None)

    @property
    def end_ns(self) -> int | None:
        """Log time of the last message."""
        return max((chunk.end_ns for chunk in self._chunks if chunk.counts), default=None)

    def runs(self, channels: frozenset[int] | None, start_ns: int | None, stop_ns: int | None) -> list[Run]:
        """Return the chunks that may hold messages of these channels and times."""
        wanted = None if channels is None else {c for c, channel in self._channels.items() if channel in channels}
        return [
            Run(chunk.start_ns, lambda chunk=chunk: self._stream(chunk, wanted, start_ns, stop_ns))  # type: ignore[misc]
            for chunk in self._chunks
            if (start_ns is None or chunk.end_ns >= start_ns)
            and (stop_ns is None or chunk.start_ns < stop_ns)
            and (wanted is None or not wanted.isdisjoint(chunk.counts))
        ]

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def _read_bag_header(self) -> records.Record:
        source = self._source
        magic = source.read(0, len(records.MAGIC))
        if magic != records.MAGIC:
            version = source.read(0, 64).split(b"\n")[0].partition(b" ")[2].decode("ascii", errors="replace")
            raise RecordingError(
                f"{source.path}: a bag of the format {version}, which ROS gave up in 2010; slamcli reads V2.0, and "
                "`rosbag fix` of ROS 1 makes such a bag of it"
            )
        buffer, offset = source.peek(len(magic), 8192)
        header = records.read_record(buffer, offset, len(buffer))
        if header.op != records.OP_BAG_HEADER:
            raise RecordError("it does not begin with a bag header")
        if records.text(header.fields, b"encryptor"):
            raise RecordingError(f"{source.path}: an encrypted bag; decrypt it with rosbag first")
        return header

    def _read_index(self, header: records.Record) -> None:
        """Read the connections and chunk infos at the end of the file; RecordError where they cannot be trusted."""
        position = records.number(header.fields, b"index_pos", 8)
        num_connections = records.number(header.fields, b"conn_count")
        num_chunks = records.number(header.fields, b"chunk_count")
        if position == 0:
            raise RecordError("it has no index: the recording was not closed")
        if not len(records.MAGIC) < position <= self._source.size:
            raise RecordError("the file ends before its index")
        data = self._source.read(position, self._source.size - position)
        offset = 0
        while offset < len(data) and len(self._chunks) < num_chunks + (len(self._connections) < num_connections):
            record = records.read_record(data, offset, len(data))
            offset = record.begin + record.size
            if offset > len(data):
                raise RecordError("its index is cut off")
            if record.op == records.OP_CONNECTION:
                number, topic = records.read_connection(record, data)
                self._connections[number] = topic
            elif record.op == records.OP_CHUNK_INFO:
                self._chunks.append(self._read_chunk_info(record, data))
            else:
                raise RecordError("its index holds something else")
        if len(self._connections) != num_connections or len(self._chunks) != num_chunks:
            raise RecordError("its index is incomplete")
        self._chunks.sort(key=lambda chunk: chunk.position)

    def _read_chunk_info(self, record: records.Record, data: bytes) -> _Chunk:
        count = records.number(record.fields, b"count")
        position = records.number(record.fields, b"chunk_pos", 8)
        if count * 8 != record.size or not len(records.MAGIC) < position < self._source.size:
            raise RecordError("a chunk info in its index is damaged")
        pairs = struct.unpack_from(f"<{2 * count}I", data, record.begin)
        counts = {number: n for number, n in zip(pairs[::2], pairs[1::2], strict=True) if n}
        if not counts.keys() <= self._connections.keys():
            raise RecordError("a chunk info in its index names an unknown connection")
        start, end = records.stamp(record.fields, b"start_time"), records.stamp(record.fields, b"end_time")
        return _Chunk(position, start, end, counts)

    def _scan(self, reason: str) -> None:
        """Read the file's records in sequence; after a damaged one, go on at the next chunk that can be found."""
        source = self._source
        position = search_from = len(records.MAGIC)
        last_ns: int | None = None
        lost, first_loss = 0, ""
        # Bounds the work on garbage whose chunks overlap each other.
        budget = 3 * source.size + MAX_CHUNK_BYTES // 8
        while position < source.size:
            try:
                record, begin = self._record_at(position)
                search_from = begin
                if record.op == records.OP_CHUNK:
                    budget -= min(record.size, source.size - begin)
                last_ns = self._scan_record(record, begin, position, last_ns)
                position = self._end_of(record, begin)
            except RecordError as error:
                budget -= records.MAX_HEADER_BYTES
                first_loss = first_loss or f"{error} at byte {position}; {at_time(last_ns)}"
                following = self._next_chunk(search_from) if budget > 0 else source.size
                lost += max(following - position, 0)
                position, search_from = following, following + 1
        what = f"{reason}; read in sequence instead"
        if first_loss:
            what += f"; {lost} of {source.size} bytes are lost: {first_loss}"
        self._damage.add(f"{source.path}: {what}")

    def _scan_record(self, record: records.Record, begin: int, position: int, last_ns: int | None) -> int | None:
        """Take in a record; return the time of the last message so far."""
        if record.op == records.OP_CHUNK:
            return self._scan_chunk(position, last_ns)
        if record.op == records.OP_CONNECTION and begin + record.size <= self._source.size:
            data = self._source.read(begin, record.size)
            number, topic = records.read_connection(record._replace(begin=0), data)
            self._connections.setdefault(number, topic)
        return last_ns

    def _end_of(self, record: records.Record, begin: int) -> int:
        size = record.size
        if record.op == records.OP_INDEX:
            # Early writers declare 20 bytes for each entry and write 12; ROS goes by the count.
            size = min(size, 12 * records.number(record.fields, b"count"))
        if begin + size > self._source.size:
            raise RecordError("a record is cut off")
        return begin + size

    def _next_chunk(self, position: int) -> int:
        """Return where the next chunk record begins, the end of the file if there is none."""
        window = 4 << 20
        candidates = 0
        while position < self._source.size and candidates < _MAX_CANDIDATES:
            data = self._source.read(position, window + _SIGNATURE_MARGIN)
            found = data.find(_CHUNK_SIGNATURE)
            while 0 <= found < window and candidates < _MAX_CANDIDATES:
                candidates += 1
                # The field stands first, or after the record's type.
                for start in (position + found - 5, position + found - 13):
                    if start >= position and self._is_chunk(start):
                        return start
                found = data.find(_CHUNK_SIGNATURE, found + 1)
            position += window
        return self._source.size

    def _is_chunk(self, position: int) -> bool:
        buffer, offset = self._source.peek(position, 256)
        try:
            record = records.read_record(buffer, offset, min(offset + 256, len(buffer)))
        except RecordError:
            return False
        return record.op == records.OP_CHUNK and b"size" in record.fields

    def _record_at(self, position: int) -> tuple[records.Record, int]:
        """Return the record at a position of the file, and the position of its data."""
        buffer, offset = self._source.peek(position, 4096)
        try:
            record = records.read_record(buffer, offset, len(buffer))
        except RecordError:
            buffer, offset = self._source.peek(position, records.MAX_HEADER_BYTES)
            record = records.read_record(buffer, offset, len(buffer))
        if not records.OP_MESSAGE <= record.op <= records.OP_CONNECTION:
            raise RecordError(f"a record has the unknown type {record.op}")
        if record.op == records.OP_INDEX:
            records.number(record.fields, b"count")
        return record, position + record.begin - offset

    def _scan_chunk(self, position: int, last_ns: int | None) -> int | None:
        contents = records.read_chunk(self._read_chunk(position))
        for number, topic in contents.connections.items():
            if len(self._connections) < MAX_TOPICS:
                self._connections.setdefault(number, topic)
        counts = Counter(entry[1] for entry in contents.entries if entry[1] in self._connections)
        times = [entry[0] for entry in contents.entries if entry[1] in self._connections]
        if times:
            self._chunks.append(_Chunk(position, min(times), max(times), dict(counts)))
            return max(times)
        return last_ns

    def _register(self) -> None:
        """Number the connections in the order of their first use."""
        totals: Counter[int] = Counter()
        for chunk in self._chunks:
            totals.update(chunk.counts)
        for number, topic in self._connections.items():
            self._channels[number] = self._table.add(dataclasses.replace(topic, count=totals[number]))

    def _chunk_header(self, position: int) -> tuple[str, int, int, int]:
        """Return compression, decompressed size, position and size of a chunk's data."""
        record, begin = self._record_at(position)
        if record.op != records.OP_CHUNK:
            raise RecordError("there is no chunk")
        compression = records.text(record.fields, b"compression") or "none"
        self._compressions[compression] += 1
        return compression, records.number(record.fields, b"size"), begin, record.size

    def _read_chunk(self, position: int) -> bytes:
        """Return a chunk's decompressed bytes, up to its damage, which is reported."""
        try:
            compression, size, begin, packed = self._chunk_header(position)
            if compression == "none" and packed == size <= self._source.size - begin:
                return self._source.read(begin, packed)
            if packed > MAX_CHUNK_BYTES and compression != "none":
                raise RecordError(f"it declares {packed} compressed bytes")  # noqa: TRY301
            data = self._source.read(begin, packed)
            return decompress(data, compression, size)
        except DecompressionError as error:
            self._damage.add(f"{self._source.path}: the chunk at byte {position} is damaged ({error})")
            return error.partial
        except RecordError as error:
            self._damage.add(f"{self._source.path}: the chunk at byte {position} cannot be read ({error})")
            return b""

    def _stream(
        self, chunk: _Chunk, wanted: set[int] | None, start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        buffer = Buffer(lambda: self._read_chunk(chunk.position), self._budget)
        channels = self._channels if wanted is None else {c: self._channels[c] for c in wanted}
        contents = records.read_chunk(buffer.load(), channels)
        expected = sum(chunk.counts.values())
        if contents.num_messages != expected or contents.error:
            last_ns = contents.entries[-1][0] if contents.entries else None
            self._damage.add(
                f"{self._source.path}: the chunk at byte {chunk.position} holds {contents.num_messages} whole messages "
                f"where {expected} are declared ({contents.error or 'index and chunk differ'}; {at_time(last_ns)})"
            )
        return stream_entries(buffer, contents.entries, self._table.names, start_ns, stop_ns)
