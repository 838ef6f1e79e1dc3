# SPDX-License-Identifier: MIT
"""``slamcli vocabulary``: from pictures and recordings to a file, and what is in one."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.vocabularies import read_vocabulary


def picture(seed, height=160, width=200):
    generator = np.random.default_rng(seed)
    coarse = generator.integers(0, 256, (height // 8, width // 8), np.uint8)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / "pictures"
    (folder / "more").mkdir(parents=True)
    for i in range(3):
        cv2.imwrite(str(folder / f"{i}.png"), picture(i))
    cv2.imwrite(str(folder / "more" / "colour.jpg"), cv2.merge([picture(5), picture(6), picture(7)]))
    (folder / "notes.txt").write_text("not a picture")
    return folder


def test_training_from_pictures_writes_a_vocabulary_and_its_record(pictures, tmp_path, capsys):
    target = tmp_path / "own.npz"
    command = ["vocabulary", "train", str(pictures), "-o", str(target), "--branching", "5", "--levels", "2", "--features", "120"]  # fmt: skip
    assert run([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["images"] == 4
    assert document["features"] == 480
    assert document["words"] == 25
    tree = read_vocabulary(target)
    assert (tree.branching, tree.depth, tree.num_words) == (5, 2, 25)
    record = json.loads((tmp_path / "own.npz.run.json").read_text())
    assert record["summary"]["words"] == 25
    assert record["parameters"]["branching"] == 5
    assert len(record["inputs"]) == 5
    first = target.read_bytes()
    assert run([*command, "-q"]) == 0
    assert target.read_bytes() == first
    assert run([*command, "-q", "--seed", "4"]) == 0
    assert target.read_bytes() != first


def test_at_most_so_many_images_of_a_source(pictures, tmp_path, capsys):
    assert run(["vocabulary", "train", str(pictures), str(pictures / "1.png"), "-o", str(tmp_path / "x.npz"), "--max-images", "2", "--json"]) == 0  # fmt: skip
    assert json.loads(capsys.readouterr().out)["images"] == 3


def test_info_says_what_is_in_a_file(pictures, tmp_path, capsys):
    target = tmp_path / "own.npz"
    run(["vocabulary", "train", str(pictures), "-o", str(target), "-q", "--levels", "2", "--features", "60"])
    capsys.readouterr()
    assert run(["vocabulary", "info", str(target), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["words"] <= 100
    assert document["levels"] == 2
    assert document["weighting"] == "tf-idf"
    assert document["weights"][1] == pytest.approx(np.log(4))
    assert run(["vocabulary", "info", str(target)]) == 0
    assert "10 branches, 2 levels" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["info", "{nowhere}"], "cannot be read"),
        (["info", "{notes}"], "no vocabulary"),
        (["train", "{notes}", "-o", "{out}"], "notes.txt"),
        (["train", "{empty}", "-o", "{out}"], "neither a recording nor a folder with pictures"),
        (["train", "{black}", "-o", "{out}"], "fewer than two differ"),
        (["train", "{one}", "-o", "{out}"], "every word occurs in every image"),
        (["train", "{damaged}", "-o", "{out}"], "no picture"),
        (["train", "{pictures}", "-o", "{pictures}"], "is a folder"),
        (["train", "{pictures}", "-o", "{out}", "--levels", "0"], "--levels"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(pictures, tmp_path, capsys, arguments, message):
    (tmp_path / "empty").mkdir()
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((100, 100), np.uint8))
    (tmp_path / "damaged.png").write_bytes((pictures / "0.png").read_bytes()[:20])
    places = {
        "nowhere": tmp_path / "nowhere.txt", "notes": pictures / "notes.txt", "out": tmp_path / "out.npz",
        "empty": tmp_path / "empty", "black": tmp_path / "black.png", "damaged": tmp_path / "damaged.png", "pictures": pictures, "one": pictures / "0.png",
    }  # fmt: skip
    assert run(["vocabulary", *(argument.format(**places) for argument in arguments)]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out.npz").exists()
