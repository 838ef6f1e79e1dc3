# SPDX-License-Identifier: MIT
"""Recordings to data-set folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from slamcli.errors import RecordingError, UsageError
from slamcli.formats.text_tables import format_stamp_s
from slamcli.outputs import atomic_directory
from slamcli.pipelines.conversion import Conversion, Selection
from slamcli.pipelines.convert import check_target, write_conversion_record
from slamcli.pipelines.folder_plan import FolderPlan, plan_folder
from slamcli.pipelines.trajectories import trajectory_of_topic
from slamcli.recordings import open_recording
from slamcli.recordings.folders.writing import TARGETS, Exported, Target
from slamcli.recordings.folders.writing.image_files import (
    camera_pixels,
    depth_pixels,
    file_bytes,
    png_bytes,
    write_bytes,
)
from slamcli.recordings.mends import Mends
from slamcli.recordings.raw import RawMessage
from slamcli.recordings.recording import Recording
from slamcli.recordings.topic_decoder import DECODING_ERRORS, TopicDecoder
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

DEPTH_UNITS_PER_M = 5000.0
_PROGRESS_EVERY = 20


def convert_to_folder(
    sources: Sequence[Path],
    target: Path,
    layout: str,
    *,
    selection: Selection | None = None,
    depth_units_per_m: float | None = None,
    log: RunLog | None = None,
) -> Conversion:
    """Write the cameras, depth, IMU and true poses of a recording to a folder in a data set's layout, whole or not at all.

    Images that are a PNG or JPEG file in their message are written byte by byte (JPEG as PNG where the layout's readers
    expect that); all others as PNG without loss. Depth is written in 1/5000 m.

    Parameters
    ----------
    sources
        One recording of any kind (several files if it was split).
    target
        A folder that does not exist, or is empty.
    layout
        A key of `slamcli.recordings.folders.writing.TARGETS`.
    depth_units_per_m
        Value of one metre in the source's depth; None for what its encoding says.

    Raises
    ------
    UsageError
        If the target holds anything, or there is no such layout.
    RecordingError
        If the source is no recording, or has no images.
    """
    log, selection = log or RunLog(), selection or Selection()
    if layout not in TARGETS:
        raise UsageError(f"no layout {layout!r} can be written: there are {', '.join(TARGETS)}")
    check_target(sources, target)
    if target.is_dir() and any(target.iterdir()):
        raise UsageError(f"{target}: the folder is not empty: name a new one for a data set")
    mends = Mends(depth_units_per_m=depth_units_per_m)
    with open_recording(sources, mends=mends, log=log) as recording:
        known = [topic.name for topic in recording.contents.topics]
        selection.check(known)
        plan = plan_folder(recording, layout, TARGETS[layout], {name for name in known if selection.chooses(name)})
        window = selection.window_ns(recording.start_ns, (recording.end_ns - recording.start_ns) / 1e9)
        with atomic_directory(target) as folder:
            export = _Export(recording, plan, TARGETS[layout], folder, layout)
            export.run(*window)
            size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        contents = recording.contents
    made = Conversion(
        record=target.with_name(f"{target.name}.run.json"),
        sources=contents.paths,
        source_format=contents.format,
        target=target,
        format=TARGETS[layout].title,
        compression="none",
        size_bytes=size,
        topics=tuple(
            replace(topic, count=export.counts[topic.name]) for topic in contents.topics if export.counts[topic.name]
        ),
        num_messages=export.counts.total(),
        start_ns=export.span[0] if export.span else None,
        end_ns=export.span[1] if export.span else None,
        num_lost=export.lost.total(),
        damage=contents.damage,
    )
    given: dict[str, Any] = {"layout": layout, "depth_scale": depth_units_per_m}
    write_conversion_record(made, given, selection, log)
    return made


@dataclass(slots=True)
class _Export:
    recording: Recording
    plan: FolderPlan
    target: Target
    folder: Path
    layout: str
    counts: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    span: tuple[int, int] | None = None

    def run(self, start_ns: int | None, stop_ns: int | None) -> None:
        """Write everything."""
        log, start = self.recording.log, self.recording.start_ns
        topics = {**self.plan.cameras, **self.plan.depth, **self.plan.imu}
        decoders = {
            name: TopicDecoder(self.recording.topic(name), self.recording.raw, self.recording.mends, log)
            for name in topics
        }
        with log.stage("convert", (self.recording.end_ns - start) / 1e9):
            for number, message in enumerate(self.recording.raw.messages(tuple(topics), start_ns, stop_ns)):
                if number % _PROGRESS_EVERY == 0:
                    log.progress.update((message.log_time_ns - start) / 1e9)
                decoder = decoders[message.topic]
                if decoder.accepts(message):
                    self._take(message, decoder)
        for decoder in decoders.values():
            decoder.tell()
        if not any(camera.frames for camera in self.plan.cameras.values()):
            raise RecordingError(f"{self.recording.name}: no image of it can be read")
        exported = Exported(
            root=self.folder,
            cameras=list(self.plan.cameras.values()),
            depth=next(iter(self.plan.depth.values()), None),
            imu=next((imu for imu in self.plan.imu.values() if imu.stamps_ns), None),
            truth=self._truth(start_ns, stop_ns),
            log=log,
        )
        self.target.finish(exported)

    def _take(self, message: RawMessage, decoder: TopicDecoder) -> None:
        name, stamp_ns = message.topic, decoder.stamp_ns(message)
        imu = self.plan.imu.get(name)
        if imu is not None:
            for sample in decoder.decode(message, stamp_ns):
                imu.stamps_ns.append(stamp_ns)
                imu.values.extend([*sample.angular_rad_s.tolist(), *sample.acceleration_m_s2.tolist()])
                self._count(name, stamp_ns)
            return
        camera = self.plan.cameras.get(name) or self.plan.depth[name]
        if camera.frames and camera.frames[-1][0] == stamp_ns:
            self._lose(name, "images with the stamp of the one before")
            return
        made = self._bytes(message, decoder, stamp_ns, is_depth=name in self.plan.depth)
        if made is None:
            self.lost[name] += 1
            return
        data, suffix = made
        file = f"{self._stem(stamp_ns)}{suffix}"
        write_bytes(self.folder / camera.folder / file, data)
        camera.frames.append((stamp_ns, file))
        self._count(name, stamp_ns)

    def _bytes(
        self, message: RawMessage, decoder: TopicDecoder, stamp_ns: int, *, is_depth: bool
    ) -> tuple[bytes, str] | None:
        """Return an image file and its suffix, None where the message holds no image."""
        if not is_depth:
            try:
                kept = file_bytes(self.recording.raw.decode(message), png_only=self.target.png_only)
            except DECODING_ERRORS:
                kept = None  # the decoder below says what is wrong with it
            if kept is not None:
                return kept
        for image in decoder.decode(message, stamp_ns):
            if not is_depth:
                return (png_bytes(camera_pixels(image)), ".png") if image.encoding != "depth" else None
            raw, far = depth_pixels(image, DEPTH_UNITS_PER_M)
            if far:
                self._lose(message.topic, "pixels farther than 13.1 m, written as no depth", far, message_lost=False)
            return png_bytes(raw), ".png"
        return None

    def _stem(self, stamp_ns: int) -> str:
        if self.layout == "tum":
            return format_stamp_s(stamp_ns)
        return f"at{stamp_ns}" if self.layout == "kitti" else str(stamp_ns)

    def _count(self, name: str, stamp_ns: int) -> None:
        self.counts[name] += 1
        low, high = self.span or (stamp_ns, stamp_ns)
        self.span = min(low, stamp_ns), max(high, stamp_ns)

    def _lose(self, name: str, what: str, number: int = 1, *, message_lost: bool = True) -> None:
        self.lost[name] += message_lost
        self.recording.log.counts[f"{name}: {what}"] += number

    def _truth(self, start_ns: int | None, stop_ns: int | None) -> Trajectory | None:
        """Return the true poses of the part that is written."""
        topic = self.plan.truth
        if topic is None:
            return None
        log = self.recording.log
        truth = trajectory_of_topic(self.recording, topic, f"{self.recording.name}:{topic}", log)
        inside = (truth.stamps_ns >= (start_ns or 0)) & (truth.stamps_ns < (stop_ns or 2**63 - 1))
        self.counts[topic] += int(inside.sum())
        return truth.select(inside) if inside.any() else None
