# SPDX-License-Identifier: MIT
"""Checks of what images show: black, blurred, repeated and dropped ones, sizes, depth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import Image
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.checks.image_evidence import ImageEvidence

_NEAREST_M, _FARTHEST_M = 0.2, 20.0
_LEAST_DEPTH = 0.2
_BLACK, _WHITE, _FLAT = 8.0, 247.0, 4.0
"""Mean grey values, and the standard deviation of grey values under which there is nothing to hold on to."""
_BLUR = 0.2
"""Sharpness over the topic's median under which an image is blurred."""
_FEW, _MANY = 0.01, 0.2


def exposure(evidence: Evidence) -> Iterator[Finding]:
    """Find images that are black, white, or without any texture."""
    for name, seen in _cameras(evidence):
        brightness, contrast = np.array(seen.brightness), np.array(seen.contrast)
        black = (brightness < _BLACK) & (contrast < 2 * _FLAT)
        white = brightness > _WHITE
        flat = (contrast < _FLAT) & ~black & ~white
        for found, what in (
            (black, "black"),
            (white, "overexposed"),
            (flat, "without texture (a bare wall, a covered lens)"),
        ):
            yield from _share(name, seen, found, f"{{}} {what}")


def blur(evidence: Evidence) -> Iterator[Finding]:
    """Find images that are much less sharp than the others of their topic."""
    for name, seen in _cameras(evidence):
        sharpness, lit = np.array(seen.sharpness), np.array(seen.contrast) >= _FLAT
        if np.count_nonzero(lit) >= 10:
            found = lit & (sharpness < _BLUR * float(np.median(sharpness[lit])))
            yield from _share(name, seen, found, "{} blurred (less than a fifth as sharp as the others)")


def repeated(evidence: Evidence) -> Iterator[Finding]:
    """Find images with exactly the bytes of the one before."""
    for name, seen in evidence.images.items():
        if seen.num_repeated:
            yield Finding(
                severity="warning" if seen.num_repeated > _FEW * seen.num else "note",
                topic=name,
                message=f"{seen.num_repeated} of {seen.num} images have exactly the bytes of the one before: the camera hung, "
                "or frames were written twice",
                stamp_ns=seen.repeated_ns,
                count=seen.num_repeated,
            )


def dropped(evidence: Evidence) -> Iterator[Finding]:
    """Find images that are missing at the camera's usual rate."""
    for name, survey in evidence.of(Image).items():
        stamps = np.sort(survey.stamps_ns)
        steps = np.diff(stamps) / 1e9
        period = float(np.median(steps)) if len(steps) >= 10 else 0.0
        if period <= 0:
            continue
        missing = np.where(steps > 1.5 * period, np.rint(steps / period) - 1, 0.0)
        total = int(missing.sum())
        if total == 0:
            continue
        worst = int(np.argmax(missing))
        share = total / (total + survey.num)
        yield Finding(
            severity="warning" if share > _FEW or missing[worst] > 3 else "note",
            topic=name,
            message=f"about {total} images were dropped ({100 * share:.1f} % at {1 / period:.3g} Hz), up to {int(missing[worst])} "
            f"in a row at {stamps[worst] / 1e9:.3f} s",
            stamp_ns=int(stamps[np.flatnonzero(missing)[0]]),
            count=total,
        )


def size_changes(evidence: Evidence) -> Iterator[Finding]:
    """Find topics whose images change their size."""
    for name, seen in evidence.images.items():
        if len(seen.sizes) > 1:
            listed = ", ".join(f"{count} of {w} x {h}" for (w, h), count in seen.sizes.most_common(4))
            usual = seen.sizes.most_common(1)[0][1]
            yield Finding(
                severity="error",
                topic=name,
                message=f"images change their size: {listed}",
                stamp_ns=seen.size_change_ns,
                count=seen.sizes.total() - usual,
                mend="convert the part that has one size (slamcli convert --start, --duration)",
            )


