# SPDX-License-Identifier: MIT
"""A sequence of poses of one frame in another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import DataError
from slamcli.geometry import quaternion, se3


def seconds(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return nanoseconds as the nearest float64 seconds, (N,).

    Dividing today's stamps by 1e9 would round twice: they have more digits than a double holds.
    """
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    whole, rest = np.divmod(stamps, 1_000_000_000)
    return np.where(np.abs(stamps) < 2**53, stamps / 1e9, whole + rest / 1e9)


_FARTHEST_M = 1e15  # squares of differences stay exact enough and finite


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses ``T_frame_child`` in the order in which they were recorded; stamps may run backwards where a clock did."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), nanoseconds."""
    positions_m: NDArray[np.float64]
    """float64 (N, 3), metres."""
    quats_xyzw: NDArray[np.float64]
    """float64 (N, 4), unit quaternions, to the digits that a file gave them."""
    frame_id: str = ""
    child_frame_id: str = ""
    matrices: NDArray[np.float64] | None = None
    """float64 (N, 4, 4), ``T_frame_child`` where the source has matrices (KITTI), with their own rounding."""
    timed: bool = True
    """Whether `stamps_ns` are times; False where they only count poses (KITTI without a times file)."""
    source: str = ""
    """Where it was read from, for messages."""

    def __post_init__(self) -> None:
        n = len(self.stamps_ns)
        if self.stamps_ns.shape != (n,) or self.positions_m.shape != (n, 3) or self.quats_xyzw.shape != (n, 4):
            raise DataError(
                f"trajectory: {self.stamps_ns.shape} stamps, {self.positions_m.shape} positions, {self.quats_xyzw.shape} orientations"
            )
        if self.matrices is not None and self.matrices.shape != (n, 4, 4):
            raise DataError(f"trajectory: {n} poses, but matrices {self.matrices.shape}")
        if not (np.isfinite(self.positions_m).all() and np.isfinite(self.quats_xyzw).all()):
            raise DataError("trajectory: a pose is not finite")
        if n and np.abs(self.positions_m).max() > _FARTHEST_M:
            raise DataError(f"trajectory: a position is farther away than {_FARTHEST_M:g} m")

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @classmethod
    def from_se2(
        cls, stamps_ns: ArrayLike, poses: ArrayLike, frame_id: str = "", child_frame_id: str = ""
    ) -> Trajectory:
        """Build from planar poses (N, 3) x, y, yaw."""
        poses = np.asarray(poses, dtype=np.float64).reshape(-1, 3)
        positions = np.column_stack([poses[:, :2], np.zeros(len(poses))])
        return cls(
            np.asarray(stamps_ns, dtype=np.int64), positions, quaternion.from_yaw(poses[:, 2]), frame_id, child_frame_id
        )

    @property
    def poses_se2(self) -> NDArray[np.float64]:
        """float64 (N, 3), the planar part x, y, yaw."""
        return np.column_stack([self.positions_m[:, :2], quaternion.yaw(self.quats_xyzw)])

    @property
    def transforms(self) -> NDArray[np.float64]:
        """float64 (N, 4, 4), ``T_frame_child``; orientations are brought to length one."""
        if self.matrices is not None:
            return self.matrices
        return se3.from_position_quaternion(self.positions_m, quaternion.normalise(self.quats_xyzw))

    @property
    def stamps_s(self) -> NDArray[np.float64]:
        """float64 (N,), seconds (about 1e-7 s exact for today's epoch: use `stamps_ns` to compare).

        The double nearest to the decimal number, as a parser of a text file would give it.
        """
        return seconds(self.stamps_ns)

    @property
    def length_m(self) -> float:
        """Length of the path in metres."""
        return float(np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1).sum())

    def select(self, rows: ArrayLike) -> Trajectory:
        """Return the poses at the given indices (or where a mask is true), in that order."""
        rows = np.asarray(rows)
        return replace(
            self,
            stamps_ns=self.stamps_ns[rows],
            positions_m=self.positions_m[rows],
            quats_xyzw=self.quats_xyzw[rows],
            matrices=None if self.matrices is None else self.matrices[rows],
        )
