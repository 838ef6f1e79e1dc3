# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import slamcli
from slamcli.cli import kernel_cache
from slamcli.cli.main import run
from slamcli.cli.warmup import ROOMS


def test_warmup_compiles_every_room_and_says_how_long_it_took(capsys):
    assert run(["warmup", "--json"]) == 0
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert list(document["seconds"]) == list(ROOMS)
    assert document["total_s"] == pytest.approx(sum(document["seconds"].values()))
    assert "all kernels are compiled" in captured.err
    assert kernel_cache.is_filled("simulation")
    assert not kernel_cache.is_filled("nowhere")


@pytest.fixture
def read_only_package(tmp_path):
    """A copy of the package whose folders cannot hold a cache (a file stands where it would be; root may write anywhere)."""
    copy = tmp_path / "site" / "slamcli"
    shutil.copytree(Path(slamcli.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").write_text("")
    return copy.parent


WARM = "from slamcli.cli import kernel_cache; kernel_cache.prepare(); import slamcli.simulation.raycast as r; r.warm(); print(kernel_cache.directory())"


def compiled(site: Path, home: Path, temporary: Path) -> tuple[str, list[str]]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "XDG", "COV"))}
    environment |= {
        "PYTHONPATH": str(site),
        "HOME": str(home),
        "TMPDIR": str(temporary),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", WARM], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    directory = Path(done.stdout.strip())
    return str(directory), sorted(path.name for path in directory.rglob("*.nbi"))


def test_kernels_are_cached_in_the_users_folder_where_the_package_cannot_be_written(tmp_path, read_only_package):
    home = tmp_path / "home"
    home.mkdir()
    directory, files = compiled(read_only_package, home, tmp_path)
    assert directory == str(home / ".cache" / "numba")
    assert files


def test_kernels_are_cached_in_a_private_folder_where_there_is_no_home_either(tmp_path, read_only_package):
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    (tmp_path / "file").write_text("")
    directory, files = compiled(read_only_package, tmp_path / "file" / "home", temporary)
    assert directory == str(temporary / f"slamcli-kernels-{os.getuid()}")
    assert Path(directory).stat().st_mode & 0o777 == 0o700
    assert files


def test_a_folder_of_somebody_else_is_not_trusted(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / f"slamcli-kernels-{os.getuid()}").mkdir(mode=0o777)
    (tmp_path / f"slamcli-kernels-{os.getuid()}").chmod(0o777)
    chosen = kernel_cache._private_temporary_folder()
    assert chosen != tmp_path / f"slamcli-kernels-{os.getuid()}"
    assert chosen.stat().st_mode & 0o777 == 0o700


def run_with_cache(given: Path, temporary: Path, *, warm: bool) -> Path:
    """Prepare the cache in a process that can write neither to the package nor to `given`; return the folder that it takes."""
    code = (
        "import sys; from pathlib import Path; from slamcli.cli import kernel_cache as k; "
        "k._can_write = lambda folder: False; k.prepare(); "
        + ("import slamcli.simulation.raycast as r; r.warm(); " if warm else "")
        + "print(k.directory())"
    )
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "XDG", "COV"))}
    environment |= {"NUMBA_CACHE_DIR": str(given), "TMPDIR": str(temporary)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300, check=True
    )
    return Path(done.stdout.strip())


def test_what_a_read_only_cache_holds_is_linked_and_not_compiled_again(tmp_path):
    image, temporary, other = tmp_path / "image", tmp_path / "tmp", tmp_path / "other"
    for folder in (image, temporary, other):
        folder.mkdir()
    filled = run_with_cache(image, other, warm=True)  # it is empty: all is compiled into the private folder
    shutil.copytree(filled, image, dirs_exist_ok=True)
    linked = run_with_cache(image, temporary, warm=True)
    kernels = sorted(path.relative_to(image) for path in image.rglob("*.nb?"))
    assert len(kernels) >= 2
    assert linked == temporary / f"slamcli-kernels-{os.getuid()}"
    assert sorted(path.relative_to(linked) for path in linked.rglob("*.nb?")) == kernels
    assert all((linked / name).is_symlink() for name in kernels)


def test_links_leave_alone_what_is_there(tmp_path):
    image, folder = tmp_path / "image" / "room_1", tmp_path / "tmp" / "room_1"
    for made in (image, folder):
        made.mkdir(parents=True)
    for name in ("a.nbi", "b.1.nbc", "c.txt"):
        (image / name).write_text("image")
    (folder / "a.nbi").write_text("own")
    for _ in range(2):
        kernel_cache._link_kernels(tmp_path / "image", tmp_path / "tmp")
    assert {path.name: path.read_text() for path in folder.iterdir()} == {"a.nbi": "own", "b.1.nbc": "image"}


def test_without_a_temporary_folder_the_users_files_are_left_alone(tmp_path, monkeypatch):
    memory = tmp_path / "shm"
    memory.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "_SHARED_MEMORY", memory)
    assert kernel_cache._private_temporary_folder() == memory / f"slamcli-kernels-{os.getuid()}"
