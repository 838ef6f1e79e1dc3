# SPDX-License-Identifier: MIT
"""Steps with different numbers of particles in one track; long runs are thinned."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.trajectory import particle_track as module
from slamcli.trajectory.particle_track import ParticleTrack, particle_track


def steps(counts):
    poses = [np.arange(3.0 * n).reshape(n, 3) + 100 * k for k, n in enumerate(counts)]
    return [7 * k for k in range(len(counts))], poses, [np.full(n, 1 / n) for n in counts]


def test_fewer_particles_leave_nan_and_no_weight():
    track = particle_track(*steps([2, 3, 1]))
    assert len(track) == 3
    assert (track.poses.dtype, track.weights.dtype) == (np.float32, np.float32)
    assert np.isnan(track.poses[..., 0]).tolist() == [[False, False, True], [False] * 3, [False, True, True]]
    np.testing.assert_allclose(track.weights, [[0.5, 0.5, 0], [1 / 3] * 3, [1, 0, 0]])
    assert track.poses[1, 2].tolist() == [106, 107, 108]


def test_a_long_run_keeps_every_so_many_steps(monkeypatch):
    monkeypatch.setattr(module, "MOST_POSES", 10)
    track = particle_track(*steps([3] * 7))  # 21 poses
    assert track.stamps_ns.tolist() == [0, 21, 42]
    assert track.poses[2, 0, 0] == 600


def test_nothing_is_a_track_too():
    assert len(particle_track([], [], [])) == 0


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(DataError, match="particles whose stamps"):
        ParticleTrack(
            stamps_ns=np.arange(2),
            poses=np.zeros((2, 3, 3), dtype=np.float32),
            weights=np.zeros((2, 4), dtype=np.float32),
        )
