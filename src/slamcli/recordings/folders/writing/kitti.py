# SPDX-License-Identifier: MIT
"""The text files of a KITTI odometry folder, and its images under their numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.formats.text_tables import format_stamp_s
from slamcli.formats.trajectories import write_kitti
from slamcli.geometry import se3
from slamcli.recordings.folders.writing.exported import Exported, ExportedCamera
from slamcli.trajectory import Trajectory, interpolate

_MOST_TURNED = 0.01
_TRUTH_GAP_NS = 50_000_000
"""How far a true pose may lie beyond the first or the last image."""


def finish(exported: Exported) -> None:
    """Number the images, and write ``times.txt``, ``calib.txt`` and ``poses.txt``."""
    stamps = _number_images(exported)
    (exported.root / "times.txt").write_text(
        "".join(f"{format_stamp_s(int(stamp))}\n" for stamp in stamps), encoding="utf-8", newline="\n"
    )
    lines = [line for camera in exported.cameras if (line := _projection(exported, camera))]
    if lines:
        (exported.root / "calib.txt").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    truth = exported.truth_of(exported.cameras[0])
    if truth is not None:
        _write_poses(exported, truth, stamps)


def _number_images(exported: Exported) -> NDArray[np.int64]:
    """Rename images to numbers that all cameras share; return the stamps of the first camera's, int64 (N,).

    A moment that some camera has no image of (within half a period) is left out with the images of the others.
    """
    first, *others = exported.cameras
    first.frames.sort()
    stamps = np.array([stamp for stamp, _ in first.frames], dtype=np.int64)
    half = float(np.median(np.diff(stamps))) / 2 if len(stamps) > 1 else 1e9
    taken = [np.arange(len(stamps))]
    whole = np.ones(len(stamps), dtype=bool)
    for camera in others:
        camera.frames.sort()
        partners = np.array([stamp for stamp, _ in camera.frames], dtype=np.int64)
        near = _nearest(partners, stamps)
        whole &= np.abs(partners[near] - stamps) < half if len(partners) else False
        first_use = np.zeros(len(stamps), dtype=bool)
        first_use[np.unique(near, return_index=True)[1]] = True
        whole &= first_use
        taken.append(near)
    for camera, near in zip(exported.cameras, taken, strict=True):
        folder = exported.root / camera.folder
        numbered = [f"{number:06d}.png" for number in range(int(whole.sum()))]
        names = [camera.frames[index][1] for index in near[whole]]
        for name, number in zip(names, numbered, strict=True):
            (folder / name).rename(folder / number)
        lost = len(camera.frames) - len(names)
        for _, name in camera.frames:
            (folder / name).unlink(missing_ok=True)
        if lost:
            exported.log.counts[f"{camera.folder}: images without a partner"] += lost
            exported.log.warn(f"{camera.folder}: {lost} images without a partner in the other cameras are left out")
    return stamps[whole]


def _nearest(stamps_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index of the stamp that is nearest to each wanted one, int64 (N,); zeros where there are none."""
    if len(stamps_ns) < 2:
        return np.zeros(len(wanted_ns), dtype=np.int64)
    after = np.clip(np.searchsorted(stamps_ns, wanted_ns), 1, len(stamps_ns) - 1)
    return after - (wanted_ns - stamps_ns[after - 1] <= stamps_ns[after] - wanted_ns)


def _projection(exported: Exported, camera: ExportedCamera) -> str:
    """Return the line of ``calib.txt`` of a camera, empty where it has no calibration."""
    model = camera.model
    if model is None:
        exported.log.warn(f"{camera.folder}: no calibration: calib.txt has no P{camera.folder[-1]}")
        return ""
    if np.any(model.distortion != 0):
        exported.log.warn(
            f"{camera.folder}: these images are distorted, those of KITTI are not: calib.txt holds their matrix alone"
        )
    T_camera_first = se3.inverse(camera.T_body_camera) @ exported.cameras[0].T_body_camera
    projection = np.array(model.projection)
    if np.abs(T_camera_first[:3, :3] - np.eye(3)).max() > _MOST_TURNED:
        exported.log.warn(f"{camera.folder}: the camera is turned against the first one: the images are not rectified")
    elif T_camera_first[:3, 3].any():
        shift = projection[:, :3] @ T_camera_first[:3, 3]
        projection[:, 3] = projection[:, 3] if np.allclose(shift, projection[:, 3], rtol=0, atol=1e-6) else shift
    return f"P{camera.folder[-1]}: " + " ".join(map(repr, projection.reshape(-1).tolist()))


def _write_poses(exported: Exported, truth: Trajectory, stamps_ns: NDArray[np.int64]) -> None:
    order = np.argsort(truth.stamps_ns, kind="stable")
    known = truth.stamps_ns[order]
    at = np.clip(np.searchsorted(known, stamps_ns), 0, max(len(known) - 1, 0))
    if len(known) and np.array_equal(known[at], stamps_ns):
        write_kitti(exported.root / "poses.txt", truth.select(order[at]))
        return
    covered = (
        len(known) > 1
        and len(stamps_ns) > 0
        and known[0] - _TRUTH_GAP_NS <= stamps_ns[0]
        and stamps_ns[-1] <= known[-1] + _TRUTH_GAP_NS
    )
    if covered:
        write_kitti(exported.root / "poses.txt", interpolate(truth, stamps_ns))
    else:
        exported.log.warn("poses.txt is left out: KITTI has a true pose of every image, and here some have none")
