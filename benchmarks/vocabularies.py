# SPDX-License-Identifier: MIT
"""Times of a vocabulary of ORBvoc.txt's size: parsed, loaded from the cache, and used.

    python benchmarks/vocabularies.py [ORBvoc.txt]

Without a file, a text of 10 branches and 6 levels with made-up descriptors is written to a temporary folder.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from slamcli.formats.vocabularies import read_vocabulary
from slamcli.runtime import peak_memory_bytes
from slamcli.vision.vocabulary import warm

LEVELS, BRANCHES = 6, 10


def write_text(path: Path) -> None:
    generator = np.random.default_rng(0)
    with path.open("wb") as stream:
        stream.write(f"{BRANCHES} {LEVELS} 0 0\n".encode())
        for level in range(1, LEVELS + 1):
            count, above = BRANCHES**level, (BRANCHES ** (level - 1) - 1) // (BRANCHES - 1)
            leaf = int(level == LEVELS)
            for begin in range(0, count, 100_000):
                rows = np.arange(begin, min(begin + 100_000, count))
                bytes_ = generator.integers(0, 256, (len(rows), 32))
                stream.writelines(
                    f"{above + row // BRANCHES} {leaf} {' '.join(map(str, values))}  {3.25 * leaf:g}\n".encode()
                    for row, values in zip(rows.tolist(), bytes_.tolist(), strict=True)
                )


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "ORBvoc.txt"
        if not path.exists():
            write_text(path)
        print(f"{path.name}: {path.stat().st_size / 1e6:.0f} MB")
        for what in ("parsed", "loaded", "loaded"):
            start = time.perf_counter()
            tree = read_vocabulary(path, cache=Path(folder) / "cache")
            print(f"{what} in {time.perf_counter() - start:.2f} s: {len(tree.levels)} nodes, {tree.num_words} words")
        warm()
        descriptors = np.random.default_rng(1).integers(0, 256, (20, 1000, 32), np.uint8)
        start = time.perf_counter()
        for image in descriptors:
            tree.words(image)
        print(f"words of 1,000 descriptors: {1e3 * (time.perf_counter() - start) / len(descriptors):.2f} ms")
        print(f"peak memory {peak_memory_bytes() / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
