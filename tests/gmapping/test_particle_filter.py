# SPDX-License-Identifier: MIT
"""The particle filter: drawing, weights, ancestry, particle numbers and the improved proposal, against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from room_world import beams_at, drive, from_first

from slamcli.geometry import se2
from slamcli.gmapping import GmappingParameters, particle_filter
from slamcli.gmapping.motion import MotionModel
from slamcli.gmapping.particle_filter import ParticleFilter, systematic_draw
from slamcli.gmapping.result import track_of
from slamcli.grids.tiles import TiledMaps


def test_systematic_draw_takes_each_as_often_as_its_weight_says():
    rng = np.random.default_rng(1)
    for count in (1, 7, 30):
        weights = rng.random(12) ** 4
        weights /= weights.sum()
        for offset in (0.0, 0.3, 0.999):
            drawn = systematic_draw(weights, count, offset)
            assert len(drawn) == count
            assert (np.diff(drawn) >= 0).all()
            times = np.bincount(drawn, minlength=12)
            assert (np.abs(times - count * weights) < 1).all()
    mean = np.mean([np.bincount(systematic_draw(weights, 7, u), minlength=12) for u in np.arange(0, 1, 1e-3)], axis=0)
    np.testing.assert_allclose(mean, 7 * weights, atol=5e-3)


def test_systematic_draw_never_takes_what_weighs_nothing():
    assert systematic_draw(np.array([0.0, 1.0, 0.0]), 4, 0.0).tolist() == [1, 1, 1, 1]
    assert systematic_draw(np.array([0.5, 0.5]), 2, 0.0).tolist() == [0, 1]
    short = np.array([0.1] * 10 + [0.0])  # sums to a little less than one
    assert systematic_draw(short, 1000, math.nextafter(1.0, 0.0)).max() == 9


def scripted(monkeypatch, likelihoods, **parameters):
    """A filter whose scan match moves nothing and says `likelihoods`, one row per update."""
    rows = iter(likelihoods)

    def match(maps, points, directions, poses, *rest, **more):
        row = np.asarray(next(rows), dtype=float)
        return np.ones(len(poses)), row[: len(poses)].copy()

    monkeypatch.setattr(particle_filter, "match_particles", match)
    size = {"xmin": -5.0, "xmax": 5.0, "ymin": -5.0, "ymax": 5.0}
    return ParticleFilter(GmappingParameters(**size, **parameters), np.random.default_rng(3), np.zeros(3))


def test_weights_neff_and_resampling(monkeypatch):
    rows = [[0.0, 1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0], [0.0, 500.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
    particles = scripted(monkeypatch, rows, particles=4, ogain=2.0)
    beams = beams_at((0.0, 0.0, 0.0), beams=12)
    for index in range(5):
        particles.update(index, beams)
    logs = np.zeros(4)
    for step, row in zip(particles.steps[1:], rows, strict=True):
        logs = logs + row
        weights = np.exp((logs - logs.max()) / (2.0 * 4))
        weights /= weights.sum()
        assert step.neff == pytest.approx(1 / (weights**2).sum())
        np.testing.assert_allclose(step.weights, weights, rtol=1e-12)
        assert step.log_likelihood == max(row)
        assert step.resampled == (step.neff < 2.0)
        if step.resampled:
            logs = np.zeros(4)
    assert [step.resampled for step in particles.steps] == [False, False, False, True, False]
    assert particles.steps[4].parents.tolist() == [1, 1, 1, 1]
    track = track_of(particles, [10, 20, 30, 40, 50])
    assert track.stamps_ns.tolist() == [10, 20, 30, 40, 50]
    np.testing.assert_allclose(track.weights[0], 0.25)
    np.testing.assert_allclose(track.weights[3], [0.0, 1.0, 0.0, 0.0], atol=1e-20)  # before it was resampled
    np.testing.assert_array_equal(track.poses[4], particles.steps[4].poses.astype(np.float32))
    np.testing.assert_allclose(particles._weight_sums, 3.0 - 2.0 + 500.0)  # of particle 1: 1 + 0 + 500


def test_a_threshold_of_zero_never_resamples(monkeypatch):
    particles = scripted(monkeypatch, [[0.0, 900.0]] * 3, particles=2, resampleThreshold=0.0)
    for index in range(4):
        particles.update(index, beams_at((0.0, 0.0, 0.0), beams=12))
    assert not any(step.resampled for step in particles.steps)


def test_the_best_path_and_its_map_are_those_of_a_particle_that_kept_its_own_history():
    _, poses = drive(40)
    parameters = GmappingParameters(
        particles=6, resampleThreshold=1.0, srr=0.3, srt=0.3, str_=0.3, stt=0.3, scan_odometry_noise=1.0, ogain=0.5,
        xmin=-5.0, xmax=5.0, ymin=-5.0, ymax=5.0, match="hillclimb", iterations=0,
    )  # fmt: skip
    particles = ParticleFilter(parameters, np.random.default_rng(2), np.zeros(3))
    scans, histories = [beams_at(pose, beams=40) for pose in poses[::4]], [[] for _ in range(6)]
    for index, scan in enumerate(scans):
        if index:
            particles.move(se2.between(poses[4 * index - 4], poses[4 * index]))
        particles.update(index, scan)
        histories = [[*history, pose] for history, pose in zip(histories, particles.steps[-1].poses, strict=True)]
        histories = [histories[parent] for parent in particles._parents]
    assert sum(step.resampled for step in particles.steps) >= 5
    best = int(np.argmax(particles._weight_sums))
    indices, path = particles.best_path()
    assert indices.tolist() == list(range(10))
    np.testing.assert_array_equal(path, np.array(histories[best]))
    for k, history in enumerate(histories):
        alone = TiledMaps(1, parameters.delta, (-5.0, -5.0, 5.0, 5.0))
        for scan, pose in zip(scans, history, strict=True):
            alone.add_scan(pose.reshape(1, 3), scan.start, scan.ends, scan.hit)
        grids = alone.occupancy(0, 0.25, "map"), particles.maps.occupancy(k, 0.25, "map")
        np.testing.assert_array_equal(grids[0].cells, grids[1].cells)
        np.testing.assert_allclose(grids[0].origin, grids[1].origin)


def test_kld_follows_the_spread(monkeypatch):
    settings = {"particles": 200, "adaptive_particles": "kld", "min_particles": 7, "resampleThreshold": 1.0}
    for spread in (0.0, 0.1, 0.4, 30.0):
        particles = scripted(monkeypatch, [np.linspace(0, 9, 200)], **settings)
        beams = beams_at((0.0, 0.0, 0.0), beams=12)
        particles.update(0, beams)
        particles.poses = np.random.default_rng(5).normal(0, 1, (200, 3)) * np.array([spread, spread, 0.0])
        drawn = particles.poses[systematic_draw(np.full(200, 1 / 200), 200, 0.5)]
        distinct = len({tuple(np.floor(pose / particle_filter._KLD_BIN)) for pose in drawn})
        poses = particles.poses
        particles.update(1, beams)
        count, k = len(particles.poses), distinct - 1
        if spread == 0.0:
            assert count == 7
        elif spread == 30.0:
            assert count == 200
        else:
            # Wilson and Hilferty's approximation of the quantile of chi squared, as Fox uses it. Weights differ a
            # little, so the bins are not quite those of all particles.
            wanted = k / 0.1 * (1 - 2 / (9 * k) + math.sqrt(2 / (9 * k)) * 2.33) ** 3
            assert 7 <= count <= min(200, math.ceil(wanted))
        assert len(particles.maps.tables) == count
        assert {tuple(pose) for pose in particles.poses} <= {tuple(pose) for pose in poses}


def test_the_improved_proposal_is_the_product_of_match_and_motion(monkeypatch):
    """Quadratic likelihood times Gaussian motion: mean, covariance and normaliser are known in closed form."""
    count, spread = 3000, np.array([0.03, 0.02, 0.015])
    optimum, motion_sigma = np.array([0.02, -0.03, 0.01]), np.array([0.05, 0.05, 0.02])

    def sample(maps, points, directions, poses, offsets, settings):
        error = (poses[:, None] + offsets[None] - optimum) / spread
        return -0.5 * (error**2).sum(axis=-1)

    monkeypatch.setattr(particle_filter, "sample_likelihoods", sample)
    parameters = GmappingParameters(
        particles=1, proposal="improved", llsamplerange=0.12, llsamplestep=0.02, lasamplerange=0.06, lasamplestep=0.012,
        xmin=-1.0, xmax=1.0, ymin=-1.0, ymax=1.0,
    )  # fmt: skip
    particles = ParticleFilter(parameters, np.random.default_rng(4), np.zeros(3))
    particles._since_update = motion_sigma**2
    matched = optimum + 0.005  # where the scan match ended
    precision = spread**-2.0 + motion_sigma**-2.0
    mean, sigma = optimum * spread**-2.0 / precision, precision**-0.5
    drawn, beams = [], beams_at((0.0, 0.0, 0.0), beams=4)
    for _ in range(count // 200):
        particles.poses = np.tile(matched, (200, 1))
        logs = particles._draw_from_proposal(beams, np.zeros((200, 3)))
        drawn.append(particles.poses)
    drawn = np.concatenate(drawn)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=4 * sigma.max() / math.sqrt(count))
    np.testing.assert_allclose(np.cov(drawn.T), np.diag(sigma**2), atol=0.12 * sigma.max() ** 2)
    exponent = -0.5 * (optimum**2 / (spread**2 + motion_sigma**2)).sum()
    volume = 0.02 * 0.02 * 0.012
    expected = exponent + np.log(sigma * math.sqrt(2 * math.pi)).sum() - math.log(volume)
    np.testing.assert_allclose(logs, expected, atol=0.02)


def test_motion_noise_has_the_sigmas_of_the_model():
    model = MotionModel(0.1, 0.2, 0.3, 0.4)
    motion = np.array([0.5, -0.2, 0.3])
    expected = [
        0.1 * 0.5 + 0.3 * 0.3 + 0.3 * 0.1 * 0.2,
        0.1 * 0.2 + 0.3 * 0.3 + 0.3 * 0.1 * 0.5,
        0.4 * 0.3 + 0.2 * math.hypot(0.5, 0.2),
    ]
    np.testing.assert_allclose(model.sigmas(motion), expected)
    start = np.tile([1.0, 2.0, 3.0], (4000, 1))
    moved = model.sample(start, motion, np.random.default_rng(6))
    noise = se2.between(start, moved) - motion
    noise[:, 2] = se2.wrap_angle(noise[:, 2])
    np.testing.assert_allclose(noise.std(axis=0), expected, rtol=0.05)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_array_equal(model.sigmas(np.zeros(3)), 0.0)
    half = MotionModel.of(GmappingParameters(), 0.5)
    whole = MotionModel.of(GmappingParameters())
    np.testing.assert_allclose(2 * half.sigmas(motion), whole.sigmas(motion))


@pytest.mark.parametrize("proposal", ["scanmatch", "improved"])
@pytest.mark.parametrize("match", ["surface", "hillclimb"])
def test_every_way_of_matching_holds_a_drive_with_true_motions(proposal, match):
    _, poses = drive(60)
    parameters = GmappingParameters(
        particles=8, proposal=proposal, match=match, scan_odometry_noise=0.1, xmin=-5.0, xmax=5.0, ymin=-5.0, ymax=5.0
    )
    particles = ParticleFilter(parameters, np.random.default_rng(7), np.zeros(3))
    for index in range(0, 60, 6):
        if index:
            particles.move(se2.between(poses[index - 6], poses[index]))
        particles.update(index, beams_at(poses[index]))
    _, path = particles.best_path()
    errors = path - from_first(poses[::6])
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 0.1
    assert np.abs(se2.wrap_angle(errors[:, 2])).max() < 0.06
