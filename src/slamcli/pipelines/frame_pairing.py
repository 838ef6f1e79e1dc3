# SPDX-License-Identifier: MIT
"""Images of two cameras that belong together by their stamps, and the IMU samples that they need before them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from slamcli.measurements import Image, ImuSample, Measurement, RgbdFrame, StereoPair
from slamcli.runtime import RunLog

DEPTH_TOLERANCE_S = 0.02
STEREO_TOLERANCE_S = 0.005
_LONGEST_WAIT_NS = 500_000_000
"""A frame does not wait longer than this for the IMU: where that one pauses, memory must not grow."""


@dataclass(slots=True)
class PairingFigures:
    """What came of it."""

    num_frames: int = 0
    num_alone: int = 0
    """Images of the main camera without a partner."""
    num_backward: int = 0
    """Frames that are not later than the one before: left out."""
    num_other_size: int = 0
    """Frames whose image has another size than the first: left out."""
    partners: int = 0
    """Images of the other camera."""
    offsets_ns: list[int] = field(default_factory=list)
    """Stamp of the partner minus that of the main image, of each pair."""


class FramePairing:
    """Makes frames of images as they come, merged by stamp.

    A partner is the nearest image of the other camera within the tolerance; it is left to the next image of the main
    camera if it is nearer to that. A frame comes after all IMU samples up to the first one at or after its stamp.

    Parameters
    ----------
    main, partner
        Topics; no partner for one camera alone.
    tolerance_ns
        Largest difference of stamps.
    imu
        Topic of the IMU, if one is used.
    """

    def __init__(self, main: str, partner: str | None, tolerance_ns: int, imu: str | None, log: RunLog) -> None:
        self._main, self._partner, self._imu = main, partner, imu
        self._tolerance_ns = tolerance_ns
        self._log = log
        self.figures = PairingFigures()
        self._images: deque[Image] = deque()
        self._partners: deque[Image] = deque()
        self._samples: deque[ImuSample] = deque()
        self._frames: deque[Image | RgbdFrame | StereoPair] = deque()
        self._last_ns: int | None = None
        self._size: tuple[int, ...] | None = None

    def run(self, measurements: Iterable[Measurement]) -> Iterator[Measurement]:
        """Yield frames and IMU samples in the order in which a mapper needs them."""
        for measurement in measurements:
            if isinstance(measurement, ImuSample):
                self._samples.append(measurement)
                now_ns = measurement.stamp_ns
            elif isinstance(measurement, Image):
                self.take(measurement)
                now_ns = measurement.stamp_ns
            else:
                continue
            self._decide(now_ns)
            yield from self._ready(now_ns)
        self._decide(None)
        yield from self._ready(None)

    @property
    def waits_since_ns(self) -> int | None:
        """Stamp of the first image whose frame is not known yet; None if there is none."""
        return self._images[0].stamp_ns if self._images else None

    def decided(self, now_ns: int | None) -> list[Image | RgbdFrame | StereoPair]:
        """Return the further frames that are known once all images up to `now_ns` were taken; None: there are no more images."""
        self._decide(now_ns)
        frames = list(self._frames)
        self._frames.clear()
        return frames

    def tell(self, what: str) -> None:
        """Say what was left out, and how far apart the pairs are."""
        found, log = self.figures, self._log
        total = found.num_frames + found.num_alone
        if found.num_alone:
            log.counts[f"{self._main}: images without a partner"] += found.num_alone
            log.warn(
                f"{found.num_alone} of {total} images of {self._main} have no {what} on {self._partner} within"
                f" {self._tolerance_ns / 1e6:g} ms and are left out (`slamcli doctor` says whether a clock is off)"
            )
        if found.num_backward:
            log.counts[f"{self._main}: images out of order"] += found.num_backward
            log.warn(f"{self._main}: {found.num_backward} images are not later than the one before and are left out")
        if found.num_other_size:
            log.counts[f"{self._main}: images of another size"] += found.num_other_size
            height, width = (self._size or (0, 0))[:2]
            log.warn(
                f"{self._main}: {found.num_other_size} of {total + found.num_other_size} images are not {width} x {height} pixels"
                " as the first is, and are left out (--start and --duration choose the stretch of one size)"
            )
        if found.offsets_ns:
            offsets = np.array(found.offsets_ns) / 1e6
            median, furthest = float(np.median(offsets)), float(np.abs(offsets).max())
            if furthest > 0.05:
                log.note(
                    f"{what} on {self._partner} is {median:+.1f} ms from the image typically, {furthest:.1f} ms at most"
                    f" (shift it with --time-offset {self._partner}=SECONDS)"
                )

    def take(self, image: Image) -> None:
        """Take the next image of either camera."""
        if image.topic == self._partner:
            self.figures.partners += 1
            self._partners.append(image)
        elif image.topic == self._main:
            if self._last_ns is not None and image.stamp_ns <= self._last_ns:
                self.figures.num_backward += 1
                return
            self._size = self._size or image.pixels.shape
            if image.pixels.shape[:2] != self._size[:2]:
                self.figures.num_other_size += 1
                return
            self._last_ns = image.stamp_ns
            self._images.append(image)

    def _decide(self, now_ns: int | None) -> None:
        """Give partners to the images that no later message can change anything for."""
        if self._partner is None:
            self._frames.extend(self._images)
            self.figures.num_frames += len(self._images)
            self._images.clear()
            return
        wait_ns = 2 * self._tolerance_ns
        while self._images and (now_ns is None or now_ns > self._images[0].stamp_ns + wait_ns):
            self._pair(self._images.popleft())

    def _pair(self, image: Image) -> None:
        tolerance_ns = self._tolerance_ns
        while self._partners and self._partners[0].stamp_ns < image.stamp_ns - tolerance_ns:
            self._partners.popleft()
        next_ns = self._images[0].stamp_ns if self._images else None

        def free(partner: Image) -> bool:
            apart = abs(partner.stamp_ns - image.stamp_ns)
            return apart <= tolerance_ns and (next_ns is None or abs(partner.stamp_ns - next_ns) >= apart)

        found = [(abs(p.stamp_ns - image.stamp_ns), i) for i, p in enumerate(self._partners) if free(p)]
        if not found:
            self.figures.num_alone += 1
            return
        i = min(found)[1]
        partner = self._partners[i]
        for _ in range(i + 1):
            self._partners.popleft()
        self.figures.num_frames += 1
        self.figures.offsets_ns.append(partner.stamp_ns - image.stamp_ns)
        if partner.encoding == "depth":
            self._frames.append(RgbdFrame(colour=image, depth=partner))
        else:
            self._frames.append(StereoPair(left=image, right=partner))

    def _ready(self, now_ns: int | None) -> Iterator[Measurement]:
        """Yield the frames whose IMU samples are there, each after its samples."""
        while self._frames:
            stamp_ns = self._frames[0].stamp_ns
            if self._imu is not None:
                waits = now_ns is not None and now_ns < stamp_ns + _LONGEST_WAIT_NS
                if waits and not (self._samples and self._samples[-1].stamp_ns >= stamp_ns):
                    return
                while self._samples:
                    sample = self._samples.popleft()
                    yield sample
                    if sample.stamp_ns >= stamp_ns:
                        break
            yield self._frames.popleft()
