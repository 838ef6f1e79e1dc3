# SPDX-License-Identifier: MIT
"""``slamcli vocabulary``: train one from pictures or recordings, and say what is in one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError, UsageError
from slamcli.formats.pictures import SUFFIXES, pictures_in, read_grey
from slamcli.formats.vocabularies import read_vocabulary, write_vocabulary
from slamcli.measurements import Image
from slamcli.outputs import check_file
from slamcli.pipelines.output_record import write_output_record
from slamcli.recordings.recording import Recording, open_recording
from slamcli.runtime import RunLog
from slamcli.vision.orb import OrbSettings, extract_orb
from slamcli.vision.vocabulary import Vocabulary
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRequest:
    """What to train a vocabulary from."""

    sources: tuple[Path, ...]
    """Pictures, folders of pictures, recordings."""
    settings: TrainingSettings
    num_features: int = 1000
    """Per image."""
    max_images: int = 400
    """Per source, evenly spread over it."""
    topic: str | None = None
    """Of the images, in recordings; None: the first that is not depth."""


def train(request: TrainingRequest, target: Path, *, log: RunLog) -> dict[str, Any]:
    """Train a vocabulary and write it; return what came of it.

    Raises
    ------
    InputError
        If a source holds no images, or they hold too few features.
    """
    check_file(target)
    descriptors: list[NDArray[np.uint8]] = []
    for source in request.sources:
        with log.stage(f"features of {source.name}"):
            descriptors.extend(descriptors_of(source, request))
    with log.stage("training"):
        tree = train_vocabulary(descriptors, request.settings)
    write_vocabulary(tree, target)
    document = {"images": len(descriptors), "features": sum(map(len, descriptors)), **facts(tree)}
    write_output_record(
        [target], command="vocabulary train", inputs=request.sources, changed={}, summary=document, log=log,
        parameters={**asdict(request.settings), "features": request.num_features, "max_images": request.max_images},
    )  # fmt: skip
    return {**document, "output": str(target), "size_bytes": target.stat().st_size}


def inspect(source: Path) -> dict[str, Any]:
    """Return what is in the file of a vocabulary.

    Raises
    ------
    FormatError
        If it cannot be read.
    """
    return {"file": str(source), "size_bytes": _size(source), **facts(read_vocabulary(source))}


def facts(tree: Vocabulary) -> dict[str, Any]:
    """Return the figures of a vocabulary by name."""
    weights = tree.weights[tree.num_children == 0]
    return {
        "branching": tree.branching, "levels": tree.depth, "nodes": len(tree.levels), "words": tree.num_words,
        "words_without_weight": int(np.count_nonzero(weights == 0.0)), "weighting": tree.weighting,
        "weights": [float(weights.min()), float(weights.max())],
        "matching_nodes": int(np.count_nonzero(tree.levels == tree.matching_level)),
    }  # fmt: skip


def descriptors_of(source: Path, request: TrainingRequest) -> Iterator[NDArray[np.uint8]]:
    """Yield the descriptors, uint8 (N, 32), of a source's images.

    Raises
    ------
    InputError
        If there are none.
    """
    settings = OrbSettings(num_features=request.num_features)
    for grey in _images(source, request):
        yield extract_orb(grey, settings).features.descriptors


def _images(source: Path, request: TrainingRequest) -> Iterator[NDArray[np.uint8]]:
    if source.is_file() and source.suffix.lower() in SUFFIXES:
        yield read_grey(source)
        return
    try:
        recording = open_recording(source)
    except RecordingError as error:
        if not source.is_dir():
            raise
        paths = pictures_in(source)
        if not paths:
            raise UsageError(f"{source}: neither a recording nor a folder with pictures in it") from error
        for path in paths[:: _stride(len(paths), request.max_images)]:
            yield read_grey(path)
        return
    with recording:
        yield from _recorded(recording, request)


def _recorded(recording: Recording, request: TrainingRequest) -> Iterator[NDArray[np.uint8]]:
    topic = recording.topic(request.topic, Image) if request.topic else _camera(recording)
    stride = _stride(topic.count or 1, request.max_images)
    for i, image in enumerate(recording.measurements([topic])):
        if i % stride == 0:
            yield _grey(image)


def _camera(recording: Recording) -> Any:
    """Return the first topic whose images are not depth."""
    for topic in recording.topics(Image):
        if not topic.count:
            continue
        with closing(recording.measurements([topic])) as images:  # type: ignore[type-var]
            first = next(iter(images), None)
        if first is not None and first.encoding != "depth":
            return topic
    raise UsageError(f"{recording.name}: there are no camera images in it to learn from")


def _grey(image: Image) -> NDArray[np.uint8]:
    """Return the grey levels of an image; weights after ITU-R BT.601, as OpenCV's."""
    if image.encoding == "depth":
        raise UsageError(f"{image.topic}: depth is nothing to learn words from; name the camera's topic")
    if image.pixels.ndim == 2:
        return np.asarray(image.pixels, np.uint8)
    weights = np.array([0.299, 0.587, 0.114])
    pixels = image.pixels if image.encoding == "rgb8" else image.pixels[..., ::-1]
    return np.rint(pixels @ weights).astype(np.uint8)


def _stride(count: int, most: int) -> int:
    return max(1, -(-count // most))


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
