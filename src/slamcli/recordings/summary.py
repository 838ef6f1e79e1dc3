# SPDX-License-Identifier: MIT
"""What a recording holds, at a glance: topics, rates, gaps, frames, calibration, and which tiers can run on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import CameraModel
from slamcli.recordings.frames import read_frames
from slamcli.recordings.raw import Contents, Topic
from slamcli.recordings.recording import Recording
from slamcli.recordings.survey import TopicSurvey, survey
from slamcli.recordings.tier_fit import TierFit, fit_tiers
from slamcli.recordings.topic_traits import describe

_QUICK_BYTES = 64_000_000
"""A bigger recording is sampled: about this much of it is read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSummary:
    """One topic."""

    topic: Topic
    count: int | None
    rate_hz: float | None
    """Messages per second of the time from its first to its last message (of the whole recording where sampled)."""
    largest_gap_s: float | None
    """Longest time between two messages that follow each other (header stamps where there are any)."""
    gap_at_ns: int | None
    """Stamp of the message before that gap."""
    frame_id: str | None
    traits: str
    """What its first message shows, in a few words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSummary:
    """A recording at a glance."""

    contents: Contents
    topics: tuple[TopicSummary, ...]
    frames: FrameTree
    cameras: tuple[CameraModel, ...]
    """First CameraInfo of each topic."""
    tiers: tuple[TierFit, ...]
    sampled_s: float | None
    """Seconds from the start that gaps, frames and traits were taken from; None if everything was read."""

    @property
    def duration_s(self) -> float:
        """Log time from the first to the last message."""
        contents = self.contents
        return ((contents.end_ns or 0) - (contents.start_ns or 0)) / 1e9


def summarise(recording: Recording, *, full: bool = False) -> RecordingSummary:
    """Return what a recording holds.

    Counts, duration and mean rates come from the container's index. Gaps, frames and traits come from reading: all of a
    small recording (64 MB, or any size with `full`), else the first seconds of a big one.
    """
    contents = recording.contents
    stop_ns = None if full else _sample_end(contents)
    surveys = survey(recording, stop_ns=stop_ns)
    if stop_ns is not None:
        _find_firsts(recording, surveys)
    frames = recording.frames() if stop_ns is None else read_frames(recording, stop_ns=stop_ns)
    contents = recording.contents  # after reading, damage is known
    whole_s = ((contents.end_ns or 0) - (contents.start_ns or 0)) / 1e9
    return RecordingSummary(
        contents=contents,
        topics=tuple(
            _summarise_topic(topic, surveys[topic.name], whole_s, sampled=stop_ns is not None)
            for topic in contents.topics
        ),
        frames=frames,
        cameras=tuple(found.first for found in surveys.values() if isinstance(found.first, CameraModel)),
        tiers=fit_tiers(surveys, frames),
        sampled_s=None if stop_ns is None else (stop_ns - (contents.start_ns or 0)) / 1e9,
    )


def _sample_end(contents: Contents) -> int | None:
    """Return the log time at which a quick look ends, None where everything may be read."""
    if contents.size_bytes <= _QUICK_BYTES or contents.start_ns is None or contents.end_ns is None:
        return None
    share = _QUICK_BYTES / contents.size_bytes
    return contents.start_ns + max(1, round((contents.end_ns - contents.start_ns) * share))


def _find_firsts(recording: Recording, surveys: dict[str, TopicSurvey]) -> None:
    """Read the first message of the topics that the sample did not hold; the index finds it."""
    for found in surveys.values():
        if found.first is None and found.adapter is not None and found.topic.count != 0 and found.num_garbage == 0:
            found.first = next(iter(recording.measurements([found.topic])), None)


def _summarise_topic(topic: Topic, found: TopicSurvey, whole_s: float, *, sampled: bool) -> TopicSummary:
    stamps = found.stamps_ns if found.has_header else found.log_times_ns
    count = topic.count if topic.count is not None else found.num
    gap_s, gap_at = _largest_gap(stamps)
    rate = _rate_hz(stamps, whole_s) if not sampled else count / whole_s if whole_s > 0 and count > 1 else None
    return TopicSummary(
        topic=topic,
        count=count,
        rate_hz=rate,
        largest_gap_s=gap_s,
        gap_at_ns=gap_at,
        frame_id=getattr(found.first, "frame_id", None),
        traits=describe(found.first) if found.first is not None else "",
    )


def _rate_hz(stamps_ns: NDArray[np.int64], whole_s: float) -> float | None:
    """Return messages per second between the first and the last, None for a single burst of them."""
    span_s = float(stamps_ns.max() - stamps_ns.min()) / 1e9 if len(stamps_ns) > 1 else 0.0
    return (len(stamps_ns) - 1) / span_s if span_s > 0.01 * whole_s else None


def _largest_gap(stamps_ns: NDArray[np.int64]) -> tuple[float | None, int | None]:
    if len(stamps_ns) < 2:
        return None, None
    gaps = np.diff(stamps_ns)
    at = int(np.argmax(gaps))
    return float(gaps[at]) / 1e9, int(stamps_ns[at])
