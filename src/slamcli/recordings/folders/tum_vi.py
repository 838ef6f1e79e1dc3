# SPDX-License-Identifier: MIT
"""TUM-VI (Schubert et al., IROS 2018), exported in the layout of EuRoC: ``mav0`` and, beside it, ``dso``.

Two fisheye cameras (Kannala-Brandt, ROS's equidistant) and an IMU whose frame is the body's. The calibration is Kalibr's,
``dso/camchain.yaml`` and ``dso/imu_config.yaml``; a ``sensor.yaml`` in a sensor's folder goes before it. True poses
(``mocap0``) are those of the IMU. Images are of 8 or of 16 bit.
"""

from __future__ import annotations

from pathlib import Path

from slamcli.recordings.folders import euroc
from slamcli.recordings.folders.layout import DataFolder, Layout, Reading
from slamcli.recordings.folders.sensor_files import SensorModel, read_camchain, read_sensor_yaml


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
    for path in sorted(euroc.base_folder(root).glob("*/sensor.yaml")):
        own = read_sensor_yaml(path, reading.damage)
        if own is not None:
            found[path.parent.name] = own
    return found


def _read(root: Path, reading: Reading) -> DataFolder:
    return euroc.read(root, reading, _calibrations)


LAYOUT = Layout(name="TUM-VI folder", signs="mav0/cam0/data.csv and dso/camchain.yaml", find=_find, read=_read)
