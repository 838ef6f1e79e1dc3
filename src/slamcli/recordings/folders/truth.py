# SPDX-License-Identifier: MIT
"""True poses of data sets as a stream."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, InputError
from slamcli.recordings.folders.layout import TRUTH_TOPIC, Reading
from slamcli.recordings.folders.listings import FIRST_STAMP_NS
from slamcli.recordings.folders.streams import Poses
from slamcli.trajectory import Trajectory


def truth_stream(stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> Poses:
    """Return poses at these stamps, sorted by them."""
    order = np.argsort(stamps_ns, kind="stable")
    return Poses(
        topic=TRUTH_TOPIC,
        frame_id="world",
        stamps_ns=np.where(stamps_ns[order] == 0, FIRST_STAMP_NS, stamps_ns[order]),
        positions_m=trajectory.positions_m[order],
        quats_xyzw=trajectory.quats_xyzw[order],
    )


def read_truth(path: Path, read: Callable[[Path], Trajectory], reading: Reading) -> Trajectory | None:
    """Return the trajectory in a file; None, and a line on why, if it is broken: the recording is of use without it."""
    try:
        return read(path)
    except (FormatError, InputError) as error:
        reading.damage.add(f"ground truth cannot be read and is left out: {error}")
        return None
