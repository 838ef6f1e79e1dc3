# SPDX-License-Identifier: MIT
"""The tutorials work as they stand: every command runs, in order, in an empty folder, and prints what the page shows."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tutorial_page import missing, steps

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


@pytest.fixture
def environment(tmp_path):
    """An environment in which `slamcli` and `python` are those of this test."""
    programs = tmp_path / "programs"
    programs.mkdir()
    for name, options in (("slamcli", "-m slamcli"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {options} "$@"\n')
        (programs / name).chmod(0o755)
    return os.environ | {"PATH": f"{programs}:{os.environ['PATH']}"}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_tutorial_works(page, tmp_path, environment):
    folder = tmp_path / "work"
    folder.mkdir()
    found = steps(page)
    assert len(found) >= 4
    for step in found:
        where = f"{page.name}:{step.line}"
        program = ["bash", "-eu", "-o", "pipefail"] if step.language == "sh" else ["python", "-"]
        run = subprocess.run(
            program, input=step.code, cwd=folder, env=environment, text=True, timeout=900,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
        )  # fmt: skip
        assert run.returncode == 0, f"{where}: exit code {run.returncode}\n{run.stdout}"
        assert missing(step.shown, run.stdout) is None, f"{where}: not printed as shown\n{run.stdout}"


def test_every_tutorial_is_run():
    assert [page.name[:2] for page in PAGES] == ["01", "02", "03", "04"]


def test_blocks_are_found_with_what_they_print(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "1. One:\n\n   ```sh\n   echo a\n   ```\n\n   ```text\n   a\n   …\n   ```\n\n```console\nno\n```\n\n```python\nx\n```\n"
    )
    found = steps(page)
    assert [(s.language, s.code, s.line, s.shown) for s in found] == [
        ("sh", "echo a\n", 3, ("a",)),
        ("python", "x\n", 16, ()),
    ]


@pytest.mark.parametrize(
    ("shown", "printed", "right"),
    [
        (("ATE 0.0053 m",), "first\nATE   0.0060  m  \nlast", True),
        (("ATE 0.0053 m",), "ATE 0.0080 m", False),
        (("ATE 0.0053 m",), "RTE 0.0053 m", False),
        (("0 collisions",), "1 collisions", False),
        (("10 of 12 … -3.0 s",), "11 of 12 (late), -2.9 s", True),
        (("a 8.90 … 0.34 …",), "a 8.90   0.99   0.34   0", True),
        (("a 8.90 … 0.34 …",), "a 8.90   0.99   0.44   0", False),
        (("a 1", "b 2"), "b 2\na 1", False),
        (("succeeded … 0.99",), " succeeded   14.8   5.18   1.01", True),
        (("n500 …",), "n1000 x", False),
    ],
)  # fmt: skip
def test_what_is_shown_is_found(shown, printed, right):
    assert (missing(shown, printed) is None) is right
