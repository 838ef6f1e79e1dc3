# SPDX-License-Identifier: MIT
"""EuRoC's V1_01: 145 s of samples at 200 Hz, corrected by the true poses once a second."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.geometry import quaternion
from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_alignment import AlignmentSettings, VisualPoses, align_inertial
from slamcli.posegraph.inertial_links import InertialStates, link_residuals, link_states

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
SEQUENCE = DATA / "visual" / "euroc_v101_start" / "mav0"
pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not SEQUENCE.exists(), reason=f"no {SEQUENCE}: set SLAMCLI_TEST_DATA"),
]
NOISE = ImuNoise(gyroscope=1.6968e-4)


def table(path):
    with path.open() as file:
        rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    return np.array([int(row[0]) for row in rows]), np.array([[float(v) for v in row[1:]] for row in rows])


@pytest.fixture(scope="module")
def sequence():
    stamps, values = table(SEQUENCE / "imu0" / "data.csv")
    samples = ImuSamples(stamps_ns=stamps, angular_rad_s=values[:, :3], acceleration_m_s2=values[:, 3:])
    at, rows = table(SEQUENCE / "state_groundtruth_estimate0" / "data.csv")
    at, rows = at[::20], rows[::20]
    states = InertialStates(
        rotations=quaternion.to_matrix(quaternion.normalise(rows[:, [4, 5, 6, 3]])), positions=rows[:, :3].copy(),
        velocities=rows[:, 7:10].copy(), biases=rows[:, 10:16].copy(),
    )  # fmt: skip
    poses = VisualPoses(
        stamps_ns=at[::2], rotations=states.rotations[::2], positions=states.positions[::2], T_camera_imu=np.eye(4)
    )
    settings = AlignmentSettings(fixed_scale=True, gravity_m_s2=9.81, position_sigma=1e-3, rotation_sigma_rad=1e-3)
    return samples, at, states, align_inertial(poses, samples, NOISE, settings)


def windows(sequence, gravity):
    """Errors (K, 9) of rotation, velocity and position after a second, and their covariance with the truth's own."""
    samples, at, states, _ = sequence
    n = np.arange(len(at))
    motions = preintegrate(samples, at[:-1], at[1:], states.biases[:-1], NOISE)
    links = link_states(n[:-1], n[1:], motions)
    out, first, second, _ = link_residuals(links, states, gravity)
    errors = np.linalg.solve(links.roots, out[:, :, None])[:, :9, 0]
    truth = np.diag(np.repeat([1.5e-3, 1e-3, 5e-3], 3) ** 2)  # its rotations wander by that much beside the gyroscope
    covariance = motions.covariances[:, :9, :9]
    for derivative in (first, second):
        by = np.linalg.solve(links.roots, derivative)[:, :9, :9]
        covariance = covariance + by @ truth @ by.transpose(0, 2, 1)
    return errors, np.sqrt(np.einsum("kii->ki", covariance))


def test_a_second_is_integrated_as_well_as_theory_allows(sequence):
    errors, sigmas = windows(sequence, sequence[3].gravity_map)
    assert len(errors) == 144
    size = np.sqrt((errors.reshape(-1, 3, 3) ** 2).sum(axis=2).mean(axis=0))
    assert size[0] < 2.5e-3  # rad; 2.2 mrad measured
    assert size[1] < 0.032  # m/s; 28 mm/s measured
    assert size[2] < 0.017  # m; 15 mm measured
    within = (np.abs(errors) < 3 * sigmas).reshape(-1, 3, 3).mean(axis=(0, 2))
    assert within.min() > 0.97


def test_gravity_and_biases_are_near_those_of_the_file(sequence):
    _, _, states, found = sequence
    assert np.degrees(np.arccos(-found.gravity_map[2] / 9.81)) < 0.3  # the file's poses are tilted by that
    np.testing.assert_allclose(found.biases[:3], states.biases[:, :3].mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(found.biases[3:], states.biases[:, 3:].mean(axis=0), atol=0.08)
    assert found.excitation_m_s2 > 0.2
