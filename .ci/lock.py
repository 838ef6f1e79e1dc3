# SPDX-License-Identifier: MIT
"""Write requirements.lock: what pip resolves for pyproject.toml, its dev extra and its build, on the oldest Python.

Run it with Python 3.11: newer Pythons may resolve to versions that 3.11 cannot use. With --keep, what is pinned stays
as it is, and only what is new is added.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEAD = """\
# Every package that slamcli, its tests and its build need, pinned; wheels exist for Python 3.11, 3.12 and 3.13.
# `make lock` writes it anew from pyproject.toml.
"""
# What only newer Pythons need: numba's and open3d's dependencies ask for it there.
NEWER = {"setuptools": 'python_version >= "3.12"'}


def main() -> None:
    if sys.version_info[:2] != (3, 11):
        sys.exit("lock: run it with Python 3.11, the oldest that is supported")
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
        wanted = [f"{ROOT}[dev]", "hatchling", "editables", *NEWER]
        if "--keep" in sys.argv[1:]:
            wanted += ["--constraint", str(ROOT / "requirements.lock")]
        subprocess.run([*command, "--report", str(report), *wanted], check=True)
        found = [item["metadata"] for item in json.loads(report.read_text())["install"]]
    lines = []
    for package in found:
        name = package["name"].lower().replace("_", "-").replace(".", "-")
        if name != "slamcli":
            marker = f" ; {NEWER[name]}" if name in NEWER else ""
            lines.append(f"{name}=={package['version']}{marker}")
    (ROOT / "requirements.lock").write_text(HEAD + "\n".join(sorted(lines)) + "\n")
    print(f"requirements.lock: {len(lines)} packages")


if __name__ == "__main__":
    main()
