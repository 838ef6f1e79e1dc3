# SPDX-License-Identifier: MIT
"""How lost frames are found again, on a 7-Scenes folder with true poses.

1. A map of every other frame; every eighth of the frames between is looked for in it, alone: by words, and by descriptors only.
2. A map of the first half; every fourth frame of the second half is looked for in it (much of it is not there).
3. The recording with 70 black frames after frame 120, in which the track is lost: maps, frames with a pose, error.

    python benchmarks/relocalisation.py ../shared/data/visual/redkitchen
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from slamcli.formats.vocabularies import load_vocabulary
from slamcli.measurements import CameraRig, Image, RgbdFrame
from slamcli.measurements.camera import CameraModel
from slamcli.orbslam3.frame_making import FrameMaker
from slamcli.orbslam3.frame_track import final_pose
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.orbslam3.places import Places
from slamcli.orbslam3.relocalisation import RelocalisationSettings
from slamcli.orbslam3.session import Session
from slamcli.orbslam3.settings import session_settings

K = np.array([[585.0, 0, 320], [0, 585, 240], [0, 0, 1]])
BLACK = -1


class Folder:
    """Frames and true poses of a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.count = len(list(folder.glob("*.color.*")))
        model = CameraModel(
            stamp_ns=0, frame_id="camera", width=640, height=480, distortion_model="plumb_bob", distortion=np.zeros(5),
            intrinsics=K, rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]),
        )  # fmt: skip
        self.rig, self.parameters = CameraRig(mode="rgbd", main=model), OrbSlam3Parameters()
        self.maker = FrameMaker(self.parameters, self.rig)

    def session(self) -> Session:
        settings = session_settings(self.parameters, self.rig, self.maker.camera, 0)
        return Session(self.maker.camera, self.maker.scales, settings, vocabulary=load_vocabulary())

    def frame(self, number: int, i: int):
        name = self.folder / f"frame-{max(i, 0):06d}"
        colour = cv2.imread(str(next(self.folder.glob(f"{name.name}.color.*"))))
        depth = cv2.imread(f"{name}.depth.png", cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000
        if i == BLACK:
            colour, depth = 0 * colour, 0 * depth
        stamp = round(number * 1e9 / 30)
        images = (Image(stamp_ns=stamp, frame_id="c", encoding=e, pixels=p) for e, p in (("bgr8", colour), ("depth", depth)))  # fmt: skip
        return self.maker.make(number, RgbdFrame(**dict(zip(("colour", "depth"), images, strict=True))))

    def pose(self, i: int) -> np.ndarray:
        return np.loadtxt(self.folder / f"frame-{i:06d}.pose.txt")


def look_for(folder: Folder, built: list[int], sought: list[int], what: str) -> None:
    session = folder.session()
    for number, i in enumerate(built):
        session.take(folder.frame(number, i))
    session.finish()
    origin = folder.pose(built[0])
    for how, vocabulary in (("words", load_vocabulary()), ("descriptors", None)):
        places = Places(vocabulary, None, RelocalisationSettings(), session.counts)
        places.learn(session.maps, 0)
        errors, seconds = [], 0.0
        for i in sought:
            frame = folder.frame(i, i)
            start = time.perf_counter()
            found = places.find(session.maps, 0, frame)
            seconds += time.perf_counter() - start
            if found.found:
                errors.append(np.linalg.norm((np.linalg.inv(folder.pose(i)) @ origin @ np.linalg.inv(found.T_camera_map))[:3, 3]))  # fmt: skip
        print(
            f"{what}, by {how}: {len(errors)} of {len(sought)} found, error median {np.median(errors):.3f} m, 95 % "
            f"{np.quantile(errors, 0.95):.3f} m, largest {np.max(errors):.3f} m; {1e3 * seconds / len(sought):.0f} ms a frame"
        )


def lose(folder: Folder) -> None:
    session, frames = folder.session(), [*range(120), *[BLACK] * 70, *range(120, folder.count)]
    for number, i in enumerate(frames):
        session.take(folder.frame(number, i))
    session.finish()
    numbers = [one.map_number for one in session.tracked]
    largest = max(sorted(set(numbers)), key=numbers.count)
    poses = session.maps[largest].poses_of_all()
    tracked = [one for one in session.tracked if one.map_number == largest and frames[one.number] != BLACK]
    found = np.array([np.linalg.inv(final_pose(session.maps[largest], poses, one, refine=True))[:3, 3] for one in tracked])  # fmt: skip
    true = np.array([folder.pose(frames[one.number])[:3, 3] for one in tracked])
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    rmse = np.sqrt(((b - a @ turn.T) ** 2).sum(axis=1).mean())
    print(f"70 black frames: {len(tracked)} of {folder.count} other frames in one map, ATE {rmse:.4f} m; {dict(session.counts)}")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = Folder(parser.parse_args().folder)
    look_for(folder, list(range(0, folder.count, 2)), list(range(1, folder.count, 8)), "between the frames of a map")
    half = folder.count // 2
    look_for(folder, list(range(half)), list(range(half, folder.count, 4)), "beyond the frames of a map")
    lose(folder)


if __name__ == "__main__":
    main()
