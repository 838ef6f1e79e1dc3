# SPDX-License-Identifier: MIT
"""The lines of Python in docs/navigate.md do what they say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from slamcli.formats.maps import write_map
from slamcli.grids import OccupancyGrid

PAGE = Path(__file__).resolve().parents[2] / "docs" / "navigate.md"


def test_ten_lines_of_python_drive_a_robot(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    cells = np.zeros((80, 120), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05, (-3.0, -2.0, 0.0)))
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {})  # noqa: S102 - our own page
    said = capsys.readouterr().out
    assert said.count("succeeded goal reached") == 2
