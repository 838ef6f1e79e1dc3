# SPDX-License-Identifier: MIT
"""Valid vocabularies and atlases for the fuzzer."""

from __future__ import annotations

import gzip
import io
import tarfile
from pathlib import Path

import numpy as np

from slamcli.formats.atlas_files import write_atlas
from slamcli.formats.vocabularies import write_vocabulary
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.visual_atlas import COLUMNS, VisualAtlas, VisualMap
from slamcli.vision.vocabulary import Vocabulary, vocabulary

_PARENTS = (0, 0, 1, 1, 2, 2)


def write_vocabularies(folder: Path) -> list[Path]:
    """Write the same small tree in every format."""
    generator = np.random.default_rng(0)
    tree = vocabulary(
        branching=2, depth=2, weighting="tf-idf", descriptors=generator.integers(0, 256, (7, 32), np.uint8),
        num_children=np.array([2, 2, 2, 0, 0, 0, 0]), weights=np.array([0, 0, 0, 1.5, 2.0, 0.5, 0.25]),
    )  # fmt: skip
    text = _text(tree)
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        entry = tarfile.TarInfo("ORBvoc.txt")
        entry.size = len(text)
        archive.addfile(entry, io.BytesIO(text))
    contents = {"ORBvoc.txt": text, "ORBvoc.txt.tar.gz": stream.getvalue(), "voc.yml": _yaml(tree), "voc.yml.gz": gzip.compress(_yaml(tree))}  # fmt: skip
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    write_vocabulary(tree, folder / "voc.npz")
    return [folder / name for name in (*contents, "voc.npz")]


def _bytes(tree: Vocabulary, node: int) -> str:
    return " ".join(map(str, tree.descriptors[node].tolist()))


def _text(tree: Vocabulary) -> bytes:
    lines = [f"{parent} {int(node > 2)} {_bytes(tree, node)}  {tree.weights[node]:g}" for node, parent in enumerate(_PARENTS, 1)]  # fmt: skip
    return ("\n".join(["2 2 0 0", *lines]) + "\n").encode()


def _yaml(tree: Vocabulary) -> bytes:
    head = "%YAML:1.0\nvocabulary:\n   k: 2\n   L: 2\n   scoringType: 0\n   weightingType: 0\n   nodes:\n"
    nodes = "".join(
        f'      - {{ nodeId:{node}, parentId:{parent}, weight:{tree.weights[node]:g},\n          descriptor:"0 32 {_bytes(tree, node)} " }}\n'
        for node, parent in enumerate(_PARENTS, 1)
    )
    words = "".join(f"      - {{ wordId:{word}, nodeId:{word + 3} }}\n" for word in range(4))
    return f"{head}{nodes}   words:\n{words}".encode()


def write_small_atlas(folder: Path) -> Path:
    """Write an atlas of one map of three keyframes."""
    generator = np.random.default_rng(0)
    rows = {"keyframes": 3, "features": 12, "points": 6, "edges": 1}
    columns = {
        name: (generator.random((rows[kind], *shape)) if dtype == "float64" else np.zeros((rows[kind], *shape))).astype(dtype)
        for name, (kind, shape, dtype) in COLUMNS.items()
    }  # fmt: skip
    columns |= {"counts": np.full(3, 4), "parent": np.arange(3) - 1, "seen": generator.integers(-1, 6, 12)}
    camera = Pinhole(fx=251.1, fy=251.1, cx=159.5, cy=119.5, width=320, height=240, baseline_m=0.08)
    write_atlas(
        VisualAtlas(camera=camera, scales=1.2 ** np.arange(8.0), maps=(VisualMap(columns=columns),)),
        folder / "atlas.npz",
    )
    return folder / "atlas.npz"
