# SPDX-License-Identifier: MIT
"""What is imported when: nothing heavy for help, nothing that a missing library would break."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = ("numba", "cv2", "gtsam", "open3d", "scipy", "matplotlib", "rosbags", "mcap", "PIL")


def run_python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_imports_without_the_libraries_that_few_commands_need():
    # open3d does not load without libusb; gtsam and lupa are for tiers to come.
    code = """
import importlib, pkgutil, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("open3d", "gtsam", "lupa"):
            raise ImportError(f"{name} is not installed")
sys.meta_path.insert(0, Missing())
import slamcli
names = [m.name for m in pkgutil.walk_packages(slamcli.__path__, "slamcli.") if not m.name.endswith("__main__")]
for name in names:
    importlib.import_module(name)
print(len(names))
"""
    assert int(run_python(code)) > 60


def test_nothing_loads_open3d_or_gtsam():
    code = f"""
import importlib, pkgutil, sys, json, slamcli
for m in pkgutil.walk_packages(slamcli.__path__, "slamcli."):
    if not m.name.endswith("__main__"):
        importlib.import_module(m.name)
print(json.dumps(sorted(set({HEAVY!r}) & set(sys.modules))))
"""
    loaded = set(json.loads(run_python(code)))
    assert not loaded & {"open3d", "gtsam"}


@pytest.mark.parametrize(
    "module", ["slamcli", "slamcli.cli.main", "slamcli.errors", "slamcli.outputs", "slamcli.runtime"]
)
def test_light_modules_stay_light(module):
    code = f"import sys, {module}; print([n for n in {(*HEAVY, 'numpy')!r} if n in sys.modules])"
    assert run_python(code).strip() == "[]"
