# SPDX-License-Identifier: MIT
"""Films: what a GIF's reader sees is what was painted."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

from slamcli.errors import DependencyError, ProcessError, UsageError
from slamcli.reports import film
from slamcli.reports.film import check_film, write_film
from slamcli.reports.film_painter import palette


def frames(count=4, shape=(31, 47)):
    rng = np.random.default_rng(5)
    first = rng.integers(0, 52, shape).astype(np.uint8)
    made = [first]
    for i in range(1, count):
        after = made[-1].copy()
        after[2 + i : 9, 5 : 9 + i] = rng.integers(0, 52, (7 - i, 4 + i))
        made.append(after)
    made.insert(2, made[1].copy())  # nothing happens
    return made


def test_a_gif_shows_every_frame_exactly(tmp_path):
    painted = frames()
    write_film(tmp_path / "f.gif", painted, frame_s=0.1)
    with Image.open(tmp_path / "f.gif") as read:
        assert read.n_frames == len(painted)
        assert read.info["loop"] == 0
        for i, frame in enumerate(painted):
            read.seek(i)
            np.testing.assert_array_equal(np.asarray(read.convert("RGB")), palette()[frame])
            assert read.info["duration"] == (2000 if i == len(painted) - 1 else 100)


def test_the_same_frames_give_the_same_bytes(tmp_path):
    for name in ("a.gif", "b.gif"):
        write_film(tmp_path / name, frames(), frame_s=0.1)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_large_noisy_frame_survives_the_packing(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (300, 400)).astype(np.uint8)
    write_film(tmp_path / "n.gif", [noise], frame_s=0.1)
    with Image.open(tmp_path / "n.gif") as read:
        np.testing.assert_array_equal(np.asarray(read.convert("RGB")), palette()[noise])


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"run\.webm: an animation is a \.gif or an \.mp4"):
        check_film(tmp_path / "run.webm")


def test_an_mp4_without_ffmpeg_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(film.shutil, "which", lambda _: None)
    monkeypatch.setattr(film, "find_spec", lambda _: None)
    with pytest.raises(
        DependencyError, match=r"apt install ffmpeg, or pip install imageio-ffmpeg.*a \.gif needs nothing"
    ):
        write_film(tmp_path / "run.mp4", frames(), frame_s=0.1)
    assert not list(tmp_path.iterdir())


def _stand_in(tmp_path, body):
    """Return a program in ffmpeg's place: it is called as ffmpeg would be."""
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!{sys.executable}\nimport sys\ndata = sys.stdin.buffer.read()\n{body}\n")
    program.chmod(0o755)
    return str(program)


def test_ffmpeg_gets_frames_of_even_size_in_colour(tmp_path, monkeypatch):
    monkeypatch.setattr(film.shutil, "which", lambda _: _stand_in(tmp_path, "open(sys.argv[-1], 'wb').write(data)"))
    painted = frames()
    write_film(tmp_path / "run.mp4", painted, frame_s=0.1)
    raw = np.frombuffer((tmp_path / "run.mp4").read_bytes(), dtype=np.uint8).reshape(len(painted), 32, 48, 3)
    np.testing.assert_array_equal(raw[:, :31, :47], palette()[np.stack(painted)])


def test_what_ffmpeg_complains_of_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(film.shutil, "which", lambda _: _stand_in(tmp_path, "sys.exit('Unknown encoder libx264')"))
    with pytest.raises(ProcessError, match=r"run\.mp4: ffmpeg failed: Unknown encoder libx264"):
        write_film(tmp_path / "run.mp4", frames(), frame_s=0.1)
    assert not (tmp_path / "run.mp4").exists()
