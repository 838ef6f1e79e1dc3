# SPDX-License-Identifier: MIT
"""The text files of a TUM RGB-D folder."""

from __future__ import annotations

import yaml

from slamcli.formats.text_tables import format_stamp_s
from slamcli.formats.trajectories import write_tum
from slamcli.measurements import CameraModel
from slamcli.recordings.folders.tum import CALIBRATION
from slamcli.recordings.folders.writing.exported import Exported, ExportedCamera

_TITLES = {"rgb": "color images", "depth": "depth maps"}


def finish(exported: Exported) -> None:
    """Write ``rgb.txt``, ``depth.txt``, ``groundtruth.txt`` and ``camera_info.yaml`` (ROS's camera_calibration)."""
    colour = exported.cameras[0]
    for camera in filter(None, (colour, exported.depth)):
        _write_list(exported, camera)
    if colour.model is not None:
        text = yaml.safe_dump(_document(colour.model), sort_keys=False, default_flow_style=None, width=120)
        (exported.root / CALIBRATION).write_text(text, encoding="utf-8", newline="\n")
    truth = exported.truth_of(colour)
    if truth is not None:
        write_tum(exported.root / "groundtruth.txt", truth)


def _write_list(exported: Exported, camera: ExportedCamera) -> None:
    lines = [f"# {_TITLES[camera.folder]}", "# timestamp filename"]
    lines += [f"{format_stamp_s(stamp)} {camera.folder}/{name}" for stamp, name in sorted(camera.frames)]
    (exported.root / f"{camera.folder}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _document(model: CameraModel) -> dict[str, object]:
    def matrix(values: object, rows: int, columns: int) -> dict[str, object]:
        return {"rows": rows, "cols": columns, "data": values}

    return {
        "image_width": model.width,
        "image_height": model.height,
        "camera_name": model.frame_id,
        "camera_matrix": matrix(model.intrinsics.reshape(-1).tolist(), 3, 3),
        "distortion_model": model.distortion_model or "plumb_bob",
        "distortion_coefficients": matrix(model.distortion.tolist(), 1, len(model.distortion)),
        "rectification_matrix": matrix(model.rectification.reshape(-1).tolist(), 3, 3),
        "projection_matrix": matrix(model.projection.reshape(-1).tolist(), 3, 4),
    }
