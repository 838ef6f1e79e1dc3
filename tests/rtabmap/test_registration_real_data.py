# SPDX-License-Identifier: MIT
"""Registration of real pairs: TUM fr3/cabinet, an image every 0.7 s."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from visual_worlds import error

from slamcli.measurements import CameraRig, Image, RgbdFrame
from slamcli.measurements.camera import CameraModel
from slamcli.rtabmap.feature_extraction import FeatureExtractor
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.settings import feature_settings, preparation_settings
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.visual_registration import register_visual
from slamcli.rtabmap.visual_settings import visual_settings
from slamcli.vision.preparation import Preparation

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
CABINET = DATA / "visual" / "fr3_cabinet"
K = np.array([[535.4, 0, 320.1], [0, 539.2, 247.6], [0, 0, 1]])
COUNT = 16

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not CABINET.is_dir(), reason=f"{CABINET} is not there"),
]


def rows(name):
    lines = (line.split() for line in (CABINET / name).read_text().splitlines() if not line.startswith("#"))
    return [(float(line[0]), line[1:]) for line in lines]


@pytest.fixture(scope="module")
def places():
    """The first places with their features, and the camera."""
    parameters = RtabmapParameters()
    parameters = replace(parameters, vis=replace(parameters.vis, feature_type=10))
    model = CameraModel(
        stamp_ns=0, frame_id="c", width=640, height=480, distortion_model="plumb_bob", distortion=np.zeros(5),
        intrinsics=K, rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]),
    )  # fmt: skip
    rig = CameraRig(mode="rgbd", main=model)
    preparation = Preparation(rig, preparation_settings(parameters, rig))
    extractor = FeatureExtractor(feature_settings(parameters), preparation)
    depths, truth = rows("depth.txt"), rows("groundtruth.txt")
    found = []
    for number, (stamp, (name,)) in enumerate(rows("rgb.txt")[:COUNT]):
        depth_name = min(depths, key=lambda row: abs(row[0] - stamp))[1][0]
        pose = np.array(min(truth, key=lambda row: abs(row[0] - stamp))[1], float)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
        depth = cv2.imread(str(CABINET / depth_name), cv2.IMREAD_UNCHANGED).astype(np.float32) / 5000
        colour = cv2.imread(str(CABINET / name))
        frame = RgbdFrame(
            colour=Image(stamp_ns=number, frame_id="c", encoding="bgr8", pixels=colour),
            depth=Image(stamp_ns=number, frame_id="c", encoding="depth", pixels=depth),
        )
        features = extractor.extract(preparation.prepare(frame))
        found.append(
            Signature(
                id=number + 1, map_id=0, stamp_ns=number, T_odom_base=T, features=features,
                points=extractor.camera.back_project(features.pixels, features.depth),
                word_ids=np.zeros(len(features), np.int64),
            )
        )  # fmt: skip
    return found, extractor.camera, visual_settings(parameters.vis, parameters.reg)


def registered(places, step):
    """Errors (m) and whether the covariance allows them, of pairs so many images apart."""
    nodes, camera, settings = places
    errors, squares = [], []
    for a, b in zip(nodes, nodes[step:], strict=False):
        found = register_visual(a, b, camera, np.eye(4), settings, seed=0)
        if found.T_a_b is None:
            continue
        wrong = error(found.T_a_b, np.linalg.inv(a.T_odom_base) @ b.T_odom_base)
        errors.append(np.linalg.norm(wrong[:3]))
        squares.append(wrong @ np.linalg.solve(found.covariance, wrong) / 6)
    return np.array(errors), np.array(squares)


def test_neighbours_are_registered(places):
    errors, squares = registered(places, 1)
    assert len(errors) == COUNT - 1
    assert np.median(errors) < 0.02
    assert np.median(squares) < 5.0


def test_wide_pairs_are_registered(places):
    errors, _ = registered(places, 2)
    assert len(errors) >= 8
    assert np.median(errors) < 0.05
