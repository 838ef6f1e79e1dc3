# SPDX-License-Identifier: MIT
"""The particles of a run, from ``particles.npz``."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from slamcli.pipelines.replay_tracks import ParticleTrack
from slamcli.runtime import RunLog


def load_particles(folder: Path, log: RunLog) -> ParticleTrack | None:
    """Return the particles of a result, None where it has none; what cannot be read is left out with a warning."""
    path = folder / "particles.npz"
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            stamps = arrays["stamps_ns"].astype(np.int64)
            poses, weights = (arrays[name].astype(np.float32) for name in ("poses", "weights"))
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        log.warn(f"{path} cannot be read and is left out: {error}")
        return None
    steps = len(stamps)
    if stamps.ndim != 1 or poses.ndim != 3 or poses.shape[::2] != (steps, 3) or weights.shape != poses.shape[:2]:
        log.warn(
            f"{path} is left out: stamps {stamps.shape}, poses {poses.shape} and weights {weights.shape} do not fit"
        )
        return None
    if not (np.isfinite(poses).all() and np.isfinite(weights).all()):
        log.warn(f"{path} is left out: a particle is not finite")
        return None
    return ParticleTrack(stamps_ns=stamps, poses=poses, weights=weights) if steps else None
