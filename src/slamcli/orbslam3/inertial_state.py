# SPDX-License-Identifier: MIT
"""What is known about an IMU along a map: gravity, and velocities and biases of its keyframes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.measurements import ImuNoise
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.posegraph.imu_samples import ImuBuffer

Floats = NDArray[np.float64]


@dataclass(kw_only=True)
class Imu:
    """An IMU as it is mounted, with its samples so far."""

    T_camera_imu: Floats
    """float64 (4, 4), metres."""
    given_noise: ImuNoise
    fixed_scale: bool
    """Whether the cameras measure depth: then a map's units are metres from the beginning."""
    buffer: ImuBuffer = field(default_factory=ImuBuffer)

    @cached_property
    def noise(self) -> ImuNoise:
        """Its noise, with the rate at which samples really come; first asked for when there are some."""
        stamps = self.buffer.samples().stamps_ns
        usual = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 5e6
        return replace(self.given_noise, frequency_hz=1e9 / usual)


class MapInertia:
    """Velocities and biases of the keyframes of one map."""

    def __init__(self) -> None:
        self.gravity_map: Floats | None = None
        """float64 (3,), m/s^2, pointing down; None until the map is aligned."""
        self.began_ns = 0
        """Stamp of the keyframe with which it was aligned."""
        self.adjusted = 0
        """How often the whole map was adjusted since."""
        self.objection = "not enough motion: there are too few keyframes"
        """Why it is not aligned yet."""
        self.version = 0
        """`SparseMap.version` that the velocities belong to."""
        self._known = np.zeros(0, np.bool_)
        self._values = np.zeros((0, 9))
        self._turns = np.zeros((0, 3, 3))

    @property
    def gravity(self) -> Floats:
        """The same, where it must be known.

        Raises
        ------
        EstimationError
            If it is not.
        """
        if self.gravity_map is None:
            raise EstimationError("the map is not aligned with the IMU: " + self.objection)
        return self.gravity_map

    def known(self, sparse_map: SparseMap) -> Ids:
        """Return the living keyframes with velocity and biases, in the order of time."""
        self._grow(sparse_map.num_keyframes)
        found = np.flatnonzero(self._known & sparse_map.keyframe_alive)
        return found[np.argsort(sparse_map.stamp_ns[found], kind="stable")]

    def velocities(self, keyframes: Ids) -> Floats:
        """Return float64 (N, 3), m/s in the map."""
        return self._values[keyframes, :3].copy()

    def biases(self, keyframes: Ids) -> Floats:
        """Return float64 (N, 6), gyroscope and accelerometer."""
        return self._values[keyframes, 3:].copy()

    def columns(self, keyframes: Ids) -> tuple[Floats, Floats]:
        """Return velocities with biases (N, 9), and rotations T_camera_map[:3, :3] (N, 3, 3) that the velocities belong to."""
        return self._values[keyframes], self._turns[keyframes]

    def set(self, sparse_map: SparseMap, keyframes: Ids, velocities: Floats, biases: Floats) -> None:
        """Write what is known about keyframes (N,)."""
        self._grow(sparse_map.num_keyframes)
        self._known[keyframes] = True
        self._values[keyframes, :3], self._values[keyframes, 3:] = velocities, biases
        self._turns[keyframes] = sparse_map.T_camera_map[keyframes, :3, :3]

    def follow(self, sparse_map: SparseMap) -> None:
        """Turn velocities along where keyframes were turned by more than local mapping does (loops)."""
        if sparse_map.version == self.version:
            return
        self.version = sparse_map.version
        known = self.known(sparse_map)
        turns = sparse_map.T_camera_map[known, :3, :3].transpose(0, 2, 1) @ self._turns[known]
        self._values[known, :3] = np.einsum("kij,kj->ki", turns, self._values[known, :3])
        self._turns[known] = sparse_map.T_camera_map[known, :3, :3]

    def complete(self, sparse_map: SparseMap, keyframes: Ids, imu: Imu) -> None:
        """Give `keyframes` that have none the velocities of their positions, and the biases of the nearest one in time."""
        known = self.known(sparse_map)
        fresh = np.setdiff1d(keyframes, known)
        if not len(fresh) or not len(known):
            return
        order = keyframes[np.argsort(sparse_map.stamp_ns[keyframes], kind="stable")]
        T, stamps = sparse_map.T_camera_map[order], sparse_map.stamp_ns[order]
        places = np.einsum("kji,kj->ki", T[:, :3, :3], imu.T_camera_imu[:3, 3] - T[:, :3, 3])
        speeds = np.gradient(places, stamps * 1e-9, axis=0) if len(order) > 1 else np.zeros((1, 3))
        nearest = np.abs(sparse_map.stamp_ns[fresh][:, None] - sparse_map.stamp_ns[known]).argmin(axis=1)
        at = np.array([int(np.flatnonzero(order == k)[0]) for k in fresh.tolist()])
        self.set(sparse_map, fresh, speeds[at], self.biases(known[nearest]))

    def joined(
        self, newer: MapInertia, old_map: SparseMap, newer_map: SparseMap, merged: SparseMap, offset: int, *,
        fixed_scale: bool,
    ) -> MapInertia:  # fmt: skip
        """Return what is known along the map that two became: keyframes of this one first, then, from `offset` on, the newer's.

        A map whose metre was unknown gives its scale to the whole: then nothing is known until that is aligned again.
        """
        out = MapInertia()
        out.version = -1  # velocities turn along with the keyframes when they are next asked for
        out._grow(merged.num_keyframes)
        if self.gravity_map is None and not (fixed_scale and newer.gravity_map is not None):
            return out
        for part, begin, source in ((self, 0, old_map), (newer, offset, newer_map)):
            known = part.known(source)
            out._known[known + begin] = True
            out._values[known + begin], out._turns[known + begin] = part.columns(known)
        out.gravity_map, out.began_ns, out.adjusted = self.gravity_map, self.began_ns, self.adjusted
        if self.gravity_map is None:
            k = int(newer.known(newer_map)[0])
            turn = merged.T_camera_map[k + offset, :3, :3].T @ newer_map.T_camera_map[k, :3, :3]
            out.gravity_map, out.began_ns, out.adjusted = turn @ newer.gravity, newer.began_ns, newer.adjusted
        return out

    def _grow(self, count: int) -> None:
        more = count - len(self._known)
        if more > 0:
            self._known = np.concatenate([self._known, np.zeros(more, np.bool_)])
            self._values = np.concatenate([self._values, np.zeros((more, 9))])
            self._turns = np.concatenate([self._turns, np.tile(np.eye(3), (more, 1, 1))])
