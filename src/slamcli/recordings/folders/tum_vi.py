# SPDX-License-Identifier: MIT
"""TUM-VI (Schubert et al., IROS 2018), exported in the layout of EuRoC: ``mav0`` and, beside it, ``dso``.

Two fisheye cameras (Kannala-Brandt, ROS's equidistant) and an IMU whose frame is the body's. The calibration is Kalibr's,
``dso/camchain.yaml`` and ``dso/imu_config.yaml``; a ``sensor.yaml`` in a sensor's folder goes before it. Where there is
neither, DSO's ``dso/cam0/camera.txt`` says the lens, but not where the camera sits. True poses (``mocap0``) are those of
the IMU. Images are of 8 or of 16 bit.
"""

from __future__ import annotations

from pathlib import Path

from slamcli.measurements import CameraModel
from slamcli.recordings.folders import euroc
from slamcli.recordings.folders.camera_models import pinhole
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.sensor_files import SensorModel, read_camchain, read_sensor_yaml

_DSO_FISHEYES = ("EquiDistant", "KannalaBrandt")


def _chain(root: Path) -> Path | None:
    """Return Kalibr's file of the cameras, None if there is none."""
    folders = (root / "dso", root, euroc.base_folder(root))
    return next((path for folder in folders for path in sorted(folder.glob("*camchain*.yaml"))), None)


def _find(folder: Path) -> Path | None:
    found = euroc.find(folder)
    base = euroc.base_folder(folder)
    return found if found and ((base / "mocap0").is_dir() or (folder / "dso").is_dir() or _chain(folder)) else None


def _calibrations(root: Path, reading: Reading) -> dict[str, SensorModel]:
    chain = _chain(root)
    found: dict[str, SensorModel] = {}
    if chain is not None:
        noise = next((path for path in sorted(chain.parent.glob("imu*.yaml"))), None)
        found = read_camchain(chain, noise, reading.damage)
    for path in sorted((root / "dso").glob("cam*/camera.txt")):
        camera = None if path.parent.name in found else _dso_camera(path, reading)
        if camera is not None:
            found[path.parent.name] = SensorModel(camera=camera)
    for path in sorted(euroc.base_folder(root).glob("*/sensor.yaml")):
        own = read_sensor_yaml(path, reading.damage)
        if own is not None:
            found[path.parent.name] = own
    return found


def _dso_camera(path: Path, reading: Reading) -> CameraModel | None:
    """Return the fisheye camera in a calibration of DSO; None, which is told, if it is none.

    The first line names the model, fx, fy, cx, cy and four coefficients, the second width and height. Where the centre is
    below 1 the first four are shares of width and height, counted from the corner of the first pixel.
    """
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
        name, *words = lines[0].split()
        fx, fy, cx, cy, *coefficients = (float(word) for word in words)
        width, height = (int(word) for word in lines[1].split())
    except (OSError, ValueError, IndexError):
        name, coefficients = "", []
    if name not in _DSO_FISHEYES or len(coefficients) != 4 or not (fx > 0 and fy > 0 and width > 0 and height > 0):
        reading.damage.add(f"{path}: no fisheye camera as DSO writes it ({', '.join(_DSO_FISHEYES)})")
        return None
    if cx < 1 and cy < 1:
        fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
    reading.remark(
        f"calibration: {path.parent.name} is that of DSO's camera.txt, which does not say where it sits (--camera)"
    )
    return pinhole(path.parent.name, (width, height), (fx, fy, cx, cy), coefficients, "equidistant")


def _read(root: Path, reading: Reading) -> DataFolder:
    return euroc.read(root, reading, _calibrations)


LAYOUT = Layout(name="TUM-VI folder", signs="mav0/cam0/data.csv and dso/camchain.yaml", find=_find, read=_read)
