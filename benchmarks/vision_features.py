# SPDX-License-Identifier: MIT
"""Features on real images: how long they take, how well they are found again, how good the depths of a stereo pair are.

python benchmarks/vision_features.py DATA [--what times again stereo]

DATA is the folder `visual` with redkitchen (7-Scenes) and kitti06 (KITTI odometry). Times are CPU times of one thread, the least of 20 runs.

again   Key points with depth are moved into the next image (redkitchen: the next of 30; kitti06: the second next) by the true
        poses. `again` is the share with a key point of about the same scale within 2 pixels there; `matches` are those that
        descriptors alone find (mutual nearest, ratio 0.8) within 6 pixels of it, `error` their median distance, less an affine
        map of the image: what calibration and poses do not explain. The same for OpenCV's ORB.
stereo  Depths of kitti06 moved into the next frame, against the disparity found there; `wrong` are those that differ from
        OpenCV's semi-global matching by more than 3 pixels.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from slamcli.vision.features import Features
from slamcli.vision.matching import (
    best_descriptors,
    feature_grid,
    match_brute_force,
    match_by_words,
    match_epipolar,
    search_by_projection,
)
from slamcli.vision.orb import OrbSettings, extract_orb
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.stereo_matching import match_stereo


@dataclass(frozen=True)
class View:
    """An image, what is known of its depth (0: nothing), its camera's pose in the world, and the right image."""

    grey: np.ndarray
    depth: np.ndarray
    T_world_camera: np.ndarray
    right: np.ndarray | None = None


def grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"no image {path}")
    return image


def redkitchen(folder: Path, numbers: range) -> tuple[Pinhole, list[View]]:
    views = []
    for k in numbers:
        depth = cv2.imread(str(folder / f"frame-{k:06d}.depth.png"), cv2.IMREAD_UNCHANGED).astype(np.float32)
        depth[depth == 65535] = 0.0
        pose = np.loadtxt(folder / f"frame-{k:06d}.pose.txt")
        views.append(View(grey(folder / f"frame-{k:06d}.color.jpg"), depth / 1000.0, pose))
    return Pinhole(fx=585.0, fy=585.0, cx=320.0, cy=240.0, width=640, height=480), views


def kitti(folder: Path, numbers: range) -> tuple[Pinhole, list[View]]:
    projection = np.array((folder / "calib.txt").read_text().splitlines()[1].split()[1:], dtype=float).reshape(3, 4)
    poses = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    dense = cv2.StereoSGBM_create(0, 192, 5, 200, 800, 1, 0, 5, 100, 2)
    camera, views = None, []
    for k in numbers:
        left, right = (grey(folder / f"image_{side}" / f"{k:06d}.png") for side in (0, 1))
        if camera is None:
            f = float(projection[0, 0])
            centre = {"cx": float(projection[0, 2]), "cy": float(projection[1, 2])}
            size = {"width": left.shape[1], "height": left.shape[0]}
            camera = Pinhole(fx=f, fy=f, baseline_m=float(-projection[0, 3] / f), **centre, **size)
        disparity = dense.compute(left, right).astype(np.float32) / 16.0
        depth = np.where(disparity > 1.0, camera.bf / np.maximum(disparity, 1.0), 0.0)
        views.append(View(left, depth, np.vstack([poses[k], [0.0, 0.0, 0.0, 1.0]]), right))
    return camera, views


def opencv_orb(image: np.ndarray, number: int) -> Features:
    points, descriptors = cv2.ORB_create(nfeatures=number, edgeThreshold=19).detectAndCompute(image, None)
    pixels = np.array([point.pt for point in points])
    octaves = np.array([point.octave for point in points])
    angles = np.radians([point.angle for point in points])
    unknown = np.full(len(points), np.nan)
    return Features(
        pixels=pixels, octaves=octaves, angles=angles, responses=unknown, descriptors=descriptors, sigmas=1.2**octaves,
        right=unknown, depth=unknown, raw_pixels=pixels,
    )  # fmt: skip


