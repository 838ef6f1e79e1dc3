# SPDX-License-Identifier: MIT
"""Frames of palette indices to a GIF, or to an MP4 by ffmpeg."""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DependencyError, ProcessError, UsageError
from slamcli.outputs import atomic_path
from slamcli.reports.film_painter import TRANSPARENT, palette

Pixels = NDArray[np.uint8]
SUFFIXES = (".gif", ".mp4")
_LAST_CS = 200
"""How long a GIF shows its last frame, hundredths of a second."""


def check_film(target: Path) -> None:
    """Refuse what cannot be written, before any work is done.

    Raises
    ------
    UsageError
        If the suffix is no film's.
    DependencyError
        If an MP4 is wanted and there is no ffmpeg.
    """
    if target.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{target}: an animation is a .gif or an .mp4")
    if target.suffix.lower() == ".mp4":
        _ffmpeg(target)


def write_film(target: Path, frames: Iterable[Pixels], *, frame_s: float) -> None:
    """Write frames uint8 (H, W), indices of `film_painter.palette` and all of one size, as the suffix says.

    The same frames give the same GIF, byte by byte.

    Raises
    ------
    UsageError, DependencyError
        As `check_film`.
    ProcessError
        If ffmpeg fails; the message has what it said.
    """
    check_film(target)
    with atomic_path(target) as temporary:
        if target.suffix.lower() == ".mp4":
            _write_mp4(temporary, target, frames, frame_s)
        else:
            with temporary.open("wb") as stream:
                _write_gif(stream, frames, frame_s)


def _write_gif(stream: IO[bytes], frames: Iterable[Pixels], frame_s: float) -> None:
    """Write a GIF that repeats for ever; of each frame only the box that differs from the one before."""
    delay = max(2, round(frame_s * 100))
    last: Pixels | None = None
    for frame, is_last in _marked(frames):
        if last is None:
            stream.write(b"GIF89a" + struct.pack("<HHBBB", frame.shape[1], frame.shape[0], 0xF7, 0, 0))
            stream.write(palette().tobytes())
            stream.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")
            box, part = (0, 0), frame
        else:
            box, part = _change(last, frame)
        stream.write(struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0x05, _LAST_CS if is_last else delay, TRANSPARENT, 0))
        stream.write(struct.pack("<BHHHHB", 0x2C, box[0], box[1], part.shape[1], part.shape[0], 0))
        stream.write(_lzw(part))
        last = frame
    stream.write(b"\x3b")


def _marked(frames: Iterable[Pixels]) -> Iterator[tuple[Pixels, bool]]:
    """Yield frames with whether they are the last."""
    waiting: Pixels | None = None
    for frame in frames:
        if waiting is not None:
            yield waiting, False
        waiting = frame
    if waiting is not None:
        yield waiting, True


def _change(last: Pixels, frame: Pixels) -> tuple[tuple[int, int], Pixels]:
    """Return left and top of the box of what changed, and its pixels, transparent where they did not."""
    differs = frame != last
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if not len(rows):
        return (0, 0), np.full((1, 1), TRANSPARENT, dtype=np.uint8)
    box = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
    return (box[1].start, box[0].start), np.where(differs[box], frame[box], np.uint8(TRANSPARENT))


def _lzw(part: Pixels) -> bytes:
    """Return a frame's pixels as GIF holds them: the size of its codes, and blocks of LZW."""
    from PIL import Image

    # Pillow's own encoder, asked for one frame: whole GIFs it writes by comparing frames in full colour, which takes long.
    return b"\x08" + Image.fromarray(np.ascontiguousarray(part)).tobytes("gif", "L", 8, 0) + b"\x00"


def _ffmpeg(target: Path) -> str:
    """Return the path of ffmpeg: the system's, or the one that imageio-ffmpeg carries."""
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    if find_spec("imageio_ffmpeg") is not None:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    raise DependencyError(
        f"{target}: an .mp4 needs ffmpeg (apt install ffmpeg, or pip install imageio-ffmpeg); a .gif needs nothing"
    )


def _write_mp4(temporary: Path, target: Path, frames: Iterable[Pixels], frame_s: float) -> None:
    colours = palette()
    process: subprocess.Popen[bytes] | None = None
    try:
        for frame in frames:
            even = np.pad(frame, [(0, n % 2) for n in frame.shape], mode="edge")  # H.264 wants even sizes
            if process is None:
                process = _started(_ffmpeg(target), temporary, even.shape, frame_s)
            if process.stdin is not None:
                process.stdin.write(colours[even].tobytes())
    except BrokenPipeError:
        pass  # ffmpeg has given up: its words follow
    if process is None:
        raise ProcessError(f"{target}: there is no frame to write")
    said = process.communicate()[1].decode(errors="replace").strip().splitlines()
    if process.returncode:
        raise ProcessError(f"{target}: ffmpeg failed: {said[-1] if said else process.returncode}")


def _started(ffmpeg: str, temporary: Path, shape: tuple[int, ...], frame_s: float) -> subprocess.Popen[bytes]:
    size = f"{shape[1]}x{shape[0]}"
    command = [
        ffmpeg, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{1 / frame_s:g}", "-i", "-",
        "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-movflags", "+faststart", "-fflags", "+bitexact", str(temporary),
    ]  # fmt: skip
    return subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
