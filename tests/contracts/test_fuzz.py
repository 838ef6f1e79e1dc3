# SPDX-License-Identifier: MIT
"""A short fuzz run; benchmarks/fuzz.py makes long ones."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_mutated_input_is_never_more_than_one_line(tmp_path):
    script = ROOT / "benchmarks" / "fuzz.py"
    command = [sys.executable, str(script), "--cases", "240", "--seed", "20", "--jobs", "1", "--keep", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "240 cases, 0 failures" in done.stdout