def moved(camera: Pinhole, here: View, there: View, features: Features) -> tuple[np.ndarray, np.ndarray]:
    """Which features are seen in the other view, and where they must lie there."""
    x, y = np.rint(features.pixels).astype(int).T
    depth = here.depth[np.clip(y, 0, here.depth.shape[0] - 1), np.clip(x, 0, here.depth.shape[1] - 1)]
    T = np.linalg.inv(there.T_world_camera) @ here.T_world_camera
    rows = np.flatnonzero((depth > 0.0) & (depth < 60.0))
    points = camera.back_project(features.pixels[rows], depth[rows].astype(float)) @ T[:3, :3].T + T[:3, 3]
    rows, points = rows[points[:, 2] > 0.2], points[points[:, 2] > 0.2]
    pixels = camera.project(points)
    inside = ((pixels > 20.0) & (pixels < [camera.width - 20.0, camera.height - 20.0])).all(axis=1)
    rows, points, pixels = rows[inside], points[inside], pixels[inside]
    x, y = np.rint(pixels).astype(int).T
    seen = np.abs(there.depth[y, x] - points[:, 2]) < 0.05 * points[:, 2]
    return rows[seen], pixels[seen]


def found_again(camera: Pinhole, views: list[View], extract: Callable[[np.ndarray], Features]) -> str:
    features = [extract(view.grey) for view in views]
    shares, matches, errors = [], [], []
    for k in range(len(views) - 1):
        rows, pixels = moved(camera, views[k], views[k + 1], features[k])
        other = features[k + 1]
        far = np.linalg.norm(pixels[:, None] - other.pixels, axis=2)
        far[np.abs(features[k].octaves[rows, None] - other.octaves) > 1] = np.inf
        shares.append((far.min(axis=1) < 2.0).mean())
        found = match_brute_force(features[k].descriptors[rows], other.descriptors, max_distance=64, ratio=0.8)
        off = (pixels - other.pixels[found])[found >= 0]
        right = np.linalg.norm(off, axis=1) < 6.0
        matches.append(right.sum())
        design = np.column_stack([np.ones(right.sum()), pixels[found >= 0][right]])
        rest = off[right] - design @ np.linalg.lstsq(design, off[right], rcond=None)[0]
        errors.append(np.median(np.linalg.norm(rest, axis=1)))
    return f"again {100 * np.mean(shares):.1f} %  matches {np.mean(matches):.0f}  error {np.mean(errors):.3f} px"


def again(data: Path) -> None:
    rooms = {"redkitchen": (*redkitchen(data / "redkitchen", range(100, 130)), 1000)}
    rooms["kitti06"] = (*kitti(data / "kitti06", range(0, 51, 2)), 2000)
    for name, (camera, views, number) in rooms.items():
        ways: dict[str, Callable[[np.ndarray], Features]] = {
            "slamcli": lambda image, n=number: extract_orb(image, OrbSettings(num_features=n)).features,
            "slamcli, on pixels": lambda image, n=number: (
                extract_orb(image, OrbSettings(num_features=n, subpixel=False)).features
            ),
            "OpenCV": lambda image, n=number: opencv_orb(image, n),
        }
        for way, extract in ways.items():
            print(f"{name:11s} {way:19s} {found_again(camera, views, extract)}")


def stereo(data: Path) -> None:
    camera, views = kitti(data / "kitti06", range(51))
    for more in (1.0, 1.5, 2.0):
        frames, wrong = [], []
        for view in views:
            left = extract_orb(view.grey, OrbSettings(num_features=2000))
            right = extract_orb(view.right, OrbSettings(num_features=int(2000 * more)))
            columns, depth = match_stereo(left, right, camera)
            features = replace(left.features, right=columns, depth=depth)
            x, y = np.rint(features.pixels).astype(int).T
            dense = view.depth[y, x]
            both = (dense > 0.0) & np.isfinite(depth)
            wrong.append(np.abs(camera.bf / dense[both] - camera.bf / depth[both]) > 3.0)
            frames.append(features)
        errors, off = [], []
        for k in range(len(views) - 1):
            one, two = frames[k], frames[k + 1]
            T = np.linalg.inv(views[k + 1].T_world_camera) @ views[k].T_world_camera
            rows = np.flatnonzero(one.depth < 60.0)
            points = camera.back_project(one.pixels[rows], one.depth[rows]) @ T[:3, :3].T + T[:3, 3]
            rows, points = rows[points[:, 2] > 1.0], points[points[:, 2] > 1.0]
            octaves, pixels = one.octaves[rows], camera.project(points)
            found = search_by_projection(
                pixels, 4.0 * one.sigmas[rows], octaves - 1, octaves + 1, one.descriptors[rows], two,
                feature_grid(two, camera), np.isfinite(two.depth), max_distance=50, angles=one.angles[rows],
            )  # fmt: skip
            disparity = two.pixels[found, 0] - two.right[found]
            errors.append((disparity - camera.bf / points[:, 2])[found >= 0])
            off.append(np.linalg.norm(pixels - two.pixels[found], axis=1)[found >= 0])
        error = np.abs(np.concatenate(errors))
        known = np.mean([np.isfinite(frame.depth).sum() for frame in frames])
        print(
            f"kitti06, {more:.1f} x as many key points in the right image: depths {known:.0f} of 2000  matched {len(error) / 50:.0f}"
            f"  disparity: median error {np.median(error):.3f} px, 90 % {np.quantile(error, 0.9):.3f} px  reprojection: median "
            f"{np.median(np.concatenate(off)):.3f} px  wrong {100 * np.concatenate(wrong).mean():.1f} %"
        )