def depth_scale(evidence: Evidence) -> Iterator[Finding]:
    """Find depth images whose unit is not what their encoding says, or that hold hardly any depth."""
    for name, seen in evidence.images.items():
        if seen.first is None or seen.first.encoding != "depth":
            continue
        medians, first_ns = np.array(seen.depth_m), seen.first.stamp_ns
        known = medians[np.isfinite(medians)]
        share = float(np.mean(seen.depth_share))
        if len(known) == 0:
            yield Finding(severity="warning", topic=name, message="depth images hold no depth", stamp_ns=first_ns)
            continue
        typical = float(np.median(known))
        if not _NEAREST_M < typical < _FARTHEST_M:
            yield Finding(
                severity="error",
                topic=name,
                message=f"depth is {typical:.3g} m typically: the unit is not what the encoding says "
                "(16UC1 millimetres, 32FC1 metres)",
                stamp_ns=first_ns,
                mend="--depth-scale UNITS (raw units per metre: 1000 for millimetres, 5000 for TUM RGB-D)",
            )
        elif share < _LEAST_DEPTH:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"only {100 * share:.0f} % of the pixels have depth",
                stamp_ns=first_ns,
            )


def registration(evidence: Evidence) -> Iterator[Finding]:
    """Find depth that is not seen from the colour camera: of another size, or of a frame that sits elsewhere."""
    colour = [seen.first for _, seen in _cameras(evidence) if seen.first is not None]
    for name, seen in evidence.images.items():
        depth = seen.first
        if depth is None or depth.encoding != "depth" or not colour:
            continue
        near = max(colour, key=lambda image: _shared_space(image.topic, name))
        sizes = [(*reversed(image.pixels.shape[:2]),) for image in (depth, near)]
        apart_m = _apart_m(evidence, depth.frame_id, near.frame_id)
        if sizes[0] == sizes[1] and apart_m < 1e-3:
            continue
        how = (
            f"has {sizes[0][0]} x {sizes[0][1]} pixels, colour on {near.topic} {sizes[1][0]} x {sizes[1][1]}"
            if sizes[0] != sizes[1]
            else f"is seen from {depth.frame_id}, {100 * apart_m:.1f} cm beside {near.frame_id} of {near.topic}"
        )
        yield Finding(
            severity="warning",
            topic=name,
            message=f"depth {how}: it is not registered to the colour image",
            stamp_ns=depth.stamp_ns,
            mend="record or choose the registered depth (--depth-topic)",
        )


def _cameras(evidence: Evidence) -> Iterator[tuple[str, ImageEvidence]]:
    """Yield the topics of grey or colour images of which some were decoded."""
    for name, seen in evidence.images.items():
        if seen.first is not None and seen.first.encoding != "depth":
            yield name, seen


def _share(name: str, seen: ImageEvidence, found: NDArray[Any], what: str) -> Iterator[Finding]:
    """Yield a finding on a share of the sampled images: over a fifth of them is a warning."""
    count = int(np.count_nonzero(found))
    if count:
        share = count / len(found)
        how_many = f"{count} of {len(found)} images" + (" that were looked at" if seen.stride > 1 else "")
        yield Finding(
            severity="warning" if share > _MANY else "note",
            topic=name,
            message=what.format(f"{how_many} ({100 * share:.0f} %) are"),
            stamp_ns=seen.stamps_ns[int(np.flatnonzero(found)[0])],
            count=count,
        )


def _shared_space(a: str, b: str) -> int:
    """Return how many parts the names of two topics begin with alike."""
    pairs = zip(a.split("/"), b.split("/"), strict=False)
    return next((number for number, (x, y) in enumerate(pairs) if x != y), 99)


def _apart_m(evidence: Evidence, a: str, b: str) -> float:
    """Return how far apart two frames sit, 0 where that is unknown."""
    if a == b or not evidence.frames.connected(a, b):
        return 0.0
    return float(np.linalg.norm(evidence.frames.lookup(a, b)[:3, 3]))
