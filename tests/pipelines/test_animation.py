# SPDX-License-Identifier: MIT
"""A closed loop as a film."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from scripted_loop import play

from slamcli.errors import ProcessError
from slamcli.pipelines import animation
from slamcli.pipelines.animation import Animation

MOUNT = np.array([0.1, 0.0, 0.0])


def film(path, seconds=3.0):
    listener = Animation(MOUNT)
    play([listener], seconds=seconds)
    return listener.write(path)


def test_ten_frames_a_second_and_the_same_bytes_again(tmp_path):
    assert film(tmp_path / "a.gif") == 31
    film(tmp_path / "b.gif")
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    with Image.open(tmp_path / "a.gif") as read:
        assert read.n_frames == 31
        assert max(read.size) <= 720
        read.seek(25)
        colours = {tuple(c) for _, c in read.convert("RGB").getcolors(1 << 20)}
    assert {(0, 158, 115), (0, 114, 178), (213, 94, 0), (230, 159, 0)} <= colours  # way, plan, scan, people


def test_a_long_run_shows_fewer_moments(tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "_MOST_FRAMES", 12)
    assert 7 <= film(tmp_path / "a.gif") <= 12


def test_nothing_is_no_film(tmp_path):
    with pytest.raises(ProcessError, match="nothing happened that could be shown"):
        Animation(MOUNT).write(tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


def test_without_a_map_the_way_alone_is_shown(tmp_path):
    listener = Animation(MOUNT)
    for i in range(5):
        listener.on_truth(i * 0.1, np.array([0.1 * i, 0.0, 0.0]), np.zeros(3))
    assert listener.write(tmp_path / "a.gif") == 5
