# SPDX-License-Identifier: MIT
"""Rules that hold for every source file; ruff, mypy and import-linter check the rest."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "slamcli"
FILES = sorted(SOURCE.rglob("*.py"))
KERNEL_FILES = [path for path in FILES if path.name == "_kernels.py" or path.name.endswith("_kernels.py")]
TESTS = [path.read_text() for path in (ROOT / "tests").rglob("*.py") if path != Path(__file__)]


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def trees(paths: list[Path]) -> Iterator[tuple[Path, ast.Module]]:
    for path in paths:
        yield path, ast.parse(path.read_text())


def decorator_names(function: ast.FunctionDef) -> list[str]:
    targets = [d.func if isinstance(d, ast.Call) else d for d in function.decorator_list]
    return [t.attr if isinstance(t, ast.Attribute) else getattr(t, "id", "") for t in targets]


def test_every_file_names_its_licence():
    everything = [*FILES, *(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py")]
    assert [name(p) for p in everything if not p.read_text().startswith("# SPDX-License-Identifier: MIT\n")] == []


def test_files_are_short():
    assert {name(p): n for p in FILES if (n := len(p.read_text().splitlines())) > 400} == {}


def test_functions_are_short():
    long = {
        f"{name(path)}:{node.name}": (node.end_lineno or 0) - node.lineno + 1
        for path, tree in trees(FILES)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and (node.end_lineno or 0) - node.lineno + 1 > 100
    }
    assert long == {}


def test_no_room_is_a_drawer():
    drawers = {"utils", "util", "common", "helpers", "core", "misc", "manager"}
    assert [name(p) for p in FILES if drawers & {part.removesuffix(".py").strip("_") for part in p.parts}] == []


def test_only_the_command_line_prints_and_exits():
    calls = [
        f"{name(path)}:{node.lineno}"
        for path, tree in trees([p for p in FILES if "cli" not in p.relative_to(SOURCE).parts[:1]])
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and (
            getattr(node.func, "id", "") in ("print", "exit", "quit", "input")
            or (
                isinstance(node.func, ast.Attribute)
                and node.func.attr in ("exit", "_exit")
                and getattr(node.func.value, "id", "") in ("sys", "os")
            )
        )
    ]
    assert calls == []


def test_compiled_code_is_in_kernel_files_and_cached():
    wrong = []
    for path, tree in trees(FILES):
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and {"njit", "jit", "vectorize", "guvectorize"} & set(
                decorator_names(node)
            ):
                text = ast.unparse(ast.Module(body=[ast.Expr(d) for d in node.decorator_list], type_ignores=[]))
                if path not in KERNEL_FILES or "cache=True" not in text:
                    wrong.append(f"{name(path)}:{node.lineno} {node.name}: {text.strip()}")
    assert wrong == []


def test_kernels_keep_ieee_arithmetic():
    assert [name(path) for path in FILES if "fastmath=True" in path.read_text()] == []


def test_kernel_files_import_only_what_a_kernel_may_use():
    allowed = {"__future__", "numpy", "numba", "math", "collections.abc", "typing", "numpy.typing"}
    wrong = []
    for path, tree in trees(KERNEL_FILES):
        for node in ast.walk(tree):
            modules = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module or "."]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            wrong.extend(f"{name(path)}: {module}" for module in modules if module not in allowed)
    assert wrong == []


@pytest.mark.parametrize("path", KERNEL_FILES, ids=name)
def test_every_kernel_file_has_a_twin_test(path):
    room = re.escape(".".join(path.parent.relative_to(SOURCE).parts))
    wrappers = [p.stem for p in path.parent.glob("*.py") if path.stem in p.read_text() and p != path]
    names = "|".join((path.stem, *wrappers))
    way_in = re.compile(rf"from slamcli\.{room}(\.({names}) import|\simport [^\n]*\b({names})\b)")
    twins = [t for t in TESTS if any(word in t for word in ("naive", "twin", "brute")) and way_in.search(t)]
    assert len(twins) >= 1, f"no test with a naive twin imports any of {names}"


@pytest.mark.parametrize("path", KERNEL_FILES, ids=name)
def test_every_kernel_file_is_compiled_by_warmup(path):
    from slamcli.cli.warmup import ROOMS

    modules = [SOURCE / f"{module.replace('.', '/')}.py" for module in ROOMS]
    wrappers = [p for p in path.parent.glob("*.py") if path.stem in p.read_text() and p != path]
    room = ".".join(path.parent.relative_to(SOURCE).parts)
    ways_in = [f"slamcli.{room}.{p.stem} import" for p in wrappers]
    assert any(module in wrappers or any(way in module.read_text() for way in ways_in) for module in modules)


def test_no_unfinished_work():
    words = ("TODO", "FIXME", "XXX", "NotImplementedError")
    assert [f"{name(p)}: {w}" for p in FILES for w in words if w in p.read_text()] == []
