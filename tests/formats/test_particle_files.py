# SPDX-License-Identifier: MIT
"""``particles.npz``: what is written is read; the same bytes at any time; damage is one clear line."""

from __future__ import annotations

import time

import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.formats import particles
from slamcli.formats.particles import read_particles, write_particles
from slamcli.trajectory.particle_track import particle_track


@pytest.fixture
def track():
    rng = np.random.default_rng(1)
    return particle_track(
        [5, 6], [rng.normal(size=(4, 3)), rng.normal(size=(3, 3))], [np.full(4, 0.25), np.full(3, 1 / 3)]
    )


def test_what_is_written_is_read(track, tmp_path, monkeypatch):
    write_particles(tmp_path / "a.npz", track)
    read = read_particles(tmp_path / "a.npz")
    for column in ("stamps_ns", "poses", "weights"):
        np.testing.assert_array_equal(getattr(read, column), getattr(track, column))
        assert getattr(read, column).dtype == getattr(track, column).dtype
    monkeypatch.setattr(time, "time", lambda: 2e9)
    write_particles(tmp_path / "b.npz", track)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_damage_is_told(track, tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    write_particles(path, track)
    whole = path.read_bytes()
    for content in (b"", b"hello", whole[:200], whole[:60] + b"\x00" * 20 + whole[80:]):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=r"a\.npz"):
            read_particles(path)
    np.savez(path, stamps_ns=np.arange(2))
    with pytest.raises(FormatError, match=r"no track of particles: .*poses"):
        read_particles(path)
    np.savez(path, stamps_ns=np.array([0.5]), poses=track.poses, weights=track.weights)
    with pytest.raises(FormatError, match="cannot be read as a track of particles"):
        read_particles(path)
    with pytest.raises(FormatError, match=r"missing\.npz: cannot be read"):
        read_particles(tmp_path / "missing.npz")
    path.write_bytes(whole)
    monkeypatch.setattr(particles, "_MOST_BYTES", 10)
    with pytest.raises(FormatError, match="when unpacked"):
        read_particles(path)
