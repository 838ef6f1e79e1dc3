# SPDX-License-Identifier: MIT
"""How well an IMU's samples say where it went within a second, against a sequence's truth and against theory.

python benchmarks/imu_preintegration.py FOLDER [--seconds 1.0]

FOLDER is a sequence of EuRoC (with mav0/imu0 and mav0/state_groundtruth_estimate0). Its samples are integrated from each
second of the truth to the next. Errors are divided by what theory says: the covariance of preintegration (IMU noise from
imu0/sensor.yaml), and that together with the uncertainty of the truth itself (--truth). Printed are root mean squares, the
mean normalised squared error per freedom (1 is as theory says, less is better), and the share within three deviations.

Three ways to begin each second:

file       velocity, biases and the vertical as they are in the file of the truth
vertical   the same, with gravity's direction estimated from the file's poses (they are tilted as a whole)
estimated  the same, with biases (one set for the whole sequence) and gravity's direction that inertial-only alignment finds
           from the file's poses, one a second
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from slamcli.geometry import quaternion
from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_preintegration import Preintegration, preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_alignment import AlignmentSettings, InertialAlignment, VisualPoses, align_inertial
from slamcli.posegraph.inertial_links import InertialStates, link_residuals, link_states

GRAVITY_M_S2 = 9.81
NAMES = ("rotation", "velocity", "position")
UNITS = ("mrad", "mm/s", "mm")


@dataclass(frozen=True)
class Sequence:
    """Samples and truth of a sequence."""

    samples: ImuSamples
    noise: ImuNoise
    stamps_ns: np.ndarray
    states: InertialStates


@dataclass(frozen=True)
class Windows:
    """Errors (K, 9) of rotation, velocity and position, with what theory says about them."""

    errors: np.ndarray
    imu: np.ndarray
    """(K, 9, 9), covariance of preintegration."""
    whole: np.ndarray
    """(K, 9, 9), with that of the states it begins and ends with."""


def read_sequence(folder: Path) -> Sequence:
    """Read a sequence of EuRoC."""
    imu, truth = folder / "mav0" / "imu0", folder / "mav0" / "state_groundtruth_estimate0"
    stamps, values = _table(imu / "data.csv")
    said = yaml.safe_load((imu / "sensor.yaml").read_text().replace("%YAML:1.0", ""))
    noise = ImuNoise(
        gyroscope=said["gyroscope_noise_density"], accelerometer=said["accelerometer_noise_density"],
        gyroscope_walk=said["gyroscope_random_walk"], accelerometer_walk=said["accelerometer_random_walk"],
        frequency_hz=said["rate_hz"],
    )  # fmt: skip
    at, rows = _table(truth / "data.csv")
    states = InertialStates(
        rotations=quaternion.to_matrix(quaternion.normalise(rows[:, [4, 5, 6, 3]])), positions=rows[:, :3].copy(),
        velocities=rows[:, 7:10].copy(), biases=rows[:, 10:16].copy(),
    )  # fmt: skip
    samples = ImuSamples(stamps_ns=stamps, angular_rad_s=values[:, :3].copy(), acceleration_m_s2=values[:, 3:].copy())
    return Sequence(samples, noise, at, states)


def _table(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with path.open() as file:
        rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    return np.array([int(row[0]) for row in rows]), np.array([[float(v) for v in row[1:]] for row in rows])


def every(sequence: Sequence, seconds: float) -> np.ndarray:
    """Return indices of the truth that lie `seconds` apart."""
    wanted = np.arange(sequence.stamps_ns[0], sequence.stamps_ns[-1] + 1, round(seconds * 1e9))
    return np.searchsorted(sequence.stamps_ns, wanted - 1_000_000)


def taken(states: InertialStates, chosen: np.ndarray) -> InertialStates:
    """Return some of the states."""
    names = ("rotations", "positions", "velocities", "biases")
    return InertialStates(**{name: getattr(states, name)[chosen] for name in names})


def aligned(sequence: Sequence, chosen: np.ndarray) -> InertialAlignment:
    """Return gravity in the truth's frame and biases, from its poses and the samples."""
    poses = VisualPoses(
        stamps_ns=sequence.stamps_ns[chosen], rotations=sequence.states.rotations[chosen],
        positions=sequence.states.positions[chosen], T_camera_imu=np.eye(4),
    )  # fmt: skip
    settings = AlignmentSettings(
        fixed_scale=True, gravity_m_s2=GRAVITY_M_S2, position_sigma=1e-3, rotation_sigma_rad=1e-3
    )
    return align_inertial(poses, sequence.samples, sequence.noise, settings)


