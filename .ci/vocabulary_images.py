# SPDX-License-Identifier: MIT
"""The pictures that slamcli's own vocabulary is learnt from; see docs/vocabulary.md.

Views of rooms whose walls, floor and boards are papered with photographs that anyone may use: public domain or CC0, out of the
wheel of scikit-image.

    python .ci/vocabulary_images.py FOLDER        (fetches the wheel with pip, writes 600 pictures)
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import cv2
import numpy as np

WHEEL = "scikit-image==0.26.0"
# File under skimage/data/ and what scikit-image's documentation says of its licence.
PHOTOGRAPHS = {
    "astronaut.png": "public domain (NASA)",
    "brick.png": "CC0 (cc0textures.com)",
    "camera.png": "CC0 (Lav Varshney)",
    "chelsea.png": "CC0 (Stefan van der Walt)",
    "clock_motion.png": "public domain (Stefan van der Walt)",
    "coffee.png": "CC0 (Rachel Michetti)",
    "grass.png": "CC0 (linolafett)",
    "gravel.png": "CC0 (cc0textures.com)",
    "hubble_deep_field.jpg": "public domain (NASA)",
    "retina.jpg": "CC0 (Mikael Häggström)",
    "rocket.jpg": "public domain (SpaceX)",
    "text.png": "public domain (Wikimedia)",
}
COUNT, WIDTH, HEIGHT = 600, 640, 480


def photographs() -> list[np.ndarray]:
    """Return the photographs as grey levels, in the order of their names."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:", "-d", folder, WHEEL],
            check=True,
        )
        with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as wheel:
            raw = [np.frombuffer(wheel.read(f"skimage/data/{name}"), np.uint8) for name in sorted(PHOTOGRAPHS)]
    return [cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) for data in raw]


def scene(photos: list[np.ndarray], generator: np.random.Generator) -> np.ndarray:
    """Return one view: a papered background, boards with photographs before it, plain furniture, and a camera's faults."""
    image = np.full((HEIGHT, WIDTH), float(generator.uniform(40, 200)), np.float32)
    for _ in range(int(generator.integers(1, 3))):
        hang(image, photos[int(generator.integers(len(photos)))], generator, 500, 900)
    for _ in range(int(generator.integers(4, 9))):
        if generator.random() < 0.3:
            furnish(image, generator)
        else:
            hang(image, photos[int(generator.integers(len(photos)))], generator, 120, 420)
    image = cv2.GaussianBlur(image, (0, 0), float(generator.uniform(0.3, 1.1)))
    image = 255.0 * (np.clip(image, 0, 255) / 255.0) ** generator.uniform(0.7, 1.4)
    return np.clip(image + generator.normal(0, generator.uniform(0, 4), image.shape), 0, 255).astype(np.uint8)


def hang(image: np.ndarray, photo: np.ndarray, generator: np.random.Generator, smallest: float, largest: float) -> None:
    """Draw a photograph as a board somewhere in the view, turned and in perspective."""
    height, width = photo.shape
    size = generator.uniform(smallest, largest)
    angle = generator.normal(0, 0.15) if generator.random() < 0.8 else generator.uniform(-np.pi, np.pi)
    centre = generator.uniform((0, 0), (WIDTH, HEIGHT))
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([width, height]) / max(width, height) * size / 2
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    target = box @ turn.T * generator.uniform(0.6, 1.0, 2) + centre + generator.normal(0, 0.06 * size, (4, 2))
    source = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    H = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    small = cv2.GaussianBlur(photo, (0, 0), max(0.1, 0.5 * max(width, height) / size)).astype(np.float32)
    gain, offset = generator.uniform(0.6, 1.1), generator.uniform(-15, 25)
    board = cv2.warpPerspective(gain * small + offset, H, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
    inside = cv2.warpPerspective(np.ones_like(photo), H, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST) > 0
    image[inside] = board[inside]


def furnish(image: np.ndarray, generator: np.random.Generator) -> None:
    """Draw a plain shape with edges: a shelf, a frame, a cable."""
    corners = generator.uniform((0, 0), (WIDTH, HEIGHT)) + generator.normal(0, 90, (int(generator.integers(3, 6)), 2))
    hull = cv2.convexHull(corners.astype(np.int32))
    cv2.fillPoly(image, [hull], float(generator.uniform(10, 245)), cv2.LINE_AA)
    for _ in range(int(generator.integers(1, 6))):
        ends = generator.uniform((0, 0), (WIDTH, HEIGHT), (2, 2)).astype(int)
        cv2.line(image, ends[0].tolist(), ends[1].tolist(), float(generator.uniform(0, 255)), int(generator.integers(1, 6)), cv2.LINE_AA)  # fmt: skip


def main() -> None:
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    photos, generator = photographs(), np.random.default_rng(0)
    for i in range(COUNT):
        cv2.imwrite(str(target / f"{i:04d}.png"), scene(photos, generator))
    print(f"{COUNT} pictures of {len(photos)} photographs in {target}")


if __name__ == "__main__":
    main()
