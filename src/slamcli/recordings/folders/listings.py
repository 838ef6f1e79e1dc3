# SPDX-License-Identifier: MIT
"""Which images a folder holds and when they were taken: by list files, or by the names of the files themselves."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats import text_tables
from slamcli.recordings.adapters.compressed_image import image_size
from slamcli.recordings.containers.damage import Damage

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
FIRST_STAMP_NS = 1
"""Stands for time 0, which means "unset" in ROS's messages."""
_HEAD_BYTES = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageList:
    """Images that are there, in the order of their stamps."""

    stamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """int64 (N,), none of them 0."""
    paths: tuple[Path, ...] = ()
    size_bytes: int = 0

    def __len__(self) -> int:
        return len(self.paths)

    def size(self) -> tuple[int, int]:
        """Return width and height of the first image whose head can be read, (0, 0) if there is none."""
        for path in self.paths[:20]:
            try:
                with path.open("rb") as stream:
                    size = image_size(stream.read(_HEAD_BYTES))
            except OSError:
                continue
            if size[0] * size[1]:
                return size
        return 0, 0


def listed_images(list_file: Path, root: Path, damage: Damage, *, unit: str | None = None) -> ImageList:
    """Return the images that a list file names (a stamp and a file name on a line), those that are there.

    Lines that cannot be understood and images that are missing are left out and told with their number.

    Parameters
    ----------
    list_file
        Such as TUM's ``rgb.txt`` or EuRoC's ``data.csv``.
    root
        Folder that the names are relative to.
    unit
        Unit of the stamps; None finds it from their size.
    """
    stamps, names, wrong = _read_list(list_file, unit)
    if wrong:
        damage.add(f"{list_file}: {len(wrong)} lines cannot be understood and are left out (first: {wrong[0]})")
    if not names:
        damage.add(f"{list_file}: names no images")
        return ImageList()
    return existing_images(stamps, [root / name for name in names], str(list_file), damage)


def lists_images(list_file: Path) -> bool:
    """Return whether a file is a list of images by its first lines (a stamp, then a file name), or a list of none."""
    if not list_file.is_file():
        return False
    try:
        rows = list(itertools.islice(text_tables.read_rows(list_file, "a list of images"), 20))
    except FormatError:
        return True  # which will be told where it is read
    return not rows or any(len(row.fields) > 1 and row.fields[1].lower().endswith(IMAGE_SUFFIXES) for row in rows)


def existing_images(stamps_ns: Sequence[int], paths: Sequence[Path], source: str, damage: Damage) -> ImageList:
    """Return those of the images that are there, sorted by stamp; the others are told."""
    there: dict[Path, dict[str, int]] = {}
    kept: list[tuple[int, Path, int]] = []
    missing: list[Path] = []
    empty: list[Path] = []
    for stamp_ns, path in zip(stamps_ns, paths, strict=True):
        folder = path.parent
        if folder not in there:
            there[folder] = file_sizes(folder)
        size = there[folder].get(path.name)
        if size is None:
            missing.append(path)
        elif size == 0:
            empty.append(path)
        else:
            kept.append((stamp_ns or FIRST_STAMP_NS, path, size))
    if missing:
        damage.add(f"{source}: {len(missing)} of {len(paths)} images that it names are missing (first: {missing[0]})")
    if empty:
        damage.add(f"{source}: {len(empty)} of {len(paths)} images are empty files (first: {empty[0]})")
    backward = sum(b[0] < a[0] for a, b in itertools.pairwise(kept))
    if backward:
        damage.add(f"{source}: {backward} of {len(kept)} stamps run backwards; the images are taken in their order")
        kept.sort(key=lambda image: image[0])
    return ImageList(
        stamps_ns=np.array([stamp for stamp, _, _ in kept], dtype=np.int64),
        paths=tuple(path for _, path, _ in kept),
        size_bytes=sum(size for _, _, size in kept),
    )


def numbered_images(folder: Path, pattern: str = r"(\d+)") -> list[tuple[int, Path]]:
    """Return (number, path) of images whose name without suffix is `pattern`, whose first group is the number; sorted."""
    matcher = re.compile(pattern)
    found = []
    for name in file_sizes(folder):
        stem, dot, suffix = name.rpartition(".")
        match = matcher.fullmatch(stem) if dot and f".{suffix.lower()}" in IMAGE_SUFFIXES else None
        if match:
            found.append((int(match[1]), folder / name))
    return sorted(found)


def stamped_images(folder: Path, damage: Damage) -> ImageList:
    """Return the images of a folder whose names are their stamps: ``1341841278.8427.png``, ``1403715273262142976.png``."""
    named = []
    for name in sorted(file_sizes(folder)):
        stem, dot, suffix = name.rpartition(".")
        if dot and f".{suffix.lower()}" in IMAGE_SUFFIXES and re.fullmatch(r"\d{1,19}(\.\d+)?", stem):
            named.append((stem, folder / name))
    if not named:
        return ImageList()
    texts = [stem for stem, _ in named]
    unit = text_tables.find_time_unit(texts, folder)
    stamps = text_tables.parse_stamps_ns(texts, range(len(texts)), folder, unit)
    order = sorted(range(len(named)), key=lambda number: stamps[number])
    return existing_images([stamps[i] for i in order], [named[i][1] for i in order], str(folder), damage)


def has_stamped_images(folder: Path) -> bool:
    """Return whether images in a folder are named by times since 1970 or with a fraction, not just by numbers."""
    return any(
        re.fullmatch(r"\d{10,19}|\d{1,10}\.\d+", name.rpartition(".")[0]) is not None
        and f".{name.rpartition('.')[2].lower()}" in IMAGE_SUFFIXES
        for name in file_sizes(folder)
    )


def file_sizes(folder: Path) -> dict[str, int]:
    """Return the size of each file in a folder by its name; empty for a folder that cannot be read."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name: entry.stat().st_size for entry in entries if entry.is_file()}
    except OSError:
        return {}


def text_size(*paths: Path) -> int:
    """Return the bytes of those files that exist."""
    return sum(path.stat().st_size for path in paths if path.is_file())


def _read_list(path: Path, unit: str | None) -> tuple[list[int], list[str], list[str]]:
    """Return stamps, file names, and what is wrong with lines."""
    rows, wrong = [], []
    try:
        for row in text_tables.read_rows(path, "a list of images"):
            if len(row.fields) >= 2:
                rows.append(row)
            else:
                wrong.append(f"line {row.line}: {len(row.fields)} fields, not a stamp and a file name")
    except FormatError as error:
        wrong.append(str(error))
    unit = unit or text_tables.find_time_unit([row.fields[0] for row in rows], path)
    stamps, names = [], []
    for row in rows:
        try:
            stamps += text_tables.parse_stamps_ns([row.fields[0]], [row.line], path, unit)
        except FormatError as error:
            wrong.append(str(error).removeprefix(f"{path}, "))
            continue
        # Lists that were written on Windows, or copied out of an archive, name files that way.
        names.append(row.fields[1].replace("\\", "/"))
    return stamps, names, wrong