def windows(
    sequence: Sequence, chosen: np.ndarray, gravity: np.ndarray, truth: np.ndarray, biases: np.ndarray | None = None
) -> Windows:
    """Integrate from each chosen state of the file to the next; `truth` (9,) deviations of its rotations, velocities and
    positions; `biases` (6,) to use instead of the file's."""
    states = taken(sequence.states, chosen)
    if biases is not None:
        states = replace(states, biases=np.tile(biases, (len(chosen), 1)))
    n, stamps = np.arange(len(chosen)), sequence.stamps_ns[chosen]
    motions = preintegrate(sequence.samples, stamps[:-1], stamps[1:], states.biases[:-1], sequence.noise)
    errors, first, second = _raw(motions, states, n, gravity)
    spread = np.diag(np.concatenate([truth[:3], truth[6:], truth[3:6]]) ** 2)  # in the order of the states
    imu = motions.covariances[:, :9, :9]
    whole = imu + sum(j[:, :, :9] @ spread @ j[:, :, :9].transpose(0, 2, 1) for j in (first, second))
    return Windows(errors, imu, whole)


def _raw(
    motions: Preintegration, states: InertialStates, n: np.ndarray, gravity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (K, 9) and derivatives (K, 9, 15) without weights."""
    links = link_states(n[:-1], n[1:], motions)
    out, first, second, _ = link_residuals(links, states, gravity)
    return tuple(
        np.linalg.solve(links.roots, v if v.ndim == 3 else v[:, :, None])[:, :9].squeeze() for v in (out, first, second)
    )


def summary(found: Windows) -> list[tuple[str, float, float, float, float, float]]:
    """Return per quantity: name, root mean square, and NEES per freedom and share within 3 sigma by both theories."""
    rows = []
    for i, name in enumerate(NAMES):
        at = slice(3 * i, 3 * i + 3)
        e = found.errors[:, at]
        judged = []
        for covariances in (found.imu, found.whole):
            c = covariances[:, at, at]
            judged.append(float(np.mean(np.einsum("ki,ki->k", e, np.linalg.solve(c, e[:, :, None])[:, :, 0])) / 3))
            judged.append(float(np.mean(np.abs(e) < 3 * np.sqrt(np.einsum("kii->ki", c)))))
        rows.append((name, float(np.sqrt((e**2).sum(axis=1).mean())), *judged))
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument(
        "--truth", type=float, nargs=3, default=(1.5, 5.0, 1.0), metavar=("MRAD", "MM_S", "MM"),
        help="deviations of the truth's rotations, velocities and positions, per axis",
    )  # fmt: skip
    given = parser.parse_args()
    sequence = read_sequence(given.folder)
    chosen = every(sequence, given.seconds)
    truth = np.repeat(np.array(given.truth) * 1e-3, 3)
    down = np.array([0.0, 0.0, -GRAVITY_M_S2])
    found = aligned(sequence, every(sequence, 1.0))
    tilt = np.degrees(np.arccos(found.gravity_map @ down / GRAVITY_M_S2**2))
    print(f"{len(chosen) - 1} windows of {given.seconds} s, {len(sequence.samples)} samples")
    print(f"gravity stands {tilt:.2f} degrees off the truth's z axis; biases {np.round(found.biases, 4)}")
    print("begin     what        rms          NEES/dof  in 3 sigma | with the truth's own: NEES/dof  in 3 sigma")
    for name, result in (
        ("file", windows(sequence, chosen, down, truth)),
        ("vertical", windows(sequence, chosen, found.gravity_map, truth)),
        ("estimated", windows(sequence, chosen, found.gravity_map, truth, found.biases)),
    ):
        for (what, rms, alone, inside, both, within), unit in zip(summary(result), UNITS, strict=True):
            print(
                f"{name:9} {what:9} {1e3 * rms:7.2f} {unit:5} {alone:10.1f} {inside:10.1%} | {both:30.2f} {within:10.1%}"
            )


if __name__ == "__main__":
    main()
