# SPDX-License-Identifier: MIT
"""MCAP files: by their summary where it is sound, else by reading their records in sequence."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from slamcli.recordings.containers import mcap_records as records
from slamcli.recordings.containers.compression import MAX_CHUNK_BYTES, DecompressionError, decompress
from slamcli.recordings.containers.damage import Damage, at_time
from slamcli.recordings.containers.mcap_extras import MAX_EXTRA_BYTES, Extra, place_of, read_extra
from slamcli.recordings.containers.mcap_records import PREFIX, Catalogue, RecordError
from slamcli.recordings.containers.mcap_resync import next_record
from slamcli.recordings.containers.runs import Budget, Buffer, Run, stream_entries
from slamcli.recordings.containers.source import Source
from slamcli.recordings.containers.topic_table import MAX_TOPICS, TopicTable
from slamcli.recordings.raw import RawMessage

_LOOSE_BYTES = 4 << 20
_MAX_TIME = 2**63 - 1


@dataclass(slots=True)
class _Part:
    """A chunk, or a stretch of messages outside of chunks."""

    position: int
    size: int
    chunked: bool
    start_ns: int
    end_ns: int
    channels: frozenset[int]


class McapVolume:
    """One ``.mcap`` file."""

    format = "mcap"

    def __init__(self, source: Source, table: TopicTable, damage: Damage, budget: Budget) -> None:
        self._source = source
        self._table = table
        self._damage = damage
        self._budget = budget
        self._catalogue = Catalogue()
        self._parts: list[_Part] | None = None
        self._extras: list[tuple[int, int]] = []
        self._counts: dict[int, int] | None = None
        self._channels: dict[int, int] = {}
        self.compression = "none"
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        try:
            self._read_summary()
        except RecordError as reason:
            self._catalogue, self._counts, self._extras = Catalogue(), None, []
            self._scan(str(reason))
        self._register()

    def runs(self, channels: frozenset[int] | None, start_ns: int | None, stop_ns: int | None) -> list[Run]:
        """Return the chunks that may hold messages of these channels and times."""
        if self._parts is None:
            self._scan("")
        wanted = None if channels is None else {n for n, channel in self._channels.items() if channel in channels}
        return [
            Run(part.start_ns, lambda part=part: self._stream(part, wanted, start_ns, stop_ns))  # type: ignore[misc]
            for part in self._parts or ()
            if (start_ns is None or part.end_ns >= start_ns)
            and (stop_ns is None or part.start_ns < stop_ns)
            and (wanted is None or not part.channels or not wanted.isdisjoint(part.channels))
        ]

    def extras(self) -> Iterator[Extra]:
        """Yield attachments and metadata records in the order of the file."""
        if self._parts is None:
            self._scan("")
        for position, length in sorted(set(self._extras)):
            try:
                if not PREFIX.size < length <= MAX_EXTRA_BYTES or position + length > self._source.size:
                    raise RecordError(f"it has {length} bytes")  # noqa: TRY301
                data = self._source.read(position, length)
                op, size = PREFIX.unpack_from(data)
                if op not in (records.ATTACHMENT, records.METADATA) or size != length - PREFIX.size:
                    raise RecordError("there is none")  # noqa: TRY301
                extra = read_extra(op, data[PREFIX.size :])
            except RecordError as error:
                self._damage.add(
                    f"{self._source.path}: the attachment or metadata at byte {position} is left out ({error})"
                )
                continue
            if extra is not None:
                yield extra

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def _read_summary(self) -> None:
        """Read topics, totals and chunk positions from the end of the file; RecordError where they cannot be trusted."""
        source = self._source
        tail = source.read(source.size - records.FOOTER_BYTES, records.FOOTER_BYTES)
        if len(tail) < records.FOOTER_BYTES or not tail.endswith(records.MAGIC) or tail[0] != records.FOOTER:
            raise RecordError("it does not end with a footer: the recording was not closed or is cut off")
        start = int.from_bytes(tail[9:17], "little")
        crc = int.from_bytes(tail[25:29], "little")
        if start == 0:
            raise RecordError("")
        end = source.size - records.FOOTER_BYTES
        if not len(records.MAGIC) <= start <= end:
            raise RecordError("its footer points outside of the file")
        data = source.read(start, end - start)
        if crc and zlib.crc32(tail[:25], zlib.crc32(data)) != crc:
            raise RecordError("the checksum of its summary is wrong")
        statistics, chunks = self._read_summary_records(data)
        if statistics is None or statistics.num_channels != len(self._catalogue.channels):
            raise RecordError("")
        if not statistics.counts.keys() <= self._catalogue.channels.keys():
            raise RecordError("its statistics name an unknown channel")
        if sum(statistics.counts.values()) == statistics.num_messages:
            self._counts = statistics.counts
        if statistics.num_messages:
            self.start_ns, self.end_ns = statistics.start_ns, min(statistics.end_ns, _MAX_TIME)
        if len(chunks) == statistics.num_chunks and (chunks or not statistics.num_messages):
            self._parts = [_Part(c.position, c.size, True, c.start_ns, c.end_ns, c.channels) for c in chunks]
            self._parts.sort(key=lambda part: part.position)
            self.compression = next((c.compression for c in chunks if c.compression), "none")

    def _read_summary_records(self, data: bytes) -> tuple[records.Statistics | None, list[records.ChunkIndex]]:
        statistics: records.Statistics | None = None
        chunks: list[records.ChunkIndex] = []
        position = 0
        while position + PREFIX.size <= len(data):
            op, length = PREFIX.unpack_from(data, position)
            begin = position + PREFIX.size
            if length > len(data) - begin:
                raise RecordError("its summary is damaged")
            position = begin + length
            if op in (records.SCHEMA, records.CHANNEL):
                self._catalogue.add(op, data[begin:position])
            elif op == records.STATISTICS:
                statistics = records.read_statistics(data[begin:position])
            elif op == records.CHUNK_INDEX:
                chunk = records.read_chunk_index(data[begin:position])
                if not len(records.MAGIC) <= chunk.position < self._source.size:
                    raise RecordError("its summary points outside of the file")
                chunks.append(chunk)
            elif op in (records.ATTACHMENT_INDEX, records.METADATA_INDEX):
                self._extras.append(place_of(data[begin:position]))
        return statistics, chunks

    def _scan(self, reason: str) -> None:
        """Read the file's records in sequence; behind damage go on at the next chunk or message that can be found."""
        source = self._source
        known = self._counts is not None
        counts: Counter[int] = Counter()
        self._parts = []
        position = len(records.MAGIC)
        lost, first_loss = 0, ""
        last_ns: int | None = None
        # Bounds the work on garbage whose records overlap each other.
        budget = 3 * source.size + (64 << 20)
        while True:
            position, stopped, last_ns, search_from = self._scan_sound(position, counts, last_ns)
            if not stopped:
                break
            first_loss = first_loss or f"{stopped} at byte {position}; {at_time(last_ns)}"
            following = source.size
            if budget > 0:
                following = next_record(source, search_from, self._catalogue.channels, last_ns)
            budget -= max(following - search_from, 1 << 16)
            lost += max(following - position, 0)
            if following >= source.size:
                break
            position = following
        if not known:
            self._counts = {number: counts[number] for number in self._catalogue.channels}
            self.start_ns = min((part.start_ns for part in self._parts), default=None)
            self.end_ns = max((part.end_ns for part in self._parts), default=None)
        if reason or first_loss:
            what = f"{reason}; read in sequence instead" if reason else "damaged"
            if first_loss:
                what += f"; {lost} of {source.size} bytes are lost: {first_loss}"
            self._damage.add(f"{source.path}: {what}")

    def _scan_sound(self, position: int, counts: Counter[int], last_ns: int | None) -> tuple[int, str, int | None, int]:
        """Read records from `position` to the end or to damage.

        Returns where that is, what is wrong there (empty at the end), the time of the last message, and where to search
        for the next sound record: within the last one, unless that was a chunk, because its length may be what is wrong.
        """
        source = self._source
        loose_begin, search_from, stopped = -1, position + 1, ""
        while position < source.size:
            buffer, offset = source.peek(position, PREFIX.size)
            op, length = PREFIX.unpack_from(buffer, offset) if len(buffer) - offset >= PREFIX.size else (0, 0)
            end = position + PREFIX.size + length
            if end > source.size or not (0 < op <= records.DATA_END or op >= records.FIRST_PRIVATE):
                stopped = "a record is cut off" if end > source.size else "there is no record"
                break
            is_loose = op in (records.SCHEMA, records.CHANNEL, records.MESSAGE)
            if is_loose and loose_begin < 0:
                loose_begin = position
            if loose_begin >= 0 and (not is_loose or end - loose_begin >= _LOOSE_BYTES):
                last_ns = self._scan_loose(loose_begin, end if is_loose else position, counts, last_ns)
                loose_begin = -1
            if op == records.CHUNK:
                last_ns = self._scan_chunk(position, length, counts, last_ns)
            if op in (records.ATTACHMENT, records.METADATA):
                self._extras.append((position, end - position))
            search_from = end if op == records.CHUNK else position + 1
            position = end
            if op in (records.FOOTER, records.DATA_END):
                position = source.size
        if loose_begin >= 0:
            last_ns = self._scan_loose(loose_begin, position, counts, last_ns)
        return position, stopped, last_ns, search_from

    def _scan_loose(self, begin: int, end: int, counts: Counter[int], last_ns: int | None) -> int | None:
        data = self._source.read(begin, end - begin)
        return self._take_in(data, begin, end - begin, False, counts, last_ns)

    def _scan_chunk(self, position: int, length: int, counts: Counter[int], last_ns: int | None) -> int | None:
        return self._take_in(self._read_chunk(position), position, length, True, counts, last_ns)

    def _take_in(
        self, data: bytes, position: int, size: int, chunked: bool, counts: Counter[int], last_ns: int | None
    ) -> int | None:
        """List a part's messages and note what it holds."""
        segment = records.read_segment(
            data, None, self._catalogue if len(self._catalogue.channels) < MAX_TOPICS else None
        )
        entries = [entry for entry in segment.entries if entry[1] in self._catalogue.channels]
        if not entries:
            return last_ns
        counts.update(entry[1] for entry in entries)
        start, end = min(entry[0] for entry in entries), max(entry[0] for entry in entries)
        assert self._parts is not None  # noqa: S101
        self._parts.append(_Part(position, size, chunked, start, end, frozenset(entry[1] for entry in entries)))
        return end

    def _register(self) -> None:
        for number in self._catalogue.channels:
            count = None if self._counts is None else self._counts.get(number, 0)
            self._channels[number] = self._table.add(self._catalogue.topic(number, count))

    def _read_chunk(self, position: int) -> bytes:
        """Return a chunk's decompressed records, up to its damage, which is reported."""
        source = self._source
        try:
            head = source.read(position, 4096)
            if len(head) < PREFIX.size or head[0] != records.CHUNK:
                raise RecordError("there is no chunk")  # noqa: TRY301
            header = records.read_chunk_header(head[PREFIX.size :], position + PREFIX.size)
            if header.compression:
                self.compression = header.compression
                if header.packed > MAX_CHUNK_BYTES:
                    raise RecordError(f"it declares {header.packed} compressed bytes")  # noqa: TRY301
            data = decompress(source.read(header.begin, header.packed), header.compression, header.size)
        except DecompressionError as error:
            self._damage.add(f"{source.path}: the chunk at byte {position} is damaged ({error})")
            return error.partial
        except RecordError as error:
            self._damage.add(f"{source.path}: the chunk at byte {position} cannot be read ({error})")
            return b""
        if header.crc and zlib.crc32(data) != header.crc:
            self._damage.add(
                f"{source.path}: the chunk at byte {position} has a wrong checksum: values in it may be wrong"
            )
        return data

    def _read_part(self, part: _Part) -> bytes:
        return self._read_chunk(part.position) if part.chunked else self._source.read(part.position, part.size)

    def _stream(
        self, part: _Part, wanted: set[int] | None, start_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        buffer = Buffer(lambda: self._read_part(part), self._budget)
        channels = self._channels if wanted is None else {n: self._channels[n] for n in wanted}
        segment = records.read_segment(buffer.load(), channels)
        if segment.error:
            last_ns = segment.entries[-1][0] if segment.entries else None
            self._damage.add(
                f"{self._source.path}: the chunk at byte {part.position} is damaged after {segment.num_messages} "
                f"messages ({segment.error}; {at_time(last_ns)})"
            )
        return stream_entries(buffer, segment.entries, self._table.names, start_ns, stop_ns)