def least_ms(work: Callable[[], object]) -> float:
    work()
    seconds = []
    for _ in range(20):
        start = time.thread_time()
        work()
        seconds.append(time.thread_time() - start)
    return 1e3 * min(seconds)


def times(data: Path) -> None:
    cv2.setNumThreads(1)
    camera, (a, b) = redkitchen(data / "redkitchen", range(100, 102))
    one, two = (extract_orb(view.grey).features for view in (a, b))
    wide, (street,) = kitti(data / "kitti06", range(1))
    many = OrbSettings(num_features=2000)
    left, right = (extract_orb(image, many) for image in (street.grey, street.right))
    grid, free = feature_grid(two, camera), np.ones(len(two), dtype=bool)
    rng = np.random.default_rng(0)
    nodes_a, nodes_b = rng.integers(0, 100, len(one)), rng.integers(0, 100, len(two))
    points = np.tile(one.pixels, (2, 1))
    octaves = np.tile(one.octaves, 2)
    descriptors = np.tile(one.descriptors, (2, 1))
    T_b_a = np.eye(4)
    T_b_a[:3, 3] = (0.1, 0.02, 0.03)
    rows: dict[str, Callable[[], object]] = {
        f"extract_orb, {a.grey.shape[1]} x {a.grey.shape[0]}, 1000": lambda: extract_orb(a.grey),
        f"extract_orb, {street.grey.shape[1]} x {street.grey.shape[0]}, 2000": lambda: extract_orb(street.grey, many),
        "match_stereo, 2000 and 2000": lambda: match_stereo(left, right, wide),
        "feature_grid, 1000": lambda: feature_grid(two, camera),
        "search_by_projection, 2000 points, 15 px": lambda: search_by_projection(
            points, np.full(len(points), 15.0), octaves - 1, octaves + 1, descriptors, two, grid, free
        ),
        "match_brute_force, 1000 x 1000": lambda: match_brute_force(
            one.descriptors, two.descriptors, max_distance=64, ratio=0.8
        ),
        "match_by_words, 1000 x 1000, 100 nodes": lambda: match_by_words(
            one.descriptors, nodes_a, two.descriptors, nodes_b, max_distance=50, ratio=0.8
        ),
        "match_epipolar, 1000 x 1000, 100 nodes": lambda: match_epipolar(
            one, free[: len(one)], nodes_a, two, free, nodes_b, T_b_a, camera
        ),
        "match_epipolar, 1000 x 1000, along the lines": lambda: match_epipolar(
            one, free[: len(one)], None, two, free, None, T_b_a, camera
        ),
        "best_descriptors, 125 groups of 8": lambda: best_descriptors(one.descriptors, np.arange(0, 1001, 8)),
    }
    for name, work in rows.items():
        print(f"{name:46s} {least_ms(work):7.2f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    ways = {"times": times, "again": again, "stereo": stereo}
    parser.add_argument("--what", nargs="+", choices=tuple(ways), default=list(ways))
    arguments = parser.parse_args()
    for what in arguments.what:
        ways[what](arguments.data)


if __name__ == "__main__":
    main()
