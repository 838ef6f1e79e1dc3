# SPDX-License-Identifier: MIT
"""The particles of a run, from ``particles.npz``."""

from __future__ import annotations

from pathlib import Path

from slamcli.errors import FormatError
from slamcli.formats.particles import read_particles
from slamcli.runtime import RunLog
from slamcli.trajectory.particle_track import ParticleTrack


def load_particles(folder: Path, log: RunLog) -> ParticleTrack | None:
    """Return the particles of a result, None where it has none; what cannot be read is left out with a warning."""
    path = folder / "particles.npz"
    if not path.is_file():
        return None
    try:
        track = read_particles(path)
    except FormatError as error:
        log.warn(f"{error}; it is left out")
        return None
    return track if len(track) else None
