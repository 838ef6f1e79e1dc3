# SPDX-License-Identifier: MIT
"""How well vocabularies know places again, on a folder of frames with true poses (7-Scenes or TUM RGB-D layout).

For every n-th frame, all frames further away than a gap in time are ranked by the similarity of their bags of words. Reported: the
share of frames whose best-ranked frame shows the same place (within 0.4 m and 30 degrees), of those where such a frame exists;
mean average precision of the ranking; words and milliseconds for a frame.

    python benchmarks/places.py ../shared/data/visual/redkitchen [VOCABULARY...]

Without a vocabulary: slamcli's own, and one trained from the recording itself. Brute-force matching (mutual, at most 50 bits) ranks
for comparison.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from slamcli.formats.pictures import read_grey
from slamcli.formats.vocabularies import load_vocabulary, read_vocabulary
from slamcli.geometry import se3
from slamcli.vision.bag_of_words import bag_of_words
from slamcli.vision.keyframe_database import KeyframeDatabase
from slamcli.vision.matching import match_brute_force
from slamcli.vision.orb import OrbSettings, extract_orb
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary


def frames(folder: Path, every: int) -> tuple[list[Path], np.ndarray]:
    """Return every n-th picture and its true pose (4, 4)."""
    if not (folder / "rgb.txt").exists():
        names = sorted(folder.glob("*.color.*"))[::every]
        return names, np.array([np.loadtxt(str(name).split(".color")[0] + ".pose.txt") for name in names])
    lines = [line.split() for line in (folder / "rgb.txt").read_text().splitlines() if line and line[0] != "#"][::every]
    truth = np.loadtxt(folder / "groundtruth.txt")
    rows = [int(np.abs(truth[:, 0] - float(stamp)).argmin()) for stamp, _ in lines]
    poses = se3.from_position_quaternion(truth[rows, 1:4], truth[rows, 4:8])
    return [folder / name for _, name in lines], poses


def same_place(poses: np.ndarray, metres: float, degrees: float) -> np.ndarray:
    apart = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=2)
    cosines = (np.einsum("aji,bji->ab", poses[:, :3, :3], poses[:, :3, :3]) - 1) / 2
    return (apart < metres) & (np.degrees(np.arccos(np.clip(cosines, -1, 1))) < degrees)


def ranked(scores: np.ndarray, same: np.ndarray, gap: int) -> tuple[float, float, int]:
    """Return share of best-ranked frames that are right, mean average precision, and how many frames could be right."""
    first, precisions = [], []
    for i in range(len(scores)):
        others = np.flatnonzero(np.abs(np.arange(len(scores)) - i) > gap)
        good = same[i, others]
        if not good.any():
            continue
        order = np.argsort(-scores[i, others], kind="stable")
        hits = good[order]
        first.append(hits[0])
        precisions.append((np.cumsum(hits) / np.arange(1, len(hits) + 1))[hits].mean())
    return float(np.mean(first)), float(np.mean(precisions)), len(first)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("vocabularies", nargs="*")
    parser.add_argument("--every", type=int, default=3)
    parser.add_argument("--gap", type=int, default=30, help="frames of the recording on either side that are left out")
    parser.add_argument("--metres", type=float, default=0.4)
    parser.add_argument("--degrees", type=float, default=30.0)
    given = parser.parse_args()
    names, poses = frames(given.folder, given.every)
    if len(names) < 2:
        parser.error(
            f"{given.folder}: neither frame-*.color.* with poses (7-Scenes) nor rgb.txt with groundtruth.txt (TUM RGB-D)"
        )
    descriptors = [extract_orb(read_grey(name), OrbSettings()).features.descriptors for name in names]
    same, gap = same_place(poses, given.metres, given.degrees), given.gap // given.every
    trees = [("slamcli's own", load_vocabulary())] + [(Path(v).name, read_vocabulary(v)) for v in given.vocabularies]
    for depth in (4, 5):
        start = time.perf_counter()
        tree = train_vocabulary(descriptors, TrainingSettings(depth=depth))
        trees.append((f"this recording, 10^{depth} ({time.perf_counter() - start:.1f} s)", tree))
    for name, tree in trees:
        start = time.perf_counter()
        bags = [bag_of_words(tree, frame) for frame in descriptors]
        milliseconds = 1e3 * (time.perf_counter() - start) / len(bags)
        database = KeyframeDatabase(tree)
        for i, bag in enumerate(bags):
            database.add(i, bag)
        scores = np.array([database.scores(bag)[1] for bag in bags])
        right, precision, count = ranked(scores, same, gap)
        print(f"{name:40s} {tree.num_words:8d} words: first right {100 * right:5.1f} % of {count}, mAP {precision:.3f}, {milliseconds:.2f} ms")  # fmt: skip
    matches = np.zeros_like(scores)
    for i in range(len(names)):
        for j in range(i + gap + 1, len(names)):
            found = match_brute_force(descriptors[i], descriptors[j], max_distance=50, ratio=0.8)
            matches[i, j] = matches[j, i] = np.count_nonzero(found >= 0)
    right, precision, count = ranked(matches, same, gap)
    print(f"{'brute-force matches':40s} {'':14s}: first right {100 * right:5.1f} % of {count}, mAP {precision:.3f}")


if __name__ == "__main__":
    main()
