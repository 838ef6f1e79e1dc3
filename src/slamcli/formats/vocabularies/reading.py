# SPDX-License-Identifier: MIT
"""Any file of a vocabulary: found out by its content, unpacked, and kept in a cache where parsing takes long."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import io
import os
import tarfile
import zlib
from pathlib import Path

from slamcli.errors import FormatError, InputError
from slamcli.formats.vocabularies.dbow2 import is_text_vocabulary, parse_text_vocabulary
from slamcli.formats.vocabularies.dbow3 import is_yaml_vocabulary, parse_yaml_vocabulary
from slamcli.formats.vocabularies.own import VERSION, is_own_vocabulary, parse_own_vocabulary, write_vocabulary
from slamcli.vision.vocabulary import Vocabulary

_CACHED_FROM = 4 << 20
"""Bytes; smaller files are read in less than half a second anyway."""
_LARGEST = 2 << 30
_SHIPPED = Path(__file__).with_name("orb.npz")


def load_vocabulary(path: str | os.PathLike[str] | None = None) -> Vocabulary:
    """Return the vocabulary in a file, or the one that slamcli brings along.

    Raises
    ------
    FormatError
        If the file cannot be read as a vocabulary.
    """
    return read_vocabulary(_SHIPPED if path is None else path)


def read_vocabulary(source: str | os.PathLike[str], *, cache: Path | None = None) -> Vocabulary:
    """Return the vocabulary in a file of any kind.

    Parameters
    ----------
    source
        ``ORBvoc.txt`` (DBoW2), DBoW3's ``.yml``, slamcli's ``.npz``; also inside ``.gz`` and ``.tar.gz``.
    cache
        Folder for what took long to parse (None: the user's cache folder): named by the content of the file and the version of the
        format, so that a changed file is parsed anew. Where nothing can be written, every run parses.

    Raises
    ------
    FormatError
        If the file cannot be read as a vocabulary.
    """
    path = Path(source)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from error
    if is_own_vocabulary(data) or len(data) < _CACHED_FROM:
        return _parsed(data, path)
    kept = (cache or _user_cache()) / f"{hashlib.sha256(data).hexdigest()[:40]}-{VERSION}.npz"
    if kept.exists():
        with contextlib.suppress(FormatError, OSError):  # a damaged one is made anew
            return parse_own_vocabulary(kept.read_bytes(), kept)
    found = _parsed(data, path)
    with contextlib.suppress(InputError, OSError):  # a cache that cannot be written is none
        write_vocabulary(found, kept, compress=False)
    return found


def _parsed(data: bytes, path: Path) -> Vocabulary:
    if data.startswith(b"\x1f\x8b"):
        data = _unzipped(data, path)
    if data[257:262] == b"ustar":
        data = _member(data, path)
    if is_own_vocabulary(data):
        return parse_own_vocabulary(data, path)
    if is_yaml_vocabulary(data):
        return parse_yaml_vocabulary(data, path)
    if is_text_vocabulary(data):
        return parse_text_vocabulary(data, path)
    raise FormatError(
        f"{path}: no vocabulary: expected DBoW2's text (ORBvoc.txt, also .tar.gz), DBoW3's .yml or slamcli's .npz"
    )


def _unzipped(data: bytes, path: Path) -> bytes:
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
            found = stream.read(_LARGEST + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"{path}: the file is cut or damaged: {error}") from error
    if len(found) > _LARGEST:
        raise FormatError(f"{path}: unpacks to more than {_LARGEST >> 30} GiB, which is no vocabulary")
    return found


def _member(data: bytes, path: Path) -> bytes:
    """Return the only file, or the first text, in an archive."""
    try:
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            files = [file for file in archive if file.isfile() and not Path(file.name).name.startswith(".")]
            files.sort(key=lambda file: not file.name.endswith((".txt", ".yml")))
            stream = archive.extractfile(files[0]) if files else None
            if stream is None:
                raise FormatError(f"{path}: there is no file in this archive")
            return stream.read()
    except (tarfile.TarError, OSError, EOFError) as error:
        raise FormatError(f"{path}: the archive is cut or damaged: {error}") from error


def _user_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(base) / "slamcli" / "vocabularies"
