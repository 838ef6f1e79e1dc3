# SPDX-License-Identifier: MIT
"""Tracks of particles in files: NumPy's ``.npz`` with ``stamps_ns``, ``poses`` and ``weights``."""

from __future__ import annotations

import os
import zipfile
import zlib
from pathlib import Path

import numpy as np

from slamcli.errors import DataError, FormatError
from slamcli.outputs import atomic_file
from slamcli.trajectory.particle_track import ParticleTrack

_MOST_BYTES = 1 << 30


def write_particles(target: str | os.PathLike[str], track: ParticleTrack) -> None:
    """Write a track; the same one gives the same bytes.

    Raises
    ------
    UsageError
        If `target` cannot be written to.
    """
    with atomic_file(target, "wb") as stream:
        np.savez_compressed(
            stream, allow_pickle=False, stamps_ns=track.stamps_ns, poses=track.poses, weights=track.weights
        )


def read_particles(source: str | os.PathLike[str]) -> ParticleTrack:
    """Return the track in a file that `write_particles` wrote.

    Raises
    ------
    FormatError
        If the file cannot be read, is no track, or is damaged.
    """
    path = Path(source)
    try:
        with zipfile.ZipFile(path) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > _MOST_BYTES:
            raise FormatError(f"{path}: {size:,} bytes when unpacked; tracks of particles have at most {_MOST_BYTES:,}")
        with np.load(path, allow_pickle=False) as columns:
            return ParticleTrack(
                stamps_ns=np.asarray(columns["stamps_ns"]).astype(np.int64, casting="safe"),
                poses=np.asarray(columns["poses"]).astype(np.float32, casting="same_kind"),
                weights=np.asarray(columns["weights"]).astype(np.float32, casting="same_kind"),
            )
    except KeyError as error:
        raise FormatError(f"{path}: no track of particles: {error.args[0]}") from error
    except (zipfile.BadZipFile, zlib.error, ValueError, TypeError, EOFError, OSError, MemoryError, RuntimeError, DataError) as error:  # fmt: skip
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: cannot be read as a track of particles: {error}") from error
