# SPDX-License-Identifier: MIT
"""What the cameras of a recording saw at a few moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import Image
from slamcli.recordings import Recording, Topic
from slamcli.reports.figures.strip import StripRow, depth_colours, shrunk

_MOMENTS = 6
_MOST_TOPICS = 4


def image_rows(recording: Recording, start_s: float | None, duration_s: float | None) -> list[StripRow]:
    """Return six pictures of each of up to four image topics, spread over the part that is shown."""
    length_s = (recording.end_ns - recording.start_ns) / 1e9 - (start_s or 0.0)
    length_s = min(length_s, duration_s) if duration_s is not None else length_s
    rows = []
    topics = [topic for topic in recording.topics(Image) if topic.count != 0]
    for topic in sorted(topics, key=lambda topic: topic.name)[:_MOST_TOPICS]:
        images = _some(recording, topic, start_s or 0.0, length_s)
        if images:
            rows.append(_row(recording, topic, images))
    return rows


def _some(recording: Recording, topic: Topic, start_s: float, length_s: float) -> list[Image]:
    """Return images at moments spread over the time, each found by seeking; none twice."""
    found: list[Image] = []
    for moment in np.linspace(0.0, max(length_s, 0.0), _MOMENTS, endpoint=False).tolist():
        rest_s = max(length_s - moment, 1e-3)
        part = recording.measurements([topic], start_s=start_s + moment, duration_s=rest_s)
        image: Image | None = next(iter(part), None)
        if image is not None and (not found or image.stamp_ns > found[-1].stamp_ns):
            found.append(image)
    return found


def _row(recording: Recording, topic: Topic, images: list[Image]) -> StripRow:
    captions = [f"{(image.stamp_ns - recording.start_ns) / 1e9:.4g} s" for image in images]
    if images[0].encoding != "depth":
        return StripRow(label=topic.name, pictures=[_colours(image) for image in images], captions=captions)
    depths = [_thinned(np.asarray(image.pixels, dtype=np.float32)) for image in images]
    known = np.concatenate([depth[np.isfinite(depth) & (depth > 0)] for depth in depths])
    farthest_m = float(np.percentile(known, 95)) if len(known) else 1.0
    pictures = [depth_colours(depth, farthest_m) for depth in depths]
    return StripRow(
        label=f"{topic.name}: dark is near, bright is {farthest_m:.2g} m", pictures=pictures, captions=captions
    )


def _thinned(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    step = max(1, round(depth.shape[1] / 200))
    return depth[::step, ::step]


def _colours(image: Image) -> NDArray[np.uint8]:
    """Return red-green-blue pixels."""
    pixels = shrunk(np.asarray(image.pixels, dtype=np.uint8))
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=2)
    return pixels[..., ::-1] if image.encoding == "bgr8" else pixels
